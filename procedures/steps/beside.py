"""Reads what the bench file asks to read beside each point, judges it by its limits, and sums it up for a run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypedDict, TypeVar

from palpate.instrument.errors import BenchError, UnknownName
from palpate.procedures.steps.flags import SURROUNDINGS, Judged

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from palpate.drivers.bench import Bench
    from palpate.instrument.bench.description import Beside
    from palpate.procedures.records.record import Recorder

P = TypeVar("P", bound="DataclassInstance")


@dataclass(frozen=True, slots=True)
class ReadBeside:
    """What was read beside a point.

    Attributes:
        values: the values and their standard uncertainties by the names of their columns; None: the device was silent.
        outside: what is wrong with them, for people.
        invalid: whether the point may not be used.
    """

    values: Mapping[str, float | None] = field(default_factory=dict)
    outside: tuple[str, ...] = ()
    invalid: bool = False

    def marked(self, point: P) -> P:
        """The point, marked where something is outside its limits; a class of points without flags cannot say so."""
        if not self.outside or not isinstance(point, Judged):
            return point
        changed: Any = {"flags": (*point.flags, SURROUNDINGS), **({"valid": False} if self.invalid else {})}
        return replace(point, **changed)


class Surroundings:
    """Reads, on an open bench, what is asked for beside each point."""

    def __init__(self, bench: Bench, record: Recorder) -> None:
        self._bench, self._record = bench, record
        self._asked = bench.description.beside
        self._last: dict[str, tuple[int, float | None]] = {}  # bench time [ns] and value, by name

    def read(self) -> ReadBeside:
        """What is read now. Whatever is outside its limits, or silent, is an event of the record."""
        values: dict[str, float | None] = {}
        outside, invalid = [], False
        for name, asked in self._asked.items():
            value, why = self._value(name, asked)
            values[asked.column(name)] = value
            if asked.u is not None:
                values[f"{asked.column(name)}_u"] = None if value is None else asked.u
            if why:
                outside.append(why)
                invalid = invalid or asked.outside == "invalidate"
                self._record.event("beside", why, self._bench.clock.now_ns())
        return ReadBeside(values, tuple(outside), invalid)

    def _value(self, name: str, asked: Beside) -> tuple[float | None, str]:
        """A value, and what is wrong with it for people; an empty text: nothing."""
        now = self._bench.clock.now_ns()
        before, value = self._last.get(name, (None, None))
        why = ""
        if before is None or asked.every is None or now - before >= 1e9 * asked.every:
            try:
                value = float(self._bench.device(asked.device).get(asked.field))
            except (BenchError, UnknownName) as error:
                value, why = None, f": {error}"
            if value is not None and not math.isfinite(value):
                value, why = None, f": {asked.field} of {asked.device} has no reading"
            self._last[name] = now, value
        if value is None:
            return None, f"{name} could not be read{why}"
        unit = f" {asked.unit}" if asked.unit else ""
        return value, "" if asked.holds(value) else f"{name} is {value:g}{unit}, the limit is {asked.limits()}"


# --- what a run says of it in the end --------------------------------------------------------------------


class BesideSummary(TypedDict):
    """What was read of one thing beside the points of a run: in `unit`; None: there was no reading, or no `u` is known.

    `readings` is their number, `silent` how many more there should have been, `outside` how many were beyond a limit.
    """

    name: str
    device: str
    field: str
    unit: str
    u: float | None
    least: float | None
    mean: float | None
    greatest: float | None
    readings: int
    silent: int
    outside: int


def summed_up(asked: Mapping[str, Beside], points: Sequence[Mapping[str, Any]]) -> list[BesideSummary]:
    """What was read beside the points of a run, as its record has them."""
    found: list[BesideSummary] = []
    for name, each in asked.items():
        values = [point[column] for point in points if (column := each.column(name)) in point]
        read = [value for value in values if value is not None]
        found.append(
            {
                "name": name, "device": each.device, "field": each.field, "unit": each.unit, "u": each.u,
                "least": min(read, default=None), "mean": math.fsum(read) / len(read) if read else None,
                "greatest": max(read, default=None), "readings": len(read), "silent": len(values) - len(read),
                "outside": sum(not each.holds(value) for value in read),
            }
        )  # fmt: skip
    return found


def sentence(of: BesideSummary) -> str:
    """What was read of one thing, for people."""
    if of["least"] is None:
        return f"no reading of {of['field']} of {of['device']}"
    u = "u not given" if of["u"] is None else f"u {of['u']:g}"
    span = f"{of['least']:.4g}" if of["least"] == of["greatest"] else f"{of['least']:.4g} to {of['greatest']:.4g}"
    lacking = [f"{of[key]} {key}" for key in ("outside", "silent") if of[key]]
    remarks = ", ".join([u, *lacking])
    return f"{span} {of['unit']}".rstrip() + f" ({remarks})"
