"""A number of the thesis beside ours: difference, error by both definitions, and whether it lies within its scatter."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from instrument.evidence import Evidence
from instrument.thesis import Cell
from procedures.run import storing

ABSOLUTE, RATIO = ("force", "pvdf"), "force_ratio"  # columns of what goes with the load, but for the ratio
FEWEST_LOADS = 3
WITHIN = 2.0  # standard uncertainties of the difference
LEAST_SHARE = 0.93  # of the experimental cells that shall lie within


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
        measured: the thesis' number is an experiment and ours stands for the theory, or the other way round.
        because: where the difference comes from, of a row outside; "" where nothing is known.
    """

    row: str
    quantity: str
    cell: Cell
    ours: float
    u: float | None
    evidence: Evidence
    measured: bool = True
    because: str = ""

    @property
    def difference(self) -> float:
        """Ours less the thesis'."""
        return self.ours - self.cell.value

    @property
    def within(self) -> bool | None:
        return None if self.u is None else abs(self.difference) <= WITHIN * self.u

    def errors(self) -> tuple[float | None, float | None]:
        """The experiment less the theory, in percent of the theory and of the experiment; None: of nothing."""
        theory, experiment = (self.ours, self.cell.value) if self.measured else (self.cell.value, self.ours)
        less = 100 * (experiment - theory)
        return less / theory if theory else None, less / experiment if experiment else None

    def record(self) -> dict[str, Any]:
        """Under public names."""
        of_theory, of_experiment = self.errors()
        return {
            "row": self.row,
            "quantity": self.quantity,
            "printed": self.cell.printed,
            "thesis": self.cell.value,
            "repaired": self.cell.reason,
            "ours": self.ours,
            "difference": self.difference,
            "error_percent_of_theory": of_theory,
            "error_percent_of_experiment": of_experiment,
            "scatter_u": self.u,
            "evidence": self.evidence.value,
            "within": self.within,
            "outside_because": self.because,
        }


@dataclass(frozen=True, slots=True)
class RowTable:
    """Rows of one table of the thesis, and what is to be said of it.

    experimental: its cells count among those of the experiments.
    """

    number: str
    title: str
    doubt: str
    rows: tuple[Row, ...]
    said: tuple[str, ...] = ()
    experimental: bool = False

    @property
    def judged(self) -> list[Row]:
        return [row for row in self.rows if row.within is not None]

    @property
    def inside(self) -> int:
        return sum(row.within is True for row in self.rows)

    @property
    def bias(self) -> float | None:
        """Mean distance of the forces and voltages, in standard uncertainties; None: of fewer than three loads."""
        loads = self._loads()
        return math.fsum(loads) / len(loads) if len(loads) >= FEWEST_LOADS else None

    @property
    def biased(self) -> bool:
        """Whether that is more than chance puts it, were all scatter of a load common to what is measured under it."""
        return self.bias is not None and abs(self.bias) > WITHIN / math.sqrt(len(self._loads()))

    def _loads(self) -> list[float]:
        """The mean distance of each load: what is measured under one has the load's own scatter in common."""
        loads: dict[str, list[float]] = {}
        for row in self.rows:
            if row.u and row.quantity.startswith(ABSOLUTE) and row.quantity != RATIO:
                loads.setdefault(row.row, []).append(row.difference / row.u)
        return [math.fsum(each) / len(each) for each in loads.values()]

    def write(self, folder: Path) -> Path:
        """As CSV; returns the file. Raises RecordError."""
        path = folder / f"table_{self.number.replace('.', '_').replace(' ', '_')}.csv"
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
            "judged": len(self.judged),
            "within": self.inside,
            "bias": self.bias,
            "biased": self.biased,
            "said": list(self.said),
        }


def by_chance(rows: Iterable[Row]) -> str:
    """How many of normal differences would lie outside, and how far the farthest, beside what is found."""
    from scipy.special import ndtr, ndtri

    distances = [abs(row.difference) / row.u for row in rows if row.u]
    if not distances:
        return "nothing is judged"
    outside, farthest = 2 * float(ndtr(-WITHIN)), float(ndtri(1 - 1 / (4 * len(distances))))
    return (
        f"{sum(d > WITHIN for d in distances)} outside, the farthest by {max(distances):.1f} standard uncertainties; of"
        f" {len(distances)} normal ones chance puts {outside * len(distances):.0f} outside, the farthest at some"
        f" {farthest:.1f}"
    )


def counted(tables: Iterable[RowTable]) -> tuple[int, int]:
    """How many rows have a stated scatter, and how many lie within."""
    chosen: Sequence[RowTable] = list(tables)
    return sum(len(table.judged) for table in chosen), sum(table.inside for table in chosen)
