"""Salvaging a damaged run into a new one, which says what is gone. The damaged one is only read."""

from __future__ import annotations

import contextlib
import json
import math
import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from instrument.errors import RecordError
from procedures.check import is_object
from procedures.record import REQUIRED, Recorder
from procedures.run import WAVEFORM_COLUMNS, WAVEFORMS, WaveformRow, opened, reading, row_crc32, samples_of

EVENT_COLUMNS = "bench_ns, kind, message, crc32"
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
        points = _rows(database, "point", "bench_ns, data, crc32")
        numbered = _rows(database, "waveform", WAVEFORM_COLUMNS)
        noted = _rows(database, "event", EVENT_COLUMNS)
    rows = [WaveformRow(*row) for _, *row in numbered]
    good = [tuple(row) for *row, crc32 in points if is_object(row[2]) and row_crc32(*row) == crc32]
    events = [row for row in noted if row_crc32(*row[1:4]) == row[4]]
    last = max((*(row.point_id for row in rows), *(point[0] for point in points)), default=0)
    gone += [f"point {number}" for number in _missing(good, last)]
    gone += [f"waveform {number}" for number in _missing(numbered, 0)]
    gone += [f"event {number}" for number in _missing(events, max((row[0] for row in noted), default=0))]
    status, summary = header.pop("status", "running"), header.pop("summary", {})
    with contextlib.ExitStack() as stack:
        try:
            file = stack.enter_context(opened(folder / WAVEFORMS))
            broken = {row: said for row in rows if isinstance(said := samples_of(file, row), RecordError)}
        except RecordError as error:  # the file is gone; the points still have their values
            broken = dict.fromkeys(rows, error)
        gone += [str(error) for error in broken.values()]
        numbers = {number for number, *_ in good}
        kept = [row for row in rows if row not in broken and row.point_id in numbers]
        header["repaired"] = {"from": str(folder), "gone": gone}
        record = stack.enter_context(Recorder.create(out, header))
        for _, bench_ns, kind, message, _ in events:
            record.event(kind, message, bench_ns)
        for number, bench_ns, data in good:
            own = [row for row in kept if row.point_id == number]
            record.point(json.loads(data), {row.name: (row.rate, _array(file, row)) for row in own}, bench_ns)
        if gone or status not in ENDED:
            record.finish("stopped", {}, f"repaired; gone: {'; '.join(gone) or 'nothing, but it had not ended'}")
        else:
            record.finish(status, summary, "repaired; nothing is gone")
    return Repaired(out.absolute(), len(good), len(kept), gone)


def _header(database: sqlite3.Connection, gone: list[str]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for _, key, value, crc32 in _rows(database, "run", "key, value, crc32"):
        try:
            if row_crc32(key, value) != crc32:
                raise ValueError
            found[key] = json.loads(value)
        except (ValueError, TypeError):
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


def _array(file: BinaryIO, row: WaveformRow) -> np.ndarray:
    samples = samples_of(file, row)
    if isinstance(samples, RecordError):  # it was whole a moment ago
        raise samples
    return samples
