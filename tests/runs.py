"""Runs on disk that no procedure has recorded: rewritten on purpose, or with more points than a test has time for."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from palpate.procedures.records.chain import HEAD_FILE, NOTHING, RECORD, Head, packed
from palpate.procedures.records.record_file import (
    SIMULATED,
    Waveforms,
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
    _put(folder, parts, head)


def made(
    folder: Path,
    header: Mapping[str, Any],
    points: Iterable[tuple[Mapping[str, Any], Waveforms]],
    summary: Mapping[str, Any] = MappingProxyType({}),
) -> None:
    """Writes a complete run of points with their waveforms at once, one a second of bench time."""
    frames, number = [header_frame(header)], 0
    for number, (data, waveforms) in enumerate(points, 1):
        frames += point_frames(number, data, waveforms, number * 10**9)
    frames.append(status_frame("complete", summary))
    start = Head(chain_of(header), 0, 0, 0, 0, 0, NOTHING)
    folder.mkdir(parents=True)
    _put(folder, *packed(start, frames, SIMULATED if header["simulated"] else 0, number, 0))


def _put(folder: Path, parts: Iterable[bytes], head: Head) -> None:
    (folder / RECORD).write_bytes(b"".join(parts))
    (folder / HEAD_FILE).write_bytes(head.packed() + head.again().packed())


def flip(file: Path, text: bytes = b"", beside: int = 0) -> None:
    """Flips a bit of a file: in its middle, or so many bytes from where a text in it begins."""
    content = bytearray(file.read_bytes())
    content[content.index(text) + beside if text else len(content) // 2] ^= 1
    file.write_bytes(content)


# --- a campaign --------------------------------------------------------------------------------------

NIGHTLY = """
name = "nightly"
scene = "noisy_lab"

[step.sweep]
procedure = "sweep-loads"
needs = ["films"]
settings = { samples = "1,2", loads = ["2 N", "3 N"], dwell = "0.5 s" }

[step.films]
procedure = "calibrate-films"
needs = ["cell"]
due = "7 d"
settings = { loads = "1.5 N, 2 N, 3 N, 4 N", dwell = "0.5 s" }

[step.cell]
procedure = "calibrate-load-cell"
due = "30 d"
"""
