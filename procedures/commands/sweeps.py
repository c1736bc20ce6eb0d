"""The sweeps that are described by functions, as `palpate.procedures.engine.unconverted` conducts them."""

from __future__ import annotations

from dataclasses import asdict
from types import ModuleType
from typing import Any

from palpate.procedures.commands.measure import tell_result
from palpate.procedures.commands.options import Output
from palpate.procedures.engine.unconverted import Procedure
from palpate.procedures.lab.session import Outcome, Session
from palpate.procedures.showing.marks import check_some_valid


def of_position() -> Procedure[Any, Any]:
    from palpate.procedures.measurements.position import procedure as position_sweep
    from palpate.procedures.measurements.position import report

    return sweep_of(
        position_sweep, position_sweep, report, position_sweep.PositionSettings, by_hand="sets the point probe"
    )


def sweep_of(
    planned: ModuleType,
    procedure: ModuleType,
    report: ModuleType,
    settings: type[Any],
    *,
    continues: bool = False,
    by_hand: str = "",
) -> Procedure[Any, Any]:
    """`planned` checks a sweep, `procedure` runs it, `report` shows it."""

    def tell(session: Session, result: Any, outcome: Outcome, output: Output) -> None:
        plot = report.plot_sweep(result, session.lab.design, session.lab.bench.simulated, session.record.folder)
        points = [asdict(p) for p in result.points]
        found = {**outcome, "points": points, **result.summary(), "plot": str(plot)}
        budgets = getattr(result, "budgets", ())
        tell_result(output, found, lambda: report.print_sweep(result, session.lab.design, outcome, plot), budgets)
        check_some_valid(result.points)

    return Procedure(
        planned.PROCEDURE,
        settings,
        lambda settings, target: planned.check(settings, target.design, target.force_limit, target.nodes),
        lambda session, settings, progress, pause: procedure.run(
            session.lab.bench, session.lab.design, session.lab.calibration, settings, session.record, progress, pause
        ),
        tell,
        loads=lambda settings: ((settings.load,), settings.extrapolate),
        continues=continues,
        by_hand=by_hand,
    )
