"""Search of a damaged run's file for everything that is left, row by row, and the list of what is lost."""

from __future__ import annotations

import contextlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from palpate.instrument.errors import RecordError
from palpate.procedures.records import format3
from palpate.procedures.records.chain import ChainFile, Frame, read_head
from palpate.procedures.records.encoding import row_crc32
from palpate.procedures.records.pages import read_pages
from palpate.procedures.records.record_file import HEAD_FILE, RECORD, SIMULATED, WAVE, whole_waveforms
from palpate.procedures.records.run import is_format4

Waves = dict[str, tuple[float, np.ndarray]]


@dataclass(frozen=True, slots=True)
class LeftPoint:
    """A point that is left: its data, and the number of waveforms that it had."""

    bench_ns: int
    data: dict[str, Any]
    waveforms: int


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
            if (lost := point.waveforms - len(whole)) > 0:
                left = ", ".join(whole) or "none"
                self.gone.append(f"{lost} of {point.waveforms} waveforms of point {number}, left: {left}")
        self.gone += _missing("event {}", "events {} to {}", self.events, last_event)


@contextlib.contextmanager
def salvaging(folder: Path) -> Iterator[Left]:
    """What is left of the run in a folder, which is only read. Raises RecordError: its file cannot be read."""
    with contextlib.ExitStack() as stack:
        if is_format4(folder):
            with _reading(folder / RECORD):
                file = stack.enter_context(ChainFile(folder / RECORD))
            yield _of_chain(file, folder / HEAD_FILE)
        else:
            yield _of_pages(folder)


def _of_chain(file: ChainFile, head_file: Path) -> Left:
    head, fault = read_head(head_file)
    # A frame in its place in the chain counts more than another one with the same number elsewhere.
    found = [*(frame for frame in file.walk(head) if file.content(frame) is not None), *file.scan()]
    chain, _ = Counter(frame.chain for frame in found).most_common(1)[0] if found else (b"", 0)
    if head is not None and head.chain != chain:
        head, fault = None, f"{HEAD_FILE} is that of another run"
    numbered: dict[int, Frame] = {}
    for frame in found:
        if frame.chain == chain:
            numbered.setdefault(frame.number, frame)
    frames = [frame for _, frame in sorted(numbered.items())]
    waves: dict[int, list[Frame]] = {}
    listed: dict[int, list[Any]] = {}
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
                listed[frame.id] = content["waveforms"]
                left.points[frame.id] = LeftPoint(content["bench_ns"], content["data"], len(listed[frame.id]))

    def waveforms(point: int) -> Waves:
        rates = {name: rate for name, rate, _ in listed[point]}
        whole = whole_waveforms(file, waves.get(point, []), listed[point])
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
    if fault and left.status != "complete":
        left.gone.append("what followed the last row, if anything did")
    return left


def _of_pages(folder: Path) -> Left:
    path, log = folder / format3.DATABASE, folder / format3.LOG
    pages = read_pages(_content(path), _content(log) if log.exists() else b"")
    header: dict[str, tuple[int, Any]] = {}
    waves: dict[int, dict[str, tuple[int, float, np.ndarray]]] = {}
    left = Left()
    last_point = last_event = 0
    for sure, number, values in pages.rows():
        try:
            match values:
                case [key, value, int(crc32)]:
                    key, value = _text(key), _text(value)
                    if row_crc32(key, value) == crc32 and (sure or key not in header):
                        header[key] = (number, json.loads(value))
                case [None, int(bench_ns), data, int(count), int(crc32)]:
                    last_point = max(last_point, number if sure else 0)
                    if row_crc32(number, bench_ns, data := _text(data), count) == crc32:
                        left.points[number] = LeftPoint(bench_ns, json.loads(data), count)
                case [None, int(bench_ns), kind, message, int(crc32)]:
                    last_event = max(last_event, number if sure else 0)
                    event = (bench_ns, _text(kind), _text(message))
                    if row_crc32(*event) == crc32:
                        left.events[number] = event
                case [None, int(point), name, int() | float() as rate, bytes(samples), int(crc32)]:
                    waveform = format3.waveform_of(point, _text(name), float(rate), samples, crc32)
                    waves.setdefault(point, {})[waveform.name] = (number, waveform.rate, waveform.samples)
        except (TypeError, ValueError, RecursionError):
            continue  # not a row, or not as it was written
    left.points = dict(sorted(left.points.items()))
    left.events = dict(sorted(left.events.items()))
    left.waveforms = lambda point: {
        name: (rate, samples)
        for name, (_, rate, samples) in sorted(waves.get(point, {}).items(), key=lambda w: w[1][0])
    }
    left.header = {key: value for key, (_, value) in sorted(header.items(), key=lambda entry: entry[1][0])}
    left.note_gone(max(last_point, *waves, 0), last_event)
    numbers = {number for number, _ in header.values()}
    left.gone += _missing("entry {} of the header", "entries {} to {} of the header", numbers, 0)
    left.gone += [f"{key!r} of the header" for key in ("status", "summary") if key not in header]
    left.status, left.summary = left.header.pop("status", "running"), left.header.pop("summary", {})
    simulated = left.header.get("simulated")
    left.simulated = simulated if isinstance(simulated, bool) else None
    return left


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RecordError(f"cannot read {path}: {error.strerror}; make it readable or restore it") from error


def _content(path: Path) -> bytes:
    with _reading(path), ChainFile(path) as file:
        return file.read(0, file.size)


def _text(value: object) -> str:
    """Text of a column. It may have become a blob, because no checksum holds the bit that tells them apart."""
    if not isinstance(value, bytes):
        raise TypeError
    return value.decode()


def _missing(one: str, several: str, there: Iterable[int], last: int) -> list[str]:
    """The numbers from 1 to the last that are missing, with one text for each gap.

    A damaged number may be as great as 2^48, so gaps are not counted number by number.
    """
    numbers = {0, *there}
    ends = sorted({*numbers, max(last, *numbers) + 1})
    gaps = [(before + 1, after - 1) for before, after in pairwise(ends) if before + 1 < after]
    return [one.format(first) if first == end else several.format(first, end) for first, end in gaps]
