"""Listing and finding runs in a store."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Literal

from palpate.instrument.errors import RecordError, UnknownName, UsageError, check_path
from palpate.procedures.records.run import Run, is_run, last_modified, reading
from palpate.procedures.records.stored import Status


@dataclass(frozen=True, slots=True)
class RunSummary:
    """A line in a list of runs. Of a damaged run only `folder`, `started` (time of its file) and `fault` are known."""

    folder: Path
    started: datetime
    procedure: str = ""
    simulated: bool | None = None
    status: Status | Literal["damaged"] = "damaged"
    points: int = 0
    fault: str = ""
    hashed: bool | None = None


def list_runs(store: Path) -> list[RunSummary]:
    """The runs in `store`, newest first; folders without a run are left out."""
    runs = [_summary(folder) for folder in _folders(store)]
    return sorted(runs, key=lambda run: (run.started, run.folder.name), reverse=True)


def _summary(folder: Path) -> RunSummary:
    try:
        run = Run.open(folder)
        with reading(run.folder) as stored:
            points = stored.count()
    except RecordError as error:
        return RunSummary(folder, last_modified(folder), fault=str(error))
    return RunSummary(folder, run.started, run.procedure, run.simulated, run.status, points, hashed=run.hashed)


def _folders(store: Path) -> Iterator[Path]:
    return (path for path in store.glob("*") if path.is_dir() and is_run(path))


def find_run(text: str, store: Path) -> Path:
    """The folder of the run that `text` names: a path, or a name in `store`.

    Raises:
        UnknownName: there is no such run; the message lists the runs of the store. UsageError: it is a file.
    """
    check_path(Path(text))
    for folder in (Path(text), store / text):
        if is_run(folder):
            return folder
    if Path(text).is_file():
        raise UsageError(f"{text} is a file, and no run; give the folder of a run")
    raise UnknownName("run", text, (path.name for path in _folders(store)))
