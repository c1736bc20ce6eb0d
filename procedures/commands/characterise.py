"""palpate characterise."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from palpate.procedures.commands.options import (
    Choice,
    Command,
    Output,
    bench_options,
    budget_option,
    dwell_option,
    frequency_option,
)

if TYPE_CHECKING:
    from palpate.procedures.engine.unconverted import Procedure
    from palpate.procedures.lab.session import Outcome, Session


@click.command(
    cls=Command,
    epilog="Examples:\n\n  palpate characterise\n\n  palpate characterise --scene noisy_lab --drift-time '10 min'"
    "\n\n  palpate characterise --budget",
)
@click.option("--sample", default="1", show_default=True, help="Rubber sample under the probe.")
@click.option(
    "--loads", default="1.5 N:4.5 N:0.5 N", show_default=True, help="first:last:step or a list; peak to peak."
)
@dwell_option
@frequency_option
@click.option("--drift-time", default="5 min", show_default=True, help="How long one load is held to see drift.")
@bench_options
@budget_option
def characterise(
    sample: str, loads: str, dwell: str, frequency: str, drift_time: str, choice: Choice, output: Output
) -> None:
    """Find what the sensor can do (thesis 2.1), each figure with its standard uncertainty.

    Signal-to-noise ratio, force sensitivity, resolution, linearity, hysteresis, dynamic range and drift of every film,
    and the sensor's spatial resolution: loads up, loads down, then the middle one held.
    """
    from palpate.instrument.quantity import parse
    from palpate.procedures.engine.unconverted import conduct
    from palpate.procedures.measurements.characterise import procedure
    from palpate.procedures.steps.checks import parse_loads

    settings = procedure.CharacteriseSettings(
        sample, parse_loads(loads), parse(dwell, "s"), parse(frequency, "Hz"), parse(drift_time, "s")
    )
    conduct(of_characterise(), settings, choice, output)


def of_characterise() -> Procedure[Any, Any]:
    from palpate.procedures.commands.measure import tell_result
    from palpate.procedures.engine.unconverted import Procedure
    from palpate.procedures.measurements.characterise import procedure
    from palpate.procedures.measurements.characterise.characteristics import CharacteriseResult
    from palpate.procedures.measurements.characterise.report import plot_characteristics, print_characteristics

    def tell(session: Session, result: CharacteriseResult, outcome: Outcome, output: Output) -> None:
        plot = plot_characteristics(result, session.lab.bench.simulated, session.record.folder)
        points = [asdict(p) for p in result.points]
        found = {**outcome, "points": points, **result.summary(), "plot": str(plot)}
        tell_result(output, found, lambda: print_characteristics(result, outcome, plot), result.budgets)

    return Procedure(
        procedure.PROCEDURE,
        procedure.CharacteriseSettings,
        lambda settings, target: procedure.check(settings, target.design, target.force_limit, target.nodes),
        lambda session, settings, progress, _: procedure.run(
            session.lab.bench, session.lab.design, session.lab.calibration, settings, session.record, progress
        ),
        tell,
        loads=lambda settings: (settings.loads, False),
    )
