"""Looking a run over: what is damaged in it, and what is merely unfinished. Reading only."""

from __future__ import annotations

import json
import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from instrument.errors import RecordError
from procedures.encoding import row_crc32
from procedures.run import DATABASE, POINT_COLUMNS, SCHEMA, WAVEFORM_COLUMNS, Run, reading, waveform_of


@dataclass(slots=True)
class Found:
    """What a check found.

    Attributes:
        faults: what is damaged or missing; empty: every point and waveform is as it was written.
    """

    folder: Path
    status: str = "damaged"
    points: int = 0
    waveforms: int = 0
    faults: list[str] = field(default_factory=list)


def check(folder: Path) -> Found:
    """Verify database, tables, header, ids, bench times, data, and every waveform. Raises nothing."""
    found = Found(folder.absolute())
    try:
        run = Run.open(folder)
        with reading(run.folder) as database:
            said = "; ".join(text for (text,) in database.execute("PRAGMA integrity_check"))
            if said != "ok":
                found.faults.append(f"{DATABASE}: {said}")
            if tables_of(database) != _expected():
                found.faults.append(f"{DATABASE}: its tables are not those of a run")
            found.faults += _point_faults(database, found)
            found.faults += _waveform_faults(database, found)
        run.events()
        if run.status == "complete" and not run.summary:
            found.faults.append("it is complete, but its summary is gone")
        found.status = run.status
    except RecordError as error:
        found.faults.append(str(error))
    return found


def tables_of(database: sqlite3.Connection) -> set[str]:
    """The statements that made its tables."""
    return {" ".join(sql.split()) for (sql,) in database.execute("SELECT sql FROM sqlite_schema WHERE sql NOT NULL")}


def _expected() -> set[str]:
    with closing(sqlite3.connect(":memory:")) as database:
        database.executescript(SCHEMA)
        return tables_of(database)


def _point_faults(database: sqlite3.Connection, found: Found) -> Iterator[str]:
    expected, last_ns = 1, 0
    for point_id, bench_ns, text, waveforms, crc32 in database.execute(
        f"SELECT id, {POINT_COLUMNS} FROM point ORDER BY id"
    ):
        found.points += 1
        if row_crc32(point_id, bench_ns, text, waveforms) != crc32:
            yield f"point {point_id}: is not as it was written, CRC-32 differs"
        if point_id != expected:
            yield f"before point {point_id} points are missing, from {expected} on"
        if bench_ns < last_ns:
            yield f"point {point_id}: bench time goes back from {last_ns} to {bench_ns} ns"
        if not is_object(text):
            yield f"point {point_id}: its data is no JSON object"
        expected, last_ns = point_id + 1, bench_ns


def is_object(text: str) -> bool:
    """Whether a text is a JSON object."""
    try:
        return isinstance(json.loads(text), dict)
    except (ValueError, RecursionError):
        return False


def _waveform_faults(database: sqlite3.Connection, found: Found) -> Iterator[str]:
    had = Counter[int]()
    for row in database.execute(f"SELECT {WAVEFORM_COLUMNS} FROM waveform ORDER BY id"):
        found.waveforms += 1
        had[row[0]] += 1
        try:
            waveform_of(*row)
        except (TypeError, ValueError) as error:
            yield str(error)
    for point_id, count in database.execute("SELECT id, waveforms FROM point ORDER BY id"):
        if (there := had.pop(point_id, 0)) != count:
            yield f"point {point_id}: has {there} of its {count} waveforms"
    for point_id, count in had.items():
        yield f"point {point_id} is missing, {count} waveforms of it are there"
