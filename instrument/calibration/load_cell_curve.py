"""The curve through runs of dead weights, and how well its slope is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict

from palpate.instrument.allocation.stopping import pooled
from palpate.instrument.calibration.classification import WeightRun, by_position, spread_over_positions
from palpate.instrument.calibration.displayed import displayed_curve
from palpate.instrument.config import Config, Positive
from palpate.instrument.errors import EstimateError, RangeError
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.instrument.uncertainty.interpolation import Interpolation, best_degree, interpolate
from palpate.instrument.uncertainty.rounding import mean_u

CURVE, POSITIONS, REPEATABILITY, WEIGHTS = (
    "curve",
    "positions",
    "repeatability",
    "weights",
)  # of the sensitivity's budget


class Curvature(Config):
    """Term of second degree [mV/N²] of a calibration, with its standard uncertainty and covariances."""

    model_config = ConfigDict(strict=True)

    mV_per_N2: float
    u: Positive
    with_sensitivity: float
    with_zero: float


@dataclass(frozen=True, slots=True, eq=False)
class LoadCellCurve:
    """Curve of a load cell's calibration.

    Attributes:
        curve: curve through the mean readings, of the degree that was asked for, else of the better degree.
        scatter_mV: standard deviation of single displayed values; None: not known.
        sensitivity: slope at no load with its uncertainty [mV/N].
        span: change of the straight line between the least and the greatest load [mV].
        linearity: largest deviation of a mean from that line, as a fraction of the span.
    """

    curve: Interpolation
    scatter_mV: float | None
    sensitivity: Budget
    span: float
    linearity: float


def load_cell_curve(
    load: npt.NDArray[np.float64],
    runs: Sequence[WeightRun],
    resolution_mV: float,
    degree: int | None,
    loads_u: float = 0.0,
) -> LoadCellCurve:
    """Fit the means of the runs by least squares.

    Args:
        load: (k,) N, increasing.
        runs: runs with (k,) readings each.
        resolution_mV: smallest step of the indicator.
        degree: degree of the curve; None: the better one.
        loads_u: relative standard uncertainty of all loads together, as by local gravity or one set of weights.

    Raises:
        EstimateError: as in `interpolate`, or loads do not increase, shapes do not match, there is no run, or the
            sensitivity is not above three of its standard uncertainties.
        RangeError: the resolution is not positive.

    What loads share of the display's rounding counts where the scatter of displayed values is known. Where it is not,
    nothing tells how noise dithers the rounding: it counts as independent from load to load.
    """
    _check(load, runs, resolution_mV)
    mean = np.mean([run.mean_mV() for run in runs], axis=0)
    scatter = _scatter(runs)
    displays = 2 * sum(run.repeats for run in runs)
    reading_u, freedom = resolution_mV / math.sqrt(12), math.inf
    if scatter is not None:
        reading_u, freedom = mean_u(scatter, resolution_mV, displays), (displays - 2 * len(runs)) * load.size
    line = interpolate(load, mean, reading_u)
    if degree is None:
        degree = best_degree(load, mean, reading_u)
    if scatter is None:
        curve = interpolate(load, mean, reading_u, degree)
    else:
        curve = displayed_curve(load, mean, scatter, resolution_mV, displays, degree)
    spread, positions = spread_over_positions(load, runs), len({run.position for run in runs})
    if curve.by_scatter:
        freedom = curve.degrees_of_freedom
    slope = float(curve.coefficients[1])
    sensitivity = Budget("sensitivity", slope, "mV/N", (
        Component(CURVE, math.sqrt(curve.covariance[1, 1]), degrees_of_freedom=freedom, kind="A"),
        Component(POSITIONS, spread, degrees_of_freedom=max(positions - 1, 1), kind="A"),
        *_repeatability(load, runs, curve, scatter),
        *([Component(WEIGHTS, loads_u, slope)] if loads_u else []),
    ))  # fmt: skip
    if not sensitivity.value > 3 * sensitivity.u:
        raise EstimateError(
            f"sensitivity {sensitivity.value:.4g} mV/N with standard uncertainty {sensitivity.u:.2g} mV/N is not more "
            "than three times that; check the weights, the bridge and its polarity"
        )
    span = float(line.coefficients[1] * np.ptp(load))
    linearity = float(np.abs(mean - line.reading(load)).max()) / span
    return LoadCellCurve(curve, scatter, sensitivity, span, linearity)


def _repeatability(
    load: npt.NDArray[np.float64], runs: Sequence[WeightRun], curve: Interpolation, scatter: float | None
) -> list[Component]:
    """What the slopes of the runs in one position differ by more than noise explains (χ² at 1 %); empty: no more."""
    degree = curve.coefficients.size - 1
    means = by_position(runs, np.array([run.mean_mV() for run in runs]))
    slopes = [[float(interpolate(load, mean, 0.0, degree).coefficients[1]) for mean in own] for own in means]
    if scatter is None or min(map(min, slopes)) <= 0:
        return []
    noise = slope_u(load, degree) * scatter / math.sqrt(2 * runs[0].repeats) / float(curve.coefficients[1])
    found = pooled(noise, math.inf, *slopes)
    if not found.refuted:
        return []
    u = float(curve.coefficients[1]) * math.sqrt((found.u**2 - noise**2) / len(runs))
    return [Component(REPEATABILITY, u, degrees_of_freedom=found.degrees_of_freedom, kind="A")]


def slope_u(load: npt.NDArray[np.float64], degree: int) -> float:
    """Standard uncertainty [1/N] of a curve's slope at no load, by mean readings with one of 1 at loads (k,) [N]."""
    return math.sqrt(interpolate(load, load, 1.0, degree).covariance[1, 1])


def _check(load: npt.NDArray[np.float64], runs: Sequence[WeightRun], resolution_mV: float) -> None:
    shapes = [series.shape for run in runs for series in (run.loading_mV, run.unloading_mV)]
    if not runs or any(shape != load.shape for shape in shapes):
        raise EstimateError(f"{load.size} loads, but readings of shapes {shapes}; each must be ({load.size},)")
    if not (np.diff(load) > 0).all():
        raise EstimateError(f"loads {load} N must increase, each once; put the weights in order")
    if not (math.isfinite(resolution_mV) and resolution_mV > 0):
        raise RangeError(f"resolution {resolution_mV} mV must be positive: it is the indicator's smallest step")


def _scatter(runs: Sequence[WeightRun]) -> float | None:
    """Standard deviation of single displayed values, pooled over the runs; None where a run does not tell its own."""
    known = [run.scatter_mV for run in runs if run.scatter_mV is not None and run.repeats > 1]
    return float(np.linalg.norm(known)) / math.sqrt(len(runs)) if len(known) == len(runs) else None
