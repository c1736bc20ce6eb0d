"""What live pages are told: each event of a run as it comes, and to a page that opens later what came before.

Whoever tells an event only lays it down. The thread of the server takes all that lie there some time later, makes a
message of each, once for all pages, and sends it to each page as far as that reads. A page that is too slow is sent
away, comes back, and is told the state anew: so no page costs memory or makes anybody wait.
"""

from __future__ import annotations

import base64
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from socket import socket
from typing import Any

import numpy as np

from palpate.instrument.errors import PalpateError
from palpate.procedures.engine.catalogue import procedure_class
from palpate.procedures.records.columns import columns_of
from palpate.procedures.records.events import Event
from palpate.procedures.records.record_file import as_json
from palpate.procedures.records.run import Run

VERSION = 1  # of the messages, as docs/how-to/live.md describes them
SILENCE = 200  # looks without news after which a comment is sent, by which a lost connection shows
KEPT = 4096  # messages that a page may lie behind
AT_ONCE = 256  # messages that are given to the system at once
MOST_POINTS = 2048  # points that a new page is told; of more, each second one is left out, again and again
MOST_INCIDENTS = 200
MOST_SAMPLES = 8192  # of each film in a trace; of a longer one the end is shown
LASTING = ("campaign",)  # what is told of more than one run

_Line = tuple[str, Mapping[str, Any], Callable[[], str]]  # kind, data, and what makes the line of JSON


class _Viewer:
    """A page that hears the stream, and the messages that wait for it."""

    def __init__(self, connection: socket) -> None:
        self.connection = connection
        self.waiting: deque[bytes] = deque()
        self.ready = False  # once it has the state; until then its own thread sends
        self.gone = threading.Event()


class Feed:
    """The listener that live pages are told by. Its calls take next to no time, and wait for nobody.

    Attributes:
        controls: what a page may ask for: "pause", "stop".
        stored: whether pages may ask for the stored waveforms of a point.
        folder: folder of the run, once it has begun.
    """

    def __init__(self, controls: Sequence[str] = (), stored: bool = False) -> None:
        self.controls, self.stored = controls, stored
        self.folder: Path | None = None
        self._waiting: deque[_Line] = deque()
        self._traces: deque[Event] = deque(maxlen=1)
        self._lock = threading.Lock()  # of all below
        self._viewers: list[_Viewer] = []
        self._silent = 0  # looks without news
        self._now: dict[str, bytes] = {}  # the last message of each kind that is not named below
        self._restart()

    def _restart(self) -> None:
        self._begun: list[bytes] = []
        self._points: list[bytes] = []
        self._every, self._last, self._invalid = 1, 0, 0
        self._incidents: deque[bytes] = deque(maxlen=MOST_INCIDENTS)
        self._now = {kind: message for kind, message in self._now.items() if kind in LASTING}

    # --- who tells -------------------------------------------------------------------------------------

    def __call__(self, event: Event) -> None:
        if event.kind == "trace":
            self._traces.append(event)
        else:
            self._waiting.append((event.kind, event.data, event.line))

    def tell(self, kind: str, data: Mapping[str, Any]) -> None:
        """Tell the pages something that is no event of the run."""
        self._waiting.append((kind, data, lambda: as_json({"event": kind, **data})))

    # --- who sends -------------------------------------------------------------------------------------

    def look(self) -> None:
        """Send all pages what is new; the thread of the server calls this again and again."""
        with self._lock:
            fresh = list(self._news())
            trace = _message(_trace_line(self._traces.popleft())) if self._traces else None
            self._silent = 0 if fresh or trace else self._silent + 1
            if self._silent == SILENCE:
                fresh, self._silent = [b": nothing new\n\n"], 0
            if trace:
                self._now["trace"] = trace
            for viewer in self._viewers:
                if trace and not viewer.waiting:
                    viewer.waiting.append(trace)
                viewer.waiting.extend(fresh)
                try:
                    if viewer.ready:
                        _send(viewer.connection, viewer.waiting)
                except OSError:
                    viewer.gone.set()
                if len(viewer.waiting) > KEPT:
                    viewer.gone.set()

    def _news(self) -> Iterator[bytes]:
        """The messages of what was told since, which are kept for new pages."""
        while self._waiting:
            kind, data, line = self._waiting.popleft()
            message = _message(line())
            if kind == "begun":
                self._restart()
                self.folder = Path(data["run"])
                self._waiting.extendleft(reversed(list(_by_record(self.folder, data["points"]))))
            if kind in ("begun", "planned"):
                self._begun.append(message)
            elif kind == "point":
                self._keep(data, message)
            elif kind == "incident":
                self._incidents.append(message)
            else:
                self._now.pop(kind, None)
                self._now[kind] = message
            yield message

    def _keep(self, point: Mapping[str, Any], message: bytes) -> None:
        number = self._last = point["id"]
        self._invalid += point["values"].get("valid") is False
        if (number - 1) % self._every == 0:
            self._points.append(message)
        if len(self._points) > MOST_POINTS:
            del self._points[1::2]
            self._every *= 2

    def stream(self, connection: socket) -> None:
        """Send a page the state and what is new from now on, until it has gone. Raises OSError: it does not read."""
        viewer = _Viewer(connection)
        with self._lock:
            parts = [self._hello(), *self._begun, *self._points, *self._incidents, *self._now.values()]
            self._viewers.append(viewer)
        try:
            _send(connection, deque(parts))
            connection.setblocking(False)
            viewer.ready = True
            viewer.gone.wait()
        finally:
            with self._lock:
                self._viewers.remove(viewer)

    def waits(self) -> bool:
        """Whether a page has not got all that was told."""
        with self._lock:
            return bool(self._waiting) or any(each.waiting or not each.ready for each in self._viewers)

    def close(self) -> None:
        """Send all pages away."""
        with self._lock:
            for viewer in self._viewers:
                viewer.gone.set()

    def _hello(self) -> bytes:
        content = {
            "event": "page", "version": VERSION, "every": self._every, "points": self._last, "invalid": self._invalid,
            "controls": list(self.controls), "stored": self.stored,
        }  # fmt: skip
        return _message(as_json(content))

    def stored_trace(self, point: int) -> bytes:
        """The stored waveforms of a point as a trace in JSON; null: it has none. Raises RecordError."""
        if self.folder is None or not (waves := list(Run.open(self.folder).waveforms(point))):
            return b"null"
        same = [wave for wave in waves if wave.rate == waves[0].rate]
        voltage = np.array([wave.samples[-MOST_SAMPLES:] for wave in same])
        data = {"rate": waves[0].rate, "films": [wave.name for wave in same], "point": point}
        data["of"] = waves[0].samples.size
        return _trace_line(Event("trace", 0, {**data, "voltage": voltage})).encode()


def _by_record(folder: Path, points: int) -> Iterator[_Line]:
    """What the record of a run tells when it begins: its devices, and the points of an earlier part."""
    try:
        run = Run.open(folder)
        earlier = run.points()[:points] if points else []
    except PalpateError:  # pages then lack them; whoever reads the run is told why
        return
    about = {"devices": run.header.get("devices", {}), "columns": _columns(run.procedure)}
    yield "about", about, lambda: as_json({"event": "about", **about})
    for point in earlier:
        number, bench_ns = point.pop("id"), point.pop("bench_ns")
        event = Event("point", bench_ns, {"id": number, "values": point})
        yield event.kind, event.data, event.line


def _send(connection: socket, waiting: deque[bytes]) -> None:
    """Send what waits, as far as that can be done at once if the connection does not block. Raises OSError."""
    try:
        while waiting:
            sent = connection.sendmsg(list(islice(waiting, AT_ONCE)))
            while waiting and sent >= len(waiting[0]):
                sent -= len(waiting.popleft())
            if sent:
                waiting[0] = waiting[0][sent:]
    except BlockingIOError:
        pass


def _trace_line(event: Event) -> str:
    """A trace as a line of JSON; its voltages, rows of one array of little-endian float32, are in base64."""
    voltage = event.data["voltage"][:, -MOST_SAMPLES:].astype("<f4")
    data = {"samples": voltage.shape[1], "voltage": base64.b64encode(voltage.tobytes()).decode()}
    return replace(event, data={**event.data, **data}).line()


def _columns(procedure: str) -> list[dict[str, str]]:
    """The columns of a procedure's points that a table shows, in its order; none of a procedure that is not known."""
    try:
        found = columns_of(procedure_class(procedure).point)
    except PalpateError:
        return []
    return [{"name": name, "unit": each.unit, "u": each.u} for name, each in found.items() if each.head]


def _message(line: str) -> bytes:
    return b"data: " + line.encode() + b"\n\n"
