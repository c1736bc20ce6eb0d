"""What every procedure on a bench is to the command line: enough to begin it, and to go on with it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from palpate.instrument.errors import EstimateError, PalpateError, RecordError
from palpate.procedures.commands.options import Choice, Output, Progress
from palpate.procedures.lab.calibrations import check_store
from palpate.procedures.lab.open import Calibrating, Session, Target, open_session
from palpate.procedures.records.resumed import PausedAgain, Resumed
from palpate.procedures.steps.pause import NOBODY, Pause

if TYPE_CHECKING:
    from palpate.instrument.uncertainty.budget import Budget
    from palpate.instrument.uncertainty.propagation import Propagated
    from palpate.procedures.engine.replay import Replay


class Result(Protocol):
    """What a procedure finds."""

    def summary(self) -> dict[str, Any]:
        """It without its points, for the record."""


S = TypeVar("S")
R = TypeVar("R", bound=Result)


@dataclass(frozen=True, slots=True)
class Procedure(Generic[S, R]):
    """A procedure with its settings `S`, a dataclass, and its result `R`.

    Attributes:
        check: refuses what cannot be done before the bench is opened.
        tell: what follows a finished run: calibrations kept, a plot, and the result as JSON or for people.
        constants: what the record says beside the settings.
        loads: that its load cell must tell by a calibration [N, peak to peak], and whether it may extrapolate; None:
            they are not known before.
        continues: on a real bench it can go on at any point; else what came before has to be measured anew.
        by_hand: what a person does in it beside mounting samples, as "places weights"; "": nothing.
    """

    name: str
    settings: type[S]
    check: Callable[[S, Target], None]
    run: Callable[[Session, S, Progress, Pause], R]
    tell: Callable[[Session, R, dict[str, Any], Output], None]
    calibrating: Calibrating | None = None
    constants: Mapping[str, object] = field(default_factory=dict)
    loads: Callable[[S], tuple[Sequence[float], bool]] | None = None
    continues: bool = False
    by_hand: str = ""


def refuse(procedure: Procedure[S, R], settings: S, target: Target, *, by_store: bool = True) -> str:
    """Raise what a procedure refuses before a bench is opened, and, `by_store`, loads that no calibration tells.

    Returns what may refuse it yet when the bench is open, "" where nothing is known.
    """
    procedure.check(settings, target)
    if by_store and procedure.loads is not None:
        simulated = target.model is not None
        stored = check_store(*procedure.loads(settings), simulated, datetime.now(UTC).date())
        if not (stored or simulated):
            return "no stored calibration of a real bench tells these loads: run palpate calibrate load-cell there"
    return ""


def conduct(
    procedure: Procedure[S, R],
    settings: S,
    choice: Choice,
    output: Output,
    *,
    model: str | None = None,
    pause: Pause = NOBODY,
    resumed: Resumed | None = None,
    replay: Replay | None = None,
) -> tuple[R, dict[str, Any]]:
    """Do a procedure in a session, from the opened bench to the finished record, and tell what it found.

    Returns:
        The result, and what every result says of itself.

    Raises:
        As `open_session`, and whatever the procedure raises; RecordError where what follows a finished run crashed.
    """
    with (
        output.progress() as progress,
        open_session(
            procedure.name,
            choice,
            {**asdict(settings), **procedure.constants},  # type: ignore[call-overload]
            lambda target: refuse(procedure, settings, target, by_store=replay is None),
            model=model,
            calibrating=procedure.calibrating,
            resumed=resumed,
            replay=replay,
            by_hand=procedure.by_hand,
        ) as session,
    ):
        if resumed is not None:
            pause = PausedAgain(resumed, session.bench, pause)
        result = procedure.run(session, settings, progress, pause)
        outcome = session.outcome()
        session.record.finish("complete", {**result.summary(), "bench_seconds": outcome["bench_seconds"]})
    try:
        procedure.tell(session, result, outcome, output)
    except (PalpateError, OSError, KeyboardInterrupt) as error:
        error.add_note(f"the run is kept in {session.record.folder}; look at it with palpate runs show")
        raise
    except Exception as error:  # a plot is drawn by libraries, fonts and file formats that can fail in any way
        raise RecordError(
            f"the run is kept in {session.record.folder}, what follows it crashed ({type(error).__name__}: {error}); "
            "look at it with palpate runs show"
        ) from error
    return result, outcome


def tell_result(
    output: Output, found: dict[str, Any], show: Callable[[], None], budgets: Sequence[Budget | Propagated] = ()
) -> None:
    """Tell what a run found: as JSON, or by `show` for people; its budgets where they are asked for."""
    if output.as_json:
        told = {name: value for name, value in found.items() if name != "budgets"}
        output.json({**told, "budgets": [each.summary() for each in budgets]} if output.budgets else told)
    elif output.for_people:
        from palpate.instrument.uncertainty.budget import Budget
        from palpate.procedures.showing.budget import print_budgets

        show()
        if output.budgets:
            print_budgets((each if isinstance(each, Budget) else each.budget for each in budgets), found["simulated"])


class Judged(Protocol):
    """A point that may be used, or not: `flags` say why."""

    @property
    def valid(self) -> bool: ...
    @property
    def flags(self) -> Sequence[str]: ...


def check_some_valid(points: Sequence[Judged]) -> None:
    """Refuse to call a run done that has not one valid point. Raises EstimateError, which says why they are not."""
    if any(point.valid for point in points):
        return
    from palpate.procedures.showing.marks import FLAGS

    reasons = Counter(flag for point in points for flag in point.flags)
    said = "; ".join(
        f"{flag} ({count}): {FLAGS.get(flag, 'its events say why')}" for flag, count in reasons.most_common()
    )
    raise EstimateError(f"none of the {len(points)} points is valid, so there is no result. {said}")
