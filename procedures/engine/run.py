"""A procedure as a recorded run: on an open bench, or from choosing the bench to the end of its record."""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from palpate.procedures.console.progress import Progress, silent
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.engine.plan import Plan
from palpate.procedures.engine.procedure import Finished, P, Procedure, R, S
from palpate.procedures.engine.settings import check_settings
from palpate.procedures.lab.calibrations import check_store
from palpate.procedures.lab.lab import Target
from palpate.procedures.lab.open import Chosen, OpenBench, opened
from palpate.procedures.lab.session import places, recording
from palpate.procedures.lab.store import result_folder
from palpate.procedures.records.resumed import Resumed
from palpate.procedures.steps.pause import NOBODY, Pause, PausedAgain


def refuse(procedure: Procedure[S, P, R], target: Target, *, by_store: bool = True) -> str:
    """Raise what a procedure refuses before a bench is opened, and, `by_store`, loads that no calibration tells.

    Returns what may refuse it yet when the bench is open, "" where nothing is known.
    """
    check_settings(procedure)
    procedure.check(target)
    loads = procedure.loads_to_tell()
    if by_store and loads is not None:
        simulated = target.model is not None
        stored = check_store(loads.values, loads.extrapolate, simulated, datetime.now(UTC).date())
        if not (stored or simulated):
            return "no stored calibration of a real bench tells these loads: run palpate calibrate load-cell there"
    return ""


def plan(procedure: Procedure[S, P, R], bench: OpenBench) -> Plan[S]:
    """What a procedure would do on an open bench; nothing is sent. Raises what it refuses."""
    refuse(procedure, bench.target)
    return procedure.plan(bench.target)


def run(
    procedure: Procedure[S, P, R],
    bench: OpenBench,
    *,
    out: str | Path | None = None,
    progress: Progress = silent,
    pause: Pause = NOBODY,
) -> Finished[R]:
    """Carry out a procedure on an open bench and record it; a calibration that comes out is kept for later runs.

    Args:
        out: folder of the run, new or empty; None: a new one in the store ($PALPATE_STORE, or runs/).
        progress: is called with the points that are done, the points in all, and what is done now.
        pause: is asked before each point.

    Raises:
        UsageError, RangeError, UnknownName: what the bench cannot give; nothing was sent.
        BenchError: the bench could not; its outputs are off and it is closed. `resume` goes on with the run.
        EstimateError: the points give no result. RecordError: the disk could not.
    """
    refuse(procedure, bench.target)
    with result_folder(None if out is None else Path(out), procedure.name, datetime.now(UTC)) as folder:
        done = record_run(procedure, bench, folder, progress, pause)
    return concluded(procedure, done)


def concluded(procedure: Procedure[S, P, R], done: Finished[R]) -> Finished[R]:
    """A finished run whose calibration is kept. Raises EstimateError: nothing can be concluded from it."""
    procedure.keep(done)
    procedure.judge(done.result)
    return done


def open_and_run(
    procedure: Procedure[S, P, R],
    chosen: Chosen,
    *,
    out: Path | None = None,
    log: Path | None = None,
    progress: Progress = silent,
    pause: Pause = NOBODY,
    resumed: Resumed | None = None,
) -> Finished[R]:
    """Open a bench, carry out a procedure on it, or go on with one, and close it.

    What can be refused is refused before the bench is opened. Raises as `run`.
    """
    refuse(procedure, chosen.target, by_store=chosen.logged is None)
    chosen.mounting(procedure.by_hand)
    if resumed is not None:
        with opened(chosen, log, resumed) as bench:
            return record_run(procedure, bench, resumed.folder, progress, pause, resumed)
    started = datetime.now(UTC) if chosen.logged is None else chosen.logged.run.started
    with places(out, log, procedure.name, started) as folder, opened(chosen, log, started=started) as bench:
        return record_run(procedure, bench, folder, progress, pause)


def record_run(
    procedure: Procedure[S, P, R],
    bench: OpenBench,
    folder: Path,
    progress: Progress,
    pause: Pause,
    resumed: Resumed | None = None,
) -> Finished[R]:
    """Carry out a procedure on an open bench, recorded in a folder, or go on with one."""
    with recording(
        bench,
        procedure.name,
        {**asdict(procedure), **procedure.constants},
        folder,
        calibrating=procedure.calibrating,
        by_hand=procedure.by_hand,
        resumed=resumed,
    ) as session:
        if resumed is not None:
            pause = PausedAgain(resumed, session.lab.bench, pause)
        result = conduct(procedure, session.lab, session.record, progress, pause)
        outcome = session.outcome()
        session.record.finish("complete", {**result.summary(), "bench_seconds": outcome["bench_seconds"]})
    return Finished(procedure, result, session, outcome)
