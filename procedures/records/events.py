"""What happens in a run, told while it goes on: in its own process, and in any other that reads its record.

    for event in followed(Path("runs/20260102T030405Z-sweep-loads")):
        print(event.kind, event.data)

An event that the record holds is told once it is on disk, and is the same for a listener of the run and for `followed`.
What the run does now (`step`), how long it will still take (`promise`) and what the films show (`trace`) is not
recorded: only listeners hear of it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from palpate.drivers.clock import WallClock
from palpate.procedures.records.chain import HEAD_FILE, NOTHING, RECORD, ChainFile, check_holes, is_written, read_head
from palpate.procedures.records.record_file import EVENT, HEADER, POINT, STATUS, as_json, named
from palpate.procedures.records.run import telling_damage

Kind = Literal["begun", "planned", "step", "trace", "point", "incident", "paused", "resumed", "promise", "ended"]

POLL = 0.05  # s between two looks at a record that grows
SILENCE = 2.0  # s without news after which `followed` asks whether the run is still being written
SETTINGS = ("procedure", "simulated", "started", "scene", "seed", "settings", "planned")  # of a header that are told


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened in a run. What `data` holds follows from the kind::

        begun     run (folder), points (stored by an earlier part of the run), and of the
                  record's header procedure, simulated, started, scene, seed, settings
        planned   points (number), seconds (bench time of the whole), u (relative standard
                  uncertainty of the result; or None)
        step      number (of points that are taken), points (of all), what (is done now)
        trace     rate [Hz], films (names, "load" too) and voltage (films, n) [V] of what the
                  films' nodes have just sampled, also before a dwell; only the live page hears
                  of it, and not of each
        point     id (1, 2, 3, …), values (those of the point in the record)
        incident  of (kind of the record's event: incident, caution, …), message
        paused    message; the outputs are off until the run is resumed
        resumed   message
        promise   seconds (bench time that is left, by the plan), u (what the points so far
                  give, asked again once there are four times as many; or None)
        ended     status (complete, stopped, failed; killed: the writing process is gone),
                  summary

    Attributes:
        kind: what it is.
        bench_ns: bench time [ns]; of a trace the time that was last read before it.
        data: what is told of it: values of JSON under the names above; the voltage of a trace is an array.
    """

    kind: Kind
    bench_ns: int
    data: Mapping[str, Any]

    def line(self) -> str:
        """The event as one line of JSON."""
        return as_json({"event": self.kind, "bench_ns": self.bench_ns, **self.data})


Listener = Callable[[Event], None]


def unheard(_event: Event) -> None:
    """A listener that does nothing."""


def begun(folder: Path, header: Mapping[str, Any], points: int = 0) -> Iterator[Event]:
    """The events that the header of a run tells.

    Args:
        folder: folder of the run.
        header: the header, as the record has it.
        points: number of points that the record holds already.
    """
    about = {name: header.get(name) for name in SETTINGS}
    planned = about.pop("planned")
    if isinstance(about["scene"], Mapping):
        about["scene"] = about["scene"].get("name")
    yield Event("begun", 0, {"run": str(folder), "points": points, **about})
    if planned is not None:
        yield Event("planned", 0, planned)


def events_of(folder: Path, kind: bytes, own: int, content: bytes, bench_ns: int) -> Iterator[Event]:
    """The events that a frame of a record tells, once it is on disk.

    Args:
        folder: folder of the run.
        kind, own, content: of the frame.
        bench_ns: bench time of the event before.
    """
    if kind not in (HEADER, POINT, EVENT, STATUS):
        return
    value = json.loads(content)
    if kind == HEADER:
        yield from begun(folder, value["header"])
    elif kind == POINT:
        yield Event("point", value["bench_ns"], {"id": own, "values": value["data"]})
    elif kind == EVENT and value["kind"] in ("paused", "resumed"):
        yield Event(value["kind"], value["bench_ns"], {"message": value["message"]})
    elif kind == EVENT:
        yield Event("incident", value["bench_ns"], {"of": value["kind"], "message": value["message"]})
    elif value["status"] != "running":
        yield Event("ended", bench_ns, {"status": value["status"], "summary": value["summary"]})


def followed(folder: Path) -> Iterator[Event]:
    """All events of a run in order, from its beginning: those that its record holds, then each that comes.

    It ends once the run is complete, or once no process has it open any more. Raises RecordError: it is damaged.
    """
    check_holes(folder / RECORD)
    clock, silent = WallClock(), 0.0
    with telling_damage(folder / RECORD), ChainFile(folder / RECORD) as file:
        tail = _Tail(folder, file)
        end: Event | None = None  # of a run that did not complete: who has it open may be going on with it
        while True:
            left = (end is not None or silent >= SILENCE) and not is_written(folder)
            heard = 0
            for event in tail.news():
                heard, end = heard + 1, event if event.kind == "ended" else None
                if end is None:
                    yield event
            if end is not None and end.data["status"] == "complete":
                yield end
                return
            if left and not heard:
                yield end or Event("ended", tail.bench_ns, {"status": "killed", "summary": {}})
                return
            silent = 0.0 if heard else silent + POLL
            clock.wait(POLL)


class _Tail:
    """The end of a record that grows, read frame by frame as far as its head counts."""

    def __init__(self, folder: Path, file: ChainFile) -> None:
        self._folder, self._file = folder, file
        self._at, self._number, self._before = 0, 0, NOTHING
        self.bench_ns = 0

    def news(self) -> Iterator[Event]:
        """The events that are new. Raises ValueError: the record is damaged."""
        head, fault = read_head(self._folder / HEAD_FILE)
        if head is None or fault:
            again, fault = read_head(self._folder / HEAD_FILE)
            if again is None or (fault and again == head):
                raise ValueError(fault)
            return
        while self._number < head.frames:
            frame = self._file.frame(self._at)
            if frame is None or (frame.number, frame.before) != (self._number, self._before):
                raise ValueError(f"row {self._number} is missing, changed or not in its place")
            if (content := self._file.content(frame)) is None:
                raise ValueError(f"{named(frame)} is not as it was written")
            self._at, self._number, self._before = frame.end, frame.number + 1, frame.hash
            for event in events_of(self._folder, frame.kind, frame.id, content, self.bench_ns):
                self.bench_ns = event.bench_ns
                yield event
