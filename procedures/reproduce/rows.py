"""Rows: a number of the thesis beside ours, with difference, both errors, and whether it lies within its scatter."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.evidence import OTHER_RING, REPEATS, Evidence, of_model, ratio_by
from palpate.instrument.models.parameters import get_parameter_set
from palpate.instrument.thesis import MODULUS, TABLES, TableCell, ThesisTable, read_table
from palpate.procedures.records.run import storing
from palpate.procedures.reproduce.curves import RING, ring_of
from palpate.procedures.showing.text import number

# --- Every doubtful cell of the thesis' tables: as printed, its best value, and the reason -------------

COLUMNS = ("table", "row", "column", "printed", "best", "reason")


def slips() -> list[tuple[str, ...]]:
    """One row for each cell, in the order of the tables, with the columns COLUMNS."""
    return [
        (number, row, column, cell.printed, f"{cell.value:g}", cell.reason)
        for number in TABLES
        for row, column, cell in read_table(number).repaired()
    ]


def write_slips(folder: Path) -> Path:
    """Write the slips as CSV; returns the file. Raises RecordError."""
    path = folder / "slips.csv"
    with storing(path), path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([COLUMNS, *slips()])
    return path


# --- rows ----------------------------------------------------------------------------------------------

WITHIN = 2.0  # standard uncertainties of the difference


@dataclass(frozen=True, slots=True)
class RowCorrelation:
    """Correlation of a row with others of its table, by which a mean over them is judged.

    Attributes:
        kind: kind of quantity over which one mean is taken.
        u: standard uncertainty of the difference if the load is known.
        common: part of it that all rows of this kind in the table share.
        load: the thesis' load, by its own base films, over the set load.
    """

    kind: str
    u: float
    common: float
    load: float = 1.0


@dataclass(frozen=True, slots=True)
class Row:
    """One cell of a table beside ours.

    Attributes:
        row: key of the row in the table.
        quantity: name of the column, which ends in its unit.
        cell: the thesis' cell.
        ours: our number, measured on the simulated bench or computed.
        u: standard uncertainty of the difference by the stated scatter of both; None: nothing is stated.
        evidence: what agreement is worth, by what went into our number.
        by: model and parameters that gave our number; empty: the bench with the model of its scene.
        measured: whether the experiment of the two is the thesis' number; else it is ours.
        because: reason of the difference, for a row outside; "" where none is known.
        group: correlation with other rows; None: there is none, and the quantity is a kind of its own.
        follows: whether it is predicted by a fit to a table that holds the same row at another scale.
        telling: whether a theory can miss it; under an object much harder than the ring every ratio tends to 1.
    """

    row: str
    quantity: str
    cell: TableCell
    ours: float
    u: float | None
    evidence: Evidence
    measured: bool = True
    because: str = ""
    group: RowCorrelation | None = None
    by: str = ""
    telling: bool = True
    follows: bool = False

    @property
    def difference(self) -> float:
        """Ours less the thesis'."""
        return self.ours - self.cell.value

    @property
    def within(self) -> bool | None:
        return None if self.u is None else abs(self.difference) <= WITHIN * self.u

    @property
    def kind(self) -> str:
        """Kind of quantity over which one mean is taken."""
        quantity = self.group.kind if self.group else self.quantity
        return f"{quantity} by {self.by}" if self.by else quantity

    @property
    def common(self) -> float:
        """Share of the uncertainty that all rows of its kind in the table share."""
        return self.group.common / self.group.u if self.group else 0.0

    @property
    def bias_distance(self) -> float:
        """Ours less the thesis' at our load, in standard uncertainties, of a judged row."""
        group = self.group or RowCorrelation(self.quantity, self.u or math.nan, 0.0)
        return (self.ours - self.cell.value / group.load) / group.u

    def errors(self) -> tuple[float | None, float | None]:
        """The experiment less the theory, in percent of the theory and of the experiment.

        None: there is no such number, or the quantity is such a percentage itself.
        """
        if "_percent" in self.quantity:
            return None, None
        theory, experiment = (self.ours, self.cell.value) if self.measured else (self.cell.value, self.ours)
        less = 100 * (experiment - theory)
        return less / theory if theory else None, less / experiment if experiment else None

    def record(self) -> dict[str, Any]:
        """The row with the names that JSON has."""
        answered = math.isfinite(self.ours)
        of_theory, of_experiment = self.errors() if answered else (None, None)
        return {
            "row": self.row,
            "quantity": self.quantity,
            "by": self.by or None,
            "printed": self.cell.printed,
            "thesis": self.cell.value,
            "repaired": self.cell.reason,
            "ours": self.ours if answered else None,
            "difference": self.difference if answered else None,
            "error_percent_of_theory": of_theory,
            "error_percent_of_experiment": of_experiment,
            "scatter_u": self.u if self.u is not None and math.isfinite(self.u) else None,
            "evidence": self.evidence.value,
            "within": self.within,
            "outside_because": self.because,
        }


@dataclass(frozen=True, slots=True)
class RowTable:
    """Rows of one table of the thesis, with sentences.

    Attributes:
        arrangement: arrangement of sensors to which the table belongs; "": it belongs to none.
        name: name of its file; "": the table's number.
        again: whether the same numbers are in another table as well and are counted there.
    """

    number: str
    title: str
    doubt: str
    rows: tuple[Row, ...]
    sentences: tuple[str, ...] = ()
    arrangement: str = ""
    name: str = ""
    again: bool = False

    @property
    def judged(self) -> list[Row]:
        return [row for row in self.rows if row.within is not None]

    @property
    def inside(self) -> int:
        return sum(row.within is True for row in self.rows)

    def write(self, folder: Path) -> Path:
        """Write the rows as CSV; returns the file. Raises RecordError."""
        path = folder / f"table_{self.name or self.number.replace('.', '_')}.csv"
        records = [row.record() for row in self.rows]
        with storing(path), path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, list(records[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(records)
        return path

    def summary(self, file: Path) -> dict[str, Any]:
        """The table as JSON has it."""
        return {
            "table": self.number,
            "title": self.title,
            "doubt": self.doubt or None,
            "file": str(file),
            "rows": [row.record() for row in self.rows],
            "evidence": counts_record(self),
            "said": list(self.sentences),
        }


@dataclass(frozen=True, slots=True)
class Count:
    """Number of rows, of judged rows, and of rows within; and the same of rows that a theory can miss."""

    rows: int
    judged: int
    within: int
    telling: int
    telling_within: int

    @classmethod
    def of(cls, rows: Iterable[Row]) -> Self:
        every = list(rows)
        judged = [row for row in every if row.within is not None]
        telling = [row for row in judged if row.telling]
        return cls(len(every), len(judged), _inside(judged), len(telling), _inside(telling))

    def __str__(self) -> str:
        return f"{self.within} of {self.judged}" if self.judged else "not judged" if self.rows else ""


def _inside(rows: Iterable[Row]) -> int:
    return sum(row.within is True for row in rows)


def counts(table: RowTable) -> dict[Evidence, Count]:
    """Counts of each class."""
    return {each: Count.of(row for row in table.rows if row.evidence is each) for each in Evidence}


def counts_record(table: RowTable) -> dict[str, Any]:
    """Counts of each class with the names that JSON has."""
    return {evidence.value: asdict(count) for evidence, count in counts(table).items()}


def counts_said(table: RowTable) -> list[str]:
    """One sentence for each class in the table."""
    return [
        f"{each.value}: {f'{count} rows within' if count.judged else count}"
        for each, count in counts(table).items()
        if count.rows
    ]


# --- Comparison of a table of the thesis with the models, cell by cell ---------------------------------
#
# Forces and voltages are compared as magnitudes, because the thesis counts compression as negative in some places
# only.

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


# --- Every cell of a table of the thesis beside the models, for the page -------------------------------

SHORT = 30  # rows; the cells of longer tables are folded away


def every_cell(comparison: Comparison) -> str:
    """Rows in the thesis' order: printed and repaired value, then ours by each model and parameter set.

    A cell that differs by more than the goal of its column is marked as outside.
    """
    table = comparison.table
    names = list(dict.fromkeys((s.parameters, s.model) for column in comparison.columns for s in column.ours))
    header = (table.key, "quantity", "printed", "thesis", *(f"{model}, {parameters}" for parameters, model in names))
    return "\n".join(
        [
            f"<details{' open' if len(table.rows) <= SHORT else ''}><summary>every cell beside ours</summary>",
            f"<table><tr>{''.join(f'<th>{escape(name)}</th>' for name in header)}</tr>",
            *_rows(comparison, names),
            "</table></details>",
        ]
    )


def _rows(comparison: Comparison, names: list[tuple[str, str]]) -> Iterator[str]:
    for index, key in enumerate(comparison.table.rows):
        for column in comparison.columns:
            cell, thesis = column.cells[index], float(column.thesis[index])
            series = {(each.parameters, each.model): float(each.values[index]) for each in column.ours}
            cells = "".join(f"<td>{escape(text)}</td>" for text in (key, column.quantity, cell.printed, number(thesis)))
            for name in names:
                ours = series.get(name, math.nan)
                off = column.goal is not None and abs(ours - thesis) > column.goal
                cells += f"<td{' class=outside' if off else ''}>{number(ours) if math.isfinite(ours) else '-'}</td>"
            repaired = f' class=repaired title="{escape(cell.reason)}"' if cell.reason else ""
            yield f"<tr{repaired}>{cells}</tr>"
