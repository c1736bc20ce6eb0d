"""The points and the result of a characterisation: figures of merit by their definitions, with uncertainty budgets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.contracts.sensor_node import RANGE_VOLTS
from palpate.instrument.errors import EstimateError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.signals.rapid_noise import of_greatest
from palpate.instrument.uncertainty.budget import Budget, Component, Kind
from palpate.instrument.uncertainty.interpolation import Interpolation, interpolate
from palpate.procedures.measurements.characterise.definitions import (
    DEFINITIONS,
    DRIFT,
    DYNAMIC_RANGE,
    HYSTERESIS,
    LINEARITY,
    PEAK_SNR,
    RESOLUTION,
    SENSITIVITY,
    SNR,
    SPATIAL_RESOLUTION,
    ZERO_BASED_LINEARITY,
    elsewhere,
)

LEAST_LOADS = 3
SEEN = 2.0  # standard uncertainties of the noise; a larger force counts as seen
LEAST_DRIFT_POINTS = 3
LOADING, UNLOADING, HOLDING = "loading", "unloading", "holding"
DECIBELS = 20 / math.log(10)  # of a relative change

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Characteristic:
    """A figure of merit.

    Attributes:
        film: name of the film; "" for the whole sensor.
        quantity: name of the figure.
        value, u: its value and standard uncertainty.
        unit: their unit; "" for a ratio.
        definition: its equation.
        thesis: the thesis' section, and what that says.
        how: what the definition leaves open: at which load, over how many points.
    """

    film: str
    quantity: str
    value: float
    u: float
    unit: str
    definition: str
    thesis: str
    how: str


@dataclass(frozen=True, slots=True)
class FilmsPoint:
    """All films under one load. Loads and voltages are peak to peak; names with `_u` are standard uncertainties.

    Attributes:
        direction: LOADING, UNLOADING or HOLDING.
        time_s: time since the load is held; 0 before that.
        load_N: the load that was asked for.
        load_measured_N, load_measured_u: the measured load.
        voltages_V, voltages_u: voltage of each film, in the design's order.
        noise_V: rms of each film's noise.
        noise_peak_V: greatest value of each film's noise.
        samples: number of samples in the record.
        valid: whether the point is used.
        flags: why the point is not used, or what to know about it.
        attempts: number of attempts.
        incidents: number of failures of the bench that were made good since the point before.
    """

    direction: str
    time_s: float
    load_N: float
    load_measured_N: float
    load_measured_u: float
    voltages_V: tuple[float, ...]
    voltages_u: tuple[float, ...]
    noise_V: tuple[float, ...]
    noise_peak_V: tuple[float, ...]
    samples: int
    valid: bool
    flags: tuple[str, ...]
    attempts: int = 1
    incidents: int = 0


@dataclass(frozen=True, slots=True)
class CharacteriseResult:
    """The result of a characterisation.

    Attributes:
        films: names of the films, in the design's order.
        points: the points.
        rows: the figures of merit, film by film, then of the sensor.
        budgets: uncertainty budget of each row.
    """

    films: tuple[str, ...]
    points: list[FilmsPoint]
    rows: list[Characteristic]
    budgets: list[Budget]

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        return {
            "films": list(self.films),
            "rows": [asdict(row) for row in self.rows],
            "elsewhere": elsewhere(),
            "budgets": [budget.summary() for budget in self.budgets],
        }


Row = tuple[Characteristic, Budget]


def evaluate(
    points: Sequence[FilmsPoint],
    design: Design,
    calibration: LoadCellCalibration,
    dwell: float,
    force_limit: float,
    widest: float = max(RANGE_VOLTS),
) -> CharacteriseResult:
    """Find the figures of merit of every film and of the sensor.

    Args:
        points: the points, in the order in which they were measured.
        design: design of the sensor.
        calibration: calibration of the load cell.
        dwell: dwell of each point [s].
        force_limit: force limit of the bench [N].
        widest: widest input range of its sensor nodes [V].

    Raises:
        EstimateError: too few points are valid for a line.
    """
    valid = [p for p in (*(p for p in points if p.direction != HOLDING), *_longest_hold(points)) if p.valid]
    found = [
        each
        for number, film in enumerate(design.films)
        for each in _film(film, number, valid, calibration, dwell, force_limit, widest)
    ]
    pitch = min(design.cell)
    how = "by the design; palpate sweep position tells more"
    anywhere = Component("anywhere in the cell", pitch / math.sqrt(12))
    found.append(_characteristic("", SPATIAL_RESOLUTION, pitch, how, anywhere))
    rows, budgets = zip(*found, strict=True)
    return CharacteriseResult(tuple(film.name for film in design.films), list(points), list(rows), list(budgets))


def _longest_hold(points: Sequence[FilmsPoint]) -> list[FilmsPoint]:
    """The longest series of points at one load. After a failure the load was set anew, and another series begins."""
    stretches: list[list[FilmsPoint]] = [[]]
    for point in (p for p in points if p.direction == HOLDING):
        if point.incidents or point.attempts > 1:
            stretches.append([])
        stretches[-1].append(point)
    return max(stretches, key=len)


def _characteristic(film: str, quantity: str, value: float, how: str, *components: Component) -> Row:
    is_ = DEFINITIONS[quantity]
    budget = Budget(f"{quantity}, {film or 'sensor'}", float(value), is_.unit, components)
    return Characteristic(film, quantity, budget.value, budget.u, is_.unit, is_.equation, is_.thesis, how), budget


def _film(
    film: Film,
    number: int,
    points: Sequence[FilmsPoint],
    calibration: LoadCellCalibration,
    dwell: float,
    force_limit: float,
    widest: float,
) -> list[Row]:
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
    noises = np.array([p.voltages_u[number] for p in up])
    noise_u = float(noises.mean())
    # The indicator's steps are in the loads, and over a short span they are most of what the slope may be off by.
    load_u = float(np.mean([p.load_measured_u for p in up]))
    reading_u = math.hypot(noise_u, load_u * float(volts.mean() / loads.mean()))
    line = interpolate(loads, volts, reading_u)
    slope = float(line.coefficients[1])
    scatter, span = max(line.residual_sd, reading_u), slope * float(np.ptp(loads))
    proportional = float(loads @ volts / (loads @ loads))
    reach = proportional * float(loads.max())
    top = up[-1]
    resolution = SEEN * noise_u / slope
    converter = 2 * widest / slope
    largest, ends = (converter, "converter") if converter < force_limit else (force_limit, "bench's force limit")
    minutes = [p.time_s / 60 for p in held]
    amplitudes = np.array([p.voltages_V[number] for p in held])
    mean = float(amplitudes.mean())
    drift = interpolate(minutes, amplitudes / mean, held[0].voltages_u[number] / mean)

    # Relative, of the slope; the noise is that of all samples.
    of_line = Component("line", math.sqrt(line.covariance[1, 1]) / slope, 1.0, *_repeats(line))
    known = float(calibration.degrees_of_freedom or math.inf)
    of_cell = Component("load cell", calibration.sensitivity_u / calibration.sensitivity_mV_per_N, 1.0, known)
    # A film that still settles has more noise at one load than at another, and more than random noise would differ.
    scattered, random = (
        float(noises.std(ddof=1)) / noise_u / math.sqrt(len(up)),
        1 / math.sqrt(2 * sum(p.samples for p in up)),
    )
    freedom = len(up) - 1 if scattered > random else math.inf
    of_noise = Component("noise, as measured", max(scattered, random), 1.0, freedom, "A")

    def row(quantity: str, value: float, how: str, *parts: Component, each: float = 1.0) -> Row:
        return _characteristic(film.name, quantity, value, how, *(replace(p, sensitivity=each) for p in parts))

    of_amplitude = Component("amplitude", top.voltages_u[number] / top.voltages_V[number], kind="A")
    at_top = f"at {top.load_N:g} N"
    by_loads = f"{len(up)} loads, increasing"
    return [
        row(
            SNR, 20 * math.log10(top.voltages_V[number] / math.sqrt(8) / top.noise_V[number]), at_top,
            of_amplitude, Component("noise, as measured", 1 / math.sqrt(2 * top.samples), kind="A"), each=DECIBELS,
        ),
        row(
            PEAK_SNR, 20 * math.log10(top.voltages_V[number] / 2 / top.noise_peak_V[number]),
            f"{at_top}, of {top.samples} samples",
            of_amplitude, Component("greatest of the noise", of_greatest(top.samples), kind="A"), each=DECIBELS,
        ),
        row(SENSITIVITY, slope, by_loads, of_line, of_cell, each=slope),
        row(RESOLUTION, resolution, f"in {dwell:g} s", of_line, of_cell, of_noise, each=resolution),
        row(
            LINEARITY, float(np.abs(volts - line.reading(loads)).max()) / span,
            f"{by_loads}; gains scatter from load to load",
            Component("scatter of a load", scatter / span, 1.0, *_repeats(line)),
        ),
        row(
            ZERO_BASED_LINEARITY, float(np.abs(volts - proportional * loads).max()) / reach, "the same loads",
            Component("scatter of a load", scatter / reach, 1.0, *_repeats(line)),
        ),
        row(
            HYSTERESIS, _hysteresis(line, up, down, number) / span, "loads up, then down",
            Component("scatter of two loads", math.sqrt(2) * scatter / span, 1.0, *_repeats(line)),
        ),
        # Where the converter ends it, the slope is in both ends and cancels.
        row(
            DYNAMIC_RANGE, 20 * math.log10(largest / resolution), f"to {show(largest, 'N', 3)}, the {ends}",
            *(() if largest == converter else (of_line, of_cell)), of_noise, each=DECIBELS,
        ),
        row(
            DRIFT, float(drift.coefficients[1]),
            f"over {held[-1].time_s - held[0].time_s:.0f} s at {held[-1].load_N:g} N",
            Component("scatter about the line", math.sqrt(drift.covariance[1, 1]), 1.0, *_repeats(drift)),
        ),
    ]  # fmt: skip


def _repeats(line: Interpolation) -> tuple[float, Kind]:
    """Degrees of freedom of a line's scatter, and the kind of that evaluation."""
    return (line.degrees_of_freedom if line.by_scatter else math.inf), "A"


def _hysteresis(line: Interpolation, up: Sequence[FilmsPoint], down: Sequence[FilmsPoint], number: int) -> float:
    """Greatest difference between loading and unloading at the same load [V]; 0 without a common load.

    The measured loads of both ways are not quite the same, so each voltage is taken relative to the line.
    """

    def beside(points: Sequence[FilmsPoint]) -> dict[float, float]:
        return {p.load_N: p.voltages_V[number] - float(line.reading(p.load_measured_N)) for p in points}

    loading, unloading = beside(up), beside(down)
    return max((abs(loading[load] - unloading[load]) for load in loading.keys() & unloading.keys()), default=0.0)
