"""What a load sweep is asked for, what is refused of it, and what it will do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.instrument.contracts import signal_generator
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import pickup_u
from palpate.instrument.models.foundation.springs import force_ratio
from palpate.instrument.quantity import parse
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.load import check_force as check_felt
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.dwell import LONGEST, Floor, check_dwell, check_target, dwell_of, floor_u
from palpate.procedures.engine.plan import Plan, Step, expected_noise, point_seconds
from palpate.procedures.steps.film_point import recording_seconds
from palpate.procedures.steps.films import SAMPLES_PER_CYCLE, check_nodes

PROCEDURE = "sweep-loads"
PRELOAD_MARGIN = 1.2  # of half the largest load, so that contact is never lost
FREQUENCIES = (0.5, 100.0)  # Hz, of a force ratio: three cycles fit into the indicator's window from 0.3 Hz on
FREQUENCY_STEP = signal_generator.CONTRACT["frequency"].scale  # Hz
LARGEST_COUNT = 1000  # loads


@dataclass(frozen=True, slots=True)
class SweepSettings:
    """What to sweep: names of samples, loads in N peak to peak, dwell in s, frequency in Hz.

    `tolerance` is a relative standard uncertainty of the force ratio for which the dwell of each point is chosen,
    instead of `dwell`. `extrapolate` lets loads pass that lie outside the calibrated range.
    """

    samples: tuple[str, ...]
    loads: tuple[float, ...]
    dwell: float
    frequency: float
    tolerance: float | None = None
    extrapolate: bool = False


@dataclass(frozen=True, slots=True)
class LoadStep(Step):
    sample: str
    load_N: float


def parse_loads(text: str) -> tuple[float, ...]:
    """Loads in N, as `parse_steps`. Raises QuantityError; RangeError: not above zero, too."""
    loads = parse_steps(text, "N", "loads", "1.5 N:4 N:0.5 N")
    if not all(load > 0 for load in loads):
        raise RangeError(f"loads {text!r}: loads must be above zero, increasing and distinct")
    return loads


def parse_steps(text: str, unit: str, name: str, example: str) -> tuple[float, ...]:
    """Values in a unit from "1.5 N:4 N:0.5 N" (first, last, step; the last is included) or "1.5 N, 2 N".

    Raises:
        QuantityError: not of the unit. RangeError: empty, not increasing, or over 1000 of them.
    """
    parts = text.split(":")
    if len(parts) == 3:
        first, last, step = (parse(part, unit) for part in parts)
        if not (step > 0 and last >= first):
            raise RangeError(f"{name} {text!r}: give first:last:step with last >= first and step > 0")
        steps = (last - first) / step * (1 + 1e-12) + 1e-9
        if not steps < LARGEST_COUNT:
            raise RangeError(f"{name} {text!r}: more than {LARGEST_COUNT} {name}; take a larger step")
        values = tuple(round(first + i * step, 12) for i in range(math.floor(steps) + 1))
    elif len(parts) == 1:
        values = tuple(parse(part, unit) for part in text.split(","))
    else:
        raise RangeError(f"{name} {text!r}: give first:last:step, such as {example!r}, or a list with commas")
    if list(values) != sorted(set(values)):
        raise RangeError(f"{name} {text!r}: {name} must be increasing and distinct")
    return values


def preload_for(loads: Sequence[float]) -> float:
    """Static force in N under which the largest load, N peak to peak, never lifts the probe."""
    return PRELOAD_MARGIN * max(loads) / 2


def check_frequency(frequency: float, allowed: tuple[float, float] = FREQUENCIES) -> None:
    """Refuse a frequency [Hz] that is not allowed or that the generator does not give. Raises RangeError."""
    if not allowed[0] <= frequency <= allowed[1]:
        raise RangeError(f"frequency {frequency:g} Hz is outside {allowed[0]:g} to {allowed[1]:g} Hz")
    steps = round(frequency / FREQUENCY_STEP)
    if abs(frequency - steps * FREQUENCY_STEP) > 1e-6 * FREQUENCY_STEP:
        raise RangeError(
            f"frequency {frequency:.10g} Hz lies between the generator's steps of {FREQUENCY_STEP:g} Hz; "
            f"take {steps * FREQUENCY_STEP:.10g} Hz"
        )


def check_force(loads: Sequence[float], force_limit: float) -> None:
    """Refuse loads [N] of nothing, or whose peak, with the preload, passes the bench's limit [N]. Raises RangeError."""
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
    """Refuse a dwell [s] of nothing, or that never ends. Raises RangeError."""
    if not 0 < dwell <= LONGEST:
        raise RangeError(f"dwell {dwell:g} s is not above 0 and at most {LONGEST:g} s; give one inside")


def check_time(dwell: float, frequency: float) -> None:
    """Refuse a dwell [s] that gives no estimate, or never ends. Raises RangeError."""
    check_end(dwell)
    check_dwell(dwell, frequency, SAMPLES_PER_CYCLE * frequency)


def floor_of(design: Design, ratio: float) -> tuple[Floor, ...]:
    """What no dwell lowers, of a force ratio: one tooth's and its base's cables are counted."""
    scatter = Floor("gain scatter", design.ratio_scatter)
    pickup = pickup_u(design) * math.hypot(1.0, 1 / ratio)
    return (scatter, Floor("pick-up in step with the load", pickup)) if pickup else (scatter,)


def expected_ratio(design: Design, sample: str) -> float:
    """The force ratio that a sample will give, roughly."""
    return design.thesis_force_ratio.get(sample) or force_ratio(design, get_sample(sample))


def check(settings: SweepSettings, design: Design, force_limit: float, nodes: int) -> None:
    """Refuse what cannot be done, before any device is spoken to.

    Raises:
        RangeError: a load beyond the force limit in N, a frequency or dwell that gives no estimate, a tolerance below
            the floor, a sensor whose films the bench's sensor nodes cannot take.
        UnknownName: an unknown sample.
    """
    check_nodes(design, nodes)
    for sample in settings.samples:
        get_sample(sample)
    check_force(settings.loads, force_limit)
    check_frequency(settings.frequency)
    if settings.tolerance is None:
        check_time(settings.dwell, settings.frequency)
    else:
        for sample in settings.samples:
            check_target(settings.tolerance, floor_of(design, expected_ratio(design, sample)))


def plan(settings: SweepSettings, design: Design) -> Plan[LoadStep]:
    """Every load of every sample, with what is to be expected of it."""
    steps = []
    for name in settings.samples:
        ratio = expected_ratio(design, name)
        floor = floor_of(design, ratio)
        for load in settings.loads:
            noise = expected_noise(design, load, ratio)
            recording = settings.dwell
            u = math.hypot(floor_u(floor), noise / math.sqrt(settings.dwell))
            if settings.tolerance is not None:
                chosen = dwell_of(settings.tolerance, noise, settings.frequency, floor)
                recording, u = recording_seconds(chosen.dwell, settings.frequency), chosen.u
            seconds = point_seconds(settings.frequency, recording, first=load == settings.loads[0])
            steps.append(LoadStep(None if settings.tolerance else settings.dwell, seconds, u, name, load))
    return Plan(PROCEDURE, steps)
