"""Record format 4: `run.record`, a chain of frames (`procedures/records/chain.py`), with its head `run.head`.

    kind  id     content, canonical JSON
    HEAD  0      {"format": 4, "header": {…}}; the first frame
    WAVE  point  {"first": number of its first sample, "name": …, "rate": Hz}, line feed, little-endian float32
    POIN  point  {"bench_ns": …, "data": {…}, "waveforms": [[name, rate, samples], …]}; completes the WAVE frames before
          Where the samples were stored while they were measured, both also have "dwell": number of the dwell at the
          point, from 1. A dwell that was broken off or rejected leaves frames which belong to nothing.
    EVNT  event  {"bench_ns": …, "kind": …, "message": …}
    STAT  0      {"header": {…}, "status": …, "summary": {…}}; the last one counts, without one the run is "running"

Points and events are numbered from 1. The header in a STAT frame holds entries that replace earlier ones from there on.
Frames of other kinds are ignored. A waveform may be in several frames.
Flag 1 in every frame says that the run is simulated. Behind the frames that the head counts lies at most one addition.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from palpate.instrument.errors import RangeError
from palpate.procedures.records import chain
from palpate.procedures.records.chain import (
    HEAD_FILE,
    LARGEST_ROW,
    RECORD,
    ChainFile,
    Content,
    HashChain,
    Head,
    RecordFrame,
)

FORMAT = 4
HEADER, WAVE, POINT, EVENT, STATUS = b"HEAD", b"WAVE", b"POIN", b"EVNT", b"STAT"
SIMULATED = 1
IN_A_FRAME = 1 << 18  # samples
SAMPLE = np.dtype("<f4")
REAL = "fiub"  # kinds of numpy types: real numbers, and true and false
LONGEST = 100  # characters of a value in a message
_OWN_COLUMNS = frozenset({"id", "bench_ns", "simulated"})
_ENCODER = json.JSONEncoder(sort_keys=True, separators=(",", ":"), allow_nan=False)


class InPieces(NamedTuple):
    """Samples of a waveform that were stored during a dwell, with the number of the dwell at its point."""

    dwell: int
    size: int


Waveforms = Mapping[str, tuple[float, np.ndarray | InPieces]]
Status = Literal["running", "complete", "stopped", "failed"]


@dataclass(frozen=True, slots=True)
class Waveform:
    """Samples of one signal at one point: `samples`, shape (n,), float32; `rate`, Hz."""

    point_id: int
    name: str
    rate: float
    samples: np.ndarray


@dataclass(frozen=True, slots=True)
class StoredPoint:
    """A point as it is stored: `text` is its data as canonical JSON, `waveforms` are the names of its waveforms."""

    id: int
    bench_ns: int
    text: str
    waveforms: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Unfinished:
    """A dwell of which samples are stored, but whose point is not: the point, the dwell's number, and its time [s]."""

    point_id: int
    dwell: int
    seconds: float

    def __str__(self) -> str:
        return f"{self.seconds:.6g} s of a dwell at point {self.point_id} are stored"


# --- canonical JSON and float32 samples ----------------------------------------------------------------


Encoded = list[tuple[str, float, np.ndarray | InPieces]]


def encoded(data: Mapping[str, object], waveforms: Waveforms) -> tuple[str, Encoded]:
    """Encode a point: its text, and name, rate and float32 samples of each waveform. Raises RangeError."""
    if taken := _OWN_COLUMNS & data.keys():
        raise RangeError(f"a point may not have a value {', '.join(sorted(taken))}: the record sets it")
    stored: Encoded = [
        (name, float(rate), samples if isinstance(samples, InPieces) else as_samples(name, rate, samples))
        for name, (rate, samples) in waveforms.items()
    ]
    return as_json(data), stored


def as_json(value: object) -> str:
    """Canonical JSON of a value: keys sorted, no spaces, ASCII, null for NaN and infinities. Raises as `plain` does."""
    try:
        return _ENCODER.encode(value)
    except (TypeError, ValueError):  # numpy's values, NaN, or what is no JSON at all
        return _ENCODER.encode(plain(value))


def plain(value: object, where: str = "") -> object:
    """A value of which JSON can be made: numpy's values as numbers and lists, and null for NaN and infinities.

    Raises RangeError: it holds something else than numbers, texts, true, false, null, and lists and tables of these;
    `where` names its place in the message.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (str, int, float)):
        return value
    if isinstance(value, Mapping):
        return {_name(key, where): plain(item, f"{where}.{key}" if where else str(key)) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item, where) for item in value]
    raise RangeError(
        f"{where or 'it'}: {str(value)[:LONGEST]} is of type {type(value).__name__}, which a record cannot hold; give "
        "numbers, texts, true or false, or lists and tables of these"
    )


def _name(key: object, where: str) -> str:
    """A key of a table as text."""
    if isinstance(key, (str, int)):
        return str(key)
    raise RangeError(f"{where or 'it'}: {key!r} names a value; a name must be a text")


def as_samples(name: str, rate: float, samples: np.ndarray) -> np.ndarray:
    """Samples as they are stored. Raises RangeError: they cannot be, or their rate is none."""
    if not (math.isfinite(rate) and rate > 0):
        raise RangeError(f"waveform {name!r}: the sample rate is {rate} Hz; it must be positive and finite")
    samples = np.asarray(samples)
    if samples.dtype.kind not in REAL:
        raise RangeError(f"waveform {name!r}: the samples are {samples.dtype}; they must be numbers")
    if samples.ndim != 1:
        raise RangeError(f"waveform {name!r}: the samples have shape {samples.shape}; they must be (n,)")
    try:
        with np.errstate(over="raise"):
            return np.ascontiguousarray(samples, dtype=SAMPLE)
    except FloatingPointError:
        limit = float(np.finfo(SAMPLE).max)
        raise RangeError(f"waveform {name!r}: a sample is beyond float32 (±{limit:.3g})") from None


# --- frames --------------------------------------------------------------------------------------------


def chain_of(header: Mapping[str, object]) -> bytes:
    """Name of a run's chain. It is made from the header, so that equal runs have equal bytes."""
    return hashlib.sha256(as_json(header).encode()).digest()[:16]


def header_frame(header: Mapping[str, object]) -> Content:
    """The frame of a run's header."""
    return HEADER, 0, [as_json({"format": FORMAT, "header": header}).encode()]


def point_frames(point_id: int, data: Mapping[str, object], waveforms: Waveforms, bench_ns: int) -> list[Content]:
    """Frames of a point with its waveforms. Raises RangeError: they cannot be stored."""
    text, stored = encoded(data, waveforms)
    frames: list[Content] = []
    dwell = next((samples.dwell for _, _, samples in stored if isinstance(samples, InPieces)), 0)
    for name, rate, samples in stored:
        if not isinstance(samples, InPieces):
            for first in range(0, samples.size, IN_A_FRAME):
                frames.append(wave_frame(point_id, name, rate, samples[first : first + IN_A_FRAME], first, dwell))
    listed = as_json([[name, rate, samples.size] for name, rate, samples in stored])
    dwell_text = f',"dwell":{dwell}' if dwell else ""
    content = f'{{"bench_ns":{bench_ns},"data":{text}{dwell_text},"waveforms":{listed}}}'
    if len(content) > LARGEST_ROW:
        raise RangeError(f"point {point_id} has {len(content)} bytes, {LARGEST_ROW} are the most")
    frames.append((POINT, point_id, [content.encode()]))
    return frames


def wave_frame(point_id: int, name: str, rate: float, samples: np.ndarray, first: int, dwell: int) -> Content:
    """A frame of a waveform's samples, from number `first` on; dwell 0: they are stored with their point."""
    about: dict[str, object] = {"first": first, "name": name, "rate": rate}
    about_text = as_json({**about, "dwell": dwell} if dwell else about).encode() + b"\n"
    return WAVE, point_id, [about_text, samples.view(np.uint8).data]


def event_frame(event_id: int, kind: str, message: str, bench_ns: int) -> Content:
    """The frame of an event. Bytes of a file's name in the message that are not UTF-8 are escaped."""
    text = message.encode(errors="backslashreplace").decode()
    return EVENT, event_id, [as_json({"bench_ns": bench_ns, "kind": kind, "message": text}).encode()]


def status_frame(status: str, summary: Mapping[str, object], header: Mapping[str, object] | None = None) -> Content:
    """`header`: entries of it that hold from now on."""
    return STATUS, 0, [as_json({"header": header or {}, "status": status, "summary": summary}).encode()]


class Record:
    """A record as it was at one moment, whose links are whole. Contents are verified when they are read.

    Reading a damaged part raises ValueError, TypeError or KeyError.

    Attributes:
        header: the header, without `status` and `summary`.
    """

    def __init__(self, linked: HashChain) -> None:
        """Read the frames of a chain. Raises ValueError: it is no run, or damaged."""
        self._file, self.head, self.frames = linked.file, linked.head, linked.frames
        head = self.head
        self.status = "running"
        self.summary: Mapping[str, Any] = {}
        self._points: dict[int, RecordFrame] = {}
        self._waves: dict[int, list[RecordFrame]] = {}
        self._events: list[RecordFrame] = []
        header = self.json(self.frames[0])
        if self.frames[0].kind != HEADER or header["format"] != FORMAT:
            raise ValueError(f"its record format is not {FORMAT}")
        self.header: Mapping[str, Any] = header["header"]
        if chain_of(self.header) != head.chain:
            raise ValueError("its header belongs to other rows")
        for frame in self.frames:
            match frame.kind:
                case b"WAVE":
                    self._waves.setdefault(frame.id, []).append(frame)
                case b"POIN":
                    self._points[frame.id] = frame
                case b"EVNT":
                    self._events.append(frame)
                case b"STAT":
                    found = self.json(frame)
                    self.status, self.summary = found["status"], found["summary"]
                    self.header = {**self.header, **found["header"]}
                case _:
                    self.json(frame)  # its kind may be damaged
        if len(self._points) < head.points or len(self._events) < head.events:
            raise ValueError(f"some of its {head.points} points and {head.events} events are missing")

    def count(self) -> int:
        """Number of points."""
        return len(self._points)

    def points(self) -> Iterator[StoredPoint]:
        """All points in order."""
        for point_id, frame in self._points.items():
            found = self.json(frame)
            yield StoredPoint(
                point_id, found["bench_ns"], as_json(found["data"]), tuple(w[0] for w in found["waveforms"])
            )

    def rows(self) -> Iterator[dict[str, Any]]:
        """The data of all points in order, with `id` and `bench_ns`."""
        for point_id, frame in self._points.items():
            found = self.json(frame)
            yield {"id": point_id, "bench_ns": found["bench_ns"], **found["data"]}

    def events(self) -> list[dict[str, Any]]:
        """All events in order: `bench_ns`, `kind`, `message`."""
        return [self.json(frame) for frame in self._events]

    def waveforms(self, point_id: int | None = None, name: str | None = None) -> Iterator[Waveform]:
        """Waveforms in order, one in memory at a time; only those of a point and a name where these are given."""
        for frame in self._points.values():
            if point_id in (None, frame.id):
                content = self.json(frame)
                listed = content["waveforms"]
                whole = whole_waveforms(self._file, self._waves.get(frame.id, []), listed, content.get("dwell", 0))
                for its_name, rate, _ in listed:
                    if its_name not in whole:
                        raise ValueError(f"waveform {its_name!r} of point {frame.id} is not as it was written")
                    if name in (None, its_name):
                        yield Waveform(frame.id, its_name, rate, whole[its_name])

    def stored_waveforms(self, point_id: int) -> Encoded:
        """Name, rate and samples of the waveforms of a point; samples in pieces are not read."""
        content = self.json(self._points[point_id])
        if dwell := content.get("dwell", 0):
            return [(name, rate, InPieces(dwell, size)) for name, rate, size in content["waveforms"]]
        return [(each.name, each.rate, each.samples) for each in self.waveforms(point_id)]

    def unfinished(self) -> Unfinished | None:
        """The dwell whose samples are stored, but not its point. Raises ValueError: it is damaged."""
        frames = [each for waves in self._waves.values() for each in waves if each.number < self.head.frames]
        last = max(frames, key=lambda frame: frame.number, default=None)
        if last is None or last.id in self._points:
            return None
        wave = wave_of(self._file, last)
        return Unfinished(last.id, wave.dwell, (wave.first + wave.samples.size) / wave.rate)

    def faults(self) -> Iterator[str]:
        """One sentence for each damage between points, waveforms and events, which none of them shows."""
        for point_id in self._waves.keys() - self._points.keys():
            for frame in self._waves[point_id]:
                if self._file.content(frame) is None:
                    yield f"{named(frame)} is not as it was written"
        end = self.frames[-1].end
        if self.status == "complete" and not self._file.only_zeros(end):
            yield f"{RECORD} goes on after its end, from byte {end} on"

    def head_at_end(self) -> Head:
        """Head that counts all whole frames up to the last complete point, event or status."""
        # Waveforms at the end have no point: the writer was killed between them.
        last = max(n for n, frame in enumerate(self.frames) if frame.kind != WAVE or n < self.head.frames)
        end = self.frames[last]
        points, events = len(self._points), len(self._events)
        return replace(self.head, frames=last + 1, length=end.end, points=points, events=events, hash=end.hash)

    def tail(self) -> bytes:
        """Bytes of the whole frames that the head does not count yet."""
        return self._file.read(self.head.length, self.head_at_end().length - self.head.length)

    def json(self, frame: RecordFrame) -> Any:
        """The content of a frame. Raises ValueError: it is damaged."""
        content = self._file.content(frame)
        if content is None:
            raise ValueError(f"{named(frame)} is not as it was written")
        return json.loads(content)


class Wave(NamedTuple):
    """What a WAVE frame holds, and where it begins in the file."""

    point_id: int
    dwell: int
    first: int
    name: str
    rate: float
    samples: np.ndarray
    at: int


def unpacked(frame: Content, at: int = 0) -> Wave:
    """Read the content of a WAVE frame."""
    _, point_id, parts = frame
    about, _, samples = b"".join(parts).partition(b"\n")
    content, values = json.loads(about), np.frombuffer(samples, SAMPLE)
    return Wave(point_id, content.get("dwell", 0), content["first"], content["name"], content["rate"], values, at)


def wave_of(file: ChainFile, frame: RecordFrame) -> Wave:
    """Read a WAVE frame from a file. Raises ValueError: it is damaged."""
    content = file.content(frame)
    if content is None:
        raise ValueError(f"{named(frame)} is not as it was written")
    return unpacked((WAVE, frame.id, [content]), frame.at)


def waves(file: ChainFile, at: int) -> Iterator[Wave]:
    """All WAVE frames of dwells that were stored while they lasted, from a place in the file on. Raises ValueError."""
    while (frame := file.frame(at)) is not None:
        at = frame.end
        if frame.kind == WAVE and (wave := wave_of(file, frame)).dwell:
            yield wave


def whole_waveforms(
    file: ChainFile, frames: Iterable[RecordFrame], listed: list[Any], dwell: int = 0
) -> dict[str, np.ndarray]:
    """Samples (n,) float32 by name, of each waveform of a point that its WAVE frames hold completely.

    Args:
        file: file of the chain.
        frames: the WAVE frames of the point.
        listed: name, rate and number of samples of each waveform, as the point says.
        dwell: number of the dwell to which they belong; 0: they were stored with the point.
    """
    parts: dict[tuple[str, float], list[tuple[int, np.ndarray]]] = {}
    for frame in frames:
        with contextlib.suppress(ValueError):
            wave = wave_of(file, frame)
            if wave.dwell == dwell:
                parts.setdefault((wave.name, wave.rate), []).append((wave.first, wave.samples))
    found = {}
    for name, rate, size in listed:
        end, pieces = 0, [np.empty(0, SAMPLE)]
        for first, piece in sorted(parts.get((name, rate), []), key=lambda part: part[0]):
            if first == end:
                end += piece.size
                pieces.append(piece)
        if end == size:
            found[name] = np.concatenate(pieces)
    return found


def named(frame: RecordFrame) -> str:
    """Name of a frame in messages."""
    match frame.kind:
        case b"HEAD":
            return "the header"
        case b"WAVE":
            return f"a waveform of point {frame.id}"
        case b"POIN":
            return f"point {frame.id}"
        case b"EVNT":
            return f"event {frame.id}"
        case b"STAT":
            return "the status"
    return f"row {frame.number}"


@contextlib.contextmanager
def opened(folder: Path) -> Iterator[Record]:
    """Open the record in a folder. Raises OSError: there is none; ValueError: it is damaged."""
    with chain.opened(folder / RECORD, folder / HEAD_FILE) as found:
        yield Record(found)
