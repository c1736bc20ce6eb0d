"""The runs of a store, listed without opening those that an earlier list has read.

What a list reads of a run, it leaves in `runs.index` in the store. An entry holds as long as both files of its run are
those that were read, by inode, size and times. Nothing else rests on the index: it may be lost, damaged, old, or not
writable at any time, and the runs are then read. Damaged runs are read each time. A file that was changed just before
it was read is not trusted either, as it could be changed once more within the resolution of its time.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from palpate.instrument.durable import put_whole
from palpate.instrument.errors import RecordError, UnknownName, UsageError, check_path
from palpate.procedures.records.run_folder import HEAD_FILE, RECORD, is_run, last_modified

if TYPE_CHECKING:
    from palpate.procedures.records.record_file import Status

INDEX = "runs.index"
VERSION = "palpate runs 1"  # what the index begins with; another number where its entries, or those of runs, change
SETTLED = 2_000_000_000  # ns after which a file system gives a changed file another time
WORTH = 20  # runs that are read anew before an index is written: fewer are read at once


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
    header: Mapping[str, Any] = field(default_factory=dict, repr=False)


def list_runs(store: Path) -> list[RunSummary]:
    """The runs in `store`, newest first; folders without a run are left out."""
    now, known = time.time_ns(), _indexed(store)
    entries, runs = dict[str, _Entry](), list[RunSummary]()
    for folder in _folders(store):
        stamp = _stamp(folder)  # before the run is read, so that a change meanwhile shows
        entry = known.get(folder.name)
        if entry is None or entry.stamp != stamp:
            if not is_run(folder):
                continue
            try:
                entry = _read(folder, stamp)
            except RecordError as error:
                runs.append(RunSummary(folder, last_modified(folder), fault=str(error)))
                continue
        runs.append(entry.summary(folder))
        if stamp and max(stamp[2::4]) < now - SETTLED:
            entries[folder.name] = entry
    if sum(known.get(name) is not entry for name, entry in entries.items()) >= WORTH:
        with contextlib.suppress(OSError):  # as in a store that is read-only: then the runs are read each time
            put_whole(store / INDEX, _text(entries))
    return sorted(runs, key=lambda run: (run.started, run.folder.name), reverse=True)


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
    none = f"{store} holds no run yet; measure one, as with palpate sweep loads, or set PALPATE_STORE to another folder"
    raise UnknownName("run", text, (path.name for path in _folders(store) if is_run(path)), none)


def _folders(store: Path) -> Iterator[Path]:
    return (path for path in store.glob("*") if path.is_dir())


# --- the index -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Entry:
    """What the index has of a whole run: `stamp` tells its files from any others; the rest is as in `Run`."""

    stamp: list[int]
    status: Status
    points: int
    header: Mapping[str, Any]

    def summary(self, folder: Path) -> RunSummary:
        header = self.header
        started = datetime.fromisoformat(header["started"]).astimezone(UTC)
        return RunSummary(
            folder, started, header["procedure"], header["simulated"], self.status, self.points, header=header
        )


def _read(folder: Path, stamp: list[int]) -> _Entry:
    """Read a run. Raises RecordError: it is damaged."""
    from palpate.procedures.records.run import Run, reading  # with numpy, which takes longer than a list by the index

    run = Run.open(folder)
    with reading(run.folder) as stored:
        return _Entry(stamp, run.status, stored.count(), run.header)


def _stamp(folder: Path) -> list[int]:
    """Inode, size, time of writing and of change of each file of a run; empty: there are not both."""
    try:
        found = [(folder / name).stat() for name in (RECORD, HEAD_FILE)]
    except OSError:
        return []
    return [value for each in found for value in (each.st_ino, each.st_size, each.st_mtime_ns, each.st_ctime_ns)]


def _indexed(store: Path) -> dict[str, _Entry]:
    """The entries of the index by the names of their folders; none where there is no whole index of this version."""
    path = store / INDEX
    try:
        head, text = path.read_bytes().split(b"\n", 1) if path.is_file() else (b"", b"")
        if head.decode() != _head(text):
            return {}
        return {name: _Entry(*entry) for name, entry in json.loads(text).items()}
    except (OSError, ValueError):
        return {}


def _text(entries: Mapping[str, _Entry]) -> str:
    told = {name: (each.stamp, each.status, each.points, each.header) for name, each in entries.items()}
    text = json.dumps(told, separators=(",", ":"))
    return f"{_head(text.encode())}\n{text}"


def _head(text: bytes) -> str:
    """The first line of an index, which tells a whole one."""
    return f"{VERSION} {hashlib.sha256(text).hexdigest()}"
