"""A resumed run: nothing finished is lost, and nothing is stored twice.

A real bench begins at the first point that is not stored. A simulated bench does everything again, because its readings
depend on everything that was done before. Points that are stored already are compared with what the bench gives now and
are not stored a second time. So the finished run equals that of a bench that was never interrupted.
"""

from __future__ import annotations

import contextlib
import json
from collections import deque
from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from palpate.instrument.arithmetic import ALIKE, alike, same_arithmetic
from palpate.instrument.errors import RecordError, UsageError
from palpate.procedures.records.check import check
from palpate.procedures.records.encoding import Waveforms, as_json, encoded
from palpate.procedures.records.headers import changes, header_of, values_of
from palpate.procedures.records.record import MEASURED, PAUSED, Recorder, begin
from palpate.procedures.records.record_file import event_frame, header_frame, point_frames, status_frame
from palpate.procedures.records.run import Run, reading, storing

CONTINUED, CHANGED, UNSTORED = "continued", "changed", "unstored"
MARKS = frozenset({CONTINUED, CHANGED, UNSTORED, "stopped", "failed"})  # events of the record, not of the procedure
ACCEPT = "--accept-change"

T = TypeVar("T")
NamedWaveform = tuple[str, float, np.ndarray]


class Resumed(Recorder):
    """The one writer of a resumed run. It is opened, then `begin` is called, then it is used as any recorder."""

    def __init__(self, run: Run, *, replay: bool, accept: bool) -> None:
        """Keep other writers out; nothing is written yet.

        Args:
            run: the run to go on with.
            replay: whether the bench is a simulated one, which begins at its start again.
            accept: whether changes of the bench are recorded instead of refused.

        Raises:
            UsageError: another process is writing it.
            RecordError: it is damaged, or its folder cannot be written to.
        """
        super().__init__(run.folder)
        self.run = run
        self._replay, self._accept = replay, accept
        self._to_the_last_digit = True
        with contextlib.ExitStack() as undo:
            undo.callback(self.close)
            if faults := check(run.folder).faults:
                raise RecordError(f"{run.folder} is damaged: {faults[0]}; salvage it with palpate runs repair")
            with reading(run.folder) as stored:
                self._stored = list(stored.points())
                events = stored.events()
            undo.pop_all()
        self._events = deque((e["kind"], e["bench_ns"]) for e in events)
        self._measured = not replay and any(kind == MEASURED for kind, _ in self._events)
        self._bench_ns = max([0, *(ns for _, ns in self._events), *(point.bench_ns for point in self._stored)])
        self._events = deque(event for event in self._events if replay and event[0] not in MARKS)
        if not replay:
            self._points = len(self._stored)

    @property
    def bench_ns(self) -> int:
        """Bench time at which the run ended, ns."""
        return self._bench_ns

    def begin(self, header: Mapping[str, object]) -> None:
        """Go on with the run on a bench.

        Args:
            header: the header that a new run on this bench would have.

        Raises:
            UsageError: it is not the bench of the record; the message names each difference.
        """
        if bool(header["simulated"]) != self.run.simulated:
            kinds = ("a simulated", "a real")[:: 1 if self.run.simulated else -1]
            raise UsageError(
                f"{self.folder} was recorded on {kinds[0]} bench, but this is {kinds[1]} one; open the same"
            )
        found = changes(header_of(self.run), json.loads(as_json(header)), str(self.folder))
        if found and not self._accept:
            raise UsageError(
                f"{self.folder} cannot be resumed, because bench or software have changed:\n  "
                + "\n  ".join(found)
                + f"\nchange it back, or resume with {ACCEPT}, which is recorded"
            )
        was, now = self.run.header.get("arithmetic"), header.get("arithmetic")
        if not (isinstance(was, dict) and isinstance(now, dict) and same_arithmetic(was, now)):
            self._to_the_last_digit = False
            found.append(
                f"arithmetic: {json.dumps(was)} in the record, {json.dumps(now)} now; stored points are compared to"
                f" {ALIKE:g} of each number"
            )
        if not self.run.hashed:
            found.append("record format 3 until here, 4 from now on: its rows were unhashed")
            self._convert()
        self._write_on()
        marks = [(CONTINUED, f"after point {len(self._stored)}"), *((CHANGED, change) for change in found)]
        events = [self._event(kind, message, self._bench_ns, behind) for behind, (kind, message) in enumerate(marks)]
        known = {"mounting": header["mounting"]} if "mounting" in header else {}
        self._append([status_frame("running", {}, known), *events], events=len(events))

    def _convert(self) -> None:
        """Write the content of a database of record format 3 into a record beside it. The database stays as it is."""
        frames = [header_frame(self.run.header)]
        with reading(self.folder) as stored:
            for number, event in enumerate(stored.events(), 1):
                frames.append(event_frame(number, event["kind"], event["message"], event["bench_ns"]))
            for point in stored.points():
                waveforms = {w.name: (w.rate, w.samples) for w in stored.waveforms(point.id)}
                frames += point_frames(point.id, json.loads(point.text), waveforms, point.bench_ns)
        with storing(self.folder, running=True):
            begin(self.folder, self.run.header, frames)

    def point(self, data: Mapping[str, object], waveforms: Waveforms, bench_ns: int) -> int:
        """The same as `Recorder.point`, but a point that is stored already is compared with this one.

        Raises:
            RecordError: the stored point differs from what the bench gives now.
        """
        if self._points >= len(self._stored):
            if self._events:
                self._differs(f"event {self._events[0][0]!r}", bench_ns)
            return super().point(data, waveforms, bench_ns)
        text, arrays = encoded(data, waveforms)
        before = self._stored[self._points]
        self._points += 1
        with reading(self.folder) as stored:
            there = [(w.name, w.rate, w.samples) for w in stored.waveforms(before.id)]
        self._bench_ns = bench_ns
        if bench_ns != before.bench_ns or not self._same(before.text, text) or not self._same_waveforms(there, arrays):
            self._differs(f"point {self._points}", bench_ns)
        return self._points

    def _same(self, before: str, now: str) -> bool:
        return before == now if self._to_the_last_digit else alike(json.loads(before), json.loads(now))

    def _same_waveforms(self, before: list[NamedWaveform], now: list[NamedWaveform]) -> bool:
        if [(name, rate, each.size) for name, rate, each in before] != [(n, rate, each.size) for n, rate, each in now]:
            return False
        pairs = [(one, other) for (_, _, one), (_, _, other) in zip(before, now, strict=True)]
        if self._to_the_last_digit:
            return all(one.tobytes() == other.tobytes() for one, other in pairs)
        return all(np.allclose(one, other, ALIKE, ALIKE * _largest(one), equal_nan=True) for one, other in pairs)

    def event(self, kind: str, message: str, bench_ns: int) -> None:
        """The same as `Recorder.event`, but a stored event is compared. Raises RecordError as `point` does."""
        if self._events:
            if (kind, bench_ns) == self._events[0]:  # messages can name addresses, which change
                self._events.popleft()
                return
            self._differs(f"event {self._events[0][0]!r}", bench_ns)
        super().event(kind, message, bench_ns)

    def finished(self, kind: type[T]) -> list[T]:
        """The points that a real bench need not measure again, as the dataclass they were stored from."""
        data = [] if self._replay else [json.loads(point.text) for point in self._stored]
        return values_of(kind, data, f"{self.folder}: its points")

    @property
    def measured(self) -> bool:
        """Whether nothing is left to measure of a run whose points must be taken in one run; a replay measures all."""
        return self._measured

    def paused(self, bench_ns: int) -> bool:
        """Whether the recorded run was paused at this bench time."""
        return bool(self._events) and self._events[0] == (PAUSED, bench_ns)

    def _differs(self, what: str, bench_ns: int) -> None:
        message = f"{what} is not what the bench gives now"
        if not self._accept:
            raise RecordError(
                f"{self.folder}: {message}; resume with the version of palpate that began the run, or with {ACCEPT}, "
                "which is recorded"
            )
        self._events.clear()
        super().event(CHANGED, message, bench_ns)


def _largest(samples: np.ndarray) -> float:
    return float(np.abs(samples[np.isfinite(samples)]).max(initial=0.0))
