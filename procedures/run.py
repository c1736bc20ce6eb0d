"""A run on disk: its format, and reading it.

Reading never changes a run, and works at any time: while the run is being written, after a kill
(the log `run.sqlite-wal` is read too), and where the folder is read-only.
`procedures/record.py` writes what this reads.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import sqlite3
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, Self, get_args

import numpy as np

from instrument.errors import RecordError, UnknownName

if TYPE_CHECKING:
    import pandas as pd

DATABASE = "run.sqlite"
WAVEFORMS = "waveforms.f32"
APPLICATION_ID = 0x50414C50  # "PALP"
SCHEMA_VERSION = 2
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
    crc32 INTEGER NOT NULL
) STRICT;
CREATE TABLE waveform (
    id INTEGER PRIMARY KEY,
    point_id INTEGER NOT NULL REFERENCES point (id),
    name TEXT NOT NULL,
    dtype TEXT NOT NULL,    -- numpy's name of the sample type: '<f4'
    rate REAL NOT NULL,     -- Hz
    offset INTEGER NOT NULL CHECK (offset >= 0), -- bytes from the start of {WAVEFORMS}
    length INTEGER NOT NULL CHECK (length >= 0), -- samples
    crc32 INTEGER NOT NULL, -- of samples, point, name, rate and length
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

LARGEST_ROW = 10_000_000  # bytes; a point has some thousand
WAVEFORM_COLUMNS = "point_id, name, dtype, rate, offset, length, crc32"

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
class WaveformRow:
    """Where the samples of a waveform lie; see `SCHEMA`."""

    point_id: int
    name: str
    dtype: str
    rate: float
    offset: int
    length: int
    crc32: int


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
        """Raises RecordError: no run there, a damaged one, or one of a newer palpate."""
        folder = folder.absolute()
        with reading(folder) as database:
            (version,) = database.execute("PRAGMA user_version").fetchone()
            (application,) = database.execute("PRAGMA application_id").fetchone()
            if application != APPLICATION_ID:
                raise RecordError(f"{folder / DATABASE} is not a run of palpate")
            if version != SCHEMA_VERSION:
                raise RecordError(
                    f"{folder} has record format {version}, this palpate reads {SCHEMA_VERSION}; "
                    "use the palpate that wrote it"
                )
            stored = database.execute("SELECT key, value, crc32 FROM run").fetchall()
            header = {key: json.loads(value) for key, value, _ in stored}
            status, summary = header.pop("status"), header.pop("summary")
            started = datetime.fromisoformat(header["started"]).astimezone(UTC)
            if not (isinstance(header["procedure"], str) and isinstance(summary, dict) and status in get_args(Status)):
                raise TypeError("its header is none of a run")
            if not isinstance(header["simulated"], bool):
                raise TypeError("its header does not say whether it is simulated")
            for key, value, crc32 in stored:
                _verify(f"{key!r} of the header", crc32, key, value)
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
            stored = database.execute("SELECT bench_ns, kind, message, crc32 FROM event ORDER BY id").fetchall()
            for *row, crc32 in stored:
                _verify(f"event {row[1]!r}", crc32, *row)
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
        for row, samples in self._rows(where, values):
            if isinstance(samples, RecordError):
                raise samples
            yield Waveform(row.point_id, row.name, row.rate, samples)

    def verify_waveforms(self) -> Iterator[tuple[WaveformRow, str]]:
        """Each row in order, and what is wrong with its samples; "" where nothing is."""
        for row, samples in self._rows("", ()):
            yield row, str(samples) if isinstance(samples, RecordError) else ""

    def _rows(self, where: str, values: tuple[object, ...]) -> Iterator[tuple[WaveformRow, np.ndarray | RecordError]]:
        query = f"SELECT {WAVEFORM_COLUMNS} FROM waveform {where} ORDER BY id"
        with reading(self.folder) as database:
            rows = [WaveformRow(*row) for row in database.execute(query, values)]
        if not rows:
            return
        with opened(self.folder / WAVEFORMS) as file:
            for row in rows:
                yield row, samples_of(file, row)

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


def row_crc32(*values: object) -> int:
    """CRC-32 of what stands in a row."""
    return zlib.crc32(json.dumps(values).encode())


def _verify(what: str, crc32: int, *values: object) -> None:
    """Raises ValueError: a row is damaged."""
    if row_crc32(*values) != crc32:
        raise ValueError(f"{what} is not as it was written, CRC-32 differs")


def stored_points(database: sqlite3.Connection) -> Iterator[tuple[int, int, str]]:
    """Id, bench time and data of each point in order. Raises ValueError: one is damaged."""
    for *row, crc32 in database.execute("SELECT id, bench_ns, data, crc32 FROM point ORDER BY id"):
        _verify(f"point {row[0]}", crc32, *row)
        yield row[0], row[1], row[2]


def waveform_crc32(point_id: int, name: str, rate: float, samples: np.ndarray) -> int:
    """CRC-32 of a row and its samples, (n,) float32."""
    return zlib.crc32(samples.view(np.uint8).data, row_crc32(point_id, name, float(rate), samples.size))


def samples_of(file: BinaryIO, row: WaveformRow) -> np.ndarray | RecordError:
    """Those of a row in the waveform file; what is wrong is returned, so that others can still be read."""
    what = f"{file.name}: waveform {row.name!r} of point {row.point_id}"
    numbers = isinstance(row.rate, float) and isinstance(row.offset, int) and isinstance(row.length, int)
    size = os.fstat(file.fileno()).st_size
    if row.dtype != "<f4" or not numbers or row.rate <= 0 or not 0 <= row.offset <= size - 4 * row.length <= size:
        return RecordError(f"{what} is cut short, or its row is wrong; restore the file from a copy")
    file.seek(row.offset)
    samples = np.frombuffer(file.read(4 * row.length), "<f4")
    if waveform_crc32(row.point_id, row.name, row.rate, samples) != row.crc32:
        return RecordError(f"{what} is damaged (CRC-32 differs); restore the file from a copy")
    return samples


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
def opened(path: Path) -> Iterator[BinaryIO]:
    try:
        with path.open("rb") as file:
            yield file
    except RecordError:
        raise
    except OSError as error:
        raise RecordError(f"cannot read {path}: {error.strerror}; make it readable or restore it") from error


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
    return connection


def _copied(path: Path, stack: contextlib.ExitStack) -> Path:
    """A copy of the database with its log: SQLite must write beside a log to read it, and here it may not."""
    aside = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="palpate-")))
    for name in (DATABASE, f"{DATABASE}-wal", f"{DATABASE}-journal"):
        source = path.with_name(name)
        if name == DATABASE or source.exists():
            with opened(source) as file:
                (aside / name).write_bytes(file.read())
    return aside / DATABASE
