"""Whether a table lies off in the mean, though its rows lie within their scatter one by one.

Forces and voltages under one load move together, and those of one sample in part, so that their mean is known less well
than that of so many independent numbers. A bias is a mean farther from zero than chance puts the farthest of all that
are tested, once in twenty runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from palpate.instrument.findings.evidence import Evidence
from palpate.procedures.reproduce.judging.rows import Row, RowTable

BY_CHANCE = 0.05  # of the runs in which nothing is biased


@dataclass(frozen=True, slots=True)
class Bias:
    """A mean of ours less the thesis' over one kind of quantity, in standard uncertainties.

    Attributes:
        of: the table, or all tables of an arrangement.
        kind: of quantity.
        mean: of the differences, each over its standard uncertainty.
        u: standard deviation of that mean, were there no bias.
        count: loads or samples that it is taken over.
        difference: mean of the differences themselves, where all rows have one uncertainty; else None.
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
        """Under public names."""
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

    def said(self) -> str:
        plain = "" if self.difference is None else f", in its own unit {self.difference:+.3g}"
        return (
            f"{self.of}, {self.kind}: {self.mean:+.2f} ± {self.u:.2f} standard uncertainties of a row{plain}:"
            f" {abs(self.distance):.1f} standard deviations off"
        )


def biases(table: RowTable) -> list[Bias]:
    """One for each kind of quantity of a table that is judged, and each class in it."""
    kinds: dict[tuple[str, Evidence], dict[str, list[Row]]] = {}
    for row in table.judged:
        if not math.isfinite(row.ours):
            continue
        kinds.setdefault((row.kind, row.evidence), {}).setdefault(row.row, []).append(row)
    return [
        _mean(f"Table {table.number}", kind, evidence, list(loads.values()))
        for (kind, evidence), loads in kinds.items()
    ]


def all_means(tables: Iterable[RowTable]) -> list[Bias]:
    """Of every table, and of all tables of each arrangement together."""
    found: list[Bias] = []
    arrangements: dict[str, list[Bias]] = {}
    for table in tables:
        if table.again:
            continue
        found.extend(biases(table))
        if table.arrangement:
            arrangements.setdefault(table.arrangement, []).extend(biases(table))
    return found + [mean for name, of_it in arrangements.items() for mean in together(f"all tables of {name}", of_it)]


def together(of: str, found: Iterable[Bias]) -> list[Bias]:
    """Over several tables that were measured apart, for each kind and class that more than one has.

    What all rows of a table share whole, as a calibration, the tables share too: no mean over them says more.
    """
    kinds: dict[tuple[str, Evidence], list[Bias]] = {}
    for bias in found:
        if bias.u < 1:
            kinds.setdefault((bias.kind, bias.evidence), []).append(bias)
    return [
        Bias(
            of, kind, evidence, math.fsum(b.mean for b in several) / len(several),
            math.sqrt(math.fsum(b.u**2 for b in several)) / len(several), sum(b.count for b in several),
        )
        for (kind, evidence), several in kinds.items()
        if len(several) > 1
    ]  # fmt: skip


def limit(count: int) -> float:
    """Distance that the farthest of so many means passes by chance in BY_CHANCE of the runs (Šidák)."""
    from scipy.special import ndtri

    return float(ndtri(0.5 + 0.5 * (1 - BY_CHANCE) ** (1 / max(count, 1))))


def _mean(of: str, kind: str, evidence: Evidence, loads: Sequence[Sequence[Row]]) -> Bias:
    """Of the mean of each load; the part that all rows have in common does not average out."""
    means = [math.fsum(row.bias_distance for row in rows) / len(rows) for rows in loads]
    common = [math.fsum(row.common for row in rows) / len(rows) for rows in loads]
    shared = math.fsum(common) / len(common)
    own = math.fsum(1 - share**2 for share in common) / len(common) ** 2
    mean, units = math.fsum(means) / len(means), {row.u or math.nan for rows in loads for row in rows}
    difference = mean * units.pop() if len(units) == 1 else None
    return Bias(of, kind, evidence, mean, math.sqrt(shared**2 + own), len(loads), difference)
