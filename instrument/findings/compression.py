"""A pad compressed step by step: stress, strain and modulus, from what indicator and positioner read (thesis 5.3).

The suspension of the probe, the load cell and everything else between positioner and bench yield under load. A run on
the bare rigid support gives their compliance and the position at which the probe meets the support. The run with the
pad on the support then gives the pad's deflection. The two positions of contact give its thickness.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.contracts.own import POSITIONER
from palpate.instrument.errors import EstimateError
from palpate.instrument.uncertainty.budget import LINEAR, Correlations, Input, Propagated, propagate
from palpate.instrument.uncertainty.interpolation import interpolate

# --- a line through load against position --------------------------------------------------------------


LEAST_POINTS = 3
SURE = 2.0  # number of the indicator's steps above which a load shows that the probe touches
SIGNIFICANCE = 0.01
BY_RESOLUTION = 1e6  # degrees of freedom of an uncertainty by the display's step alone; practically infinite


@dataclass(frozen=True, slots=True, eq=False)
class DisplaySeries:
    """Displayed values (n, m) [mV] of the indicator, m at each of the positions (n,) [m]. Positions count downwards."""

    positions: Floats
    displays: Floats


@dataclass(frozen=True, slots=True, eq=False)
class LoadLine:
    """Load against position while the probe touches.

    Errors are given at the mean position, because slope and mean load have independent errors there.

    Attributes:
        position: mean position [m].
        slope, slope_u: slope with its standard uncertainty [N/m].
        mean, mean_u: mean load with its standard uncertainty [N].
        scatter: standard deviation of one load [N].
        deviation: greatest deviation of a load from the line [N].
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
    def through(cls, name: str, series: DisplaySeries, calibration: LoadCellCalibration) -> Self:
        """Fit the line to the points that surely touch. Raises EstimateError: they are fewer than three."""
        from scipy.special import fdtrc

        loads = np.array([calibration.load(float(reading))[0] for reading in series.displays.mean(axis=1)])
        least = SURE * calibration.resolution()
        sure = loads > least
        if sure.sum() < LEAST_POINTS:
            raise EstimateError(
                f"{name}: {sure.sum()} loads are above {least:.3g} N, which surely is contact, and"
                f" {LEAST_POINTS} are needed; compress further or in more steps"
            )
        positions, loads = series.positions[sure], loads[sure]
        display_u, freedom = displays_u(series.displays, calibration)
        line = interpolate(positions, loads, display_u)
        scatter = max(line.residual_sd, display_u)
        # The F-test asks whether the loads scatter about the line more than the display's steps explain.
        if fdtrc(line.degrees_of_freedom, freedom, (line.residual_sd / display_u) ** 2) > SIGNIFICANCE:
            scatter = display_u
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

    def shares(self, index: int, load: str = "load") -> Correlations:
        """Correlations of the error of one of the line's loads, under that name, with the errors of the line."""
        away = self.positions - self.positions.mean()
        return {
            (load, f"{self.name} mean"): 1 / math.sqrt(len(away)),
            (load, f"{self.name} slope"): float(away[index] / np.linalg.norm(away)),
        }

    def related(self) -> Correlations:
        """Slope and mean are uncorrelated, but the one scatter of the line gives both uncertainties."""
        return {(f"{self.name} slope", f"{self.name} mean"): 0.0}

    def inputs(self) -> tuple[Input, Input]:
        mean_u = self.scatter / math.sqrt(len(self.loads))
        return (
            Input(f"{self.name} slope", self.slope, self.slope_u, self.degrees_of_freedom, "A"),
            Input(f"{self.name} mean", self.mean, mean_u, self.degrees_of_freedom, "A"),
        )


def displays_u(displays: Floats, calibration: LoadCellCalibration) -> tuple[float, float]:
    """Standard uncertainty [N] of a mean of displayed values, and its degrees of freedom.

    Where the values scatter by about a step, the scatter dithers the rounding: of the first term of its Fourier series
        Gaussian noise of deviation s leaves exp(-2 (pi s / step)^2) (Widrow and Kollar 2008), of higher terms next to
        nothing. Where the values stand still, the true value may be anywhere within a step.
    """
    points, count = displays.shape
    step = calibration.resolution_mV
    shown = float(displays.var(axis=1, ddof=1).mean())
    noise = shown - step**2 / 12
    if noise <= 0:
        return step / math.sqrt(12) / calibration.sensitivity_mV_per_N, BY_RESOLUTION
    left = step / (math.sqrt(2) * math.pi) * math.exp(-2 * math.pi**2 * noise / step**2)
    return math.hypot(math.sqrt(shown / count), left) / calibration.sensitivity_mV_per_N, points * (count - 1)


# --- compression ---------------------------------------------------------------------------------------


Values = Mapping[str, Floats]  # inputs by name, each (n,)

POSITION_STEP = POSITIONER["target"].scale  # m
SEED = 5302  # seed of the Monte Carlo trials: any number, but always the same one
LOADING, UNLOADING = "loading", "unloading"


@dataclass(frozen=True, slots=True)
class CompressionPoint:
    """One step of the compression of a pad.

    Stress [Pa] and strain are positive under compression. Names that end in `_u` are standard uncertainties.
    `extrapolated` says that the load lies outside the calibrated range of the load cell.
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
    """Result of the compression of a pad.

    Attributes:
        tangent: Young modulus by the slope of the loading line [Pa].
        secant: Young modulus as stress over strain at the largest strain [Pa].
        unloading: Young modulus by the slope of the unloading line [Pa].
        thickness: thickness of the pad by the two contacts [m].
        compliance: compliance of the bench [m/N].
        linearity: greatest deviation of a load from the loading line, as a fraction of the span.
        energy_loss: share of the loading work that unloading does not return.
    """

    tangent: Propagated
    secant: Propagated
    unloading: Propagated
    thickness: Propagated
    compliance: Propagated
    linearity: float
    energy_loss: Propagated
    points: tuple[CompressionPoint, ...]


def compress(
    bare: DisplaySeries,
    loading: DisplaySeries,
    unloading: DisplaySeries,
    calibration: LoadCellCalibration,
    area: float,
    area_u: float,
) -> Compression:
    """Stress, strain and moduli of a pad.

    Args:
        bare: series on the rigid support alone.
        loading, unloading: series on the pad.
        calibration: calibration of the load cell.
        area, area_u: area of the pad's face with its standard uncertainty [m2].

    Raises:
        EstimateError: a series has fewer than three points that surely touch, or the pad is not softer than the bench.
    """
    support = LoadLine.through("bare", bare, calibration)
    lines = {
        LOADING: LoadLine.through(LOADING, loading, calibration),
        UNLOADING: LoadLine.through(UNLOADING, unloading, calibration),
    }
    for name, line in lines.items():
        if not support.slope > line.slope > 0:
            raise EstimateError(
                f"{name}: the load rises by {line.slope:.4g} N/m on the pad and by {support.slope:.4g} N/m on the bare"
                " support; the pad must be the softer: check which of them was under the probe"
            )
    pad = _Pad(support.position, lines[LOADING].position)
    freedom = float(calibration.degrees_of_freedom or math.inf)
    inputs = (
        *support.inputs(),
        *lines[LOADING].inputs(),
        Input("sensitivity", 1.0, calibration.sensitivity_u / calibration.sensitivity_mV_per_N, freedom),
        Input("zero", 0.0, calibration.zero_u / calibration.sensitivity_mV_per_N, freedom),
        Input("area", area, area_u),
        Input("positions", 0.0, POSITION_STEP / math.sqrt(6)),  # two contact positions, each rounded to a step
    )
    related = {
        ("sensitivity", "zero"): calibration.covariance / (calibration.sensitivity_u * calibration.zero_u),
        **support.related(),
        **lines[LOADING].related(),
    }

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
    loads = [
        Input(f"{name} load {index}", float(load), line.scatter, line.degrees_of_freedom, "A")
        for name, line in lines.items()
        for index, load in enumerate(line.loads)
    ]
    each = [up.shares(index, f"{LOADING} load {index}") for index in range(len(up.loads))]
    # The loads of the unloading line share one estimate of scatter, too. The line itself is none of these inputs.
    each += [{(f"{UNLOADING} load 0", f"{UNLOADING} load {k}"): 0.0} for k in range(1, len(lines[UNLOADING].loads))]
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
        energy_loss=found(
            "energy loss",
            "1",
            lambda v: 1 - pad.work(v, lines[UNLOADING]) / pad.work(v, up),
            *loads,
            method=LINEAR,
            shared={pair: value for shares in each for pair, value in shares.items()},
        ),
        points=points,
    )


@dataclass(frozen=True, slots=True)
class _Pad:
    """The pad's quantities as functions of the fitted lines, whose mean positions these are [m].

    A load is (reading - zero) / sensitivity.
    """

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

    def work(self, v: Values, line: LoadLine) -> Floats:
        """Work per volume [J/m3] of loading or unloading: the area under stress over strain, by trapezoids."""
        stress, strain = [np.zeros_like(v["zero"])], [np.zeros_like(v["zero"])]
        for index in np.argsort(line.positions):
            at = {**v, "load": v[f"{line.name} load {index}"]}
            stress.append(self.stress(at))
            strain.append(self.strain(at, float(line.positions[index])))
        work: Floats = np.trapezoid(np.array(stress), np.array(strain), axis=0)
        return work
