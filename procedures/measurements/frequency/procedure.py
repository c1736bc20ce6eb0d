"""Frequency sweep (thesis 2.1.4, 6.2): gain and phase of each film, the charge amplifiers' corner, resonance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from palpate.drivers.bench import Bench
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import parse, show
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.frequency_response import TACTILE, Corner, Resonance, fit_corner, fit_resonance
from palpate.procedures.engine.plan import FIRST_STEPS, Plan, Step, point_seconds
from palpate.procedures.engine.progress import Progress
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.begin import Points, begin
from palpate.procedures.steps.checks import (
    FREQUENCY_STEP,
    check_end,
    check_force,
    check_frequency,
    check_time,
    preload_for,
)
from palpate.procedures.steps.film_point import FilmPoint, measure
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.pause import NOBODY, Pause
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import LoadServo, finish, press

PROCEDURE = "sweep-frequency"
RANGE = (0.1, 100.0)  # Hz
FEWEST, MOST = 3, 200
CYCLES = 3  # at least, in a dwell


@dataclass(frozen=True, slots=True)
class FrequencySettings:
    """Frequencies in Hz, a sample, a load in N peak to peak, the shortest dwell in s."""

    frequencies: tuple[float, ...]
    sample: str
    load: float
    dwell: float
    extrapolate: bool = False


@dataclass(frozen=True, slots=True)
class FrequencyStep(Step):
    frequency_Hz: float


@dataclass(frozen=True, slots=True)
class FilmResponse:
    """One film: voltage per newton of load, and its phase before that of the first base film.

    The generator and the nodes share no clock, so no phase against the drive is known.
    """

    film: str
    gain_V_per_N: float
    gain_u: float
    phase_deg: float
    phase_u: float


@dataclass(frozen=True, slots=True)
class FrequencyPoint:
    """One frequency. `response_N_per_V`: load for the generator's amplitude, both peak to peak."""

    frequency_Hz: float
    tactile: bool
    load_measured_N: float
    load_measured_u: float
    response_N_per_V: float
    films: tuple[FilmResponse, ...]
    valid: bool
    dwell_s: float
    settling_s: float
    attempts: int
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FrequencyResult:
    """`corners`: of each film; None where the sweep shows none. `resonance`: of shaker, object and sensor."""

    points: list[FrequencyPoint]
    corners: dict[str, Corner | None]
    resonance: Resonance | None

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        return {
            "corners": [{"film": film, **_known(corner)} for film, corner in self.corners.items()],
            "resonance": None if self.resonance is None else asdict(self.resonance),
        }


def _known(corner: Corner | None) -> dict[str, float | None]:
    if corner is None:
        return dict.fromkeys(("gain", "gain_u", "corner_Hz", "corner_u", "time_constant_s"))
    return {**asdict(corner), "time_constant_s": corner.time_constant}


def parse_frequencies(text: str) -> tuple[float, ...]:
    """Frequencies in Hz from "0.1 Hz:100 Hz:16" (first, last, how many: evenly in the logarithm) or "1 Hz, 10 Hz".

    Those between are put on the generator's steps.

    Raises:
        QuantityError: not a frequency. RangeError: not increasing, or fewer than 3 or more than 200 of them.
    """
    parts = text.split(":")
    if len(parts) == 3:
        first, last, count = parse(parts[0], "Hz"), parse(parts[1], "Hz"), parse(parts[2], "")
        if not (0 < first < last and count == round(count) and FEWEST <= count <= MOST):
            raise RangeError(
                f"frequencies {text!r}: give first:last:count with first < last and a count of {FEWEST} to {MOST}"
            )
        even = np.geomspace(first, last, round(count))
        inner = (round(float(f) / FREQUENCY_STEP) * FREQUENCY_STEP for f in even[1:-1])
        found = (first, *(round(f, 9) for f in inner), last)
    elif len(parts) == 1:
        found = tuple(parse(part, "Hz") for part in text.split(","))
    else:
        raise RangeError(f"frequencies {text!r}: give first:last:count, such as '0.1 Hz:100 Hz:16', or a list")
    if list(found) != sorted(set(found)):
        raise RangeError(f"frequencies {text!r}: they must increase, each at least a step of {FREQUENCY_STEP:g} Hz")
    if not FEWEST <= len(found) <= MOST:
        raise RangeError(f"frequencies {text!r}: {len(found)} of them; a corner takes {FEWEST} to {MOST}")
    return found


def dwell_at(frequency: float, shortest: float) -> float:
    """Whole cycles, three at least, of `shortest` s or longer [s]."""
    return max(CYCLES, math.ceil(shortest * frequency * (1 - 1e-9))) / frequency


def check(settings: FrequencySettings, design: Design, force_limit: float, nodes: int) -> None:
    """Refuse what cannot be done, before any device is spoken to.

    Raises:
        RangeError: a frequency outside 0.1 to 100 Hz or between the generator's steps, too few of them, a load beyond
            the force limit in N, a dwell without end, or too few sensor nodes.
        UnknownName: an unknown sample.
    """
    check_nodes(design, nodes)
    get_sample(settings.sample)
    check_force((settings.load,), force_limit)
    check_end(settings.dwell)
    if len(settings.frequencies) < FEWEST:
        raise RangeError(f"{len(settings.frequencies)} frequencies do not show a corner; give {FEWEST} or more")
    for frequency in settings.frequencies:
        check_frequency(frequency, RANGE)
        check_time(dwell_at(frequency, settings.dwell), frequency)


def plan(settings: FrequencySettings, _design: Design) -> Plan[FrequencyStep]:
    """Every frequency, from low to high."""
    steps: list[FrequencyStep] = []
    for frequency in settings.frequencies:
        dwell = dwell_at(frequency, settings.dwell)
        seconds = point_seconds(frequency, dwell, first=not steps, steps=FIRST_STEPS)
        steps.append(FrequencyStep(dwell, seconds, None, frequency))
    return Plan(PROCEDURE, steps)


def run(
    bench: Bench,
    design: Design,
    calibration: LoadCellCalibration,
    settings: FrequencySettings,
    record: Recorder,
    progress: Progress,
    pause: Pause = NOBODY,
) -> FrequencyResult:
    """Drive one sample with one load at each frequency. Each point is durable before `progress` hears of it.

    Raises:
        RangeError, UnknownName: as `check`, or a load outside the calibrated range; the outputs have stayed off.
        UnreachableError, SafetyError, LinkError, DeviceError: the bench could not; points stay on disk.
    """
    check(settings, design, bench.force_limit, len(bench.nodes))
    steps = plan(settings, design).steps
    films = begin(
        bench, design, calibration, (settings.load,), steps[0].frequency_Hz, (settings.sample,), settings.extrapolate
    )
    points = Points(films, record, progress, len(steps), pause, record.finished(FrequencyPoint))
    points.tell(f"mount sample {settings.sample}")
    preloaded = press(bench, calibration, get_sample(settings.sample), preload_for((settings.load,)))
    for step in steps[len(points.taken) :]:
        what = show(step.frequency_Hz, "Hz")
        points.next(what)
        films.set_frequency(step.frequency_Hz)
        servo = LoadServo(bench, calibration, step.frequency_Hz, preloaded)
        carry_out(bench, what, partial(servo.set, settings.load))
        dwell = dwell_at(step.frequency_Hz, settings.dwell)
        measured = measure(films, servo, settings.load, dwell, record, what, compare=False)
        points.keep(_point(design, step.frequency_Hz, measured, servo.amplitude), measured, what)
    finish(bench, calibration)
    return evaluate(points.taken, design)


def _point(design: Design, frequency: float, measured: FilmPoint, amplitude: float) -> FrequencyPoint:
    fit = measured.fit
    reference = next(i for i, film in enumerate(design.films) if film.kind == FILM_KINDS[1])
    relative_u = fit.amplitude_u / np.where(fit.amplitude > 0, fit.amplitude, np.nan)
    films = []
    for i, film in enumerate(design.films):
        gain = 2 * float(fit.amplitude[i]) / measured.load_N
        phase = math.remainder(float(fit.phase[i] - fit.phase[reference]), 2 * math.pi)
        phase_u = 0.0 if i == reference else math.hypot(float(relative_u[i]), float(relative_u[reference]))
        relative = math.hypot(film.scatter, float(relative_u[i]), measured.load_u / measured.load_N)
        films.append(FilmResponse(film.name, gain, gain * relative, math.degrees(phase), math.degrees(phase_u)))
    return FrequencyPoint(
        frequency_Hz=frequency,
        tactile=frequency <= TACTILE,
        load_measured_N=measured.load_N,
        load_measured_u=measured.load_u,
        response_N_per_V=measured.load_N / (2 * amplitude),
        films=tuple(films),
        valid=measured.valid,
        dwell_s=measured.dwell,
        settling_s=measured.settling,
        attempts=measured.attempts,
        flags=measured.flags,
    )


def evaluate(points: Sequence[FrequencyPoint], design: Design) -> FrequencyResult:
    """Corners and resonance by the valid points; None where there are too few."""
    valid = [point for point in points if point.valid]
    frequency = [point.frequency_Hz for point in valid]
    corners: dict[str, Corner | None] = dict.fromkeys(film.name for film in design.films)
    if len(valid) >= FEWEST:
        for i, film in enumerate(design.films):
            gains = [point.films[i] for point in valid]
            corners[film.name] = fit_corner(frequency, [g.gain_V_per_N for g in gains], [g.gain_u for g in gains])
    resonance = None
    if len(valid) > FEWEST:
        response = np.array([point.response_N_per_V for point in valid])
        relative = np.array([point.load_measured_u / point.load_measured_N for point in valid])
        resonance = fit_resonance(frequency, response, response * relative)
    return FrequencyResult(list(points), corners, resonance)
