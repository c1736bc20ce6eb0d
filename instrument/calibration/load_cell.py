"""Calibration of a load cell: the load that belongs to a reading, and the checks of where it may be used."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Self

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from palpate.instrument.calibration.calibration import Calibration
from palpate.instrument.calibration.classification import Classification
from palpate.instrument.calibration.load_cell_curve import Curvature
from palpate.instrument.config import NotNegative, Positive
from palpate.instrument.errors import ConfigError, EstimateError, RangeError
from palpate.instrument.uncertainty.rounding import mean_u


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
