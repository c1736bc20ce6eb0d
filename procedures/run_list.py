"""Where runs are kept: listing and finding them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from instrument.errors import RecordError, UnknownName
from procedures.run import DATABASE, Run, Status, reading


@dataclass(frozen=True, slots=True)
class RunSummary:
    """A line in a list of runs; of a damaged one only `folder`, `started` (file time) and `fault` hold."""

    folder: Path
    started: datetime
    procedure: str = ""
    simulated: bool | None = None
    status: Status | Literal["damaged"] = "damaged"
    points: int = 0
    fault: str = ""


def list_runs(store: Path) -> list[RunSummary]:
    """The runs in `store`, newest first; folders without a run are left out."""
    runs = [_summary(path.parent) for path in store.glob(f"*/{DATABASE}")]
    return sorted(runs, key=lambda run: (run.started, run.folder.name), reverse=True)


def _summary(folder: Path) -> RunSummary:
    try:
        run = Run.open(folder)
        with reading(run.folder) as database:
            (points,) = database.execute("SELECT count(*) FROM point").fetchone()
    except RecordError as error:
        modified = datetime.fromtimestamp((folder / DATABASE).stat().st_mtime, UTC)
        return RunSummary(folder, modified, fault=str(error))
    return RunSummary(folder, run.started, run.procedure, run.simulated, run.status, points)


def find_run(text: str, store: Path) -> Path:
    """The folder of the run that `text` names: a path, or a name in `store`.

    Raises:
        UnknownName: neither; lists the runs of the store.
    """
    for folder in (Path(text), store / text):
        if (folder / DATABASE).is_file():
            return folder
    raise UnknownName("run", text, (path.parent.name for path in store.glob(f"*/{DATABASE}")))
