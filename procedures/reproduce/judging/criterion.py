"""Requirements of `reproduce` for each class of rows, and the verdicts, which alone decide its exit status."""

from __future__ import annotations

import csv
import math
import statistics
from collections.abc import Iterable, Mapping
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from palpate.instrument.models.evidence import Evidence
from palpate.procedures.records.run import storing
from palpate.procedures.reproduce.judging.bias import BY_CHANCE, MeanDifference, all_means, limit
from palpate.procedures.reproduce.judging.comparison import HARD_END
from palpate.procedures.reproduce.judging.rows import WITHIN, Count, Row, RowTable

LEAST_SHARE = 0.93  # of the input rows that must lie within; one in twenty is outside by chance

REQUIRED: Mapping[Evidence, str] = MappingProxyType(
    {
        Evidence.INPUT: f"every row has an answer, {LEAST_SHARE:.0%} of them within two standard uncertainties of their"
        " scatter, and no mean farther off than chance puts the farthest",
        Evidence.FITTED: "every row within the goal of the fit",
        Evidence.PREDICTED: "every row has an answer; how many lie within is printed and nothing is asked of it",
    }
)


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict on a class of rows.

    Attributes:
        count: counts of its rows.
        answered: number of rows for which we have a number.
        by: the same counts for each model with its parameters.
        unjudged: rows without a stated scatter by kind of quantity: their number, and the median of ours over the
            thesis'.
        follows: counts of the rows that follow from a fit to the other ring's table.
        farthest: greatest difference of a judged row, in standard uncertainties.
        by_chance: for as many normal differences, how many lie outside and how far off the farthest is.
        means: means that were tested for a bias.
        limit: distance that chance gives the farthest of them, once in twenty runs.
    """

    evidence: Evidence
    count: Count
    answered: int
    by: Mapping[str, Count]
    unjudged: Mapping[str, tuple[int, float]]
    follows: Count
    farthest: float
    by_chance: tuple[float, float]
    means: tuple[MeanDifference, ...]
    limit: float

    @property
    def share(self) -> float | None:
        return self.count.within / self.count.judged if self.count.judged else None

    @property
    def biased(self) -> list[MeanDifference]:
        """Means that are farther off than chance explains, the farthest first."""
        found = [mean for mean in self.means if abs(mean.distance) > self.limit]
        return sorted(found, key=lambda mean: -abs(mean.distance))

    @property
    def met(self) -> bool:
        """Whether the class meets its requirement."""
        if self.answered < self.count.rows and self.evidence is not Evidence.FITTED:
            return False
        if self.evidence is Evidence.INPUT:
            return self.count.within >= LEAST_SHARE * self.count.judged and not self.biased
        if self.evidence is Evidence.FITTED:
            return self.count.within == self.count.judged
        return True

    def record(self) -> dict[str, Any]:
        """The verdict with the names that JSON has."""
        return {
            **asdict(self.count),
            "share": self.share,
            "by": {name: asdict(count) for name, count in self.by.items()},
            "unjudged": {kind: {"rows": rows, "factor": factor} for kind, (rows, factor) in self.unjudged.items()},
            "follows": {"judged": self.follows.judged, "within": self.follows.within},
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
        """Text of how many rows lie within."""
        share = "" if self.share is None else f" lie within their stated scatter, {self.share:.1%}"
        return f"{self.count.within} of {self.count.judged} rows{share}{_telling(self.count)}"

    def following(self) -> list[str]:
        """Text of how many rows lie within, if those that follow from a fit are left out; empty without such rows."""
        judged, within = self.count.judged - self.follows.judged, self.count.within - self.follows.within
        if not self.follows.judged or not judged:
            return []
        return [
            f"without {self.follows.judged} rows that follow from a fit, since both rings have one curve over the ratio"
            f" of moduli: {within} of {judged}, {within / judged:.1%}"
        ]

    def required(self) -> str:
        """Text of the class's requirement, and whether it is met."""
        return f"required: {REQUIRED[self.evidence]}: {'met' if self.met else 'NOT MET'}"

    def sentences(self) -> list[str]:
        """Sentences for people, the share first."""
        lines = [self.counted(), *self.following(), self.required()]
        judged = self.count.judged
        if self.evidence is Evidence.INPUT and judged:
            outside, farthest = self.by_chance
            lines.append(
                f"{judged - self.count.within} rows lie outside, the farthest by {self.farthest:.1f} standard"
                f" uncertainties; of {judged} normally distributed differences chance puts {outside:.0f} outside, and"
                f" the farthest at about {farthest:.1f}"
            )
        lines += [
            f"{name}: {count} rows, {count.within / count.judged:.1%}{_telling(count)}"
            for name, count in self.by.items()
        ]
        if self.unjudged:
            kinds = [
                f"{rows} rows of {kind}, of which the median is {factor:.3g} times the thesis'"
                for kind, (rows, factor) in self.unjudged.items()
            ]
            lines.append(f"not judged, as no scatter is stated: {'; '.join(kinds)}")
        if self.means:
            lines.append(self.tested())
            if self.biased:
                lines += [f"BIASED: {mean.sentence()}" for mean in self.biased]
            else:
                off = max(self.means, key=lambda mean: abs(mean.distance))
                lines.append(f"the farthest mean: {off.sentence()}")
        return lines

    def tested(self) -> str:
        """Text of how many means are biased."""
        return (
            f"means over a table or arrangement: {len(self.biased) or 'none'} of {len(self.means)} farther off than"
            f" {self.limit:.1f} of their standard deviations, which chance exceeds once in {1 / BY_CHANCE:.0f} runs"
        )

    def brief(self) -> list[str]:
        """Short text of the verdict, with the reason where it is not met."""
        lines = [self.counted(), *self.following(), self.required(), *([self.tested()] if self.means else [])]
        if not self.met:
            lines += [f"BIASED: {mean.sentence()}" for mean in self.biased]
            lines += [f"without an answer: {self.count.rows - self.answered} rows"] * (self.answered < self.count.rows)
        return lines


def _unjudged(rows: Iterable[Row]) -> dict[str, tuple[int, float]]:
    """Number and median factor of rows without a stated scatter, by the first word of their quantity.

    Theories that Table 5.8 implies are counted under that name.
    """
    kinds: dict[str, list[float]] = {}
    for row in rows:
        if row.within is None and row.cell.value:
            kind = "theory" if "_vs_" in row.quantity else row.quantity.partition("_")[0]
            kinds.setdefault(kind, []).append(abs(row.ours / row.cell.value))
    return {kind: (len(factors), statistics.median(factors)) for kind, factors in kinds.items()}


def _telling(count: Count) -> str:
    """Text of how many rows lie within if rows that no theory can miss are left out; empty where there are none."""
    if count.telling == count.judged:
        return ""
    return f" ({count.telling_within} of {count.telling} where the force ratio is below {HARD_END:g})"


def judge(tables: Iterable[RowTable]) -> dict[Evidence, Verdict]:
    """Verdict on each class, in the order of what agreement is worth."""
    from scipy.special import ndtr, ndtri

    chosen = list(tables)
    means = all_means(chosen)
    verdicts = {}
    for evidence in Evidence:
        rows = [row for table in chosen if not table.again for row in table.rows if row.evidence is evidence]
        answered = [row for row in rows if math.isfinite(row.ours)]
        names = dict.fromkeys(row.by for row in rows if row.by and row.within is not None)
        found = tuple(mean for mean in means if mean.evidence is evidence)
        verdicts[evidence] = Verdict(
            evidence=evidence,
            count=(count := Count.of(rows)),
            answered=len(answered),
            unjudged=_unjudged(rows),
            by={name: Count.of(row for row in rows if row.by == name) for name in names},
            follows=Count.of(row for row in rows if row.follows),
            farthest=max((abs(row.difference) / row.u for row in answered if row.u), default=0.0),
            by_chance=(2 * float(ndtr(-WITHIN)) * count.judged, float(ndtri(1 - 1 / (4 * max(count.judged, 1))))),
            means=found,
            limit=limit(len(found)),
        )
    return verdicts


def write_classes(verdicts: Mapping[Evidence, Verdict], folder: Path) -> Path:
    """Write counts and share of each class as CSV; returns the file. Raises RecordError."""
    path = folder / "classes.csv"
    header = ("class", *Count.__slots__, "share", "means", "biased", "required", "met")
    with storing(path), path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for evidence, v in verdicts.items():
            counted = (*astuple(v.count), "" if v.share is None else v.share, len(v.means), len(v.biased))
            writer.writerow((evidence.value, *counted, REQUIRED[evidence], v.met))
    return path
