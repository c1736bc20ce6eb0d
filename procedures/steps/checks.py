"""Checks of loads, frequencies and times that a bench cannot give. Most are made before the bench is opened."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Protocol

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import MOST_QUOTED, RangeError, UnreachableError, quoted
from palpate.instrument.quantity import Typed, as_typed, parse, parse_list, show
from palpate.instrument.sensor.sample import check_force as check_felt
from palpate.instrument.signals.dwell import LONGEST, check_dwell
from palpate.procedures.steps.films import SAMPLES_PER_CYCLE

PRELOAD_MARGIN = 1.2  # preload over half the largest load, so that contact is never lost
FREQUENCIES = (0.5, 100.0)  # Hz, for force ratios; the indicator's window takes three cycles from 0.3 Hz on
LARGEST_COUNT = 1000  # loads
SMALLEST_LOAD = 2.0  # steps of the indicator


def parse_loads(text: str) -> tuple[float, ...]:
    """Loads [N] from a text, read by `parse_steps`; a load may be repeated, such as "4 N, 4 N".

    Raises QuantityError, RangeError: as `parse_steps`, or one is not above zero.
    """
    loads = parse_steps(text, "N", "loads", "1.5 N:4 N:0.5 N", repeated=True)
    if not all(load > 0 for load in loads):
        raise RangeError(f"loads {quoted(text)}: loads must be above zero")
    return loads


def parse_steps(text: str, unit: str, name: str, example: str, repeated: bool = False) -> tuple[float, ...]:
    """Values in a unit from a text such as "1.5 N:4 N:0.5 N" (first:last:step, with the last) or "1.5 N, 2 N".

    Args:
        text: the text.
        unit: unit of the values.
        name: what the values are, for messages.
        example: a text that would be right, for messages.
        repeated: whether a value may be repeated.

    Raises:
        QuantityError: a value is not in the unit.
        RangeError: there is no value, there are over 1000 of them, or they do not increase.
    """
    parts = text.split(":")
    if len(parts) == 3:
        first, last, step = (parse(part, unit) for part in parts)
        if not (step > 0 and last >= first):
            raise RangeError(f"{name} {quoted(text)}: give first:last:step with last >= first and step > 0")
        steps = (last - first) / step * (1 + 1e-12) + 1e-9
        if not steps < LARGEST_COUNT:
            raise RangeError(f"{name} {quoted(text)}: more than {LARGEST_COUNT} {name}; take a larger step")
        values = tuple(round(first + i * step, 12) for i in range(math.floor(steps) + 1))
    elif len(parts) == 1:
        values = parse_list(text, unit)
        if len(values) > LARGEST_COUNT:
            raise RangeError(f"{name} {quoted(text)}: more than {LARGEST_COUNT} {name}; give fewer")
    else:
        raise RangeError(f"{name} {quoted(text)}: give first:last:step, such as {example!r}, or a list with commas")
    if not _in_order(values, repeated):
        raise RangeError(f"{name} {quoted(text)}: {name} {_ORDER[repeated]}")
    return values


_ORDER = {False: "must be increasing and distinct", True: "must not decrease; a repeated one is a load set of its own"}


def parse_bench_time(text: str) -> float:
    """A bench time [s] that messages quote as it was typed, such as "2 min". Raises QuantityError: it is no time."""
    return Typed(parse(text, "s", "30 min"), text.strip())


def check_bench_time(time: float | None, example: str) -> None:
    """Refuse a bench time of a run [s] that is none. Raises RangeError.

    Args:
        time: the bench time [s]; None: none is asked for.
        example: a time that would do, as people write it.
    """
    if time is not None and not 0 < time < math.inf:
        raise RangeError(f"--time {as_typed(time, 's')} is not above 0 and finite; give a time such as '{example}'")


def check_increasing(name: str, values: Sequence[float], unit: str, repeated: bool = False) -> None:
    """Refuse values in a unit of which one is below the one before it, or equal to it unless `repeated`.

    Raises RangeError.
    """
    if not _in_order(values, repeated):
        listed = ", ".join(show(value, unit) for value in values[:MOST_QUOTED])
        if len(values) > MOST_QUOTED:
            listed += f", ... ({len(values)} values)"
        raise RangeError(f"{name} {listed} {_ORDER[repeated]}")


def _in_order(values: Sequence[float], repeated: bool) -> bool:
    return all(before < after or (repeated and before == after) for before, after in pairwise(values))


def set_names(loads: Sequence[float]) -> list[str]:
    """Text of each load [N] for people, such as "4 N, set 2" where it is repeated."""
    seen: dict[float, int] = {}
    texts = []
    for load in loads:
        seen[load] = seen.get(load, 0) + 1
        texts.append(show(load, "N") + (f", set {seen[load]}" if seen[load] > 1 else ""))
    return texts


def preload_for(loads: Sequence[float]) -> float:
    """Static force under which none of the loads [N, peak to peak] lifts the probe [N]."""
    return PRELOAD_MARGIN * max(loads) / 2


class LoadLimits(Protocol):
    """What is known of the loads of a bench before it is opened; see `palpate.procedures.lab.lab.Target`."""

    @property
    def frequency_step(self) -> float | None: ...
    @property
    def drivable(self) -> Callable[[float], object]: ...


def check_frequency(frequency: float, target: LoadLimits | None, allowed: tuple[float, float] = FREQUENCIES) -> None:
    """Refuse a frequency [Hz] that is outside the limits, or that the bench cannot have by its file.

    What the file does not tell, the drivers refuse before anything moves. A target of None: no bench is known yet.

    Raises:
        RangeError: it is outside the limits, between the bench's steps, or one of its devices cannot do it.
        BenchError: the bench lacks a device that a load needs.
    """
    if not allowed[0] <= frequency <= allowed[1]:
        raise RangeError(f"frequency {frequency:g} Hz is outside {allowed[0]:g} to {allowed[1]:g} Hz; give one inside")
    if target is None:
        return
    target.drivable(frequency)
    step = target.frequency_step
    if step is None:
        return
    steps = max(round(frequency / step), 1)
    if abs(frequency - steps * step) > 1e-6 * step:
        raise RangeError(
            f"frequency {frequency:.10g} Hz lies between the exciter's steps of {step:g} Hz; "
            f"take {steps * step:.10g} Hz"
        )


def check_force(loads: Sequence[float], force_limit: float) -> None:
    """Refuse loads that are not above zero, or too large for the bench.

    Args:
        loads: loads, peak to peak [N].
        force_limit: limit of the bench for the peak force, which contains the preload [N].

    Raises:
        RangeError: a load is not above zero, or the largest exceeds the force limit.
    """
    if not min(loads) > 0:
        raise RangeError(f"load {min(loads):g} N peak to peak is not above zero; give a positive one")
    largest = max(loads)
    peak = preload_for(loads) + largest / 2
    if peak > force_limit:
        most = force_limit / (0.5 + PRELOAD_MARGIN / 2)
        raise RangeError(
            f"load {largest:g} N peak to peak takes a peak force of {peak:.3g} N with its preload, above the bench's "
            f"force limit of {force_limit:g} N; loads up to {most:.3g} N are possible"
        )
    check_felt(min(loads))


def check_end(dwell: float) -> None:
    """Refuse a dwell [s] that is not above zero, or too long. Raises RangeError."""
    if not 0 < dwell <= LONGEST:
        raise RangeError(f"dwell {dwell:g} s is not above 0 and at most {LONGEST:g} s; give one inside")


def check_time(dwell: float, frequency: float) -> None:
    """Refuse a dwell [s] that gives no estimate at a frequency [Hz], or is too long. Raises RangeError."""
    check_end(dwell)
    check_dwell(dwell, frequency, SAMPLES_PER_CYCLE * frequency)


def check_loads(loads: Sequence[float], calibration: LoadCellCalibration, extrapolate: bool) -> None:
    """Refuse loads that the load cell cannot measure.

    Args:
        loads: loads, peak to peak [N].
        calibration: calibration of the load cell.
        extrapolate: whether loads may lie outside the calibrated range.

    Raises:
        UnreachableError: a load is below what the indicator resolves.
        RangeError: a load lies outside the calibrated range.
    """
    smallest = SMALLEST_LOAD * calibration.resolution()
    if min(loads) < smallest:
        raise UnreachableError(
            f"load {show(min(loads), 'N')} peak to peak is below {SMALLEST_LOAD:g} steps of the load indicator; "
            f"ask for {show(smallest, 'N', 3)} or more"
        )
    if not extrapolate:
        for load in loads:
            calibration.check_range(load)
