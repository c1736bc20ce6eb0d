"""What a characterisation is expected to give: the uncertainty of each figure of merit, by the lines of its budget.

A film's gain scatters from load to load as the design says [M], noise is that of usual films [A] and of the
converter's steps, and each load is off by its reading. Linearity, hysteresis and drift are expected to be what scatter
and noise make of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.contracts.sensor_node import FULL_SCALE_COUNTS, RANGE_VOLTS
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.signals.rapid_noise import of_greatest
from palpate.procedures.engine.promise import RELATIVE, Expected
from palpate.procedures.measurements.characterise.definitions import (
    DRIFT,
    HYSTERESIS,
    LINEARITY,
    PEAK_SNR,
    RESOLUTION,
    SENSITIVITY,
    SNR,
    SPATIAL_RESOLUTION,
    ZERO_BASED_LINEARITY,
)
from palpate.procedures.measurements.characterise.result import DECIBELS
from palpate.procedures.measurements.prospects import film_noise, load_on, reading_u
from palpate.procedures.steps.checks import preload_for
from palpate.procedures.steps.films import HEADROOM


def expected_figures(
    design: Design,
    ratio: float,
    loads: Sequence[float],
    samples: int,
    dwell: float,
    times: Sequence[float],
    cell: LoadCellCalibration,
) -> list[Expected]:
    """The uncertainty of each figure of merit.

    Args:
        design: design of the sensor.
        ratio: expected force ratio of the sample.
        loads: increasing loads, peak to peak [N].
        samples: number of samples in each record.
        dwell: dwell of each point [s].
        times: times of the points while the middle load is held [s].
        cell: calibration of the load cell.
    """
    at = np.asarray(loads, dtype=np.float64)
    found = [each for film in design.films for each in _film(design, film, ratio, at, samples, dwell, times, cell)]
    return [*found, Expected(f"{SPATIAL_RESOLUTION}, sensor", min(design.cell) / math.sqrt(12), "m")]


def _film(
    design: Design,
    film: Film,
    ratio: float,
    loads: np.ndarray,
    samples: int,
    dwell: float,
    times: Sequence[float],
    cell: LoadCellCalibration,
) -> Iterator[Expected]:
    # All uncertainties are in newtons of the load: the slope is one.
    forces = [load_on(design, film, ratio, load) for load in loads.tolist()]
    rounding = _step(film, loads) / math.sqrt(12) * math.sqrt(2 / samples) / film.sensitivity
    noise = np.array([
        load * math.hypot(film_noise(film, force, dwell), rounding / (force / 2))
        for load, force in zip(loads.tolist(), forces, strict=True)
    ])  # fmt: skip
    each = np.sqrt((film.scatter * loads) ** 2 + noise**2 + (reading_u(cell, 1.0)) ** 2)
    away = loads - loads.mean()
    weight = 1 - 1 / loads.size - away**2 / float(away @ away)  # of each point's error in the line's residuals
    scatter = math.sqrt(float(weight @ each**2) / (loads.size - 2))
    line = scatter / float(np.linalg.norm(away))
    of_cell = cell.sensitivity_u / cell.sensitivity_mV_per_N
    of_noise = 1 / math.sqrt(2 * samples * loads.size)
    of_top, span = noise[-1] / loads[-1], float(np.ptp(loads))
    minutes = np.asarray(times) / 60
    middle = loads[loads.size // 2]

    def figure(quantity: str, u: float, unit: str = RELATIVE) -> Expected:
        return Expected(f"{quantity}, {film.name}", float(u), unit)

    yield figure(SNR, DECIBELS * math.hypot(of_top, 1 / math.sqrt(2 * samples)), "dB")
    yield figure(PEAK_SNR, DECIBELS * math.hypot(of_top, of_greatest(samples)), "dB")
    yield figure(SENSITIVITY, math.hypot(line, of_cell))
    yield figure(RESOLUTION, math.hypot(line, of_cell, of_noise))
    yield figure(LINEARITY, scatter / span, "")
    yield figure(ZERO_BASED_LINEARITY, scatter / float(loads.max()), "")
    yield figure(HYSTERESIS, math.sqrt(2) * scatter / span, "")
    of_held = noise[loads.size // 2] / middle
    yield figure(DRIFT, of_held / float(np.linalg.norm(minutes - minutes.mean())), "1/min")


def _step(film: Film, loads: np.ndarray) -> float:
    """Step of the converter [V] on the range that the films are set to for these loads, as `Films` chooses it."""
    largest = preload_for(loads.tolist()) + float(loads.max()) / 2
    finest, widest = min(RANGE_VOLTS), max(RANGE_VOLTS)
    return (finest if HEADROOM * film.sensitivity * largest <= finest else widest) / FULL_SCALE_COUNTS
