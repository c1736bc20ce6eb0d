"""Runs on disk that are not as the recorder leaves them: rewritten on purpose, or of record format 3."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from palpate.procedures.records import format3
from palpate.procedures.records.chain import NOTHING, Head
from palpate.procedures.records.chain_writer import packed
from palpate.procedures.records.encoding import row_crc32, waveform_crc32
from palpate.procedures.records.record_file import (
    HEAD_FILE,
    RECORD,
    SIMULATED,
    chain_of,
    event_frame,
    header_frame,
    point_frames,
    status_frame,
)
from palpate.procedures.records.run import reading

Change = Callable[[dict[str, Any]], None]


def _nothing(_values: dict[str, Any]) -> None:
    pass


def rehash(
    folder: Path, *, header: Change = _nothing, point: Change = _nothing, number: int = 0, status: str | None = None
) -> None:
    """Writes a run anew, with another header, another point of that number, or another status: a forgery."""
    with reading(folder) as stored:
        stored_header: dict[str, Any] = json.loads(json.dumps(stored.header))
        header(stored_header)
        frames = [header_frame(stored_header)]
        events = stored.events()
        for each in stored.points():
            data = json.loads(each.text)
            if each.id == number:
                point(data)
            waveforms = {w.name: (w.rate, w.samples) for w in stored.waveforms(each.id)}
            frames += point_frames(each.id, data, waveforms, each.bench_ns)
        for event_id, event in enumerate(events, 1):
            frames.append(event_frame(event_id, event["kind"], event["message"], event["bench_ns"]))
        frames.append(status_frame(stored.status if status is None else status, stored.summary))
        start = Head(chain_of(stored_header), 0, 0, 0, 0, 0, NOTHING)
        flags = SIMULATED if stored_header["simulated"] else 0
        parts, head = packed(start, frames, flags, stored.count(), len(events))
    (folder / RECORD).write_bytes(b"".join(parts))
    (folder / HEAD_FILE).write_bytes(head.packed() + head.again().packed())


def as_format3(folder: Path, *, killed: bool = False) -> None:
    """Turns a run into one of record format 3; `killed` leaves its points in the log of the database."""
    path = folder / format3.DATABASE
    with reading(folder) as stored, closing(sqlite3.connect(path)) as database:
        database.executescript(format3.SCHEMA)
        header: Mapping[str, Any] = {**stored.header, "status": stored.status, "summary": stored.summary}
        rows = [(key, json.dumps(value, sort_keys=True, separators=(",", ":"))) for key, value in header.items()]
        database.executemany("INSERT INTO run VALUES (?, ?, ?)", [(*row, row_crc32(*row)) for row in rows])
        database.commit()
        if killed:
            database.execute("PRAGMA journal_mode = WAL")
        for point in stored.points():
            row = (point.id, point.bench_ns, point.text, len(point.waveforms))
            database.execute("INSERT INTO point VALUES (?, ?, ?, ?, ?)", (*row, row_crc32(*row)))
            for w in stored.waveforms(point.id):
                crc32 = waveform_crc32(w.point_id, w.name, w.rate, w.samples)
                database.execute(
                    "INSERT INTO waveform (point_id, name, rate, samples, crc32) VALUES (?, ?, ?, ?, ?)",
                    (w.point_id, w.name, w.rate, w.samples.tobytes(), crc32),
                )
            database.commit()
        for event in stored.events():
            values = (event["bench_ns"], event["kind"], event["message"])
            database.execute(
                "INSERT INTO event (bench_ns, kind, message, crc32) VALUES (?, ?, ?, ?)", (*values, row_crc32(*values))
            )
        database.commit()
        if killed:
            aside = folder.with_name(f"{folder.name}-copy")
            shutil.copytree(folder, aside)
    if killed:
        shutil.rmtree(folder)
        aside.rename(folder)
    (folder / RECORD).unlink()
    (folder / HEAD_FILE).unlink()
