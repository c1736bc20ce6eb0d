"""A run that goes on where it ended: nothing finished is lost, and nothing is stored twice.

A real bench begins at the first point that is not stored. A simulated one gets to where it was by doing everything
again, because what it gives depends on all that was done to it before; what is stored already is compared with what it
gives now, and not stored a second time. So the finished run is that of a bench that was never interrupted.
"""

from __future__ import annotations

import contextlib
import json
import tomllib
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError

from palpate.drivers.bench import Bench
from palpate.instrument.errors import RecordError, UsageError
from palpate.procedures.arithmetic import ALIKE, alike, same_arithmetic
from palpate.procedures.records.check import check
from palpate.procedures.records.encoding import Waveforms, as_json, encoded
from palpate.procedures.records.record import Recorder, begin
from palpate.procedures.records.record_file import event_frame, header_frame, point_frames, status_frame
from palpate.procedures.records.run import Run, reading, storing
from palpate.procedures.steps.pause import PAUSED, Pause

COMPARED = ("settings", "scene", "bench", "devices", "contracts", "calibration", "film_calibration", "versions")
CONTINUED, CHANGED = "continued", "changed"
MARKS = frozenset({CONTINUED, CHANGED, "stopped", "failed"})  # events of the record's, not of the procedure's
ACCEPT = "--accept-change"

T = TypeVar("T")
NamedWaveform = tuple[str, float, np.ndarray]


class _Scene(BaseModel):
    toml: str


class _Header(BaseModel):
    """What the record of a procedure on a bench says of its beginning; see `procedures/lab/open.py`."""

    settings: dict[str, Any]
    scene: _Scene | None
    bench: str
    devices: dict[str, str]
    contracts: str
    calibration: dict[str, Any]
    film_calibration: dict[str, Any] | None
    versions: dict[str, str]


class Resumed(Recorder):
    """The one writer of a run that goes on: opened, then `begin`, then as any recorder."""

    def __init__(self, run: Run, *, replay: bool, accept: bool) -> None:
        """Keep other writers out; nothing is written yet.

        Args:
            replay: the bench is a simulated one that begins at its start again.
            accept: what has changed since is recorded, not refused.

        Raises:
            UsageError: the run is complete, or another process is writing it.
            RecordError: it is damaged, or its folder cannot be written to.
        """
        if run.status == "complete":
            raise UsageError(f"{run.folder} is complete; there is nothing to resume")
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
        self._bench_ns = max([0, *(ns for _, ns in self._events), *(point.bench_ns for point in self._stored)])
        self._events = deque(event for event in self._events if replay and event[0] not in MARKS)
        if not replay:
            self._points = len(self._stored)

    @property
    def bench_ns(self) -> int:
        """Bench time at which the run ended, ns."""
        return self._bench_ns

    def begin(self, header: Mapping[str, object]) -> None:
        """Go on, on the bench that `header` describes as that of a new run.

        Raises:
            UsageError: it is not the bench of the record; names each difference.
        """
        if bool(header["simulated"]) != self.run.simulated:
            raise UsageError(f"{self.folder} is {'' if self.run.simulated else 'not '}simulated, this bench is another")
        changes = list(_differences(_comparable(header_of(self.run)), _comparable(json.loads(as_json(header)))))
        if changes and not self._accept:
            raise UsageError(
                f"{self.folder} cannot go on, the bench has changed:\n  "
                + "\n  ".join(changes)
                + f"\nput it back as it was, or resume with {ACCEPT}, which is recorded"
            )
        was, now = self.run.header.get("arithmetic"), header.get("arithmetic")
        if not (isinstance(was, dict) and isinstance(now, dict) and same_arithmetic(was, now)):
            self._to_the_last_digit = False
            changes.append(
                f"arithmetic: {json.dumps(was)} in the record, {json.dumps(now)} now; stored points are compared to"
                f" {ALIKE:g} of each number"
            )
        if not self.run.hashed:
            changes.append("record format 3 until here, 4 from now on: its rows were unhashed")
            self._convert()
        self._write_on()
        marks = [(CONTINUED, f"after point {len(self._stored)}"), *((CHANGED, change) for change in changes)]
        events = [self._event(kind, message, self._bench_ns, behind) for behind, (kind, message) in enumerate(marks)]
        known = {"mounting": header["mounting"]} if "mounting" in header else {}
        self._append([status_frame("running", {}, known), *events], events=len(events))

    def _convert(self) -> None:
        """Makes a record of what the database of record format 3 holds, beside it; it is left as it is."""
        frames = [header_frame(self.run.header)]
        with reading(self.folder) as stored:
            for number, event in enumerate(stored.events(), 1):
                frames.append(event_frame(number, event["kind"], event["message"], event["bench_ns"]))
            for point in stored.points():
                waveforms = {w.name: (w.rate, w.samples) for w in stored.waveforms(point.id)}
                frames += point_frames(point.id, json.loads(point.text), waveforms, point.bench_ns)
        with storing(self.folder):
            begin(self.folder, self.run.header, frames)

    def point(self, data: Mapping[str, object], waveforms: Waveforms, bench_ns: int) -> int:
        """As `Recorder.point`; one that is stored already is compared.

        Raises:
            RecordError: it is not what the bench gives now.
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
        """As `Recorder.event`; one that is stored already is compared. Raises RecordError as `point`."""
        if self._events:
            if (kind, bench_ns) == self._events[0]:  # messages can name addresses, which are new
                self._events.popleft()
                return
            self._differs(f"event {self._events[0][0]!r}", bench_ns)
        super().event(kind, message, bench_ns)

    def finished(self, kind: type[T]) -> list[T]:
        """The points that a real bench need not measure again, as the dataclass they were stored from."""
        data = [] if self._replay else [json.loads(point.text) for point in self._stored]
        try:
            return _as(kind, data)
        except ValidationError as error:
            raise RecordError(f"{self.folder}: its points are of another palpate ({_first(error)}); run anew") from None

    def paused(self, bench_ns: int) -> bool:
        """Whether the run was paused at this moment before."""
        return bool(self._events) and self._events[0] == (PAUSED, bench_ns)

    def _differs(self, what: str, bench_ns: int) -> None:
        message = f"{what} is not what the bench gives now"
        if not self._accept:
            raise RecordError(
                f"{self.folder}: {message}; resume with the palpate that began the run, or with {ACCEPT}, which is "
                "recorded"
            )
        self._events.clear()
        super().event(CHANGED, message, bench_ns)


def _largest(samples: np.ndarray) -> float:
    return float(np.abs(samples[np.isfinite(samples)]).max(initial=0.0))


class PausedAgain:
    """Pauses a replayed run where it was paused before, for no time, and else where somebody asks. A `Pause`."""

    def __init__(self, record: Resumed, bench: Bench, pause: Pause) -> None:
        self._record, self._bench, self._pause = record, bench, pause
        self._before = False

    def asked(self) -> bool:
        self._before = self._record.paused(self._bench.clock.now_ns())
        return self._before or self._pause.asked()

    def wait(self) -> None:
        if not self._before:
            self._pause.wait()


def header_of(run: Run) -> Mapping[str, Any]:
    """The header of a run that a procedure began on a bench. Raises RecordError: it has another."""
    header: Mapping[str, Any] = run.header
    try:
        _Header.model_validate(header, strict=True)
        tomllib.loads(header["bench"] if header["scene"] is None else header["scene"]["toml"])
    except ValidationError as error:
        reason = _first(error)
    except tomllib.TOMLDecodeError as error:
        reason = str(error)
    else:
        return header
    raise RecordError(f"{run.folder}: its header is not that of a procedure on a bench ({reason}); run anew")


def settings_of(run: Run, kind: type[T]) -> T:
    """The settings that a run was begun with, as their dataclass. Raises RecordError."""
    try:
        (settings,) = _as(kind, [run.header["settings"]])
    except ValidationError as error:
        raise RecordError(f"{run.folder}: its settings are of another palpate ({_first(error)}); run anew") from None
    return settings


def _first(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"


def _comparable(header: Mapping[str, Any]) -> dict[str, Any]:
    """What has to be as it was; a simulated bench has new addresses each time, its scene says what it is."""
    found = {key: header[key] for key in COMPARED}
    found["devices"] = {name.partition(" at ")[0]: serial for name, serial in header["devices"].items()}
    if found["scene"] is None:
        found["bench"] = tomllib.loads(found["bench"])
    else:
        found["scene"] = tomllib.loads(found["scene"]["toml"])
        del found["bench"]
    return found


def _differences(before: Any, now: Any, key: str = "") -> Iterator[str]:
    """Each value that differs, with its key."""
    if isinstance(before, dict) and isinstance(now, dict):
        for name in dict.fromkeys((*before, *now)):
            yield from _differences(before.get(name), now.get(name), f"{key}.{name}" if key else name)
    elif before != now:
        yield f"{key}: {json.dumps(before)} in the record, {json.dumps(now)} now"


def _as(kind: type[T], data: list[Any]) -> list[T]:
    """`data` from JSON as dataclasses; a null where a number belongs was NaN."""
    adapter = TypeAdapter(list[kind])  # type: ignore[valid-type]
    try:
        return adapter.validate_python(data)
    except ValidationError as error:
        nulls = [tuple(e["loc"]) for e in error.errors(include_url=False) if e["input"] is None]
        if not nulls:
            raise
        try:
            for *path, last in nulls:
                where: Any = data
                for part in path:
                    where = where[part]
                where[last] = float("nan")
        except (LookupError, TypeError):  # no number belongs there
            raise error from None
    return adapter.validate_python(data)
