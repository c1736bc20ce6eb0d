"""What a live page is told: each event of a run as it comes, and to a page that opens later what came before.

All messages are made once and kept in one bounded store for all pages. A page that is too slow to find its next message
there is sent away, comes back, and is told the state anew: so no page costs memory or makes anybody wait.
"""

from __future__ import annotations

import base64
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.drivers.clock import WallClock
from palpate.instrument.errors import PalpateError
from palpate.procedures.engine.catalogue import procedure_class
from palpate.procedures.records.columns import columns_of
from palpate.procedures.records.events import Event
from palpate.procedures.records.record_file import as_json
from palpate.procedures.records.run import Run

VERSION = 1  # of the messages, as docs/how-to/live.md describes them
LOOK = 0.05  # s between two looks of a page for what is new
SILENCE = 200  # looks without news after which a comment is sent, by which a lost connection shows
KEPT = 4096  # messages that a page may lie behind
MOST_POINTS = 2048  # points that a new page is told; of more, each second one is left out, again and again
MOST_INCIDENTS = 200
MOST_SAMPLES = 8192  # of each film in a trace; of a longer one the end is shown


class Feed:
    """The listener that a live page is told by. Its calls never wait for a page.

    Attributes:
        controls: what a page may ask for: "pause", "stop".
        stored: whether pages may ask for the stored waveforms of a point.
        folder: folder of the run, once it has begun.
    """

    def __init__(self, controls: Sequence[str] = (), stored: bool = False) -> None:
        self.controls, self.stored = controls, stored
        self.folder: Path | None = None
        self._lock = threading.Lock()
        self._recent: deque[bytes] = deque(maxlen=KEPT)
        self._number = 0  # of messages so far
        self._trace: Event | bytes | None = None  # the last one, made a message once a page wants it
        self._traces = 0
        self._closed = False
        self._restart()

    def _restart(self) -> None:
        self._begun: list[bytes] = []
        self._points: list[bytes] = []
        self._every, self._last, self._invalid = 1, 0, 0
        self._incidents: deque[bytes] = deque(maxlen=MOST_INCIDENTS)
        self._now: dict[str, bytes] = {}  # the last event of each other kind

    def __call__(self, event: Event) -> None:
        if event.kind == "trace":
            shown = event.data["voltage"][:, -MOST_SAMPLES:].astype("<f4")  # which keeps nothing of a long dwell
            with self._lock:
                self._trace = replace(event, data={**event.data, "voltage": shown})
                self._traces += 1
            return
        message = _message(event.line())
        with self._lock:
            if event.kind == "begun":
                self._restart()
                self.folder = Path(event.data["run"])
            if event.kind in ("begun", "planned"):
                self._begun.append(message)
            elif event.kind == "point":
                self._keep(event, message)
            elif event.kind == "incident":
                self._incidents.append(message)
            else:
                self._now.pop(event.kind, None)
                self._now[event.kind] = message
            self._tell(message)
        if event.kind == "begun":
            self._told_by_record(event.data)

    def tell(self, kind: str, data: Mapping[str, Any]) -> None:
        """Tell the pages something that is no event of the run."""
        message = _message(as_json({"event": kind, **data}))
        with self._lock:
            self._now[kind] = message
            self._tell(message)

    def _tell(self, message: bytes) -> None:
        self._recent.append(message)
        self._number += 1

    def _keep(self, event: Event, message: bytes) -> None:
        number = self._last = event.data["id"]
        self._invalid += event.data["values"].get("valid") is False
        if (number - 1) % self._every == 0:
            self._points.append(message)
        if len(self._points) > MOST_POINTS:
            del self._points[1::2]
            self._every *= 2

    def _told_by_record(self, begun: Mapping[str, Any]) -> None:
        """Tell what the record of a run knows when it begins: its devices, and the points of an earlier part."""
        try:
            run = Run.open(Path(begun["run"]))
            earlier = run.points()[: begun["points"]] if begun["points"] else []
        except PalpateError:  # the page then lacks them; whoever reads the run is told why
            return
        self.tell("about", {"devices": run.header.get("devices", {}), "columns": _columns(run.procedure)})
        for point in earlier:
            number, bench_ns = point.pop("id"), point.pop("bench_ns")
            self(Event("point", bench_ns, {"id": number, "values": point}))

    # --- what a page gets ------------------------------------------------------------------------------

    def close(self) -> None:
        """Let every page have what is left, and end."""
        self._closed = True

    def messages(self) -> Iterator[bytes]:
        """All messages for one page, from the state on; it ends with the feed, or where the page is too slow."""
        clock = WallClock()
        with self._lock:
            at, shown = self._number, 0
            state = [self._hello(), *self._begun, *self._points, *self._incidents, *self._now.values()]
        yield from state
        silent = 0
        while True:
            closing = self._closed
            with self._lock:
                fresh, at = self._number - at, self._number
                if fresh > len(self._recent):
                    return
                found = list(self._recent)[-fresh:] if fresh else []
                if self._traces != shown and self._trace is not None:
                    if isinstance(self._trace, Event):
                        self._trace = _message(_trace_line(self._trace))
                    found.insert(0, self._trace)
                    shown = self._traces
            silent = 0 if found else silent + 1
            if found:
                yield b"".join(found)
            elif silent % SILENCE == 0:
                yield b": nothing new\n\n"
            if closing:
                return
            clock.wait(LOOK)

    def _hello(self) -> bytes:
        told = {
            "event": "page", "version": VERSION, "every": self._every, "points": self._last, "invalid": self._invalid,
            "controls": list(self.controls), "stored": self.stored,
        }  # fmt: skip
        return _message(as_json(told))

    def stored_trace(self, point: int) -> bytes:
        """The stored waveforms of a point as a trace in JSON; null: it has none. Raises RecordError."""
        if self.folder is None or not (waves := list(Run.open(self.folder).waveforms(point))):
            return b"null"
        same = [wave for wave in waves if wave.rate == waves[0].rate]
        voltage = np.array([wave.samples[-MOST_SAMPLES:] for wave in same], "<f4")
        told = {"rate": waves[0].rate, "films": [wave.name for wave in same], "point": point}
        told["of"] = waves[0].samples.size
        return _trace_line(Event("trace", 0, {**told, "voltage": voltage})).encode()


def _trace_line(event: Event) -> str:
    """A trace as a line of JSON; its voltages, rows of one array of little-endian float32, are in base64."""
    voltage = event.data["voltage"]
    told = {"samples": voltage.shape[1], "voltage": base64.b64encode(voltage.tobytes()).decode()}
    return replace(event, data={**event.data, **told}).line()


def _columns(procedure: str) -> list[dict[str, str]]:
    """The columns of a procedure's points that a table shows, in its order; none of a procedure that is not known."""
    try:
        found = columns_of(procedure_class(procedure).point)
    except PalpateError:
        return []
    return [{"name": name, "unit": each.unit, "u": each.u} for name, each in found.items() if each.head]


def _message(line: str) -> bytes:
    return b"data: " + line.encode() + b"\n\n"
