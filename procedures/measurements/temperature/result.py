"""What a temperature sweep measures and finds: what warming adds to each film, and what is left in the ratio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.instrument.findings.film_forces import scatter_covariance
from palpate.instrument.sensor.design import Design
from palpate.instrument.uncertainty.budget import Budget
from palpate.instrument.uncertainty.interpolation import interpolate

FEWEST = 3  # different changes that give a slope


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
    budgets: tuple[Budget, ...] = ()

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


def gain_u(design: Design) -> np.ndarray:
    """Relative standard uncertainty of the films' gains (films,): their scatter, and their calibration."""
    variance = scatter_covariance(design).diagonal()
    if design.film_covariance is not None:
        variance = variance + np.asarray(design.film_covariance).diagonal()
    return np.sqrt(variance)


def evaluate(points: Sequence[TemperaturePoint], design: Design) -> TemperatureResult:
    """Slopes by the valid points."""
    valid = [point for point in points if point.valid]
    warmth = [point.step_K for point in valid]
    if len(set(warmth)) < FEWEST:
        return TemperatureResult(list(points), dict.fromkeys(film.name for film in design.films), None, None, None)

    def slope(values: Sequence[float], u: float) -> tuple[float, float]:
        line = interpolate(warmth, values, u)
        return float(line.coefficients[1]), math.sqrt(float(line.covariance[1, 1]))

    def offset(i: int, own_u: float) -> tuple[float, float]:
        value, u = slope([point.films[i].offset_N for point in valid], 0.0)
        return value, math.hypot(u, own_u * value)  # all rows may share the film's gain: no residual tells of it

    gains_u = gain_u(design)
    mean = math.fsum(point.force_ratio for point in valid) / len(valid)
    u = max(point.force_ratio_u for point in valid) / mean
    return TemperatureResult(
        points=list(points),
        offsets={film.name: offset(i, float(gains_u[i])) for i, film in enumerate(design.films)},
        ratio_per_K=slope([point.force_ratio / mean for point in valid], u),
        largest_lock_in=max((point.error_lock_in for point in valid), key=abs),
        largest_rms=max((point.error_rms for point in valid), key=abs),
    )
