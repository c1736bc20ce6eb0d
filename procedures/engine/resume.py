"""A run that was killed, stopped or failed goes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from palpate.instrument.errors import UsageError
from palpate.procedures.engine.procedure import Finished, P, Procedure, R, S
from palpate.procedures.engine.progress import Progress
from palpate.procedures.engine.run import open_and_run
from palpate.procedures.lab.open import Chosen, choose
from palpate.procedures.records.record import put_file
from palpate.procedures.records.resumed import Resumed, header_of
from palpate.procedures.records.run import Run
from palpate.procedures.steps.pause import Pause


def begun(run: Run, kind: type[Procedure[S, P, R]], bench: Path | None) -> Procedure[S, P, R]:
    """The procedure of a run that can go on, with its settings.

    Raises:
        UsageError: a bench for a simulated run, or points on a real bench that belong together.
        RecordError: its header is none of a procedure's.
    """
    if header_of(run)["scene"] is not None:
        if bench is not None:
            raise UsageError("--bench: the run was on a simulated bench; leave it out")
    elif not kind.continues and run.points():
        raise UsageError(
            f"{run.folder}: on a real bench {run.procedure!r} cannot go on in the middle, its points belong "
            "together; run it anew"
        )
    return kind.recorded(run)


def go_on(
    procedure: Procedure[S, P, R],
    run: Run,
    *,
    bench: Path | None,
    accept_change: bool,
    assume_mounted: bool,
    progress: Progress,
    pause: Pause,
) -> Finished[R]:
    """Open the bench of a run again and take the points that are left.

    Raises:
        UsageError: the run is complete, or the bench has changed and that is not accepted.
        RecordError: it is damaged. And as `open_and_run`.
    """
    record = Resumed(run, replay=run.header["scene"] is not None, accept=accept_change)
    try:
        chosen = _bench_of(run, bench, assume_mounted)
        return open_and_run(procedure, chosen, progress=progress, pause=pause, resumed=record)
    finally:
        record.close()


def _bench_of(run: Run, bench: Path | None, assume_mounted: bool) -> Chosen:
    """The bench of a run: of its own files, which a run that was killed at its start may lack."""
    scene: Any = run.header["scene"]
    path = run.folder / ("scene.toml" if scene else "bench.toml")
    if not path.exists():
        put_file(path, scene["toml"] if scene else str(run.header["bench"]))
    if scene:
        return choose(None, str(path), assume_mounted=assume_mounted)
    return choose(bench or path, assume_mounted=assume_mounted)
