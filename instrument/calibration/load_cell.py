"""Calibration of a load cell: the load that belongs to a reading, and the checks of where it may be used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from palpate.instrument.allocation.stopping import pooled
from palpate.instrument.arrays import Floats
from palpate.instrument.calibration.calibration import Calibration
from palpate.instrument.config import Config, NotNegative, Positive, check, read_hashed
from palpate.instrument.errors import ConfigError, EstimateError, RangeError
from palpate.instrument.uncertainty.budget import Budget, Component, mean_u, sums_u
from palpate.instrument.uncertainty.interpolation import Interpolation, best_degree, interpolate, polynomials

# --- classes -------------------------------------------------------------------------------------------

# Figures and limits after ISO 376:2011 (Table 2) and ASTM E74-18.


NOT_CLASSIFIABLE = "not classifiable"

ASTM_E74_FACTORS = {"AA": 2000.0, "A": 400.0}  # the range of a class begins at this multiple of the lower limit factor
ASTM_E74_SIGMAS = 2.4
ASTM_E74_LOADS, ASTM_E74_READINGS = 10, 30
ISO_376_LOADS = 8
ISO_376_PART = 0.5  # the range of a class must begin at this share of the greatest load, or below


@dataclass(frozen=True, slots=True)
class WeightRun:
    """One run of weights that are put on one after the other and taken off again.

    Args:
        position: angle of the cell about its axis [degrees].
        loading_mV, unloading_mV: (k,) readings, both at increasing loads.
        zero_before_mV, zero_after_mV: readings of the unloaded cell; None: not read.
        repeats: number of displayed values whose mean is one reading.
        scatter_mV: standard deviation of a single displayed value about such a mean; None: not known.
    """

    position: float
    loading_mV: Floats
    unloading_mV: Floats
    zero_before_mV: float | None = None
    zero_after_mV: float | None = None
    repeats: int = 1
    scatter_mV: float | None = None

    def mean_mV(self) -> Floats:
        """Mean (k,) of the readings of loading and unloading."""
        mean: Floats = 0.5 * (self.loading_mV + self.unloading_mV)
        return mean


class Classification(Config):
    """The class of a load cell and the loads over which it holds. Where there is none, `reason` says why."""

    model_config = ConfigDict(strict=True)

    name: str
    least_N: float | None = None
    greatest_N: float | None = None
    reason: str = ""


Quantities = dict[str, Floats | None]
"""Quantities of ISO 376 by name: fractions (k,) at the loads; None: the runs do not determine it.

    reproducibility  b: spread of the first runs in several positions over their mean
    repeatability    b': greatest spread of the runs in one position over their mean
    interpolation    fc: size of the deviation of the mean deflection from the curve
    reversibility    v: unloading less loading over loading, in size, mean of the runs
    zero_return      f0: greatest change of the zero over a run, over the greatest deflection
    creep            c: change of the reading from 30 s to 300 s under the greatest load, over its deflection
    resolution       r: a step of the indicator over the deflection
"""

_ORDER = ("reproducibility", "repeatability", "interpolation", "reversibility", "zero_return", "creep", "resolution")

ISO_376: dict[str, dict[str, float]] = {
    "00": dict(zip(_ORDER, (5e-4, 2.5e-4, 2.5e-4, 7e-4, 1.2e-4, 2.5e-4, 1 / 4000), strict=True)),
    "0.5": dict(zip(_ORDER, (1e-3, 5e-4, 5e-4, 1.5e-3, 2.5e-4, 5e-4, 1 / 2000), strict=True)),
    "1": dict(zip(_ORDER, (2e-3, 1e-3, 1e-3, 3e-3, 5e-4, 1e-3, 1 / 1000), strict=True)),
    "2": dict(zip(_ORDER, (4e-3, 2e-3, 2e-3, 5e-3, 1e-3, 2e-3, 1 / 500), strict=True)),
}
"""Greatest value of each quantity in each class, from the best class to the worst."""

MAY_BE_MISSING = ("creep",)  # ISO 376 accepts the reversibility instead of it


def quantities(
    load: Floats, runs: Sequence[WeightRun], curve: Interpolation, resolution_mV: float, creep_mV: float | None
) -> Quantities:
    """Quantities of ISO 376 from runs of dead weights.

    Args:
        load: (k,) N, increasing.
        curve: curve through the mean readings.
        creep_mV: change of the reading from 30 s to 300 s under the greatest load; None: not measured.
    """
    zero = float(curve.coefficients[0])
    up = np.array([run.loading_mV - _zero(run, zero) for run in runs])
    down = np.array([run.unloading_mV - _zero(run, zero) for run in runs])
    groups = by_position(runs, up)
    first = np.array([own[0] for own in groups])
    repeated = [own for own in groups if len(own) > 1]
    fitted = curve.reading(load) - zero
    mean = np.mean([run.mean_mV() for run in runs], axis=0) - zero
    returns = [
        abs(run.zero_after_mV - run.zero_before_mV)
        for run in runs
        if run.zero_after_mV is not None and run.zero_before_mV is not None
    ]
    greatest, all_loads = abs(float(fitted[-1])), np.ones(load.size)
    return {
        "reproducibility": _spread(first) if len(first) > 1 else None,
        "repeatability": np.max([_spread(own) for own in repeated], axis=0) if repeated else None,
        "interpolation": np.abs(mean / fitted - 1),
        "reversibility": np.mean(np.abs(down / up - 1), axis=0),
        "zero_return": max(returns) / greatest * all_loads if returns else None,
        "creep": None if creep_mV is None else abs(creep_mV) / greatest * all_loads,
        "resolution": resolution_mV / np.abs(fitted),
    }


def spread_over_positions(load: Floats, runs: Sequence[WeightRun]) -> float:
    """Standard deviation [mV/N] of the slopes of straight lines over the positions of the cell; 0 for one position."""
    groups = by_position(runs, np.array([run.mean_mV() for run in runs]))
    if len(groups) == 1:
        return 0.0
    return float(np.std([interpolate(load, own.mean(axis=0), 0.0).coefficients[1] for own in groups], ddof=1))


def by_position(runs: Sequence[WeightRun], values: Floats) -> list[Floats]:
    """Rows of values (runs, k), grouped by the position of the cell in their runs, in the order of the runs."""
    positions = [run.position for run in runs]
    return [values[[p == position for p in positions]] for position in dict.fromkeys(positions)]


def _zero(run: WeightRun, fitted: float) -> float:
    return fitted if run.zero_before_mV is None else run.zero_before_mV


def _spread(deflections: Floats) -> Floats:
    spread: Floats = np.ptp(deflections, axis=0) / np.abs(deflections.mean(axis=0))
    return spread


def classify_iso_376(load: Floats, found: Quantities) -> Classification:
    """The best class that holds from some load to the greatest one, and at least down to half of it."""
    if reasons := short_of_iso_376(load, found, "2"):
        return _none(*reasons)
    name = next(name for name in ISO_376 if not short_of_iso_376(load, found, name))
    good = np.all([values <= ISO_376[name][key] for key, values in found.items() if values is not None], axis=0)
    first = int(np.flatnonzero(~good).max(initial=-1)) + 1
    return Classification(name=name, least_N=float(load[first]), greatest_N=float(load[-1]))


def short_of_iso_376(load: Floats, found: Quantities, name: str) -> list[str]:
    """Why runs do not give a class: what they lack, and the quantities above its limits; empty: they do."""
    missing = [key for key, values in found.items() if values is None and key not in MAY_BE_MISSING]
    reasons = lacking_for_iso_376(load, missing)
    must = max(int((load <= ISO_376_PART * load[-1]).sum()) - 1, 0)  # from here a class holds at the latest
    for key, values in found.items():
        if values is None:
            continue
        worst, limit = float(values[must:].max()), ISO_376[name][key]
        if not worst <= limit:  # NaN is no class
            reasons.append(
                f"{key.replace('_', ' ')} {100 * worst:.3g} % from {load[must]:.4g} N on exceeds the "
                f"{100 * limit:.3g} % of ISO 376 class {name}"
            )
    return reasons


def lacking_for_iso_376(load: Floats, missing: Sequence[str]) -> list[str]:
    """What loads and runs lack for any class; `missing`: quantities that the runs do not tell."""
    reasons = []
    if load.size < ISO_376_LOADS:
        reasons.append(f"ISO 376 asks for {ISO_376_LOADS} loads, not {load.size}")
    if load[0] > ISO_376_PART * load[-1]:
        reasons.append(f"ISO 376 asks for loads down to {ISO_376_PART:.0%} of the greatest")
    if missing:
        reasons.append(f"ISO 376 asks for {' and '.join(missing)}, which the runs do not tell")
    return reasons


def iso_376_class_of(key: str, worst: float) -> str:
    """The class that one quantity meets, given its greatest value."""
    return next((name for name, limits in ISO_376.items() if worst <= limits[key]), NOT_CLASSIFIABLE)


def lower_limit_factor(load: Floats, runs: Sequence[WeightRun], curve: Interpolation) -> float:
    """LLF of ASTM E74 [N]: 2.4 standard deviations of the single readings about the curve.

    Their degrees of freedom are readings less coefficients. Dividing by one degree more, as some do, gives 0.096 N
    instead of 0.100 N for the thesis' cell.
    """
    fitted = curve.reading(load)
    residual = np.concatenate([series - fitted for run in runs for series in (run.loading_mV, run.unloading_mV)])
    s = float(np.linalg.norm(residual)) / math.sqrt(residual.size - curve.coefficients.size)
    return ASTM_E74_SIGMAS * s / abs(float(curve.coefficients[1]))


def classify_astm_e74(load: Floats, readings: int, factor: float, resolution: float) -> Classification:
    """Class AA or A of ASTM E74, with the range of loads over which it holds.

    Args:
        load: (k,) N, increasing.
        readings: number of readings under load, in all runs.
        factor: lower limit factor [N]; at least the resolution is used.
        resolution: load of one step of the indicator [N].
    """
    counted = max(factor, resolution)
    for name, times in ASTM_E74_FACTORS.items():
        least = max(times * counted, float(load[0]))
        if least <= load[-1]:
            few = _few(load.size, readings)
            return _none(*few) if few else Classification(name=name, least_N=least, greatest_N=float(load[-1]))
    least = ASTM_E74_FACTORS["A"] * counted
    return _none(
        f"ASTM E74 class A begins at {ASTM_E74_FACTORS['A']:g} x {counted:.3g} N = {least:.3g} N, above the greatest "
        f"load of {load[-1]:.3g} N",
        *_few(load.size, readings),
    )


def _few(loads: int, readings: int) -> list[str]:
    if loads >= ASTM_E74_LOADS and readings >= ASTM_E74_READINGS:
        return []
    return [f"ASTM E74 asks for {ASTM_E74_READINGS} readings at {ASTM_E74_LOADS} loads, not {readings} at {loads}"]


def _none(*reasons: str) -> Classification:
    return Classification(name=NOT_CLASSIFIABLE, reason="; ".join(reasons))


# --- readings of a display -----------------------------------------------------------------------------

# Loads that are nearly a whole number of display steps apart are rounded alike, in every run. How alike depends on the
# slope. That is known to its uncertainty alone, so the greatest error over all slopes within it counts, and never less
# than that of rounding which is independent from load to load.


SLOPES = 41
"""Number of slopes that are tried. Over all of them the readings move by less than a step against each other."""


def displayed_curve(
    load: Floats, reading: Floats, scatter: float, step: float, values: float, degree: int
) -> Interpolation:
    """Least-squares polynomial through mean readings, whose covariance holds what loads share of the rounding.

    Orthonormal polynomials weigh the readings. For evenly spaced loads, the errors of mean and slope in these terms are
    uncorrelated; they count as uncorrelated for all loads.

    Args:
        load: (n,) N, increasing.
        reading: (n,) mV, each the mean of some displayed values.
        scatter: standard deviation of single displayed values [mV].
        step: step of the display [mV].
        values: number of displayed values in each mean.
        degree: 1 or 2.

    Raises:
        EstimateError: as in `interpolate`.
    """
    curve = interpolate(load, reading, mean_u(scatter, step, values), degree)
    weights, powers = polynomials(load, degree)
    rounded = rounding_u(load, curve.reading(load), weights, scatter, step, values)
    own = curve.residual_sd if curve.by_scatter else mean_u(scatter, step, values)
    variances = own**2 + rounded**2 - mean_u(scatter, step, math.inf) ** 2
    return replace(curve, covariance=(powers * variances) @ powers.T)


def rounding_u(load: Floats, reading: Floats, weights: Floats, scatter: float, step: float, values: float) -> Floats:
    """Standard uncertainties (p,) of weighted sums of mean readings by rounding alone, which no further value lowers.

    Args:
        load, scatter, step, values: as in `displayed_curve`.
        reading: (n,) mV, on the curve.
        weights: (n, p), of the readings in p sums.
    """
    about = load - load.mean()
    widest = math.sqrt(3) * mean_u(scatter, step, values) / float(np.linalg.norm(about))
    cases = reading + np.linspace(-widest, widest, SLOPES)[:, np.newaxis] * about
    shared = sums_u(weights, cases, scatter, step).max(axis=0)
    independent = mean_u(scatter, step, math.inf) * np.linalg.norm(weights, axis=0)
    greatest: Floats = np.maximum(shared, independent)
    return greatest


# --- the curve -----------------------------------------------------------------------------------------


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
    scatters = [run.scatter_mV for run in runs if run.scatter_mV is not None and run.repeats > 1]
    return float(np.linalg.norm(scatters)) / math.sqrt(len(runs)) if len(scatters) == len(runs) else None


# --- the calibration -----------------------------------------------------------------------------------


class LoadCellCalibration(Calibration):
    """Calibration of a load cell with its indicator.

    `reading_mV = zero_mV + sensitivity_mV_per_N · load_N + curvature · load_N²`

    The field names are the keys of the calibration file. Each fraction is the greatest one over all loads. It is None
    where the runs do not determine it.

    Args:
        sensitivity_mV_per_N, sensitivity_u: slope at no load, with standard uncertainty.
        zero_mV, zero_u: reading at no load, with standard uncertainty.
        covariance: covariance of sensitivity and zero [mV²/N].
        degrees_of_freedom: degrees of freedom of these uncertainties; None: they rest on the indicator's step alone.
        curvature: term of second degree, for a cell whose readings are not straight.
        least_N, greatest_N: the calibrated range.
        linearity: largest deviation of a mean reading from the line, as a fraction of the span.
        reversibility: largest difference of loading and unloading at one load, as a fraction of the span.
        reversibility_of_reading: v of ISO 376, which goes with the deflection at the load.
        repeatability, reproducibility, interpolation, zero_return, creep: b', b, fc, f0 and c of ISO 376.
        resolution_mV: smallest step of the indicator.
        scatter_mV: standard deviation of single displayed values about their mean; None: not known.
        lower_limit_factor_N: lower limit factor of ASTM E74.
        astm_e74, iso_376: class "AA" or "A", "00" to "2", or "not classifiable".
        gage_factor: gage factor to which the indicator was set.
        device: serial number of the load cell's indicator.
    """

    file: ClassVar[str] = "calibration of a load cell"
    kind: ClassVar[str] = "load_cell"
    make: ClassVar[str] = "run palpate calibrate load-cell"

    model_config = ConfigDict(strict=True)

    sensitivity_mV_per_N: Positive
    sensitivity_u: Positive
    zero_mV: float
    zero_u: Positive
    covariance: float
    degrees_of_freedom: Annotated[int, Field(ge=1)] | None = None
    least_N: float
    greatest_N: float
    linearity: NotNegative
    reversibility: NotNegative
    reversibility_of_reading: NotNegative
    repeatability: NotNegative | None = None
    reproducibility: NotNegative | None = None
    interpolation: NotNegative
    zero_return: NotNegative | None = None
    creep: NotNegative | None = None
    resolution_mV: Positive
    scatter_mV: NotNegative | None = None
    lower_limit_factor_N: NotNegative
    astm_e74: Classification
    iso_376: Classification
    gage_factor: Positive
    curvature: Curvature | None = None

    @field_validator("covariance")
    @classmethod
    def _is_a_covariance(cls, value: float, info: ValidationInfo) -> float:
        bound = info.data.get("sensitivity_u", math.inf) * info.data.get("zero_u", math.inf)
        if not abs(value) <= bound:
            raise ValueError(f"{value:g} exceeds sensitivity_u · zero_u = {bound:g} in size")
        return value

    @field_validator("greatest_N")
    @classmethod
    def _is_a_range(cls, value: float, info: ValidationInfo) -> float:
        least = info.data.get("least_N", -math.inf)
        if not value > least:
            raise ValueError(f"{value:g} N is not above least_N = {least:g} N")
        return value

    @model_validator(mode="after")
    def _are_covariances(self) -> Self:
        if self.curvature is not None:
            u = np.array([self.zero_u, self.sensitivity_u, self.curvature.u])
            if not np.linalg.eigvalsh(self._covariance() / np.outer(u, u)).min() >= -1e-9:
                raise ValueError("covariances of zero, sensitivity and curvature cannot be: one is too large")
        return self

    def _covariance(self) -> npt.NDArray[np.float64]:
        """Covariance matrix of zero, sensitivity and, where there is one, curvature."""
        matrix = np.array([[self.zero_u**2, self.covariance], [self.covariance, self.sensitivity_u**2]])
        if self.curvature is None:
            return matrix
        column = np.array([self.curvature.with_zero, self.curvature.with_sensitivity])
        return np.block([[matrix, column[:, np.newaxis]], [column, np.array([self.curvature.u**2])]])

    def load(self, reading_mV: float, displays: int = 1) -> tuple[float, float]:
        """Load [N] that belongs to a reading, and its standard uncertainty [N].

        The uncertainty holds those of the curve (with covariances) and of the reading (`reading_u`).

        Args:
            reading_mV: mean of some displayed values.
            displays: how many values that are.

        Raises:
            EstimateError: the reading is not finite, or beyond the vertex of a curved calibration.
        """
        if not math.isfinite(reading_mV):
            raise EstimateError(f"reading {reading_mV} mV is not finite, so it has no load; repeat it")
        bend = 0.0 if self.curvature is None else self.curvature.mV_per_N2
        net = reading_mV - self.zero_mV
        slope_squared = self.sensitivity_mV_per_N**2 + 4 * bend * net
        if not slope_squared > 0:
            raise EstimateError(f"reading {reading_mV:g} mV is beyond the vertex of the calibration; reduce the load")
        slope = math.sqrt(slope_squared)
        load = 2 * net / (self.sensitivity_mV_per_N + slope)
        return load, math.hypot(self.curve_u(load), self.reading_u(displays) / slope)

    def curve_u(self, load_N: float) -> float:
        """Standard uncertainty [N] of a load by the curve alone; it shifts all readings at that load alike."""
        bend = 0.0 if self.curvature is None else self.curvature.mV_per_N2
        covariance = self._covariance()
        powers = load_N ** np.arange(len(covariance))
        variance = max(float(powers @ covariance @ powers), 0.0)
        return math.sqrt(variance) / (self.sensitivity_mV_per_N + 2 * bend * load_N)

    def mean_curve_u(self, loads: npt.NDArray[np.float64]) -> float:
        """Relative standard uncertainty of a mean over loads (n,) [N] by the curve, which is the same at all of them.

        Each load counts with its relative error. The errors do not average out, but those of the zero weigh more at
        small loads than at large ones.
        """
        bend = 0.0 if self.curvature is None else self.curvature.mV_per_N2
        covariance = self._covariance()
        powers = loads[:, np.newaxis] ** np.arange(len(covariance))
        slope = (self.sensitivity_mV_per_N + 2 * bend * loads) * loads
        mean = (powers / slope[:, np.newaxis]).mean(axis=0)
        return math.sqrt(max(float(mean @ covariance @ mean), 0.0))

    def reading_u(self, displays: int = 1) -> float:
        """Standard uncertainty [mV] of the mean of some displayed values.

        It holds the scatter of single values, and the error of rounding that is left beside that scatter. Where the
        scatter is not known, it holds the rounding alone.
        """
        if self.scatter_mV is None:
            return self.resolution_mV / math.sqrt(12)
        return mean_u(self.scatter_mV, self.resolution_mV, displays)

    def reading(self, load_N: float) -> float:
        """Reading [mV] that a load gives."""
        bend = 0.0 if self.curvature is None else self.curvature.mV_per_N2
        return self.zero_mV + (self.sensitivity_mV_per_N + bend * load_N) * load_N

    def resolution(self) -> float:
        """Load [N] that moves the reading by the smallest step of the indicator."""
        return self.resolution_mV / self.sensitivity_mV_per_N

    def covers(self, load_N: float) -> bool:
        """Whether a load lies in the calibrated range."""
        slack = 1e-9 * self.greatest_N
        return self.least_N - slack <= load_N <= self.greatest_N + slack

    def check_range(self, load_N: float) -> None:
        """Check that a load [N] lies in the calibrated range. Raises RangeError."""
        if not self.covers(load_N):
            raise RangeError(
                f"load {load_N:g} N lies outside the {self.least_N:.4g} to {self.greatest_N:.4g} N that the load cell "
                f"is calibrated for ({self.source}); take a load inside, calibrate with other weights "
                "(palpate calibrate load-cell --loads), or accept what the fit says out there where a command has "
                "--extrapolate"
            )

    def check_gage_factor(self, gage_factor: float) -> None:
        """Check that the indicator is set as it was. Raises ConfigError."""
        if abs(self.gage_factor - gage_factor) > 1e-6 * gage_factor:
            raise ConfigError(
                f"{self.made} at gage factor {self.gage_factor:g}, this bench's is {gage_factor:g}; set gage_factor in "
                f"the bench file back, or {self.make}"
            )


# --- how it is made ------------------------------------------------------------------------------------


STANDARD_GRAVITY = 9.80665
"""m/s², turns the gram-force of dead weights into newtons."""


def calibrate_load_cell(
    load_N: npt.ArrayLike,
    runs: Sequence[WeightRun],
    resolution_mV: float,
    *,
    degree: int | None = None,
    creep_mV: float | None = None,
    loads_u: float = 0.0,
    gage_factor: float,
    **origin: Any,
) -> LoadCellCalibration:
    """Calibrate a load cell from runs of dead weights that are put on and taken off again.

    The curve is fitted to the mean reading at each load, since repeats at one load share its rounding. The span is that
    of the line between the least and the greatest load. The spread of the sensitivity over several positions of the
    cell adds to its uncertainty, since nobody knows in which position the cell will be used.

    Args:
        load_N: (k,) N, increasing.
        runs: readings (k,) each.
        resolution_mV: smallest step of the indicator.
        degree: degree of the curve; None: 2 where an F-test finds it better than 1.
        creep_mV: change of the reading from 30 s to 300 s under the greatest load; None: not measured.
        loads_u: relative standard uncertainty of all loads together, as by gravity.
        gage_factor: as in `LoadCellCalibration`.
        origin: the fields of `Calibration`.

    Raises:
        EstimateError: as in `interpolate`, or loads do not increase, shapes do not match, there is no run, or the
            sensitivity is not above three of its standard uncertainties.
        RangeError: the resolution is not positive.
        ConfigError: a text is empty.
    """
    load = np.asarray(load_N, dtype=np.float64)
    fitted = load_cell_curve(load, runs, resolution_mV, degree, loads_u)
    curve, sensitivity, span = fitted.curve, fitted.sensitivity, fitted.span
    freedom = sensitivity.degrees_of_freedom
    found = quantities(load, runs, curve, resolution_mV, creep_mV)
    factor = lower_limit_factor(load, runs, curve)
    up_less_down = np.mean([run.loading_mV - run.unloading_mV for run in runs], axis=0)
    fields: dict[str, Any] = {
        "sensitivity_mV_per_N": sensitivity.value,
        "sensitivity_u": sensitivity.u,
        "zero_mV": float(curve.coefficients[0]),
        "zero_u": math.sqrt(curve.covariance[0, 0]),
        "covariance": float(curve.covariance[0, 1]),
        "degrees_of_freedom": max(math.floor(freedom), 1) if math.isfinite(freedom) else None,
        "least_N": float(load[0]),
        "greatest_N": float(load[-1]),
        "linearity": fitted.linearity,
        "reversibility": float(np.abs(up_less_down).max()) / span,
        "reversibility_of_reading": _greatest(found["reversibility"]),
        **{
            name: _greatest(found[name])
            for name in ("repeatability", "reproducibility", "interpolation", "zero_return", "creep")
        },
        "resolution_mV": float(resolution_mV),
        "scatter_mV": fitted.scatter_mV,
        "lower_limit_factor_N": factor,
        "astm_e74": classify_astm_e74(load, 2 * load.size * len(runs), factor, resolution_mV / sensitivity.value),
        "iso_376": classify_iso_376(load, found),
        "gage_factor": gage_factor,
        **origin,
    }
    if curve.coefficients.size == 3:
        bend = float(curve.coefficients[2])
        by_loads = 2 * bend * loads_u  # loads that are all too great by a share move it by twice that share
        fields["curvature"] = {
            "mV_per_N2": bend,
            "u": math.hypot(math.sqrt(curve.covariance[2, 2]), by_loads),
            "with_sensitivity": float(curve.covariance[1, 2]) + by_loads * loads_u * sensitivity.value,
            "with_zero": float(curve.covariance[0, 2]),
        }
    return check(fields, LoadCellCalibration, "load cell calibration")


def _greatest(values: npt.NDArray[np.float64] | None) -> float | None:
    return None if values is None else float(values.max())


THESIS_LOAD_CELL = read_hashed(Path(__file__).with_name("thesis_load_cell.toml"), LoadCellCalibration)
"""Load cell of thesis Table 5.1 [T]: 10.306 ± 0.056 mV/N, zero 1.81 mV, resolution 1 mV.

A simulated bench without a calibration of its own uses it. It is stored, since every command would fit it anew;
`tests/instrument/test_calibration.py` fits it to the table and compares.
"""


# --- the budget of a load ------------------------------------------------------------------------------


def load_budget(calibration: LoadCellCalibration, load: float, displays: int = 1) -> Budget:
    """Budget of a load [N] that was measured by the mean of some displayed values.

    Its `u` is that of `LoadCellCalibration.load`.
    """
    c = calibration
    bend = 0.0 if c.curvature is None else c.curvature.mV_per_N2
    slope = c.sensitivity_mV_per_N + 2 * bend * load
    freedom = math.inf if c.degrees_of_freedom is None else float(c.degrees_of_freedom)
    components = [
        Component("zero", c.zero_u, -1 / slope, freedom, "A"),
        Component("sensitivity", c.sensitivity_u, -load / slope, freedom, "A"),
        Component("reading", c.reading_u(displays), 1 / slope),
    ]
    correlations = {("zero", "sensitivity"): c.covariance / (c.zero_u * c.sensitivity_u)}
    if c.curvature is not None:
        bent = c.curvature
        components.append(Component("curvature", bent.u, -(load**2) / slope, freedom, "A"))
        correlations["zero", "curvature"] = bent.with_zero / (c.zero_u * bent.u)
        correlations["sensitivity", "curvature"] = bent.with_sensitivity / (c.sensitivity_u * bent.u)
    return Budget("load", load, "N", tuple(components), correlations)
