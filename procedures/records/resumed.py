"""A resumed run: nothing finished is lost, and nothing is stored twice.

A real bench begins at the first point that is not stored. A simulated bench does everything again, because its readings
depend on everything that was done before. Points that are stored already are compared with what the bench gives now and
are not stored a second time. So the finished run equals that of a bench that was never interrupted. The header of the
record is compared with that of the bench as it is now.

The same holds for the samples of a long dwell in which the run ended: a simulated bench goes on with it where they end.
On a real bench that time is gone, so the dwell is taken anew; its first samples stay in the record.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import tomllib
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError

from palpate.instrument.arithmetic import ALIKE, alike, same_arithmetic
from palpate.instrument.bench.description import BenchDescription, compared, recorded_bench
from palpate.instrument.errors import ConfigError, RecordError, UsageError, quoted
from palpate.instrument.refusals import wrong
from palpate.procedures.records.chain import RECORD, ChainFile, Content
from palpate.procedures.records.damage import check
from palpate.procedures.records.events import Listener, begun, unheard
from palpate.procedures.records.record import MEASURED, PAUSED, Recorder
from palpate.procedures.records.record_file import (
    Encoded,
    InPieces,
    Wave,
    Waveforms,
    as_json,
    encoded,
    status_frame,
    unpacked,
    waves,
)
from palpate.procedures.records.run import Run, reading, telling_damage

COMPARED = ("settings", "scene", "bench", "devices", "contracts", "calibration", "film_calibration", "versions")
CONTINUED, CHANGED, UNSTORED = "continued", "changed", "unstored"
MARKS = frozenset({CONTINUED, CHANGED, UNSTORED, "stopped", "failed"})  # events of the record, not of the procedure
ACCEPT = "--accept-change"

T = TypeVar("T")


# --- headers -------------------------------------------------------------------------------------------


class _Scene(BaseModel):
    toml: str


class _Header(BaseModel):
    """Header of a procedure's record on a bench; see `procedures/lab/session.py`."""

    settings: dict[str, Any]
    scene: _Scene | None
    bench: str
    devices: dict[str, str]
    contracts: str
    calibration: dict[str, Any]
    film_calibration: dict[str, Any] | None
    versions: dict[str, str]


def header_of(run: Run) -> Mapping[str, Any]:
    """The header of a run that a procedure began on a bench. Raises RecordError: the run has another kind of header."""
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
    """The settings of a run, as their dataclass. Raises RecordError."""
    (settings,) = values_of(kind, [run.header["settings"]], f"{run.folder}: its settings")
    return settings


def _first(error: ValidationError) -> str:
    first: Mapping[str, Any] = dict(error.errors(include_url=False)[0])
    key = ".".join(map(str, first["loc"]))
    return f"{key}: is missing" if first["type"] == "missing" else f"{key}: {quoted(first['input'])} {wrong(first)}"


def changes(before: Mapping[str, Any], now: Mapping[str, Any], where: str) -> list[str]:
    """How a header differs from that of a record, where it must not; `where` names the record in messages.

    Raises:
        RecordError: the record's bench cannot be read.
    """
    parts = comparable(before), comparable(now)
    if before["scene"] is None:
        bench_before, here = (_bench(header, where) for header in (before, now))
        parts[0]["bench"], parts[1]["bench"] = compared(bench_before, here)
    return list(differences(*parts))


def comparable(header: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a header that must not change. A simulated bench has new addresses; its scene counts."""
    found = {key: header[key] for key in COMPARED}
    found["maps"] = header.get("maps", {})  # a bench without makers' devices has none
    found["model_calibration"] = header.get("model_calibration")  # of runs that ask a model which references calibrated
    found["before"] = header.get("before")  # of runs that did not begin on a bench as it was opened
    found["devices"] = {}
    listed = [(name.partition(" at ")[0], serial) for name, serial in header["devices"].items()]
    if found["scene"] is not None:
        listed.sort()  # they stand in the order of their addresses, which a simulated bench has anew each time
    for title, serial in listed:
        several = sum(alike.partition(" #")[0] == title for alike in found["devices"])
        found["devices"][f"{title} #{several + 1}" if several else title] = serial
    if found["scene"] is not None:
        found["scene"] = tomllib.loads(found["scene"]["toml"])
    del found["bench"]
    return found


def _bench(header: Mapping[str, Any], where: str) -> BenchDescription:
    """The bench of a header. Raises RecordError."""
    try:
        return recorded_bench(header["bench"], f"{where}: its bench file")
    except ConfigError as error:
        raise RecordError(f"{error}; run anew, or install what is missing") from None


def differences(before: Any, now: Any, key: str = "") -> Iterator[str]:
    """One text for each value that differs, with its key."""
    if isinstance(before, dict) and isinstance(now, dict):
        for name in dict.fromkeys((*before, *now)):
            yield from differences(before.get(name), now.get(name), f"{key}.{name}" if key else name)
    elif before != now:
        yield f"{key}: {json.dumps(before)} in the record, {json.dumps(now)} now"


def values_of(kind: type[T], data: list[Any], what: str) -> list[T]:
    """Dataclasses of JSON `data`; `what` names it in messages. Raises RecordError: it is of other fields."""
    try:
        return _as(kind, data)
    except ValidationError as error:
        raise RecordError(f"{what} were recorded by another version of palpate ({_first(error)}); run anew") from None


def _as(kind: type[T], data: list[Any]) -> list[T]:
    """Turn JSON `data` into dataclasses; a null in the place of a number becomes NaN."""
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


# --- going on ------------------------------------------------------------------------------------------


class Resumed(Recorder):
    """The one writer of a resumed run. It is opened, then `begin` is called, then it is used as any recorder."""

    def __init__(self, run: Run, *, replay: bool, accept: bool, listener: Listener = unheard) -> None:
        """Keep other writers out; nothing is written yet.

        Args:
            run: the run to go on with.
            replay: whether the bench is a simulated one, which begins at its start again.
            accept: whether changes of the bench are recorded instead of refused.
            listener: as that of any recorder.

        Raises:
            UsageError: another process is writing it.
            RecordError: it is damaged, or its folder cannot be written to.
        """
        super().__init__(run.folder, listener=listener)
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
                self._unfinished = stored.unfinished()
            undo.pop_all()
        self._events = deque((e["kind"], e["bench_ns"]) for e in events)
        self._measured = not replay and any(kind == MEASURED for kind, _ in self._events)
        self._bench_ns = max([0, *(ns for _, ns in self._events), *(point.bench_ns for point in self._stored)])
        self._events = deque(event for event in self._events if replay and event[0] not in MARKS)
        self._pieces: Iterator[Wave] = iter(())
        if not replay:
            self._points = len(self._stored)
            self._dwells = self._unfinished.dwell if self._unfinished else 0

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
        self._write_on()
        if self._replay:
            self._pieces = waves(self._open.enter_context(ChainFile(self.folder / RECORD)), 0)
        for event in begun(self.folder, self.run.header, len(self._stored)):
            self.listener(event)
        after = f"after point {len(self._stored)}"
        if self._unfinished:
            after += f"; {self._unfinished}, and it {'goes on' if self._replay else 'is taken anew'}"
        marks = [(CONTINUED, after), *((CHANGED, change) for change in found)]
        events = [self._event(kind, message, self._bench_ns, behind) for behind, (kind, message) in enumerate(marks)]
        mounting = {"mounting": header["mounting"]} if "mounting" in header else {}
        self._append([status_frame("running", {}, mounting), *events], events=len(events))

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
        self._points, self._dwells = self._points + 1, 0
        with reading(self.folder) as stored:
            there = stored.stored_waveforms(before.id)
        self._bench_ns = bench_ns
        if bench_ns != before.bench_ns or not self._same(before.text, text) or not self._same_waveforms(there, arrays):
            self._differs(f"point {self._points}", bench_ns)
        return self._points

    def _same(self, before: str, now: str) -> bool:
        return before == now if self._to_the_last_digit else alike(json.loads(before), json.loads(now))

    def _same_waveforms(self, before: Encoded, now: Encoded) -> bool:
        if [(name, rate, each.size) for name, rate, each in before] != [(n, rate, each.size) for n, rate, each in now]:
            return False
        pairs = [(one, other) for (_, _, one), (_, _, other) in zip(before, now, strict=True)]
        return all(self._alike(one, other) for one, other in pairs)

    def _alike(self, before: np.ndarray | InPieces, now: np.ndarray | InPieces) -> bool:
        if isinstance(before, InPieces) or isinstance(now, InPieces):
            return type(before) is type(now) and before == now
        if self._to_the_last_digit:
            return before.tobytes() == now.tobytes()
        return np.allclose(before, now, ALIKE, ALIKE * _largest(before), equal_nan=True)

    def _store_piece(self, frames: Sequence[Content]) -> int:
        """The same as that of a recorder, but samples that are stored already are compared."""
        with telling_damage(self.folder / RECORD):
            there = list(itertools.islice(self._pieces, len(frames)))
        if not there:
            return super()._store_piece(frames)
        for before, now in itertools.zip_longest(there, map(unpacked, frames)):
            what = f"samples of point {now.point_id} from number {now.first + 1} on"
            if before is None or (before[:-2], before.samples.size) != (now[:-2], now.samples.size):
                raise RecordError(f"{self.folder}: {what} are stored in other pieces than come now; run it anew")
            if not self._alike(before.samples, now.samples):
                self._differs(what, self._bench_ns)
        return there[0].at

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
