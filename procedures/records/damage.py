"""Damage of runs: a check finds it, a search finds what is left, and a repair writes that into a new run.

Check and search only read. The search finds whole rows wherever they lie in the file, and lists what is lost.
"""

from __future__ import annotations

import contextlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from palpate.instrument.errors import RecordError
from palpate.procedures.records.chain import (
    HEAD_FILE,
    RECORD,
    ChainFile,
    RecordFrame,
    check_holes,
    last_modified,
    read_head,
)
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.record_file import SIMULATED, WAVE, Record, whole_waveforms
from palpate.procedures.records.run import Run, reading


@dataclass(slots=True)
class DamageReport:
    """Result of a check.

    Attributes:
        points, waveforms: how many are whole.
        faults: what is damaged or missing; empty: every row is as it was written.
        unfinished: what is stored of a dwell whose point is not stored; empty: nothing.
    """

    folder: Path
    status: str = "damaged"
    points: int = 0
    waveforms: int = 0
    faults: list[str] = field(default_factory=list)
    unfinished: str = ""


def check(folder: Path) -> DamageReport:
    """Verify every row of a run, that none is missing, and that they make sense together. Raises nothing."""
    found = DamageReport(folder.absolute())
    try:
        run = Run.open(folder)
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
                found.points = len(left.points)
                found.waveforms = sum(len(left.waveforms(number)) for number in left.points)
        except RecordError as error:
            found.faults.append(str(error))
    return found


def _faults(stored: Record, found: DamageReport) -> Iterator[str]:
    yield from stored.faults()
    last_ns = 0
    for expected, point in enumerate(stored.rows(), 1):
        found.points += 1
        if point["id"] != expected:
            yield f"point {point['id']} stands where point {expected} should"
        if point["bench_ns"] < last_ns:
            yield f"point {point['id']}: bench time goes back from {last_ns} to {point['bench_ns']} ns"
        last_ns = point["bench_ns"]
    found.waveforms = sum(1 for _ in stored.waveforms())
    stored.events()
    found.unfinished = str(stored.unfinished() or "")


# --- what is left --------------------------------------------------------------------------------------

Waves = dict[str, tuple[float, np.ndarray]]


@dataclass(frozen=True, slots=True)
class LeftPoint:
    """A point that is left: its data, and the names of the waveforms that it had."""

    bench_ns: int
    data: dict[str, Any]
    waveforms: Sequence[str]


@dataclass(slots=True)
class Left:
    """What is left of a run.

    Attributes:
        header: what is left of the header.
        simulated: whether the run is simulated; None: nothing tells.
        points, events: points and events by their numbers, from 1.
        waveforms: whole waveforms of each point by its number: rate and samples by name.
        gone: a few words for each thing that is missing or damaged.
    """

    header: dict[str, Any] = field(default_factory=dict)
    simulated: bool | None = None
    status: str = "running"
    summary: Mapping[str, Any] = field(default_factory=dict)
    points: dict[int, LeftPoint] = field(default_factory=dict)
    events: dict[int, tuple[int, str, str]] = field(default_factory=dict)
    waveforms: Callable[[int], Waves] = lambda _point: {}
    gone: list[str] = field(default_factory=list)

    def note_gone(self, last_point: int, last_event: int) -> None:
        """Note which points and events up to these numbers are missing, and which of their waveforms."""
        self.gone += _missing("point {}", "points {} to {}", self.points, last_point)
        for number, point in self.points.items():
            whole = self.waveforms(number)
            if lost := [name for name in point.waveforms if name not in whole]:
                left = ", ".join(whole) or "none"
                self.gone.append(f"waveform {', '.join(lost)} of point {number}, left: {left}")
        self.gone += _missing("event {}", "events {} to {}", self.events, last_event)


@contextlib.contextmanager
def salvaging(folder: Path) -> Iterator[Left]:
    """What is left of the run in a folder, which is only read. Raises RecordError: its file cannot be read."""
    check_holes(folder / RECORD)
    with contextlib.ExitStack() as stack:
        with _reading(folder / RECORD):
            file = stack.enter_context(ChainFile(folder / RECORD))
        yield _of_chain(file, folder / HEAD_FILE)


def _of_chain(file: ChainFile, head_file: Path) -> Left:
    head, fault = read_head(head_file)
    # A frame in its place in the chain counts more than another one with the same number elsewhere.
    found = [*(frame for frame in file.walk(head) if file.content(frame) is not None), *file.scan()]
    chain, _ = Counter(frame.chain for frame in found).most_common(1)[0] if found else (b"", 0)
    if head is not None and head.chain != chain:
        head, fault = None, f"{HEAD_FILE} is that of another run"
    numbered: dict[int, RecordFrame] = {}
    for frame in found:
        if frame.chain == chain:
            numbered.setdefault(frame.number, frame)
    frames = [frame for _, frame in sorted(numbered.items())]
    waves: dict[int, list[RecordFrame]] = {}
    listed: dict[int, tuple[list[Any], int]] = {}
    left = Left()
    for frame in frames:
        left.simulated = bool(frame.flags & SIMULATED)
        if frame.kind == WAVE:
            waves.setdefault(frame.id, []).append(frame)
            continue
        content = json.loads(file.content(frame) or b"{}")
        match frame.kind:
            case b"HEAD":
                left.header = content["header"]
            case b"STAT":
                left.status, left.summary = content["status"], content["summary"]
                left.header |= content["header"]
            case b"EVNT":
                left.events[frame.id] = (content["bench_ns"], content["kind"], content["message"])
            case b"POIN":
                listed[frame.id] = content["waveforms"], content.get("dwell", 0)
                left.points[frame.id] = LeftPoint(
                    content["bench_ns"], content["data"], [name for name, *_ in listed[frame.id][0]]
                )

    def waveforms(point: int) -> Waves:
        rates = {name: rate for name, rate, _ in listed[point][0]}
        whole = whole_waveforms(file, waves.get(point, []), *listed[point])
        return {name: (rates[name], samples) for name, samples in whole.items()}

    left.waveforms = waveforms
    if head is None:
        left.note_gone(max(waves, default=0), 0)
    else:
        left.note_gone(head.points, head.events)
    if 0 not in numbered:
        left.gone.append("the header")
    if head is not None and not left.gone and len(frames) < head.frames:
        left.gone.append("the status or the summary")
    if head is not None:
        counted = {each[0].id for each in waves.values() if each[0].number < head.frames}
        unfinished = sorted(number for number in counted - left.points.keys() if number > head.points)
        left.gone += [f"what was stored of a dwell at point {number}, which was not finished" for number in unfinished]
    if fault and left.status != "complete":
        left.gone.append("what followed the last row, if anything did")
    return left


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RecordError(f"cannot read {path}: {error.strerror}; make it readable or restore it") from error


def _missing(one: str, several: str, there: Iterable[int], last: int) -> list[str]:
    """The numbers from 1 to the last that are missing, with one text for each gap.

    A damaged number may be as great as 2^48, so gaps are not counted number by number.
    """
    numbers = {0, *there}
    ends = sorted({*numbers, max(last, *numbers) + 1})
    gaps = [(before + 1, after - 1) for before, after in pairwise(ends) if before + 1 < after]
    return [one.format(first) if first == end else several.format(first, end) for first, end in gaps]


# --- repair --------------------------------------------------------------------------------------------

ENDED = ("complete", "stopped", "failed")
UNKNOWN = "unknown"  # procedure of a run whose header is lost


@dataclass(frozen=True, slots=True)
class Repaired:
    """Result of a repair: folder, points and waveforms of the new run, and losses."""

    folder: Path
    points: int
    waveforms: int
    gone: list[str]


def repair(folder: Path, out: Path) -> Repaired:
    """Write every whole row of the run in `folder` into a new run in `out`.

    Points are numbered anew where some are lost. The new run is complete only where the old one was complete and
    nothing is lost; otherwise it is stopped and has no summary.

    Raises:
        RecordError: nothing can be saved, or `out` cannot be written to.
        UsageError: `out` holds a run.
    """
    folder = folder.absolute()
    with salvaging(folder) as left:
        if not (left.header or left.points or left.events):
            raise RecordError(f"nothing can be salvaged: {folder} has no whole row")
        header = _header(left, folder)
        header["repaired"] = {"from": str(folder), "gone": left.gone}
        kept = 0
        with Recorder.create(out, header) as record:
            for bench_ns, kind, message in left.events.values():
                record.event(kind, message, bench_ns)
            for number, point in left.points.items():
                waveforms = left.waveforms(number)
                record.point(point.data, waveforms, point.bench_ns)
                kept += len(waveforms)
            if left.gone or left.status not in ENDED:
                gone = "; ".join(left.gone) or "nothing, but it had not ended"
                record.finish("stopped", {}, f"repaired; gone: {gone}")
            else:
                record.finish(left.status, left.summary, "repaired; nothing is gone")  # type: ignore[arg-type]
        return Repaired(out.absolute(), len(left.points), kept, left.gone)


def _header(left: Left, folder: Path) -> dict[str, Any]:
    """What is left of the header. Required entries that are lost are replaced and listed as lost."""
    header = dict(left.header)
    made_up = {
        "procedure": UNKNOWN,
        "simulated": left.simulated is not False,  # a simulated run must not pass for a real one
        "started": last_modified(folder).isoformat(timespec="seconds"),
    }
    for key, value in made_up.items():
        if key not in header:
            header[key] = value
        if key not in left.header and not (key == "simulated" and left.simulated is not None):
            left.gone.append(f"{key!r} of the header, now {value!r}")
    return header
