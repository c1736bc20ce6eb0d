"""A run on disk, for reading, and the list of all runs of a store with its index.

A run is a folder with `run.record` and `run.head` (`record_file.py`); copy both. Reading never changes a run; it works
while the run is being written, and in a folder that is read-only. `record.py` writes runs.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, get_args

import numpy as np

from palpate.instrument.durable import put_whole
from palpate.instrument.errors import RecordError, UnknownName, UsageError, check_path, reason
from palpate.procedures.records import record_file
from palpate.procedures.records.chain import HEAD_FILE, RECORD, check_holes, is_run, last_modified
from palpate.procedures.records.record_file import Status, Waveform

if TYPE_CHECKING:
    import pandas as pd


ELSEWHERE = "a writable folder with --out or $PALPATE_STORE"
_FULL = ("ENOSPC", "EDQUOT")
_REMEDY = {
    "EFBIG": "raise the limit on file sizes (ulimit -f)",
    "EIO": "check the disk",
}
_DAMAGES = (KeyError, ValueError, TypeError, OverflowError, RecursionError, IndexError)


@dataclass(frozen=True, slots=True)
class Run:
    """A stored run.

    Attributes:
        started: UTC.
        status: the stored status; the run of a killed program stays "running".

    All methods raise RecordError, which names what is damaged.
    """

    folder: Path
    procedure: str
    simulated: bool
    started: datetime
    status: Status
    header: Mapping[str, object] = field(repr=False)
    summary: Mapping[str, object] = field(repr=False)

    @classmethod
    def open(cls, folder: Path) -> Self:
        """Open a run. Raises RecordError: there is no run, it is damaged, or it has another record format."""
        check_path(folder)
        folder = folder.absolute()
        with reading(folder) as stored:
            header, summary = stored.header, stored.summary
            status: Any = stored.status
            started = datetime.fromisoformat(header["started"]).astimezone(UTC)
            if not (isinstance(header["procedure"], str) and isinstance(summary, dict) and status in get_args(Status)):
                raise TypeError("its header is not that of a run")
            if not isinstance(header["simulated"], bool):
                raise TypeError("its header does not say whether it is simulated")
            return cls(folder, header["procedure"], header["simulated"], started, status, header, summary)

    @property
    def about(self) -> dict[str, str]:
        """What the run says about itself, by the lab's keys."""
        found = self.header.get("about")
        return dict(found) if isinstance(found, dict) else {}

    def points(self) -> list[dict[str, Any]]:
        """All points in order, as they were stored, with `id` and `bench_ns`; null is None."""
        with reading(self.folder) as stored:
            return [*stored.rows()]

    def events(self) -> list[dict[str, Any]]:
        """All events in order: `bench_ns`, `kind`, `message`."""
        with reading(self.folder) as stored:
            return stored.events()

    def waveform_names(self, point_id: int) -> list[str]:
        """The names of a point's waveforms, in the order they were given."""
        with reading(self.folder) as stored:
            return [name for point in stored.points() if point.id == point_id for name in point.waveforms]

    def waveform(self, point_id: int, name: str) -> np.ndarray:
        """The samples, shape (n,), float32, verified.

        Raises:
            UnknownName: the point has no such waveform.
        """
        for waveform in self._waveforms(point_id, name):
            return waveform.samples
        raise UnknownName(f"waveform of point {point_id}", name, self.waveform_names(point_id))

    def waveforms(self, point_id: int | None = None) -> Iterator[Waveform]:
        """All waveforms, or those of a point, in order, verified, those of one point in memory at a time."""
        return self._waveforms(point_id, None)

    def _waveforms(self, point_id: int | None, name: str | None) -> Iterator[Waveform]:
        with reading(self.folder) as stored:
            yield from stored.waveforms(point_id, name)

    def digest(self) -> str:
        """SHA-256 over all points and waveforms, hex: the same for runs that measured the same, by one arithmetic."""
        total = hashlib.sha256()
        with reading(self.folder) as stored:
            for point in stored.points():
                total.update(json.dumps((point.id, point.bench_ns, point.text)).encode() + b"\n")
            _add_waveforms(total, stored.waveforms())
        return total.hexdigest()

    def signal_digest(self) -> str:
        """SHA-256 over what was asked for and the signals, hex: settings, and each point's time and waveforms.

        Unlike `digest` it does not rest on the arithmetic: no number in it was computed from the signals.
        """
        total = hashlib.sha256(json.dumps(self.header.get("settings"), sort_keys=True).encode() + b"\n")
        with reading(self.folder) as stored:
            for point in stored.rows():
                total.update(json.dumps((point["id"], point["bench_ns"])).encode() + b"\n")
            _add_waveforms(total, stored.waveforms())
        return total.hexdigest()

    def table(self) -> pd.DataFrame:
        """The points, one a row: `id`, `bench_ns`, `simulated` (the same in each row), then their values.

        Lists, as flags, are tuples, by which pandas can group.
        """
        return frame_of(self, map(hashable, self.points()))


def unfinished(run: Run) -> str:
    """What is stored of a dwell whose point is not stored, in words; empty: nothing. Raises RecordError."""
    with reading(run.folder) as stored:
        return str(stored.unfinished() or "")


def frame_of(run: Run, points: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """Points of a run as a table, which says whether they are simulated."""
    import pandas as pd

    frame = pd.DataFrame(list(points))
    frame.insert(min(2, len(frame.columns)), "simulated", run.simulated)
    return frame


def hashable(point: Mapping[str, Any]) -> dict[str, Any]:
    """A point whose lists are tuples, and whose objects are tuples of names and values, also within each other."""
    return {name: _hashable(value) for name, value in point.items()}


def _hashable(value: Any) -> Any:
    if isinstance(value, dict):
        return tuple((name, _hashable(each)) for name, each in value.items())
    return tuple(map(_hashable, value)) if isinstance(value, list) else value


def read(folder: str | Path) -> Run:
    """The run in a folder. Raises RecordError: there is none, or it is damaged."""
    return Run.open(Path(folder))


@contextlib.contextmanager
def reading(folder: Path) -> Iterator[record_file.Record]:
    """Open a run as it is now for reading. Raises RecordError, also for damage that is found inside the block."""
    check_holes(folder / RECORD)
    with telling_damage(folder / RECORD), record_file.opened(folder) as record:
        yield record


@contextlib.contextmanager
def telling_damage(path: Path) -> Iterator[None]:
    """Turn what the block raises about a damaged record, or one that cannot be read, into a RecordError."""
    try:
        yield
    except RecordError:
        raise
    except _DAMAGES as error:
        why = f"no {error}" if isinstance(error, KeyError) else error
        raise RecordError(
            f"{path} is damaged ({why}); restore it from a copy, or salvage it with palpate runs repair"
        ) from error
    except OSError as error:
        raise RecordError(f"cannot read {path}: {error.strerror}; make it readable or restore it") from error


@contextlib.contextmanager
def storing(path: Path, choose: str = ELSEWHERE, *, running: bool = False) -> Iterator[None]:
    """Turn an error of the disk in the block into a RecordError that names `path` and says what to do.

    Args:
        path: what is written.
        choose: what to choose instead, with the option that sets it.
        running: whether this belongs to a run that is being written, which somebody may have moved.
    """
    try:
        yield
    except RecordError:
        raise
    except OSError as error:
        code = errno.errorcode.get(error.errno or 0, "")
        raise RecordError(f"cannot write {path}: {reason(error)}; {_remedy(code, path, choose, running)}") from error


def check_new(out: Path | None, formats: Sequence[str]) -> None:
    """Check a file that an option --out names, before anything is computed for it; None: it is not given.

    Raises UsageError: its name ends in none of the formats, its folder does not exist, or the file exists.
    """
    if out is None:
        return
    if out.suffix not in formats:
        raise UsageError(f"{out} does not end in {' or '.join(formats)}; choose another --out")
    with storing(out):
        if not out.parent.is_dir():
            raise UsageError(f"{out}: there is no folder {out.parent}; make it, or choose another --out")
        if os.path.lexists(out):
            raise UsageError(f"{out} exists and is not overwritten; choose another --out")


def _remedy(code: str, path: Path, choose: str, running: bool) -> str:
    elsewhere = f"choose {choose}"
    if code in _FULL:
        return f"free space on the disk, or {elsewhere}"
    if code == "ENOENT" and running:
        return f"do not move or remove a run while it is being written, or {elsewhere}"
    if code == "ENOENT" and not path.parent.exists():
        return f"make the folder {path.parent}, or {elsewhere}"
    return _REMEDY.get(code, elsewhere)


def _add_waveforms(total: hashlib._Hash, waveforms: Iterable[Waveform]) -> None:
    for waveform in waveforms:
        row = (waveform.point_id, waveform.name, waveform.rate, waveform.samples.size)
        total.update(json.dumps(row).encode() + b"\n" + waveform.samples.tobytes())


# --- The runs of a store, listed without opening those that an earlier list has read -------------------
#
# What a list reads of a run, it leaves in `runs.index` in the store. An entry holds as long as both files of its run
# are those that were read, by inode, size and times. Nothing else rests on the index: it may be lost, damaged, old,
# or not writable at any time, and the runs are then read. Damaged runs are read each time. A file that was changed
# just before it was read is not trusted either, as it could be changed once more within the resolution of its time.

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
    now, index = time.time_ns(), _indexed(store)
    entries, runs = dict[str, _Entry](), list[RunSummary]()
    for folder in _folders(store):
        stamp = _stamp(folder)  # before the run is read, so that a change meanwhile shows
        entry = index.get(folder.name)
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
    if sum(index.get(name) is not entry for name, entry in entries.items()) >= WORTH:
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
    rows = {name: (each.stamp, each.status, each.points, each.header) for name, each in entries.items()}
    text = json.dumps(rows, separators=(",", ":"))
    return f"{_head(text.encode())}\n{text}"


def _head(text: bytes) -> str:
    """The first line of an index, which tells a whole one."""
    return f"{VERSION} {hashlib.sha256(text).hexdigest()}"
