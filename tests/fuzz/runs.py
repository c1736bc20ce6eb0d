"""Run folders. An input is the record.

What is damaged is either found, or leaves points and waveforms as they were.
"""

from __future__ import annotations

import contextlib
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from palpate.instrument.errors import RecordError
from palpate.procedures.records.chain import HEAD_FILE, MAGIC, RECORD
from palpate.procedures.records.damage import check, salvaging
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from tests.fuzz.files import FOLDER, in_file
from tests.fuzz.target import Target, require

HEADER = {"procedure": "sweep loads", "simulated": True, "started": datetime(2026, 11, 21, tzinfo=UTC).isoformat()}
POINTS = [({"load_N": 1.5 + n, "valid": True}, 1_000_000_000 * (n + 1)) for n in range(3)]


@cache
def _stored() -> tuple[dict[str, bytes], list[dict[str, Any]], list[dict[str, Any]], str]:
    folder = FOLDER / "good"
    with Recorder.create(folder, HEADER) as record:
        for data, bench_ns in POINTS:
            waves = {name: (1000.0, np.arange(8.0) * bench_ns) for name in ("rigid", "total")}
            record.point(data, waves, bench_ns)
        record.event("note", "a note", 4_000_000_000)
        record.finish("complete", {"points": 3})
    run = Run.open(folder)
    found = run.points(), run.events(), run.digest()
    files = {name: (folder / name).read_bytes() for name in (RECORD, HEAD_FILE)}
    return files, *found


def decode(data: bytes) -> None:
    files, points, events, digest = _stored()
    folder = Path(FOLDER)
    for name in files:
        (folder / name).unlink(missing_ok=True)
    in_file(RECORD, data)
    in_file(HEAD_FILE, files[HEAD_FILE])
    faults = check(folder).faults
    with contextlib.suppress(RecordError), salvaging(folder) as left:
        salvaged = [{"id": n, "bench_ns": point.bench_ns, **point.data} for n, point in left.points.items()]
        require(all(point in points for point in salvaged), "salvaged", salvaged)
    run = Run.open(folder)
    found = run.points()
    require(run.events() == events, "events", run.events())
    require({**run.header, **run.summary} == {**HEADER, "points": 3}, "header", run.header)
    same = run.digest() == digest
    require(all(point in points for point in found), "points", found)
    require(same or bool(faults), "a run that differs and has no fault", faults)


def run() -> Target:
    return Target(
        [_stored()[0][RECORD]],
        decode,
        [b"\0\0", b"\xff\xff\xff\xff", b"null", b"[", MAGIC, b"WAVE", b"STAT"],
    )
