"""Comparison of a table of the thesis with the models, cell by cell.

Forces and voltages are compared as magnitudes, because the thesis counts compression as negative in some places only.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.evidence import OTHER_RING, REPEATS, Evidence, of_model, ratio_by
from palpate.instrument.models.parameter_sets import get_parameter_set
from palpate.instrument.thesis import MODULUS, TableCell, ThesisTable, read_table
from palpate.procedures.reproduce.curves import RING, ring_of
from palpate.procedures.reproduce.judging.rows import WITHIN, Row, RowCorrelation, RowTable

Array = NDArray[np.float64]

HARD_END = 0.9  # force ratio above which theories can hardly differ


@dataclass(frozen=True, slots=True)
class ModelSeries:
    """Values of a model with one parameter set for a column; NaN where it has no answer."""

    parameters: str
    model: str
    values: Array

    @property
    def name(self) -> str:
        return f"{self.parameters}_{self.model}"


@dataclass(frozen=True, slots=True)
class Deviation:
    """Difference of a model from a column.

    Attributes:
        worst: difference of greatest magnitude.
        worst_at: row of that difference.
        rms: root mean square of the differences.
        factor: median of ours over the thesis'.
        cells: number of compared cells.
        within: number of cells that differ by `goal` at most; None: there is no goal.
        evidence: what agreement is worth, by the tables to which the model was fitted.
    """

    quantity: str
    parameters: str
    model: str
    worst: float
    worst_at: str
    rms: float
    factor: float
    cells: int
    goal: float | None
    within: int | None
    evidence: Evidence

    def record(self) -> dict[str, Any]:
        """The deviation with the names that JSON has."""
        return {**asdict(self), "evidence": self.evidence.value}


@dataclass(frozen=True, slots=True)
class ComparedColumn:
    """One column of a table.

    Attributes:
        quantity: name of the column, which ends in its unit.
        cells: the thesis' cells, by row.
        ours: series of models and parameter sets.
        goal: greatest difference that is aimed at; None: there is no goal.
        holds: tables of the thesis from which its numbers follow, beside the table itself.
    """

    quantity: str
    cells: tuple[TableCell, ...]
    ours: tuple[ModelSeries, ...]
    goal: float | None = None
    holds: tuple[str, ...] = ()

    @property
    def u(self) -> float | None:
        """Standard uncertainty that corresponds to the goal."""
        return None if self.goal is None else self.goal / WITHIN

    @property
    def thesis(self) -> Array:
        """The thesis' best values, as magnitudes."""
        return np.array([abs(cell.value) for cell in self.cells])

    def difference(self, series: ModelSeries) -> Array:
        """Ours less the thesis'."""
        difference: Array = series.values - self.thesis
        return difference

    def deviation(self, series: ModelSeries, table: ThesisTable) -> Deviation:
        """Deviation over the cells for which the model has an answer; there must be at least one."""
        difference = self.difference(series)
        answered = np.isfinite(difference)
        at = int(np.nanargmax(np.abs(difference)))
        inside = None if self.goal is None else int((np.abs(difference[answered]) <= self.goal).sum())
        return Deviation(
            quantity=self.quantity,
            parameters=series.parameters,
            model=series.model,
            worst=float(difference[at]),
            worst_at=table.rows[at],
            rms=float(np.sqrt(np.mean(difference[answered] ** 2))),
            factor=float(np.median((series.values / self.thesis)[answered])),
            cells=int(answered.sum()),
            goal=self.goal,
            within=inside,
            evidence=self.evidence(series, table),
        )

    def evidence(self, series: ModelSeries, table: ThesisTable) -> Evidence:
        """What agreement of the model with this column is worth."""
        return of_model(self.quantity, ratio_by(series.model, series.parameters), table.number, *self.holds)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of a table.

    Attributes:
        table: table of the thesis.
        columns: compared columns.
        sentences: sentences that tell what agrees and what does not.
    """

    table: ThesisTable
    columns: tuple[ComparedColumn, ...]
    sentences: tuple[str, ...]

    def deviations(self) -> list[Deviation]:
        """Deviation of every column and series."""
        return [column.deviation(series, self.table) for column in self.columns for series in column.ours]

    def row_table(self) -> RowTable:
        """Every cell of every model as a row; half a goal counts as a standard uncertainty.

        The cells of a curve are fully correlated, so their mean counts as one number.
        """
        rows = [
            Row(
                key, column.quantity, TableCell(cell.printed, abs(cell.value), cell.reason), float(ours), column.u,
                evidence, False, by=f"{series.model}, {series.parameters}",
                group=None if column.u is None else RowCorrelation(column.quantity, column.u, column.u),
                telling=self.table.key != MODULUS or abs(cell.value) < HARD_END,
                follows=self._follows(series, key),
            )
            for column in self.columns
            for series in column.ours
            for evidence in [column.evidence(series, self.table)]
            for key, cell, ours in zip(self.table.rows, column.cells, series.values, strict=True)
        ]  # fmt: skip
        number = self.table.number
        return RowTable(
            number, self.table.title, self.table.doubt, tuple(rows), self.sentences, again=number in REPEATS
        )

    def _follows(self, series: ModelSeries, key: str) -> bool:
        """Whether the series was fitted to the other ring's table, which has this row at the same ratio of moduli."""
        other = OTHER_RING.get(REPEATS.get(self.table.number, self.table.number))
        if other is None or other not in get_parameter_set(series.parameters, series.model).fitted_to:
            return False
        return float(key) * RING / ring_of(self.table) >= float(read_table(other).keys()[0])

    def records(self) -> Iterable[dict[str, Any]]:
        """One record for each cell: the thesis' number as printed and as repaired, then ours with both differences."""
        for column in self.columns:
            evidence = {series.name: column.evidence(series, self.table).value for series in column.ours}
            for index, (row, cell) in enumerate(zip(self.table.rows, column.cells, strict=True)):
                thesis = abs(cell.value)
                record: dict[str, Any] = {
                    self.table.key: row, "quantity": column.quantity, "printed": cell.printed, "thesis": thesis,
                    "repaired": cell.reason,
                }  # fmt: skip
                for series in column.ours:
                    ours = float(series.values[index])
                    answered = math.isfinite(ours)
                    record[series.name] = ours if answered else None
                    record[f"{series.name}_evidence"] = evidence[series.name]
                    record[f"{series.name}_difference"] = ours - thesis if answered else None
                    # Both definitions of a relative error: over the thesis' value, and over ours.
                    record[f"{series.name}_relative_difference"] = ours / thesis - 1 if answered and thesis else None
                    record[f"{series.name}_relative_to_ours"] = 1 - thesis / ours if answered and ours else None
                yield record


def column_of(
    table: ThesisTable, quantity: str, ours: Mapping[tuple[str, str], Array], goal: float | None = None
) -> ComparedColumn:
    """A printed column with series by (parameter set, model)."""
    series = tuple(ModelSeries(parameters, model, values) for (parameters, model), values in ours.items())
    return ComparedColumn(quantity, table.columns[quantity], series, goal)


def fit_sentence(comparison: Comparison, quantity: str) -> str:
    """Sentence that tells which models meet a column and which do not."""
    parts = []
    for d in comparison.deviations():
        if d.quantity != quantity:
            continue
        figures = f"worst {d.worst:+.4f} at {comparison.table.key} {d.worst_at}, rms {d.rms:.4f}"
        verdict = ""
        if d.within is not None:
            met = "meets all of" if d.within == d.cells else f"does not match: {d.within} of"
            verdict = f"{met} {d.cells} cells within {d.goal:g}, "
        parts.append(f"{d.parameters} set by {d.model}: {verdict}{figures}")
    return f"{quantity}: " + "; ".join(parts)
