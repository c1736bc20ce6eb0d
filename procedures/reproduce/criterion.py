"""What `reproduce` asks of each class of rows, and what it finds: its exit status rests on this alone."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from instrument.evidence import Evidence
from procedures.reproduce.bias import Bias, all_means, limit
from procedures.reproduce.rows import WITHIN, RowTable
from procedures.run import storing

LEAST_SHARE = 0.93  # of the input rows: one in twenty is outside by chance

REQUIRED: Mapping[Evidence, str] = MappingProxyType(
    {
        Evidence.INPUT: f"{LEAST_SHARE:.0%} of the rows within two standard uncertainties of their scatter, and no mean"
        " farther off than chance puts the farthest",
        Evidence.FITTED: "every row within the goal of the fit",
        Evidence.PREDICTED: "every row has an answer; how many lie within is printed and nothing is asked of it",
    }
)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a class comes to.

    Attributes:
        rows: of the class; `answered` have a number of ours at all, `judged` a stated scatter, and `within` of these
            lie within twice of it.
        by: what ours is by, judged, and within: a model and its parameters, where a class has several.
        farthest: of those judged, in standard uncertainties; `by_chance`: how many of so many normal differences lie
            outside, and how far the farthest lies.
        means: that were looked at for a bias; `limit`: how far chance puts the farthest of them, once in twenty runs.
    """

    evidence: Evidence
    rows: int
    answered: int
    judged: int
    within: int
    by: tuple[tuple[str, int, int], ...]
    farthest: float
    by_chance: tuple[float, float]
    means: tuple[Bias, ...]
    limit: float

    @property
    def share(self) -> float | None:
        return self.within / self.judged if self.judged else None

    @property
    def biased(self) -> list[Bias]:
        """Means farther off than chance explains, the farthest first."""
        found = [mean for mean in self.means if abs(mean.distance) > self.limit]
        return sorted(found, key=lambda mean: -abs(mean.distance))

    @property
    def met(self) -> bool:
        """Whether the class has what is required of it."""
        if self.evidence is Evidence.INPUT:
            return self.within >= LEAST_SHARE * self.judged and not self.biased
        if self.evidence is Evidence.FITTED:
            return self.within == self.judged
        return self.answered == self.rows

    def record(self) -> dict[str, Any]:
        """Under public names."""
        return {
            "rows": self.rows,
            "judged": self.judged,
            "within": self.within,
            "share": self.share,
            "by": {name: {"judged": judged, "within": within} for name, judged, within in self.by},
            "farthest": self.farthest,
            "outside_by_chance": self.by_chance[0],
            "farthest_by_chance": self.by_chance[1],
            "means": [mean.record() for mean in self.means],
            "mean_limit": self.limit,
            "biased": [mean.record() for mean in self.biased],
            "required": REQUIRED[self.evidence],
            "met": self.met,
        }

    def counted(self) -> str:
        """How many lie within, in words."""
        share = "" if self.share is None else f" lie within their stated scatter, {self.share:.1%}"
        rest = self.rows - self.judged
        return f"{self.within} of {self.judged} rows{share}" + (f"; {rest} more have none stated" if rest else "")

    def said(self) -> list[str]:
        """Sentences for people, the share first."""
        lines = [self.counted(), f"required: {REQUIRED[self.evidence]}: {'met' if self.met else 'NOT MET'}"]
        if self.evidence is Evidence.INPUT and self.judged:
            outside, farthest = self.by_chance
            lines.append(
                f"{self.judged - self.within} outside, the farthest by {self.farthest:.1f} standard uncertainties; of"
                f" {self.judged} normal ones chance puts {outside:.0f} outside, the farthest at some {farthest:.1f}"
            )
        lines += [f"{name}: {within} of {judged} rows, {within / judged:.1%}" for name, judged, within in self.by]
        if self.means:
            lines.append(
                f"means over a table: {len(self.biased) or 'none'} of {len(self.means)} biased; of so many chance puts"
                f" the farthest {self.limit:.1f} of its standard deviations off"
            )
            if self.biased:
                lines += [f"BIASED: {mean.said()}" for mean in self.biased]
            else:
                off = max(self.means, key=lambda mean: abs(mean.distance))
                lines.append(f"the farthest: {off.said()}")
        return lines


def judge(tables: Iterable[RowTable]) -> dict[Evidence, Verdict]:
    """Every class alone, in the order of what a match is worth."""
    from scipy.special import ndtr, ndtri

    chosen = list(tables)
    means = all_means(chosen)
    verdicts = {}
    for evidence in Evidence:
        rows = [row for table in chosen if not table.again for row in table.rows if row.evidence is evidence]
        answered = [row for row in rows if math.isfinite(row.ours)]
        judged = [row for row in rows if row.within is not None]
        by: dict[str, list[bool]] = {}
        for row in judged:
            if row.by:
                by.setdefault(row.by, []).append(bool(row.within))
        found = tuple(mean for mean in means if mean.evidence is evidence)
        verdicts[evidence] = Verdict(
            evidence=evidence,
            rows=len(rows),
            answered=len(answered),
            judged=len(judged),
            within=sum(bool(row.within) for row in judged),
            by=tuple((name, len(within), sum(within)) for name, within in by.items()),
            farthest=max((abs(row.difference) / row.u for row in answered if row.u), default=0.0),
            by_chance=(2 * float(ndtr(-WITHIN)) * len(judged), float(ndtri(1 - 1 / (4 * max(len(judged), 1))))),
            means=found,
            limit=limit(len(found)),
        )
    return verdicts


def write_classes(verdicts: Mapping[Evidence, Verdict], folder: Path) -> Path:
    """Counts and share of each class as CSV; returns the file. Raises RecordError."""
    path = folder / "classes.csv"
    header = ("class", "rows", "judged", "within", "share", "means", "biased", "required", "met")
    with storing(path), path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for evidence, v in verdicts.items():
            counted = (v.rows, v.judged, v.within, "" if v.share is None else v.share, len(v.means), len(v.biased))
            writer.writerow((evidence.value, *counted, REQUIRED[evidence], v.met))
    return path
