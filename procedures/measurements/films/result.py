"""The points and the result of a film calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.uncertainty.budget import Budget


@dataclass(frozen=True, slots=True)
class PressedPoint:
    """One tooth pressed alone. Loads and voltages are peak to peak; names with `_u` are standard uncertainties.

    Attributes:
        tooth: number of the tooth, from 1.
        frequency_Hz: frequency of the load.
        load_N: the asked load.
        indicator_mV: reading of the indicator.
        load_measured_N, load_measured_u: the measured load.
        extrapolated: whether the load lies outside the load cell's calibrated range.
        voltages_V, voltages_u: voltage of each film.
        valid: whether the point is used.
        flags: why it is not used, or what to know about it.
    """

    tooth: int
    frequency_Hz: float
    load_N: float
    indicator_mV: float
    load_measured_N: float
    load_measured_u: float
    extrapolated: bool
    voltages_V: tuple[float, ...]
    voltages_u: tuple[float, ...]
    valid: bool
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FilmResult:
    """The calibration and the points that it comes from."""

    calibration: FilmCalibration
    points: Sequence[PressedPoint]

    @property
    def achieved_u(self) -> float:
        """Greatest relative standard uncertainty of a sensitivity."""
        return max(film.sensitivity_u / film.sensitivity_mV_per_N for film in self.calibration.films)

    @property
    def budgets(self) -> Sequence[Budget]:
        """The budget of each film's sensitivity."""
        return self.calibration.budgets()

    def summary(self) -> dict[str, Any]:
        """The calibration for JSON, without its origin."""
        found = self.calibration.model_dump()
        return {name: found[name] for name in ("films", "covariance", "crosstalk", "crosstalk_u", "frequencies_Hz",
                                               "gain", "least_N", "greatest_N", "load_cell", "expires")}  # fmt: skip
