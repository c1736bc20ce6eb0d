"""Straight line through load against position while a probe presses, with its independent errors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import EstimateError
from palpate.instrument.uncertainty.budget import Correlations
from palpate.instrument.uncertainty.interpolation import interpolate
from palpate.instrument.uncertainty.propagation import Input

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
        known, freedom = _reading_u(series.displays, calibration)
        line = interpolate(positions, loads, known)
        scatter = max(line.residual_sd, known)
        # The F-test asks whether the loads scatter about the line more than the display's steps explain.
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


def _reading_u(displays: Floats, calibration: LoadCellCalibration) -> tuple[float, float]:
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
