"""Rows: a number of the thesis beside ours, with difference, both errors, and whether it lies within its scatter."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from palpate.instrument.models.evidence import Evidence
from palpate.instrument.thesis import TableCell
from palpate.procedures.records.run import storing

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
        absent: names of the thesis' columns that no row has.
        absent_cells: number of cells in these columns.
        absent_because: why palpate has nothing beside them.
    """

    number: str
    title: str
    doubt: str
    rows: tuple[Row, ...]
    sentences: tuple[str, ...] = ()
    arrangement: str = ""
    name: str = ""
    again: bool = False
    absent: tuple[str, ...] = ()
    absent_cells: int = 0
    absent_because: str = ""

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
            "absent": {
                "columns": list(self.absent),
                "cells": self.absent_cells,
                "because": self.absent_because or None,
            },
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
    """One sentence for each class in the table, and one for cells that it has not."""
    said = [
        f"{each.value}: {f'{count} rows within' if count.judged else count}"
        for each, count in counts(table).items()
        if count.rows
    ]
    if table.absent:
        said.append(f"absent: {table.absent_cells} cells of {', '.join(table.absent)}: {table.absent_because}")
    return said
