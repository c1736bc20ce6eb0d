"""Goes on with a run that was killed, stopped or failed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from palpate.instrument.errors import UsageError
from palpate.procedures.engine.catalogue import class_of
from palpate.procedures.engine.listeners import told_to
from palpate.procedures.engine.procedure import Finished, P, Procedure, R, Result, S
from palpate.procedures.engine.run import open_and_run
from palpate.procedures.lab.before import before_of
from palpate.procedures.lab.calibrations import is_unstored
from palpate.procedures.lab.chosen import Chosen, choose
from palpate.procedures.lab.store import store
from palpate.procedures.records.events import Listener
from palpate.procedures.records.record import MEASURED, put_file
from palpate.procedures.records.resumed import Resumed, header_of
from palpate.procedures.records.run import Run, find_run
from palpate.procedures.steps.pause import NOBODY, Pause

if TYPE_CHECKING:
    from palpate.procedures.engine.procedure import Result


@overload
def resume(
    run: str | Path,
    kind: None = None,
    *,
    bench: str | Path | None = None,
    accept_change: bool = False,
    listeners: Sequence[Listener] = (),
    pause: Pause = NOBODY,
) -> Finished[Result]: ...
@overload
def resume(
    run: str | Path,
    kind: type[Procedure[S, P, R]],
    *,
    bench: str | Path | None = None,
    accept_change: bool = False,
    listeners: Sequence[Listener] = (),
    pause: Pause = NOBODY,
) -> Finished[R]: ...
def resume(
    run: str | Path,
    kind: type[Procedure[S, P, R]] | None = None,
    *,
    bench: str | Path | None = None,
    accept_change: bool = False,
    listeners: Sequence[Listener] = (),
    pause: Pause = NOBODY,
) -> Finished[R] | Finished[Result]:
    """Go on with a run that was killed, stopped or failed, or whose calibration is not stored for later runs.

    No finished point is lost or stored twice.

    Args:
        run: its folder, or its name in the store.
        kind: class of its procedure; None: the one of that name, ours or of an installed package.
        bench: bench file of a real bench; None: the run's own.
        accept_change: go on although bench or software have changed; the record says how.
        listeners: as for `run`.

    Raises:
        UnknownName: no such run. UsageError: it is complete, or of another procedure or bench.
        RecordError: it is damaged. And as `run`.
    """
    found, file = Run.open(find_run(str(run), store())), None if bench is None else Path(bench)
    if kind is None:
        return _resumed(class_of(found, "resume"), found, file, accept_change, listeners, pause)
    return _resumed(kind, found, file, accept_change, listeners, pause)


def _resumed(
    kind: type[Procedure[S, P, R]],
    run: Run,
    bench: Path | None,
    accept_change: bool,
    listeners: Sequence[Listener],
    pause: Pause,
) -> Finished[R]:
    procedure = begun(run, kind, bench)
    with told_to(listeners) as listener:
        done = go_on(
            procedure,
            run,
            bench=bench,
            accept_change=accept_change,
            assume_mounted=False,
            listener=listener,
            pause=pause,
        )
    done.conclude()
    return done


def begun(run: Run, kind: type[Procedure[S, P, R]], bench: Path | None) -> Procedure[S, P, R]:
    """The procedure of a run that can go on, with its settings.

    Raises:
        UsageError: a run of another procedure, one of which nothing is left to do, a bench for a simulated run, a run
            on a simulated bench of which not everything is known that was done before, or points on a real bench that
            belong together.
        RecordError: its header is none of a procedure's.
    """
    left = "replayed" not in run.header and is_unstored(run.folder, kind.calibrates)
    if run.status == "complete" and not left:
        raise UsageError(f"{run.folder} is complete; there is nothing to resume")
    header, procedure = header_of(run), kind.recorded(run)
    if header["scene"] is not None:
        if bench is not None:
            raise UsageError("--bench: the run used a simulated bench; leave this option out")
        before = before_of(run)
        if before and before.unknown:
            raise UsageError(
                f"{run.folder}: the simulated bench cannot be brought back to where the run began: {before.unknown}; "
                "run it anew"
            )
    elif not kind.resumable_on_real_bench and run.points() and not measured(run):
        raise UsageError(
            f"{run.folder}: on a real bench {run.procedure!r} cannot be resumed, because its points must be taken in "
            "one run; run it anew"
        )
    return procedure


def measured(run: Run) -> bool:
    """Whether a run has all its points."""
    return run.status == "complete" or any(event["kind"] == MEASURED for event in run.events())


def go_on(
    procedure: Procedure[S, P, R],
    run: Run,
    *,
    bench: Path | None,
    accept_change: bool,
    assume_mounted: bool,
    listener: Listener,
    pause: Pause,
) -> Finished[R]:
    """Open the bench of a run again and take the points that are left.

    Raises:
        UsageError: bench or software have changed and that is not accepted.
        RecordError: the run is damaged.
        Others as `open_and_run` raises them.
    """
    record = Resumed(run, replay=run.header["scene"] is not None, accept=accept_change, listener=listener)
    try:
        chosen = _bench_of(run, bench, assume_mounted)
        return open_and_run(procedure, chosen, pause=pause, resumed=record)
    finally:
        record.close()


def _bench_of(run: Run, bench: Path | None, assume_mounted: bool) -> Chosen:
    """The bench of a run, by the run's own files, which are written now if the run was killed before it wrote them."""
    scene: Any = run.header["scene"]
    path = run.folder / ("scene.toml" if scene else "bench.toml")
    if not path.exists():
        put_file(path, scene["toml"] if scene else str(run.header["bench"]))
    if scene:
        return choose(None, str(path), assume_mounted=assume_mounted)
    return choose(bench or path, assume_mounted=assume_mounted)
