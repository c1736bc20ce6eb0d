"""Salvaging a damaged run into a new one, which says what is gone. The damaged one is only read."""

from __future__ import annotations

import contextlib
import json
import math
import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from instrument.errors import RecordError
from procedures.check import is_object
from procedures.encoding import row_crc32
from procedures.record import REQUIRED, Recorder
from procedures.run import EVENT_COLUMNS, POINT_COLUMNS, WAVEFORM_COLUMNS, Waveform, reading, waveform_of

ENDED = ("complete", "stopped", "failed")


@dataclass(frozen=True, slots=True)
class Repaired:
    """The new run, how much is in it, and what is gone, each in a sentence."""

    folder: Path
    points: int
    waveforms: int
    gone: list[str]


def repair(folder: Path, out: Path) -> Repaired:
    """Write what can be read of the run in `folder` into a new run in `out`.

    Points are numbered anew where some are gone. The new run is complete only where the old one was and nothing is
    gone; else it is stopped, without a summary.

    Raises:
        RecordError: nothing can be salvaged, or `out` cannot be written to.
        UsageError: `out` holds a run.
    """
    folder = folder.absolute()
    gone: list[str] = []
    with reading(folder) as database:
        header = _header(database, gone)
        points = _rows(database, "point", POINT_COLUMNS)
        noted = _rows(database, "event", EVENT_COLUMNS)
        good = [tuple(row) for *row, crc32 in points if is_object(row[2]) and _intact(crc32, *row)]
        events = [row for row in noted if _intact(row[4], *row[1:4])]
        whole: dict[int, dict[str, int]] = {}  # for each point the numbers of its waveforms, by name
        for number, point_id in _rows(database, "waveform", "point_id"):
            if waveform := _waveform(database, number):
                whole.setdefault(point_id, {})[waveform.name] = number
        gone += [f"point {number}" for number in _missing(good, max((*whole, *(row[0] for row in points)), default=0))]
        for number, _, _, count in good:
            if (lost := count - len(left := whole.get(number, {}))) > 0:
                gone.append(f"{lost} of {count} waveforms of point {number}, left: {', '.join(left) or 'none'}")
        gone += [f"event {number}" for number in _missing(events, max((row[0] for row in noted), default=0))]
        status, summary = header.pop("status", "running"), header.pop("summary", {})
        header["repaired"] = {"from": str(folder), "gone": gone}
        kept = 0
        with Recorder.create(out, header) as record:
            for _, bench_ns, kind, message, _ in events:
                record.event(kind, message, bench_ns)
            for number, bench_ns, data, _ in good:
                # Read again, one point at a time: a long run does not fit in memory at once.
                waveforms = [w for of in whole.get(number, {}).values() if (w := _waveform(database, of))]
                record.point(json.loads(data), {w.name: (w.rate, w.samples) for w in waveforms}, bench_ns)
                kept += len(waveforms)
            if gone or status not in ENDED:
                record.finish("stopped", {}, f"repaired; gone: {'; '.join(gone) or 'nothing, but it had not ended'}")
            else:
                record.finish(status, summary, "repaired; nothing is gone")
    return Repaired(out.absolute(), len(good), kept, gone)


def _intact(crc32: int, *values: object) -> bool:
    try:
        return row_crc32(*values) == crc32
    except TypeError:  # a text that has become a blob
        return False


def _waveform(database: sqlite3.Connection, number: int) -> Waveform | None:
    """The waveform in a row; None: it is damaged."""
    try:
        row = database.execute(f"SELECT {WAVEFORM_COLUMNS} FROM waveform WHERE id = ?", (number,)).fetchone()
        return waveform_of(*row)
    except (sqlite3.DatabaseError, TypeError, ValueError):
        return None


def _header(database: sqlite3.Connection, gone: list[str]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for _, key, value, crc32 in _rows(database, "run", "key, value, crc32"):
        try:
            if not _intact(crc32, key, value):
                raise ValueError
            found[key] = json.loads(value)
        except ValueError:
            gone.append(f"{key!r} of the header")
    if lacking := REQUIRED - found.keys():
        raise RecordError(f"nothing can be salvaged: the header lacks {', '.join(sorted(lacking))}")
    return found


def _rows(database: sqlite3.Connection, table: str, columns: str) -> list[tuple[Any, ...]]:
    """What can be read of a table, in order, each behind its number: from its start to the damage, and from its end."""
    found: dict[int, list[Any]] = {}
    for order, beyond in (("ASC", ">"), ("DESC", "<")):
        # A row a query: a cursor has read the next row already, and loses this one where that is damaged.
        query = f"SELECT rowid, {columns} FROM {table} WHERE rowid {beyond} ? ORDER BY rowid {order} LIMIT 1"
        last = -math.inf if order == "ASC" else math.inf
        with contextlib.suppress(sqlite3.DatabaseError):
            while (row := database.execute(query, (last,)).fetchone()) and row[0] not in found:
                last, *found[row[0]] = row
    return [(number, *found[number]) for number in sorted(found)]


def _missing(rows: list[tuple[Any, ...]], last: int) -> list[int]:
    """The numbers from 1 to the last that no row has."""
    numbers = {row[0] for row in rows}
    return [number for number in range(1, max({last, *numbers}, default=0) + 1) if number not in numbers]
