"""Procedures that are not yet of the form in `engine/procedure.py`: described by functions, each with its own loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any, Generic, Protocol, TypeVar

from palpate.procedures.commands.measure import after
from palpate.procedures.commands.options import Choice, Output
from palpate.procedures.console.progress import Progress
from palpate.procedures.lab.calibrations import check_store
from palpate.procedures.lab.lab import Target
from palpate.procedures.lab.logged import LoggedRun
from palpate.procedures.lab.open import Calibrating, Chosen, choose, opened
from palpate.procedures.lab.session import Outcome, Session, places, recording
from palpate.procedures.records.resumed import Resumed
from palpate.procedures.steps.pause import NOBODY, Pause, PausedAgain


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
    tell: Callable[[Session, R, Outcome, Output], None]
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
    replay: LoggedRun | None = None,
) -> tuple[R, Outcome]:
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
            pause = PausedAgain(resumed, session.lab.bench, pause)
        result = procedure.run(session, settings, progress, pause)
        outcome = session.outcome()
        session.record.finish("complete", {**result.summary(), "bench_seconds": outcome["bench_seconds"]})
    with after(session.record.folder):
        procedure.tell(session, result, outcome, output)
    return result, outcome


@contextmanager
def open_session(
    procedure: str,
    choice: Choice,
    settings: Mapping[str, object],
    check: Callable[[Target], object],
    *,
    model: str | None = None,
    parameters: str | None = None,
    calibrating: Calibrating | None = None,
    resumed: Resumed | None = None,
    replay: LoggedRun | None = None,
    by_hand: str = "",
) -> Iterator[Session]:
    """Open the bench and its run, a new one or one that goes on; on the way out outputs are off, then it is closed.

    Raises: as `choose`, `check`, `opened` and `recording`.
    """
    if replay is None:
        chosen = choose(choice.bench, choice.scene, choice.seed, model, parameters, choice.assume_mounted)
    else:
        chosen = Chosen.of_log(replay)
    check(chosen.target)
    chosen.mounting(by_hand)
    if resumed is not None:
        with (
            opened(chosen, None, resumed) as bench,
            recording(
                bench, procedure, settings, resumed.folder, calibrating=calibrating, by_hand=by_hand, resumed=resumed
            ) as session,
        ):
            yield session
        return
    started = datetime.now(UTC) if replay is None else replay.run.started
    with (
        places(choice.out, choice.log, procedure, started) as folder,
        opened(chosen, choice.log, started=started) as bench,
        recording(bench, procedure, settings, folder, calibrating=calibrating, by_hand=by_hand) as session,
    ):
        yield session
