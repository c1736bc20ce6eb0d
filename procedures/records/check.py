"""Looking a run over: what is damaged in it, and what is merely unfinished. Reading only."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from palpate.instrument.errors import RecordError
from palpate.procedures.records.run import Run, reading
from palpate.procedures.records.salvage import salvaging
from palpate.procedures.records.stored import Stored


@dataclass(slots=True)
class Found:
    """Result of a check.

    Attributes:
        hashed: whether a lost row would have been noticed; None: the run cannot be read.
        faults: what is damaged or missing; empty: every row is as it was written.
    """

    folder: Path
    status: str = "damaged"
    points: int = 0
    waveforms: int = 0
    hashed: bool | None = None
    faults: list[str] = field(default_factory=list)


def check(folder: Path) -> Found:
    """Verify every row of a run, that none is missing, and that they make sense together. Raises nothing."""
    found = Found(folder.absolute())
    try:
        run = Run.open(folder)
        found.hashed = run.hashed
        with reading(run.folder) as stored:
            found.faults += _faults(stored, found)
        if run.status == "complete" and not run.summary:
            found.faults.append("it is complete, but its summary is gone")
        found.status = run.status
    except RecordError as error:
        found.faults.append(str(error))
    if found.faults:
        try:
            with salvaging(found.folder) as left:
                found.faults += [f"gone: {what}" for what in left.gone]
        except RecordError as error:
            found.faults.append(str(error))
    return found


def _faults(stored: Stored, found: Found) -> Iterator[str]:
    yield from stored.faults()
    last_ns = 0
    for expected, point in enumerate(stored.points(), 1):
        found.points += 1
        if point.id != expected:
            yield f"point {point.id} stands where point {expected} should"
        if point.bench_ns < last_ns:
            yield f"point {point.id}: bench time goes back from {last_ns} to {point.bench_ns} ns"
        if not isinstance(json.loads(point.text), dict):
            yield f"point {point.id}: its data is no JSON object"
        last_ns = point.bench_ns
    found.waveforms = sum(1 for _ in stored.waveforms())
    stored.events()
