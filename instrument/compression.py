"""A pad compressed step by step: stress, strain and modulus, from what indicator and positioner read (thesis 5.3).

The probe hangs on a suspension, which yields with the load cell and everything else between positioner and bench. A
run on the bare rigid support gives that compliance, and where the probe meets the support; the run with the pad on
it then gives the pad's deflection, and by the two contacts its thickness.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self

import numpy as np
import numpy.typing as npt
from scipy.special import fdtrc

from instrument.calibration import LoadCellCalibration
from instrument.contracts import positioner
from instrument.errors import EstimateError
from instrument.interpolation import interpolate
from instrument.propagation import LINEAR, Input, Propagated, propagate
from instrument.uncertainty import Correlations

Floats = npt.NDArray[np.float64]
Values = Mapping[str, Floats]  # inputs by name, each (n,)

LEAST_POINTS = 3
SURE = 2.0  # steps of the indicator: above them the probe touches
POSITION_STEP = positioner.CONTRACT["target"].scale  # m
SIGNIFICANCE = 0.01
BY_RESOLUTION = 1e6  # degrees of freedom where the display's step is all there is: as good as known
SEED = 5302  # of Monte Carlo trials: any, but the same
LOADING, UNLOADING = "loading", "unloading"


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Displays of the indicator (n, m) mV, m at each of the positions (n,) m, which count downwards."""

    positions: Floats
    displays: Floats


@dataclass(frozen=True, slots=True)
class CompressionPoint:
    """One step on the pad. Stress [Pa] and strain are positive under compression; `_u` are standard uncertainties.

    `extrapolated`: the load lies outside the calibrated range of the load cell.
    """

    direction: str
    position_m: float
    reading_mV: float
    load_N: float
    extrapolated: bool
    strain: float
    strain_u: float
    stress_Pa: float
    stress_u: float
    secant_modulus_Pa: float
    secant_modulus_u: float


@dataclass(frozen=True, slots=True)
class Compression:
    """What the compression of a pad gives.

    Attributes:
        tangent: Young modulus by the slope of the loading line [Pa].
        secant: by stress over strain at the largest strain [Pa].
        unloading: by the slope of the unloading line [Pa].
        thickness: of the pad, by the two contacts [m].
        compliance: of the bench [m/N].
        linearity: greatest deviation of a load from the loading line, as a fraction of the span.
        energy_loss: share of the work of loading that unloading does not give back.
    """

    tangent: Propagated
    secant: Propagated
    unloading: Propagated
    thickness: Propagated
    compliance: Propagated
    linearity: float
    energy_loss: float
    points: tuple[CompressionPoint, ...]


def compress(
    bare: Series, loading: Series, unloading: Series, calibration: LoadCellCalibration, area: float, area_u: float
) -> Compression:
    """Stress, strain and moduli of a pad.

    Args:
        bare: on the rigid support alone. loading, unloading: of the pad.
        area: of the pad's face [m2], with its standard uncertainty.

    Raises:
        EstimateError: a series has fewer than three points that surely touch, or the pad is no softer than the bench.
    """
    support = _Line.through("bare", bare, calibration)
    lines = {
        LOADING: _Line.through(LOADING, loading, calibration),
        UNLOADING: _Line.through(UNLOADING, unloading, calibration),
    }
    for name, line in lines.items():
        if not support.slope > line.slope > 0:
            raise EstimateError(
                f"{name}: the load rises by {line.slope:.4g} N/m on the pad and by {support.slope:.4g} N/m on the bare"
                " support; the pad must be the softer: check which of them was under the probe"
            )
    pad = _Pad(support.position, lines[LOADING].position)
    inputs = (
        *support.inputs(),
        *lines[LOADING].inputs(),
        Input("sensitivity", 1.0, calibration.sensitivity_u / calibration.sensitivity_mV_per_N),
        Input("zero", 0.0, calibration.zero_u / calibration.sensitivity_mV_per_N),
        Input("area", area, area_u),
        Input("positions", 0.0, POSITION_STEP / math.sqrt(6)),  # two contacts
    )
    related = {("sensitivity", "zero"): calibration.covariance / (calibration.sensitivity_u * calibration.zero_u)}

    def found(
        name: str,
        unit: str,
        of: Callable[[Values], Floats],
        *more: Input,
        method: str | None = None,
        shared: Correlations = MappingProxyType({}),
    ) -> Propagated:
        given = (*inputs, *more)
        names = [each.name for each in given]

        def function(*values: Floats) -> Floats:
            return of(dict(zip(names, values, strict=True)))

        return propagate(name, unit, function, given, {**related, **shared}, seed=SEED, method=method)

    def step(direction: str, index: int) -> CompressionPoint:
        line = lines[direction]
        position, load = float(line.positions[index]), float(line.loads[index])
        own = Input("load", load, line.scatter, line.degrees_of_freedom, "A")
        stress = found("stress", "Pa", pad.stress, own, method=LINEAR)
        shared = line.shares(index) if direction == LOADING else {}
        strain = found("strain", "", lambda v: pad.strain(v, position), own, method=LINEAR, shared=shared)
        secant = found("secant modulus", "Pa", lambda v: pad.secant(v, position), own, method=LINEAR, shared=shared)
        return CompressionPoint(
            direction, position, calibration.reading(load), load, not calibration.covers(load), strain.value,
            strain.u, stress.value, stress.u, secant.value, secant.u,
        )  # fmt: skip

    points = tuple(step(name, index) for name, line in lines.items() for index in range(len(line.loads)))
    up = lines[LOADING]
    last = int(np.argmax(up.positions))
    furthest = Input("load", float(up.loads[last]), up.scatter, up.degrees_of_freedom, "A")
    return Compression(
        tangent=found("tangent modulus", "Pa", lambda v: pad.modulus(v, LOADING)),
        secant=found(
            "secant modulus",
            "Pa",
            lambda v: pad.secant(v, float(up.positions[last])),
            furthest,
            shared=up.shares(last),
        ),
        unloading=found("unloading modulus", "Pa", lambda v: pad.modulus(v, UNLOADING), lines[UNLOADING].inputs()[0]),
        thickness=found("thickness", "m", pad.thickness),
        compliance=found("compliance of the bench", "m/N", pad.compliance),
        linearity=up.deviation / float(np.ptp(up.loads)),
        energy_loss=1 - _work(points, UNLOADING) / _work(points, LOADING),
        points=points,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """Load against position while the probe touches.

    Its errors are given for the mean, at the mean `position`: there slope and mean have independent ones.

    Attributes:
        slope, slope_u: [N/m]. mean, mean_u, scatter: [N], the last of one load.
        deviation: greatest from the line [N].
    """

    name: str
    positions: Floats
    loads: Floats
    slope: float
    slope_u: float
    mean: float
    scatter: float
    degrees_of_freedom: float
    deviation: float

    @classmethod
    def through(cls, name: str, series: Series, calibration: LoadCellCalibration) -> Self:
        """Raises EstimateError: fewer than three points surely touch."""
        loads = np.array([calibration.load(float(reading))[0] for reading in series.displays.mean(axis=1)])
        least = SURE * calibration.resolution()
        sure = loads > least
        if sure.sum() < LEAST_POINTS:
            raise EstimateError(
                f"{name}: {sure.sum()} loads are above {least:.3g} N, which surely is contact, and"
                f" {LEAST_POINTS} are needed; compress further or in more steps"
            )
        positions, loads = series.positions[sure], loads[sure]
        known, freedom = _reading_u(series.displays, calibration)
        line = interpolate(positions, loads, known)
        scatter = max(line.residual_sd, known)
        # F-test: do the loads scatter about the line more than their displays say?
        if fdtrc(line.degrees_of_freedom, freedom, (line.residual_sd / known) ** 2) > SIGNIFICANCE:
            scatter = known
        else:
            freedom = line.degrees_of_freedom
        return cls(
            name,
            positions,
            loads,
            slope=float(line.coefficients[1]),
            slope_u=scatter / float(np.linalg.norm(positions - positions.mean())),
            mean=float(loads.mean()),
            scatter=scatter,
            degrees_of_freedom=freedom,
            deviation=float(np.abs(loads - line.reading(positions)).max()),
        )

    @property
    def position(self) -> float:
        return float(self.positions.mean())

    def shares(self, index: int) -> Correlations:
        """Correlations of the error of a load with those of the line, of which it is one point in n."""
        away = self.positions - self.positions.mean()
        return {
            ("load", f"{self.name} mean"): 1 / math.sqrt(len(away)),
            ("load", f"{self.name} slope"): float(away[index] / np.linalg.norm(away)),
        }

    def inputs(self) -> tuple[Input, Input]:
        mean_u = self.scatter / math.sqrt(len(self.loads))
        return (
            Input(f"{self.name} slope", self.slope, self.slope_u, self.degrees_of_freedom, "A"),
            Input(f"{self.name} mean", self.mean, mean_u, self.degrees_of_freedom, "A"),
        )


def _reading_u(displays: Floats, calibration: LoadCellCalibration) -> tuple[float, float]:
    """Standard uncertainty of a mean of displays [N], and its degrees of freedom.

    Where the displays scatter by a step or so they dither the steps away, all but the first term of the steps' Fourier
    series, which Gaussian noise of a deviation s leaves exp(-2 (pi s / step)^2) of (Widrow and Kollar 2008); where
    they stand still, a step hides what lies within it.
    """
    points, count = displays.shape
    step = calibration.resolution_mV
    shown = float(displays.var(axis=1, ddof=1).mean())
    noise = shown - step**2 / 12
    if noise <= 0:
        return step / math.sqrt(12) / calibration.sensitivity_mV_per_N, BY_RESOLUTION
    left = step / (math.sqrt(2) * math.pi) * math.exp(-2 * math.pi**2 * noise / step**2)
    return math.hypot(math.sqrt(shown / count), left) / calibration.sensitivity_mV_per_N, points * (count - 1)


@dataclass(frozen=True, slots=True)
class _Pad:
    """What follows from the lines, whose mean positions these are [m]. A load is (read - zero) / sensitivity."""

    at_bare: float
    at_pad: float

    def contact(self, v: Values) -> Floats:
        return self.at_pad - (v["loading mean"] - v["zero"]) / v["loading slope"]

    def thickness(self, v: Values) -> Floats:
        bare = self.at_bare - (v["bare mean"] - v["zero"]) / v["bare slope"]
        return bare - self.contact(v) + v["positions"]

    def compliance(self, v: Values) -> Floats:
        return v["sensitivity"] / v["bare slope"]

    def modulus(self, v: Values, direction: str) -> Floats:
        yielding = v["sensitivity"] / v[f"{direction} slope"] - self.compliance(v)
        return self.thickness(v) / (yielding * v["area"])

    def load(self, v: Values) -> Floats:
        return (v["load"] - v["zero"]) / v["sensitivity"]

    def stress(self, v: Values) -> Floats:
        return self.load(v) / v["area"]

    def strain(self, v: Values, position: float) -> Floats:
        return (position - self.contact(v) - self.load(v) * self.compliance(v)) / self.thickness(v)

    def secant(self, v: Values, position: float) -> Floats:
        return self.stress(v) / self.strain(v, position)


def _work(points: tuple[CompressionPoint, ...], direction: str) -> float:
    """Of one way, by volume: trapezoids from no strain on [J/m3]."""
    way = sorted((p.strain, p.stress_Pa) for p in points if p.direction == direction)
    strain, stress = np.array([(0.0, 0.0), *way]).T
    return float(np.trapezoid(stress, strain))
