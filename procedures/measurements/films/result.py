"""What a film calibration reads and finds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.uncertainty.budget import Budget


@dataclass(frozen=True, slots=True)
class PressedPoint:
    """One tooth pressed alone. Loads and voltages are peak to peak; `_u` are standard uncertainties."""

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
    calibration: FilmCalibration
    points: Sequence[PressedPoint]

    @property
    def budgets(self) -> Sequence[Budget]:
        """Of each film's sensitivity."""
        return self.calibration.budgets()

    def summary(self) -> dict[str, Any]:
        """Under its public names: all of the calibration but where it comes from."""
        found = self.calibration.model_dump()
        return {name: found[name] for name in ("films", "covariance", "crosstalk", "crosstalk_u", "frequencies_Hz",
                                               "gain", "least_N", "greatest_N", "load_cell", "expires")}  # fmt: skip
