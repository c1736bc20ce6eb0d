"""A run on disk, for reading.

A run is a folder with `run.record` and `run.head` (`record_file.py`); copy both. Reading never changes a run; it works
while the run is being written, and in a folder that is read-only. `record.py` writes runs.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, get_args

import numpy as np

from palpate.instrument.errors import RecordError, UnknownName, UsageError, check_path, reason
from palpate.procedures.records import record_file
from palpate.procedures.records.chain import check_holes
from palpate.procedures.records.record_file import Status, Waveform
from palpate.procedures.records.run_folder import RECORD

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
