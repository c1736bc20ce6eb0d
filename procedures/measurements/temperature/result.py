"""The points and the result of a temperature sweep: what warming adds to each film, and to the force ratio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from palpate.instrument.sensor.design import Design
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.instrument.uncertainty.interpolation import Interpolation, interpolate
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import Column

FEWEST = 3  # least number of different changes for a slope


@dataclass(frozen=True, slots=True)
class FilmWarming:
    """One film after a change of temperature."""

    film: Annotated[str, Column("name of the film")]
    force_N: Annotated[float, Column("force by the fit with a trend, peak to peak", "N")]
    offset_N: Annotated[
        float,
        Column(
            "what the change has added to the film's steady signal, as a force; NaN: it was lost", "N", "offset N",
            "+z.3f", u="offset_u",
        ),
    ]  # fmt: skip
    offset_u: Annotated[float, Column(head="u N", cell="z.3f")]
    trend_N_per_s: Annotated[float, Column("drift of the signal under the load, as a force", "N/s")]
    error_lock_in: Annotated[float, Column("relative error of a lock-in amplifier on the same record")]
    error_rms: Annotated[float, Column("relative error of a voltmeter (RMS) on the same record")]


@dataclass(frozen=True, slots=True)
class TemperaturePoint:
    """One change of temperature, measured while the films warm up."""

    temperature_K: Annotated[float, Column("temperature relative to the start", "K", "K", "g")]
    step_K: Annotated[float, Column("its change from the one before", "K", "change\nK", "+g")]
    offset_after_s: Annotated[float, Column("time from the change until the films' offsets were taken", "s")]
    load_measured_N: columns.MeasuredLoad
    load_measured_u: float
    force_ratio: columns.ForceRatio
    force_ratio_u: columns.ForceRatioU
    error_lock_in: Annotated[
        float,
        Column("relative error of the ratio by a lock-in amplifier", "", "lock-in\nerror %", "+z.3f", 100),
    ]
    error_rms: Annotated[
        float, Column("relative error of the ratio by a voltmeter", "", "voltmeter\nerror %", "+z.2f", 100)
    ]
    films: Annotated[tuple[FilmWarming, ...], Column("each film", after="step_K", each="film")]
    valid: columns.Valid
    settling_s: columns.Settling
    attempts: columns.Attempts
    flags: columns.Flags


@dataclass(frozen=True, slots=True)
class TemperatureResult:
    """The result of a temperature sweep; values are None with fewer than three different valid changes.

    Attributes:
        points: the points.
        offsets: slope of the apparent force right after a change, with its standard uncertainty, by film [N/K].
        ratio_per_K: relative slope of the force ratio by the fit with a trend, with its standard uncertainty [1/K].
        largest_lock_in: largest relative error of the ratio by a lock-in amplifier.
        largest_rms: largest relative error of the ratio by a voltmeter.
        budgets: uncertainty budget of each slope.
    """

    points: list[TemperaturePoint]
    offsets: dict[str, tuple[float, float] | None]
    ratio_per_K: tuple[float, float] | None
    largest_lock_in: float | None
    largest_rms: float | None
    budgets: tuple[Budget, ...] = ()

    def summary(self) -> dict[str, Any]:
        """The result for JSON, without its points."""
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
    """Relative standard uncertainty of the films' gains, by scatter and calibration, shape (films,)."""
    variance = np.asarray(design.scatter_covariance).diagonal()
    if design.film_covariance is not None:
        variance = variance + np.asarray(design.film_covariance).diagonal()
    found: np.ndarray = np.sqrt(variance)
    return found


def evaluate(points: Sequence[TemperaturePoint], design: Design) -> TemperatureResult:
    """Find the slopes from the valid points."""
    valid = [point for point in points if point.valid]
    warmth = [point.step_K for point in valid]
    if len(set(warmth)) < FEWEST:
        return TemperatureResult(list(points), dict.fromkeys(film.name for film in design.films), None, None, None)

    offsets: dict[str, tuple[float, float] | None] = {}
    budgets = []
    for i, (film, film_u) in enumerate(zip(design.films, map(float, gain_u(design)), strict=True)):
        line = interpolate(warmth, [point.films[i].offset_N for point in valid], 0.0)
        value, line_u = _slope(line)
        # An error of the gain is common to all rows, so residuals miss it.
        offsets[film.name] = value, math.hypot(line_u, film_u * value)
        gain = Component("gain of the film", film_u, sensitivity=value)
        budgets.append(Budget(f"offset of film {film.name}", value, "N/K", (_about(line), gain)))

    mean = math.fsum(point.force_ratio for point in valid) / len(valid)
    u = max(point.force_ratio_u for point in valid) / mean
    line = interpolate(warmth, [point.force_ratio / mean for point in valid], u)
    ratio = _slope(line)
    budgets.append(Budget("change of the force ratio with a trend", ratio[0], "1/K", (_about(line),)))
    return TemperatureResult(
        points=list(points),
        offsets=offsets,
        ratio_per_K=ratio,
        largest_lock_in=max((point.error_lock_in for point in valid), key=abs),
        largest_rms=max((point.error_rms for point in valid), key=abs),
        budgets=tuple(budgets),
    )


def _slope(line: Interpolation) -> tuple[float, float]:
    """The slope of a line and its standard uncertainty."""
    return float(line.coefficients[1]), math.sqrt(float(line.covariance[1, 1]))


def _about(line: Interpolation) -> Component:
    """What the points of a line leave open of its slope."""
    _, u = _slope(line)
    if not line.by_scatter:
        return Component("points of the line", u)
    return Component("scatter about the line", u, degrees_of_freedom=line.degrees_of_freedom, kind="A")
