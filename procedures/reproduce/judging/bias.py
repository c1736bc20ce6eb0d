"""Biases: tables that are off in the mean, although each row is within its scatter.

Forces and voltages under one load are correlated, and those of one sample partly so. Their mean is therefore known less
well than the mean of as many independent numbers. A mean is biased where it is farther from zero than chance puts the
farthest of all tested means, once in twenty runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from palpate.instrument.models.evidence import Evidence
from palpate.procedures.reproduce.judging.rows import Row, RowTable

BY_CHANCE = 0.05  # share of runs without bias in which a bias is found by chance


@dataclass(frozen=True, slots=True)
class MeanDifference:
    """Mean difference, ours less the thesis', over one kind of quantity.

    Attributes:
        of: name of the table, or of an arrangement with all its tables.
        kind: kind of quantity.
        mean: mean of the differences, each over its standard uncertainty.
        u: standard deviation of that mean if there is no bias.
        count: number of loads or samples over which it is taken.
        difference: mean of the differences themselves where all rows have one uncertainty; else None.
    """

    of: str
    kind: str
    evidence: Evidence
    mean: float
    u: float
    count: int
    difference: float | None = None

    @property
    def distance(self) -> float:
        return self.mean / self.u

    def record(self) -> dict[str, Any]:
        """The bias with the names that JSON has."""
        return {
            "of": self.of,
            "kind": self.kind,
            "evidence": self.evidence.value,
            "mean": self.mean,
            "u": self.u,
            "distance": self.distance,
            "count": self.count,
            "difference": self.difference,
        }

    def sentence(self) -> str:
        plain = "" if self.difference is None else f", in its own unit {self.difference:+.3g}"
        return (
            f"{self.of}, {self.kind}: {self.mean:+.2f} ± {self.u:.2f} standard uncertainties of a row{plain}:"
            f" {abs(self.distance):.1f} standard deviations off"
        )


def biases(table: RowTable) -> list[MeanDifference]:
    """Mean differences of a table, one for each judged kind of quantity and each class."""
    kinds: dict[tuple[str, Evidence], dict[str, list[Row]]] = {}
    for row in table.judged:
        if not math.isfinite(row.ours):
            continue
        kinds.setdefault((row.kind, row.evidence), {}).setdefault(row.row, []).append(row)
    return [
        _mean(f"Table {table.number}", kind, evidence, list(loads.values()))
        for (kind, evidence), loads in kinds.items()
    ]


def all_means(tables: Iterable[RowTable]) -> list[MeanDifference]:
    """Mean differences of every table, and of all tables of each arrangement together."""
    found: list[MeanDifference] = []
    arrangements: dict[str, list[MeanDifference]] = {}
    for table in tables:
        if table.again:
            continue
        found.extend(biases(table))
        if table.arrangement:
            arrangements.setdefault(table.arrangement, []).extend(biases(table))
    return found + [mean for name, of_it in arrangements.items() for mean in together(f"all tables of {name}", of_it)]


def together(of: str, found: Iterable[MeanDifference]) -> list[MeanDifference]:
    """Mean differences over several tables that were measured apart, for each kind and class that they share.

    An uncertainty that all rows of a table share completely, such as that of a calibration, is also shared by the
        tables: a mean over them tells nothing more.
    """
    kinds: dict[tuple[str, Evidence], list[MeanDifference]] = {}
    for bias in found:
        if bias.u < 1:
            kinds.setdefault((bias.kind, bias.evidence), []).append(bias)
    return [
        MeanDifference(
            of, kind, evidence, math.fsum(b.mean for b in several) / len(several),
            math.sqrt(math.fsum(b.u**2 for b in several)) / len(several), sum(b.count for b in several),
        )
        for (kind, evidence), several in kinds.items()
        if len(several) > 1
    ]  # fmt: skip


def limit(count: int) -> float:
    """Distance from zero that the farthest of `count` means exceeds by chance in BY_CHANCE of the runs (Šidák)."""
    from scipy.special import ndtri

    return float(ndtri(0.5 + 0.5 * (1 - BY_CHANCE) ** (1 / max(count, 1))))


def _mean(of: str, kind: str, evidence: Evidence, loads: Sequence[Sequence[Row]]) -> MeanDifference:
    """Mean difference over the means of the loads. The part that all rows share does not average out."""
    means = [math.fsum(row.bias_distance for row in rows) / len(rows) for rows in loads]
    common = [math.fsum(row.common for row in rows) / len(rows) for rows in loads]
    shared = math.fsum(common) / len(common)
    own = math.fsum(1 - share**2 for share in common) / len(common) ** 2
    mean, units = math.fsum(means) / len(means), {row.u or math.nan for rows in loads for row in rows}
    difference = mean * units.pop() if len(units) == 1 else None
    return MeanDifference(of, kind, evidence, mean, math.sqrt(shared**2 + own), len(loads), difference)
