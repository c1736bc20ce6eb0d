"""A run on disk: its format, and reading it.

A run is one file, `run.sqlite`, in a folder of its own: header, points, waveforms and events (`SCHEMA`). While it is
being written, and after a kill, a log lies beside it, `run.sqlite-wal`, without which it lacks its last points: copy
both. Reading never changes a run, and works at any time, also where the folder is read-only.
`procedures/record.py` writes what this reads.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, get_args

import numpy as np

from instrument.errors import RecordError, UnknownName
from procedures.encoding import LARGEST_ROW, SAMPLE, verify, waveform_crc32

if TYPE_CHECKING:
    import pandas as pd

DATABASE = "run.sqlite"
APPLICATION_ID = 0x50414C50  # "PALP"
SCHEMA_VERSION = 3
SCHEMA = f"""
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {SCHEMA_VERSION};
CREATE TABLE run (          -- the header, and at the end status and summary
    key TEXT PRIMARY KEY,
    value TEXT NOT NULL,    -- JSON
    crc32 INTEGER NOT NULL  -- of the others, as in all tables
) STRICT;
CREATE TABLE point (
    id INTEGER PRIMARY KEY, -- 1, 2, 3, … without a gap
    bench_ns INTEGER NOT NULL,
    data TEXT NOT NULL,     -- JSON object, keys sorted, no wall time: equal runs have equal bytes
    waveforms INTEGER NOT NULL, -- how many it has
    crc32 INTEGER NOT NULL
) STRICT;
CREATE TABLE waveform (
    id INTEGER PRIMARY KEY,
    point_id INTEGER NOT NULL REFERENCES point (id),
    name TEXT NOT NULL,
    rate REAL NOT NULL,     -- Hz
    samples BLOB NOT NULL,  -- float32, little-endian
    crc32 INTEGER NOT NULL, -- of point, name, rate, number of samples, and the samples
    UNIQUE (point_id, name)
) STRICT;
CREATE TABLE event (
    id INTEGER PRIMARY KEY,
    bench_ns INTEGER NOT NULL,
    kind TEXT NOT NULL,
    message TEXT NOT NULL,
    crc32 INTEGER NOT NULL
) STRICT;
"""

POINT_COLUMNS = "bench_ns, data, waveforms, crc32"
WAVEFORM_COLUMNS = "point_id, name, rate, samples, crc32"
EVENT_COLUMNS = "bench_ns, kind, message, crc32"

Status = Literal["running", "complete", "stopped", "failed"]

_ELSEWHERE = "choose a writable folder with --out or $PALPATE_STORE"
_REMEDY = {
    **dict.fromkeys(("ENOSPC", "EDQUOT", "SQLITE_FULL"), "free space on the disk, or choose another with --out"),
    "ENOENT": f"do not move or remove a run while it is being written, or {_ELSEWHERE}",
    "EFBIG": "raise the limit on file sizes (ulimit -f)",
    "SQLITE_IOERR": "check the disk, its free space and the limit on file sizes (ulimit -f)",
}


@dataclass(frozen=True, slots=True)
class Waveform:
    """Samples of one signal at one point: `samples`, shape (n,), float32; `rate`, Hz."""

    point_id: int
    name: str
    rate: float
    samples: np.ndarray


@dataclass(frozen=True, slots=True)
class Run:
    """A stored run. `started` is UTC; `status` is what is stored: a killed run stays "running".

    All methods raise RecordError, which names what is damaged.
    """

    folder: Path
    procedure: str
    simulated: bool
    started: datetime
    status: Status
    header: Mapping[str, object]
    summary: Mapping[str, object]

    @classmethod
    def open(cls, folder: Path) -> Self:
        """Raises RecordError: no run there, a damaged one, or one of another record format."""
        folder = folder.absolute()
        with reading(folder) as database:
            stored = database.execute("SELECT key, value, crc32 FROM run").fetchall()
            header = {key: json.loads(value) for key, value, _ in stored}
            status, summary = header.pop("status"), header.pop("summary")
            started = datetime.fromisoformat(header["started"]).astimezone(UTC)
            if not (isinstance(header["procedure"], str) and isinstance(summary, dict) and status in get_args(Status)):
                raise TypeError("its header is none of a run")
            if not isinstance(header["simulated"], bool):
                raise TypeError("its header does not say whether it is simulated")
            for key, value, crc32 in stored:
                verify(f"{key!r} of the header", crc32, key, value)
            return cls(folder, header["procedure"], header["simulated"], started, status, header, summary)

    def points(self) -> list[dict[str, Any]]:
        """All points in order: what was stored, with `id` and `bench_ns`; null is None."""
        with reading(self.folder) as database:
            return [
                {"id": point_id, "bench_ns": bench_ns, **json.loads(data)}
                for point_id, bench_ns, data in stored_points(database)
            ]

    def events(self) -> list[dict[str, Any]]:
        """All events in order: `bench_ns`, `kind`, `message`."""
        with reading(self.folder) as database:
            stored = database.execute(f"SELECT {EVENT_COLUMNS} FROM event ORDER BY id").fetchall()
            for *row, crc32 in stored:
                verify(f"event {row[1]!r}", crc32, *row)
            return [{"bench_ns": bench_ns, "kind": kind, "message": message} for bench_ns, kind, message, _ in stored]

    def waveform_names(self, point_id: int) -> list[str]:
        """The names of a point's waveforms, in the order they were given."""
        with reading(self.folder) as database:
            rows = database.execute("SELECT name FROM waveform WHERE point_id = ? ORDER BY id", (point_id,))
            return [name for (name,) in rows]

    def waveform(self, point_id: int, name: str) -> np.ndarray:
        """The samples, shape (n,), float32; length and CRC-32 are verified.

        Raises:
            UnknownName: the point has no such waveform.
        """
        for waveform in self._waveforms("WHERE point_id = ? AND name = ?", (point_id, name)):
            return waveform.samples
        raise UnknownName(f"waveform of point {point_id}", name, self.waveform_names(point_id))

    def waveforms(self) -> Iterator[Waveform]:
        """All waveforms in order, verified, one in memory at a time."""
        return self._waveforms("", ())

    def _waveforms(self, where: str, values: tuple[object, ...]) -> Iterator[Waveform]:
        with reading(self.folder) as database:
            for row in database.execute(f"SELECT {WAVEFORM_COLUMNS} FROM waveform {where} ORDER BY id", values):
                yield waveform_of(*row)

    def digest(self) -> str:
        """SHA-256 over all points and waveforms, hex: the same for runs that measured the same."""
        total = hashlib.sha256()
        with reading(self.folder) as database:
            for point in stored_points(database):
                total.update(json.dumps(point).encode() + b"\n")
        for waveform in self.waveforms():
            row = (waveform.point_id, waveform.name, waveform.rate, waveform.samples.size)
            total.update(json.dumps(row).encode() + b"\n" + waveform.samples.tobytes())
        return total.hexdigest()

    def table(self) -> pd.DataFrame:
        """The points, one a row: `id`, `bench_ns`, `simulated` (the same in each row), then their values."""
        import pandas as pd

        frame = pd.DataFrame(self.points())
        frame.insert(min(2, len(frame.columns)), "simulated", self.simulated)
        return frame


def stored_points(database: sqlite3.Connection) -> Iterator[tuple[int, int, str]]:
    """Id, bench time and data of each point in order. Raises ValueError: one is damaged."""
    for *row, crc32 in database.execute(f"SELECT id, {POINT_COLUMNS} FROM point ORDER BY id"):
        verify(f"point {row[0]}", crc32, *row)
        yield row[0], row[1], row[2]


def waveform_of(point_id: int, name: str, rate: float, samples: bytes, crc32: int) -> Waveform:
    """What stands in a row (`WAVEFORM_COLUMNS`). Raises ValueError, TypeError: it is damaged."""
    found = np.frombuffer(samples, SAMPLE)
    if waveform_crc32(point_id, name, rate, found) != crc32 or not rate > 0:
        raise ValueError(f"waveform {name!r} of point {point_id} is not as it was written, CRC-32 differs")
    return Waveform(point_id, name, rate, found)


@contextlib.contextmanager
def storing(path: Path) -> Iterator[None]:
    """What goes wrong inside is a RecordError that names `path` and what to do."""
    try:
        yield
    except sqlite3.Error as error:
        code = "_".join(getattr(error, "sqlite_errorname", "").split("_")[:2])
        raise RecordError(f"cannot write {path}: {error}; {_REMEDY.get(code, _ELSEWHERE)}") from error
    except RecordError:
        raise
    except OSError as error:
        code = errno.errorcode.get(error.errno or 0, "")
        reason = error.strerror or str(error)
        raise RecordError(f"cannot write {path}: {reason}; {_REMEDY.get(code, _ELSEWHERE)}") from error


@contextlib.contextmanager
def reading(folder: Path) -> Iterator[sqlite3.Connection]:
    """One snapshot of the database, for as short as it takes: an open reader keeps the log from ending."""
    path = folder / DATABASE
    with contextlib.ExitStack() as stack:
        try:
            try:
                database = _snapshot(path, "ro", stack)
            except sqlite3.OperationalError as error:
                if error.sqlite_errorcode & 0xFF not in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY):
                    raise
                database = _snapshot(_copied(path, stack), "rw", stack)
            yield database
        except (sqlite3.Error, KeyError, ValueError, TypeError, OverflowError, RecursionError) as error:
            reason = f"no {error}" if isinstance(error, KeyError) else error
            raise RecordError(f"{path} is damaged ({reason}); restore it from a copy") from error


def _snapshot(path: Path, mode: str, stack: contextlib.ExitStack) -> sqlite3.Connection:
    connection = sqlite3.connect(f"{path.as_uri()}?mode={mode}", uri=True)
    stack.enter_context(contextlib.closing(connection))
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_ROW)
    connection.execute("BEGIN")
    (others,) = connection.execute("SELECT count(*) FROM sqlite_schema WHERE type NOT IN ('table', 'index')").fetchone()
    if others:  # a view could go on for ever
        raise ValueError("it has views or triggers, a run has none")
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    if application != APPLICATION_ID:
        raise RecordError(f"{path} is not a run of palpate")
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version != SCHEMA_VERSION:
        raise RecordError(
            f"{path} has record format {version}, this palpate reads {SCHEMA_VERSION}; use the palpate that wrote it"
        )
    return connection


def _copied(path: Path, stack: contextlib.ExitStack) -> Path:
    """A copy of the database with its log: SQLite must write beside a log to read it, and here it may not."""
    aside = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="palpate-")))
    for name in (DATABASE, f"{DATABASE}-wal", f"{DATABASE}-journal"):
        source = path.with_name(name)
        if name == DATABASE or source.exists():
            try:
                shutil.copyfile(source, aside / name)
            except OSError as error:
                raise RecordError(f"cannot read {source}: {error.strerror}; make it readable or restore it") from error
    return aside / DATABASE
