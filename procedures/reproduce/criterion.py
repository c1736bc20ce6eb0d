"""Requirements of `reproduce` for each class of rows, and the verdicts, which alone decide its exit status."""

from __future__ import annotations

import csv
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.evidence import Evidence
from palpate.instrument.models.springs import LINES, OddsLine
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.thesis import ThesisTable
from palpate.instrument.uncertainty.budget import coverage_factor
from palpate.procedures.records.run import storing
from palpate.procedures.reproduce.curves import RING, ring_of
from palpate.procedures.reproduce.rows import HARD_END, WITHIN, Count, Row, RowTable

# -------------------------------------------------------------------------------------------------------
# The law of the thesis' three-dimensional tables: tooth force over ring force is a straight line in the modulus

Array = NDArray[np.float64]

STEPS = 20  # of Gauss and Newton; five would suffice


def fitted_line(table: ThesisTable) -> OddsLine:
    """Line by least squares over the unrepaired force ratios of a table; `residual` is over all its cells."""
    places, ratios, sound = cells_of(table)
    x, ratio = places[sound], ratios[sound]
    start, slope = 0.1, 0.1
    for _ in range(STEPS):
        odds = start + slope * x
        weight = 1 / (1 + odds) ** 2  # change of the ratio by one of the odds
        change, *_ = np.linalg.lstsq(
            weight[:, None] * np.stack([np.ones_like(x), x], axis=1), ratio - odds / (1 + odds), rcond=None
        )
        start, slope = max(start + change[0], 1e-6), max(slope + change[1], 1e-6)
    return OddsLine(float(start), float(slope), distance(OddsLine(float(start), float(slope), 0.0), table))


def distance(line: OddsLine, table: ThesisTable) -> float:
    """Greatest difference of the line's force ratio from a table's."""
    places, ratios, _ = cells_of(table)
    return float(np.abs([line.force_ratio(place) for place in places] - ratios).max())


def odds_sentence(table: ThesisTable, design: str) -> str:
    """Sentence that tells how well a table keeps the law, by a line of its own and by model `column_fitted`.

    For the long table of the softer ring, with which the experiments were done, it also tells what the law means for
    them.
    """
    own, softer = fitted_line(table), ring_of(table) == RING
    evidence = "fitted to this ring" if softer else "fitted on the other ring, a prediction on this one"
    head = (
        f"odds of tooth to ring R/(1-R) are {own.start:.5f} + {own.slope:.6f} E1/E2, to {own.residual:.1e} of R at"
        f" worst; by model column_fitted, {evidence}, to {distance(LINES[design], table):.1e}"
    )
    if not (softer and table.number.startswith("A")):
        return head
    low, high = moduli_of_experiments(design)
    return (
        f"{head}. So two springs, the object over the tooth and the object in series with the ring, do what the thesis'"
        " finite elements do. By the inverse the experiments' mean ratios are those of objects"
        f" {low:.2f} to {high:.2f} times as hard as the samples"
    )


def moduli_of_experiments(design: str) -> tuple[float, float]:
    """Moduli by the line from the experiments' mean ratios, over the samples' moduli: least and greatest."""
    of_design = get_design(design)
    shares = [
        LINES[design].modulus_ratio(ratio) * of_design.ring.material.modulus / get_sample(name).modulus
        for name, ratio in of_design.thesis_force_ratio.items()
    ]
    return min(shares), max(shares)


def cells_of(table: ThesisTable) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Ratios of moduli, force ratios, and whether each of these is as printed."""
    column = table.columns["force_ratio" if "force_ratio" in table.columns else "force_rigid_N"]
    ratios = np.array([abs(cell.value) for cell in column])
    return table.keys() / ring_of(table), ratios, np.array([not cell.reason for cell in column])


# --- Biases: tables that are off in the mean, although each row is within its scatter ------------------
#
# Forces and voltages under one load are correlated, and those of one sample partly so. Their mean is therefore known
# less well than the mean of as many independent numbers. A mean is biased where it is farther from zero than chance
# puts the farthest of all tested means, once in twenty runs.

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
            f"{self.of}, {self.kind}: {self.mean:+.2f} standard uncertainties of a row{plain}; without a bias 95 % of"
            f" such means are within ± {coverage_factor(math.inf) * self.u:.2f}, and this is {abs(self.distance):.1f}"
            " standard deviations off"
        )


def biases(table: RowTable) -> list[MeanDifference]:
    """Mean differences of a table, one for each judged kind of quantity and each class."""
    kinds: dict[tuple[str, Evidence], dict[str, list[Row]]] = {}
    for row in table.judged:
        if not math.isfinite(row.ours):
            continue
        kinds.setdefault((row.kind, row.evidence), {}).setdefault(row.row, []).append(row)
    return [
        mean_difference(f"Table {table.number}", kind, evidence, list(loads.values()))
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


def mean_difference(of: str, kind: str, evidence: Evidence, loads: Sequence[Sequence[Row]]) -> MeanDifference:
    """Mean difference over the means of the loads. The part that all rows share does not average out."""
    means = [math.fsum(row.bias_distance for row in rows) / len(rows) for rows in loads]
    common = [math.fsum(row.common for row in rows) / len(rows) for rows in loads]
    shared = math.fsum(common) / len(common)
    own = math.fsum(1 - share**2 for share in common) / len(common) ** 2
    mean, units = math.fsum(means) / len(means), {row.u or math.nan for rows in loads for row in rows}
    difference = mean * units.pop() if len(units) == 1 else None
    return MeanDifference(of, kind, evidence, mean, math.sqrt(shared**2 + own), len(loads), difference)


# --- the requirements ----------------------------------------------------------------------------------

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
