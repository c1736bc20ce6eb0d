"""A number of the thesis beside ours: difference, error by both definitions, and whether it lies within its scatter."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from palpate.instrument.findings.evidence import Evidence
from palpate.instrument.thesis import Cell
from palpate.procedures.records.run import storing

WITHIN = 2.0  # standard uncertainties of the difference


@dataclass(frozen=True, slots=True)
class Group:
    """How a row moves with others of its table, so that a mean over them is judged by what it averages out.

    Attributes:
        kind: of quantity, of which one mean is taken.
        u: standard uncertainty of the difference, the load being known.
        common: part of it that all rows of this kind in the table have in common.
        load: of the thesis over the set one, by its own films on the base.
    """

    kind: str
    u: float
    common: float
    load: float = 1.0


@dataclass(frozen=True, slots=True)
class Row:
    """One cell.

    Attributes:
        row: which, as the table's key has it.
        quantity: name, which ends in its unit.
        cell: the thesis'.
        ours: measured on the simulated bench, or calculated.
        u: standard uncertainty of the difference by the stated scatter of both; None: nothing is stated.
        evidence: what a match is worth, by what went into ours.
        by: what ours is by, where it is not the bench with the models of its scene: a model and its parameters.
        measured: the thesis' number is an experiment and ours stands for the theory, or the other way round.
        because: where the difference comes from, of a row outside; "" where nothing is known.
        group: how it moves with others; None: with none, and its quantity is a kind of its own.
        follows: predicted by a fit to a table that has this row, too, but for a scale.
        telling: a theory can miss it; under an object much harder than the ring the ratio of all tends to 1.
    """

    row: str
    quantity: str
    cell: Cell
    ours: float
    u: float | None
    evidence: Evidence
    measured: bool = True
    because: str = ""
    group: Group | None = None
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
        """Of quantity, of which one mean is taken."""
        quantity = self.group.kind if self.group else self.quantity
        return f"{quantity} by {self.by}" if self.by else quantity

    @property
    def common(self) -> float:
        """Share of the uncertainty that all rows of its kind in the table have in common."""
        return self.group.common / self.group.u if self.group else 0.0

    @property
    def bias_distance(self) -> float:
        """Ours less the thesis' at the load of ours, in standard uncertainties; of a row that is judged."""
        group = self.group or Group(self.quantity, self.u or math.nan, 0.0)
        return (self.ours - self.cell.value / group.load) / group.u

    def errors(self) -> tuple[float | None, float | None]:
        """The experiment less the theory, in percent of the theory and of the experiment; None: of nothing, or of what
        is such a percentage itself."""
        if "_percent" in self.quantity:
            return None, None
        theory, experiment = (self.ours, self.cell.value) if self.measured else (self.cell.value, self.ours)
        less = 100 * (experiment - theory)
        return less / theory if theory else None, less / experiment if experiment else None

    def record(self) -> dict[str, Any]:
        """Under public names."""
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
    """Rows of one table of the thesis, and what is to be said of it.

    arrangement: of sensors, of which it is one of several tables; "": it stands alone.
    name: of its file, where another has the number's; "": the number.
    again: the same numbers stand in another table as well, and are counted there.
    """

    number: str
    title: str
    doubt: str
    rows: tuple[Row, ...]
    said: tuple[str, ...] = ()
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
        """As CSV; returns the file. Raises RecordError."""
        path = folder / f"table_{self.name or self.number.replace('.', '_')}.csv"
        records = [row.record() for row in self.rows]
        with storing(path), path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, list(records[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(records)
        return path

    def summary(self, file: Path) -> dict[str, Any]:
        """For machines."""
        return {
            "table": self.number,
            "title": self.title,
            "doubt": self.doubt or None,
            "file": str(file),
            "rows": [row.record() for row in self.rows],
            "evidence": counts_record(self),
            "said": list(self.said),
        }


@dataclass(frozen=True, slots=True)
class Count:
    """How many rows there are, how many of them are judged, and how many of these lie within; those that tell, too."""

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
    """Of every class alone."""
    return {each: Count.of(row for row in table.rows if row.evidence is each) for each in Evidence}


def counts_record(table: RowTable) -> dict[str, Any]:
    """Under public names."""
    return {evidence.value: asdict(count) for evidence, count in counts(table).items()}


def counts_said(table: RowTable) -> list[str]:
    """One sentence for each class that the table has."""
    return [
        f"{each.value}: {f'{count} rows within' if count.judged else count}"
        for each, count in counts(table).items()
        if count.rows
    ]
