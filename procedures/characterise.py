"""What a sensor can do: noise, sensitivity, resolution, linearity, hysteresis, range, drift, place (thesis 2.1)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.bench import Bench
from instrument.calibration import LoadCellCalibration
from instrument.contracts.sensor_node import RANGE_VOLTS
from instrument.design import Design, Film
from instrument.errors import EstimateError, RangeError
from instrument.interpolation import Interpolation, interpolate
from instrument.quantity import show
from instrument.sample import get_sample
from procedures.film_point import FilmPoint, measure
from procedures.films import Films, check_nodes
from procedures.load_plan import check_force, check_frequency, check_time, preload_for
from procedures.load_sweep import check_loads
from procedures.policy import carry_out
from procedures.record import Recorder
from procedures.servo import LoadServo, check_zero, finish, press, withdraw

PROCEDURE = "characterise"
LEAST_LOADS = 3
SEEN = 2.0  # standard uncertainties of the noise that a force must be to count as seen
LARGEST_DRIFT_TIME = 86_400.0  # s
LEAST_DRIFT_POINTS, DRIFT_POINTS = 3, 10
LOADING, UNLOADING, HOLDING = "loading", "unloading", "holding"
DECIBELS = 20 / math.log(10)  # of a relative change

Progress = Callable[[int, int, str], None]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CharacteriseSettings:
    """Sample, loads in N peak to peak up and then down, dwell in s, frequency in Hz; how long drift is watched [s]."""

    sample: str
    loads: tuple[float, ...]
    dwell: float
    frequency: float
    drift_time: float


@dataclass(frozen=True, slots=True)
class Characteristic:
    """A figure of merit with its standard uncertainty, and how it was measured. `film` is "" for the whole sensor."""

    film: str
    quantity: str
    value: float
    u: float
    unit: str
    how: str


@dataclass(frozen=True, slots=True)
class FilmsPoint:
    """All films under one load: peak-to-peak voltages and noise by film, in the design's order."""

    direction: str
    time_s: float
    load_N: float
    load_measured_N: float
    load_measured_u: float
    voltages_V: tuple[float, ...]
    voltages_u: tuple[float, ...]
    noise_V: tuple[float, ...]
    samples: int
    valid: bool
    flags: tuple[str, ...]
    attempts: int = 1
    incidents: int = 0


@dataclass(frozen=True, slots=True)
class CharacteriseResult:
    films: tuple[str, ...]
    points: list[FilmsPoint]
    rows: list[Characteristic]

    def summary(self) -> dict[str, Any]:
        """Results under their public names."""
        return {"films": list(self.films), "rows": [asdict(row) for row in self.rows]}


def check(settings: CharacteriseSettings, design: Design, force_limit: float, nodes: int) -> None:
    """Refuse what cannot be done, before any device is spoken to.

    Raises:
        RangeError: too few loads for a line, a load beyond the force limit in N, a frequency, dwell or drift time that
            gives no estimate, a sensor whose films the bench's sensor nodes cannot take.
        UnknownName: an unknown sample.
    """
    get_sample(settings.sample)
    check_nodes(design, nodes)
    if len(settings.loads) < LEAST_LOADS:
        raise RangeError(f"{len(settings.loads)} loads do not give a line with its scatter; give {LEAST_LOADS} or more")
    check_force(settings.loads, force_limit)
    check_frequency(settings.frequency)
    check_time(settings.dwell, settings.frequency)
    least = LEAST_DRIFT_POINTS * settings.dwell
    if not least <= settings.drift_time <= LARGEST_DRIFT_TIME:
        raise RangeError(
            f"drift time {settings.drift_time:g} s is outside {least:g} s, {LEAST_DRIFT_POINTS} dwells, to"
            f" {LARGEST_DRIFT_TIME:g} s; give one inside"
        )


def run(
    bench: Bench,
    design: Design,
    calibration: LoadCellCalibration,
    settings: CharacteriseSettings,
    record: Recorder,
    progress: Progress,
) -> CharacteriseResult:
    """Loads up, loads down, then one load for a while. Each point is durable before `progress` hears of it.

    Raises:
        RangeError, UnknownName: as `check`, or a load outside the calibrated range; the outputs have stayed off.
        UnreachableError, SafetyError, LinkError, DeviceError: the bench could not; points stay on disk.
        EstimateError: too few points are valid.
    """
    check(settings, design, bench.force_limit, len(bench.nodes))
    check_loads(settings.loads, calibration, extrapolate=False)
    films = Films(bench, design, settings.frequency, preload_for(settings.loads) + max(settings.loads) / 2)
    withdraw(bench)
    check_zero(bench, calibration)
    preloaded = press(bench, calibration, get_sample(settings.sample), preload_for(settings.loads))
    servo = LoadServo(bench, calibration, settings.frequency, preloaded)
    middle = settings.loads[len(settings.loads) // 2]
    pause = settings.drift_time / DRIFT_POINTS
    steps = [
        *((LOADING, load) for load in settings.loads),
        *((UNLOADING, load) for load in settings.loads[::-1]),
        *((HOLDING, middle) for _ in range(DRIFT_POINTS + 1)),
    ]
    points: list[FilmsPoint] = []
    held_ns = 0
    for direction, load in steps:
        what = f"{direction}, {show(load, 'N')}"
        progress(len(points), len(steps), what)
        if direction != HOLDING or not held_ns:
            carry_out(bench, what, partial(servo.set, load))
        if direction == HOLDING:
            if held_ns:
                bench.clock.wait(max(0.0, pause - settings.dwell))
            held_ns = held_ns or bench.clock.now_ns()
        measured = measure(films, servo, load, settings.dwell, record, what)
        point = _point(direction, load, 1e-9 * (bench.clock.now_ns() - held_ns) if held_ns else 0.0, measured)
        record.point(asdict(point), measured.waveforms(design), bench.clock.now_ns())
        points.append(point)
        progress(len(points), len(steps), what)
    finish(bench, calibration)
    return evaluate(points, design, calibration, settings, bench.force_limit)


def _point(direction: str, load: float, time: float, measured: FilmPoint) -> FilmsPoint:
    fit = measured.fit
    return FilmsPoint(
        direction=direction,
        time_s=time,
        load_N=load,
        load_measured_N=measured.load_N,
        load_measured_u=measured.load_u,
        voltages_V=tuple(float(v) for v in 2 * fit.amplitude),
        voltages_u=tuple(float(u) for u in 2 * fit.amplitude_u),
        noise_V=tuple(float(v) for v in fit.residual),
        samples=fit.samples,
        valid=measured.valid,
        flags=measured.flags,
        attempts=measured.attempts,
        incidents=measured.incidents,
    )


def evaluate(
    points: Sequence[FilmsPoint],
    design: Design,
    calibration: LoadCellCalibration,
    settings: CharacteriseSettings,
    force_limit: float,
) -> CharacteriseResult:
    """Every film's figures, and the sensor's; `force_limit` of the bench in N.

    Raises:
        EstimateError: too few points are valid for a line.
    """
    valid = [p for p in (*(p for p in points if p.direction != HOLDING), *_longest_hold(points)) if p.valid]
    rows = [
        row
        for number, film in enumerate(design.films)
        for row in _film(film, number, valid, calibration, settings, force_limit)
    ]
    pitch = min(design.cell)
    how = "by the design: one tooth tells not where in its cell it is pressed; palpate sweep position tells more"
    rows.append(Characteristic("", "spatial resolution", pitch, pitch / math.sqrt(12), "m", how))
    return CharacteriseResult(tuple(film.name for film in design.films), list(points), rows)


def _longest_hold(points: Sequence[FilmsPoint]) -> list[FilmsPoint]:
    """Points of one load that was held: where something went wrong, it was set anew and is another one."""
    stretches: list[list[FilmsPoint]] = [[]]
    for point in (p for p in points if p.direction == HOLDING):
        if point.incidents or point.attempts > 1:
            stretches.append([])
        stretches[-1].append(point)
    return max(stretches, key=len)


def _film(
    film: Film,
    number: int,
    points: Sequence[FilmsPoint],
    calibration: LoadCellCalibration,
    settings: CharacteriseSettings,
    force_limit: float,
) -> list[Characteristic]:
    ways = {way: [p for p in points if p.direction == way] for way in (LOADING, UNLOADING, HOLDING)}
    up, down, held = ways[LOADING], ways[UNLOADING], ways[HOLDING]
    if len(up) < LEAST_LOADS or len(held) < LEAST_DRIFT_POINTS:
        raise EstimateError(
            f"film {film.name!r}: {len(up)} loads up and {len(held)} while holding are valid, {LEAST_LOADS} and"
            f" {LEAST_DRIFT_POINTS} are needed; see the record for what was flagged"
        )
    loads, volts = (
        np.array(values) for values in zip(*((p.load_measured_N, p.voltages_V[number]) for p in up), strict=True)
    )
    noise_u = float(np.mean([p.voltages_u[number] for p in up]))
    line = interpolate(loads, volts, noise_u)
    slope = float(line.coefficients[1])
    scatter, span = max(line.residual_sd, noise_u), slope * float(np.ptp(loads))
    relative_u = math.hypot(
        math.sqrt(line.covariance[1, 1]) / slope, calibration.sensitivity_u / calibration.sensitivity_mV_per_N
    )
    freedom = sum(p.samples for p in up)
    top = up[-1]
    signal = top.voltages_V[number] / math.sqrt(8)
    noise = top.noise_V[number]
    amplitude_u = top.voltages_u[number] / top.voltages_V[number]
    resolution = SEEN * noise_u / slope
    resolution_u = resolution * math.hypot(relative_u, 1 / math.sqrt(2 * freedom))
    converter = 2 * max(RANGE_VOLTS) / slope
    largest, ends = (converter, "converter") if converter < force_limit else (force_limit, "bench's force limit")
    drift, drift_u = _drift(held, number)
    dwell = f"{settings.dwell:g} s"

    def row(quantity: str, value: float, u: float, unit: str, how: str) -> Characteristic:
        return Characteristic(film.name, quantity, float(value), float(u), unit, how)

    return [
        row(
            "signal-to-noise ratio", 20 * math.log10(signal / noise),
            DECIBELS * math.hypot(amplitude_u, 1 / math.sqrt(2 * top.samples)), "dB",
            f"rms of the sine over rms of what is left of it, at {top.load_N:g} N",
        ),
        row("force sensitivity", slope, slope * relative_u, "V/N", "line of voltage over load cell, loading"),
        row(
            "resolution", resolution, resolution_u, "N",
            f"force that is {SEEN:g} standard uncertainties of noise in {dwell}, peak to peak",
        ),
        row(
            "linearity", _deviation(line, loads, volts) / span, scatter / span, "",
            "greatest deviation from the line over the span; gains scatter from load to load",
        ),
        row(
            "hysteresis", _hysteresis(line, up, down, number) / span, math.sqrt(2) * scatter / span, "",
            "greatest difference of loading and unloading at a load over the span",
        ),
        row(
            "dynamic range", 20 * math.log10(largest / resolution),
            DECIBELS * math.hypot(relative_u, resolution_u / resolution), "dB",
            f"from the resolution to {show(largest, 'N', 3)}, the {ends}",
        ),
        row(
            "drift", drift, drift_u, "1/min",
            f"slope of the amplitude over {held[-1].time_s - held[0].time_s:.0f} s at {held[-1].load_N:g} N",
        ),
    ]  # fmt: skip


def _deviation(line: Interpolation, loads: Floats, volts: Floats) -> float:
    return float(np.abs(volts - line.reading(loads)).max())


def _hysteresis(line: Interpolation, up: Sequence[FilmsPoint], down: Sequence[FilmsPoint], number: int) -> float:
    """Both ways seldom have just the same load: each is compared with the line first. Zero without a common load."""

    def beside(points: Sequence[FilmsPoint]) -> dict[float, float]:
        return {p.load_N: p.voltages_V[number] - float(line.reading(p.load_measured_N)) for p in points}

    loading, unloading = beside(up), beside(down)
    return max((abs(loading[load] - unloading[load]) for load in loading.keys() & unloading.keys()), default=0.0)


def _drift(held: Sequence[FilmsPoint], number: int) -> tuple[float, float]:
    """Relative change of the amplitude a minute, with its standard uncertainty."""
    minutes = [p.time_s / 60 for p in held]
    volts = np.array([p.voltages_V[number] for p in held])
    line = interpolate(minutes, volts / volts.mean(), held[0].voltages_u[number] / float(volts.mean()))
    return float(line.coefficients[1]), math.sqrt(line.covariance[1, 1])
