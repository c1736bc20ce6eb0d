"""Record format 3, which earlier versions wrote: one SQLite database, for reading only.

Each row has a CRC-32, but nothing ties a row to the one before. So a log (`run.sqlite-wal`) that was left behind or is
damaged takes the last points with it unnoticed: a run of this format is unhashed, and everything that reads it says so.
"""

from __future__ import annotations

import contextlib
import json
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from palpate.instrument.errors import RecordError
from palpate.procedures.records.encoding import LARGEST_ROW, SAMPLE, verify, waveform_crc32
from palpate.procedures.records.stored import Point, Waveform

DATABASE = "run.sqlite"
LOG = f"{DATABASE}-wal"
FORMAT = 3
APPLICATION_ID = 0x50414C50  # "PALP"
SCHEMA = f"""
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {FORMAT};
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


class Database:
    """A snapshot of a database. Meets `Stored`."""

    hashed = False

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database = database
        self.header: dict[str, Any] = {}
        for key, value, crc32 in database.execute("SELECT key, value, crc32 FROM run"):
            verify(f"{key!r} of the header", crc32, key, value)
            self.header[key] = json.loads(value)
        self.status, self.summary = self.header.pop("status"), self.header.pop("summary")

    def count(self) -> int:
        (count,) = self._database.execute("SELECT count(*) FROM point").fetchone()
        return int(count)

    def points(self) -> Iterator[Point]:
        names: dict[int, list[str]] = {}
        for point_id, name in self._database.execute("SELECT point_id, name FROM waveform ORDER BY id"):
            names.setdefault(point_id, []).append(name)
        for *row, crc32 in self._database.execute("SELECT id, bench_ns, data, waveforms, crc32 FROM point ORDER BY id"):
            verify(f"point {row[0]}", crc32, *row)
            yield Point(row[0], row[1], row[2], tuple(names.get(row[0], ())))

    def events(self) -> list[dict[str, Any]]:
        found = []
        for *row, crc32 in self._database.execute("SELECT bench_ns, kind, message, crc32 FROM event ORDER BY id"):
            verify(f"event {row[1]!r}", crc32, *row)
            found.append(dict(zip(("bench_ns", "kind", "message"), row, strict=True)))
        return found

    def waveforms(self, point_id: int | None = None, name: str | None = None) -> Iterator[Waveform]:
        for row in self._database.execute(
            "SELECT point_id, name, rate, samples, crc32 FROM waveform"
            " WHERE point_id = coalesce(?, point_id) AND name = coalesce(?, name) ORDER BY id",
            (point_id, name),
        ):
            yield waveform_of(*row)

    def faults(self) -> Iterator[str]:
        """Damage that only the database as a whole shows."""
        said = "; ".join(text for (text,) in self._database.execute("PRAGMA integrity_check"))
        if said != "ok":
            yield f"{DATABASE}: {said}"
        with contextlib.closing(sqlite3.connect(":memory:")) as empty:
            empty.executescript(SCHEMA)
            if _tables(self._database) != _tables(empty):
                yield f"{DATABASE}: its tables are not those of a run"
        counts = (
            "SELECT id, waveforms, (SELECT count(*) FROM waveform WHERE point_id = point.id) FROM point ORDER BY id"
        )
        for point_id, count, there in self._database.execute(counts):
            if there != count:
                yield f"point {point_id}: has {there} of its {count} waveforms"
        for (point_id,) in self._database.execute(
            "SELECT DISTINCT point_id FROM waveform WHERE point_id NOT IN (SELECT id FROM point) ORDER BY id"
        ):
            yield f"point {point_id} is missing, waveforms of it are there"


def waveform_of(point_id: int, name: str, rate: float, samples: bytes, crc32: int) -> Waveform:
    """The waveform in a row. Raises ValueError, TypeError: the row is damaged."""
    found = np.frombuffer(samples, SAMPLE)
    if waveform_crc32(point_id, name, rate, found) != crc32 or not rate > 0:
        raise ValueError(f"waveform {name!r} of point {point_id} is not as it was written, CRC-32 differs")
    return Waveform(point_id, name, rate, found)


def _tables(database: sqlite3.Connection) -> set[str]:
    """The statements that made its tables."""
    return {" ".join(sql.split()) for (sql,) in database.execute("SELECT sql FROM sqlite_schema WHERE sql NOT NULL")}


@contextlib.contextmanager
def opened(folder: Path) -> Iterator[Database]:
    """Open the database in a folder for a short time.

    Raises:
        RecordError: it holds no run, or one of another format. Otherwise as in `Stored`.
    """
    path = folder / DATABASE
    for file in (path, folder / LOG):
        if file.exists() and not file.is_file():  # a pipe would be waited for
            raise RecordError(f"cannot read {file}: It is no file; restore it")
    with contextlib.ExitStack() as stack:
        try:
            database = _snapshot(path, "ro", stack)
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF not in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY):
                raise
            database = _snapshot(_copied(path, stack), "rw", stack)
        yield Database(database)


def _snapshot(path: Path, mode: str, stack: contextlib.ExitStack) -> sqlite3.Connection:
    connection = sqlite3.connect(f"{path.as_uri()}?mode={mode}", uri=True)
    stack.enter_context(contextlib.closing(connection))
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_ROW)
    connection.execute("BEGIN")
    (others,) = connection.execute("SELECT count(*) FROM sqlite_schema WHERE type NOT IN ('table', 'index')").fetchone()
    if others:  # reading a view might never end
        raise ValueError("it has views or triggers, a run has none")
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    if application != APPLICATION_ID:
        raise RecordError(f"{path} is not a run of palpate")
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version != FORMAT:
        raise RecordError(
            f"{path} has record format {version}, and this version of palpate reads 3 and 4; use that which wrote it"
        )
    return connection


def _copied(path: Path, stack: contextlib.ExitStack) -> Path:
    """A copy of the database with its log: SQLite must write beside a log to read it, and here it may not."""
    aside = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="palpate-")))
    for name in (DATABASE, LOG, f"{DATABASE}-journal"):
        source = path.with_name(name)
        if name == DATABASE or source.exists():
            try:
                shutil.copyfile(source, aside / name)
            except OSError as error:
                raise RecordError(f"cannot read {source}: {error.strerror}; make it readable or restore it") from error
    return aside / DATABASE
