"""Temperature sweep (thesis 2.1.6, 6.2): what warming films add to their signals, what a fitted trend takes away."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from palpate.drivers.bench import Bench
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import film_forces, scatter_covariance
from palpate.instrument.quantity import parse, show
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.estimators import boxcar, rms
from palpate.instrument.uncertainty.interpolation import interpolate
from palpate.procedures.engine.plan import Plan, Step, point_seconds
from palpate.procedures.engine.progress import Progress
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.begin import Points, begin
from palpate.procedures.steps.checks import check_force, check_frequency, check_time, preload_for
from palpate.procedures.steps.film_point import FilmPoint, measure
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.pause import NOBODY, Pause
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import LoadServo, finish, press
from palpate.procedures.steps.standing import BEFORE, LENGTH, RESPONSE, Added, after_change, before_change

PROCEDURE = "sweep-temperature"
RANGE = (-20.0, 40.0)  # K against the start; PVDF loses its polarisation from about 80 °C on [S]
FEWEST, MOST = 3, 50
LONGEST_SOAK = 86400.0  # s
SETTING = 60.0  # s, for a person to set a temperature [A]


@dataclass(frozen=True, slots=True)
class TemperatureSettings:
    """Temperatures in K against the start, a sample, a load in N peak to peak, dwell in s, frequency in Hz.

    `soak`: s, before each change, in which the films take the temperature that was set before.
    """

    temperatures: tuple[float, ...]
    sample: str
    load: float
    dwell: float
    frequency: float
    soak: float
    extrapolate: bool = False


@dataclass(frozen=True, slots=True)
class TemperatureStep(Step):
    temperature_K: float
    step_K: float


@dataclass(frozen=True, slots=True)
class FilmWarming:
    """One film. Its force is by the fit with a trend; errors are what others would have read off the same record.

    Attributes:
        force_N: peak to peak.
        offset_N, offset_u: what the change has added to the film's standing signal, in terms of force; null where lost.
        trend_N_per_s: drift of the signal under the load, in terms of force.
        error_lock_in, error_rms: relative, of a lock-in amplifier and of a voltmeter.
    """

    film: str
    force_N: float
    offset_N: float
    offset_u: float
    trend_N_per_s: float
    error_lock_in: float
    error_rms: float


@dataclass(frozen=True, slots=True)
class TemperaturePoint:
    """After a change by `step_K`, while the films warm up; errors of the ratio are relative.

    `offset_after_s`: from the change to where the films' offsets were taken.
    """

    temperature_K: float
    step_K: float
    offset_after_s: float
    load_measured_N: float
    load_measured_u: float
    force_ratio: float
    force_ratio_u: float
    error_lock_in: float
    error_rms: float
    films: tuple[FilmWarming, ...]
    valid: bool
    settling_s: float
    attempts: int
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TemperatureResult:
    """Slopes against the change of temperature, with standard uncertainties; None: fewer than three valid changes.

    Attributes:
        offsets: film -> apparent force right after a change, a kelvin of it [N/K].
        ratio_per_K: relative change of the compensated force ratio, a kelvin: what is left.
        largest_lock_in, largest_rms: largest relative error of the ratio without compensation.
    """

    points: list[TemperaturePoint]
    offsets: dict[str, tuple[float, float] | None]
    ratio_per_K: tuple[float, float] | None
    largest_lock_in: float | None
    largest_rms: float | None

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        ratio, ratio_u = self.ratio_per_K or (None, None)
        rows = [(film, *(found or (None, None))) for film, found in self.offsets.items()]
        return {
            "offsets": [{"film": film, "offset_N_per_K": slope, "offset_u": u} for film, slope, u in rows],
            "ratio_per_K": ratio,
            "ratio_per_K_u": ratio_u,
            "largest_error_lock_in": self.largest_lock_in,
            "largest_error_rms": self.largest_rms,
        }


def parse_temperatures(text: str) -> tuple[float, ...]:
    """Temperatures in K against the start, such as "0 K, 5 K, 10 K". Raises QuantityError."""
    return tuple(parse(part, "K") for part in text.split(","))


def check(settings: TemperatureSettings, design: Design, force_limit: float, nodes: int) -> None:
    """Refuse what cannot be done, before any device is spoken to.

    Raises:
        RangeError: temperatures too few, repeated or beyond what films bear, a load beyond the force limit in N, a
            frequency or dwell that gives no estimate, or too few sensor nodes.
        UnknownName: an unknown sample.
    """
    check_nodes(design, nodes)
    get_sample(settings.sample)
    changes = steps_of(settings.temperatures)
    if len(set(changes)) < FEWEST or len(changes) > MOST:
        raise RangeError(
            f"temperatures {list(settings.temperatures)} K make {len(set(changes))} different changes; {FEWEST} to "
            f"{MOST} give a slope, such as '0 K, 5 K, 15 K, 10 K'"
        )
    if not 0 <= settings.soak <= LONGEST_SOAK:
        raise RangeError(f"soak {settings.soak:g} s is outside 0 to {LONGEST_SOAK:g} s")
    for temperature in settings.temperatures:
        if not RANGE[0] <= temperature <= RANGE[1]:
            raise RangeError(
                f"temperature {temperature:g} K against the start is outside {RANGE[0]:g} to {RANGE[1]:g} K, which the "
                "films bear"
            )
    check_force((settings.load,), force_limit)
    check_frequency(settings.frequency)
    check_time(settings.dwell, settings.frequency)


def steps_of(temperatures: Sequence[float]) -> tuple[float, ...]:
    """By how much each differs from the one before; the first, from the start."""
    return tuple(after - before for before, after in pairwise((0.0, *temperatures)))


def plan(settings: TemperatureSettings, design: Design) -> Plan[TemperatureStep]:
    """Every temperature, in the order given."""
    steps: list[TemperatureStep] = []
    for temperature, step in zip(settings.temperatures, steps_of(settings.temperatures), strict=True):
        soak = max(settings.soak, BEFORE) + RESPONSE + LENGTH
        seconds = soak + SETTING + point_seconds(settings.frequency, settings.dwell, first=not steps)
        steps.append(TemperatureStep(settings.dwell, seconds, design.ratio_scatter, temperature, step))
    return Plan(PROCEDURE, steps)


def run(
    bench: Bench,
    design: Design,
    calibration: LoadCellCalibration,
    settings: TemperatureSettings,
    record: Recorder,
    progress: Progress,
    pause: Pause = NOBODY,
) -> TemperatureResult:
    """Measure one load at each temperature, as soon as it is set. Each point is durable before `progress` hears of it.

    Raises:
        RangeError, UnknownName: as `check`, or a load outside the calibrated range; the outputs have stayed off.
        UnreachableError, SafetyError, LinkError, DeviceError: the bench could not; points stay on disk.
    """
    check(settings, design, bench.force_limit, len(bench.nodes))
    steps = plan(settings, design).steps
    films = begin(
        bench, design, calibration, (settings.load,), settings.frequency, (settings.sample,), settings.extrapolate
    )
    points = Points[TemperaturePoint](films, record, progress, len(steps), pause)
    points.tell(f"mount sample {settings.sample}")
    preloaded = press(bench, calibration, get_sample(settings.sample), preload_for((settings.load,)))
    servo = LoadServo(bench, calibration, settings.frequency, preloaded)
    for step in steps:
        what = show(step.temperature_K, "K")
        points.next(what)
        carry_out(bench, "outputs off", bench.rest)
        bench.clock.wait(max(settings.soak - BEFORE, 0.0))
        before = before_change(films)
        bench.operator.set_temperature(step.temperature_K)
        added = after_change(films, before)
        carry_out(bench, "outputs on", bench.drive)
        carry_out(bench, what, partial(servo.set, settings.load))
        measured = measure(films, servo, settings.load, settings.dwell, record, what)
        points.keep(_point(design, step, added, measured), measured, what)
    finish(bench, calibration)
    return evaluate(points.taken, design)


def _point(design: Design, step: TemperatureStep, added: Added, measured: FilmPoint) -> TemperaturePoint:
    fit, forces = measured.fit, film_forces(design, measured.fit)
    good = np.isfinite(measured.record.voltage).all(axis=0)
    time, volts = measured.record.time[good], measured.record.voltage[:, good]
    amplitude = np.where(fit.amplitude > 0, fit.amplitude, np.nan)  # of a film that clips all the time
    flags = (*measured.flags, *sorted(added.lost - set(measured.flags)))
    known = _gain_u(design)
    lock_in, voltmeter = (estimator(time, volts, fit.frequency) / amplitude for estimator in (boxcar, rms))
    return TemperaturePoint(
        temperature_K=step.temperature_K,
        step_K=step.step_K,
        offset_after_s=added.after,
        load_measured_N=measured.load_N,
        load_measured_u=measured.load_u,
        force_ratio=forces.force_ratio,
        force_ratio_u=forces.force_ratio_u,
        error_lock_in=_of_ratio(design, lock_in),
        error_rms=_of_ratio(design, voltmeter),
        films=tuple(
            FilmWarming(
                film=film.name,
                force_N=2 * float(fit.amplitude[i]) / film.sensitivity,
                offset_N=float(added.voltage[i]) / film.sensitivity,
                offset_u=math.hypot(float(added.u[i]), known[i] * float(added.voltage[i])) / film.sensitivity,
                trend_N_per_s=float(fit.trend[i]) / film.sensitivity,
                error_lock_in=float(lock_in[i]) - 1,
                error_rms=float(voltmeter[i]) - 1,
            )
            for i, film in enumerate(design.films)
        ),
        valid=not flags,
        settling_s=measured.settling,
        attempts=measured.attempts,
        flags=flags,
    )


def _gain_u(design: Design) -> np.ndarray:
    """Relative standard uncertainty of the films' gains (films,): their scatter, and their calibration."""
    variance = scatter_covariance(design).diagonal()
    if design.film_covariance is not None:
        variance = variance + np.asarray(design.film_covariance).diagonal()
    return np.sqrt(variance)


def _of_ratio(design: Design, read: np.ndarray) -> float:
    """Relative error of the mean ratio of rigid films to base films, from what was read of each, relative."""
    rigid = [float(read[i]) for i, film in enumerate(design.films) if film.kind == FILM_KINDS[0]]
    total = [float(read[i]) for i, film in enumerate(design.films) if film.kind == FILM_KINDS[1]]
    return (math.fsum(rigid) / len(rigid)) / (math.fsum(total) / len(total)) - 1


def evaluate(points: Sequence[TemperaturePoint], design: Design) -> TemperatureResult:
    """Slopes by the valid points."""
    valid = [point for point in points if point.valid]
    warmth = [point.step_K for point in valid]
    if len(set(warmth)) < FEWEST:
        return TemperatureResult(list(points), dict.fromkeys(film.name for film in design.films), None, None, None)

    def slope(values: Sequence[float], u: float) -> tuple[float, float]:
        line = interpolate(warmth, values, u)
        return float(line.coefficients[1]), math.sqrt(float(line.covariance[1, 1]))

    def offset(i: int, gain_u: float) -> tuple[float, float]:
        value, u = slope([point.films[i].offset_N for point in valid], 0.0)
        return value, math.hypot(u, gain_u * value)  # all rows may share the film's gain: no residual tells of it

    gains_u = _gain_u(design)
    mean = math.fsum(point.force_ratio for point in valid) / len(valid)
    u = max(point.force_ratio_u for point in valid) / mean
    return TemperatureResult(
        points=list(points),
        offsets={film.name: offset(i, float(gains_u[i])) for i, film in enumerate(design.films)},
        ratio_per_K=slope([point.force_ratio / mean for point in valid], u),
        largest_lock_in=max((point.error_lock_in for point in valid), key=abs),
        largest_rms=max((point.error_rms for point in valid), key=abs),
    )
