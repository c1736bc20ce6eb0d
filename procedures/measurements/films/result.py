"""The points and the result of a film calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.uncertainty.budget import Budget
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import Column


@dataclass(frozen=True, slots=True)
class PressedPoint:
    """One tooth pressed alone. Loads and voltages are peak to peak."""

    tooth: Annotated[int, Column("number of the tooth, from 1")]
    frequency_Hz: Annotated[float, Column("frequency of the load", "Hz")]
    load_N: columns.AskedLoad
    indicator_mV: columns.Indicator
    load_measured_N: columns.MeasuredLoad
    load_measured_u: float
    extrapolated: columns.Extrapolated
    voltages_V: columns.Volts
    voltages_u: tuple[float, ...]
    valid: columns.Valid
    flags: columns.Flags


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
    def reached(self) -> float:
        """Greatest half-width of the 95 % interval of a sensitivity, relative."""
        return max(budget.expanded() / budget.value for budget in self.budgets)

    @property
    def budgets(self) -> Sequence[Budget]:
        """The budget of each film's sensitivity."""
        return self.calibration.budgets()

    def summary(self) -> dict[str, Any]:
        """The calibration for JSON, without its origin."""
        found = self.calibration.model_dump()
        return {name: found[name] for name in ("films", "covariance", "crosstalk", "crosstalk_u", "frequencies_Hz",
                                               "gain", "least_N", "greatest_N", "load_cell", "expires")}  # fmt: skip
