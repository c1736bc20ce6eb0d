"""Lines of uncertainty of an answer, what lowers each of them, and what that costs on the bench.

    lines = [Line("gain scatter", 0.082, Unit.SET, 7), Line("noise", 0.002, Unit.SECOND)]
    budget(lines, mountings=1, sets=3, dwell=0.1).u

An answer that is the mean over k mountings, N sets in all and D seconds of dwell in all has the variance
Σ u² / x + floor², where x is k, N or D by what lowers the line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import combinations

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.uncertainty.budget import COVERAGE, Budget, Component, mixture_factors

MOST_FREEDOM = 1e9  # as good as infinitely many


class RepeatUnit(Enum):
    """What lowers a line: it falls with the square root of the number of these."""

    SET = "set"
    MOUNTING = "mounting"
    SECOND = "second of dwell"
    NOTHING = "nothing"


@dataclass(frozen=True, slots=True)
class BudgetLine:
    """One source of uncertainty of an answer.

    Args:
        name: what is uncertain, such as "gain scatter".
        u: relative standard uncertainty of the answer from this source, with one unit.
        per: what lowers it.
        degrees_of_freedom: degrees of freedom of `u`, above 0; infinite where it is known exactly.
        estimate: name of the one estimate from which this line and others come; they share its degrees of freedom.
            Empty: an estimate of its own.

    Raises:
        RangeError: `u` is negative or not finite, or there are no degrees of freedom.
    """

    name: str
    u: float
    per: RepeatUnit
    degrees_of_freedom: float = math.inf
    estimate: str = ""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.u) and self.u >= 0):
            raise RangeError(f"line {self.name!r}: standard uncertainty {self.u:g}; give a finite one of 0 or more")
        if not self.degrees_of_freedom > 0:
            raise RangeError(f"line {self.name!r}: {self.degrees_of_freedom:g} degrees of freedom; give more than 0")


@dataclass(frozen=True, slots=True)
class Costs:
    """What a plan takes on the bench [s]; a second of dwell takes one second besides.

    Args:
        start: what is paid once, whatever the plan: zero, end of the run.
        mounting: each mounting, the first as well: a person's part, approach, preload.
        set: each set, without its dwell: drive, servo, settling, readings.
        person: the part of `mounting` that a person takes. A computation of this length delays nothing.

    Raises:
        RangeError: a cost is negative or not finite, or a person takes longer than the mounting.
    """

    start: float
    mounting: float
    set: float
    person: float = 0.0

    def __post_init__(self) -> None:
        for name in ("start", "mounting", "set", "person"):
            if not (math.isfinite(seconds := getattr(self, name)) and seconds >= 0):
                raise RangeError(f"cost {name!r}: {seconds:g} s; give a finite time of 0 or more")
        if self.person > self.mounting:
            raise RangeError(
                f"a person takes {self.person:g} s of a mounting of {self.mounting:g} s; give no more than the mounting"
            )

    def seconds(self, mountings: float, sets: float, dwell: float) -> float:
        """Bench time of a plan. `sets` are those of all mountings together, `dwell` is that of one set [s]."""
        return self.start + self.mounting * mountings + (self.set + dwell) * sets


def budget(lines: Sequence[BudgetLine], mountings: float, sets: float, dwell: float) -> Budget:
    """Relative uncertainty of the answer by the lines: `u`, `degrees_of_freedom`, and `rows()` with each line's share.

    Args:
        lines: lines with names of their own.
        mountings: number of mountings, each with as many sets.
        sets: number of sets in all mountings together.
        dwell: dwell of one set [s].

    Raises:
        RangeError: there is not one set for each mounting, or no dwell.
        EstimateError: two lines share a name.
    """
    if not (1 <= mountings <= sets and dwell > 0):
        raise RangeError(
            f"{mountings:g} mountings, {sets:g} sets, {dwell:g} s of dwell: give one mounting or more, one set or more"
            " for each mounting, and a dwell above 0"
        )
    units = {
        RepeatUnit.MOUNTING: mountings,
        RepeatUnit.SET: sets,
        RepeatUnit.SECOND: sets * dwell,
        RepeatUnit.NOTHING: 1,
    }
    inputs = tuple(Component(e.name, e.u / math.sqrt(units[e.per]), 1.0, e.degrees_of_freedom) for e in lines)
    shared = {(a.name, b.name): 0.0 for a, b in combinations(lines, 2) if a.estimate and a.estimate == b.estimate}
    prior = next((e.name for e in lines if e.per is RepeatUnit.MOUNTING and math.isfinite(e.degrees_of_freedom)), "")
    return Budget("relative deviation", 0.0, "1", inputs, shared, prior)


def falling(lines: Sequence[BudgetLine]) -> list[BudgetLine]:
    """Those of the lines that more sets or mountings lower."""
    return [line for line in lines if line.per is not RepeatUnit.NOTHING]


def half_widths(lines: Sequence[BudgetLine], mountings: Floats, each: Floats, dwell: float, of_sets: Floats) -> Floats:
    """Half-widths of the 95 % interval of the answer, relative, of many plans at once.

    Args:
        lines: lines with names of their own; of those that fall with mountings at most one has a finite number of
            degrees of freedom.
        mountings: number of mountings, an array.
        each: number of sets in each mounting, of the same shape.
        dwell: dwell of one set [s].
        of_sets: degrees of freedom of the scatter of sets, of the same shape.
    """

    def variance(unit: RepeatUnit) -> float:
        return math.fsum(line.u**2 for line in lines if line.per is unit)

    sets = (variance(RepeatUnit.SET) + variance(RepeatUnit.SECOND) / dwell) / (mountings * each)
    freedom = min((line.degrees_of_freedom for line in lines if line.per is RepeatUnit.MOUNTING), default=math.inf)
    return halves_of(lines, variance(RepeatUnit.MOUNTING) / mountings, freedom + mountings - 1, sets, of_sets)


def halves_of(
    lines: Sequence[BudgetLine], mounted: Floats, prior: Floats, sets: Floats, of_sets: Floats | float
) -> Floats:
    """Half-widths of the 95 % interval by the variances of an answer, each with its degrees of freedom.

    Args:
        lines: those of them count that nothing lowers.
        mounted, prior: variance by mountings.
        sets, of_sets: variance by sets and their dwell.
    """
    fixed = [line for line in lines if line.per is RepeatUnit.NOTHING]
    rest = sets + math.fsum(line.u**2 for line in fixed)
    spent = sets**2 / np.minimum(of_sets, MOST_FREEDOM)
    spent = spent + math.fsum(line.u**4 / line.degrees_of_freedom for line in fixed)
    total = mounted + rest
    if np.isfinite(prior).all():
        freedom = np.divide(rest**2, spent, out=np.full(rest.shape, MOST_FREEDOM), where=spent > 0)
        factor = mixture_factors(mounted / np.where(total > 0, total, 1.0), prior + 0.0 * total, freedom)
    else:
        from scipy.special import stdtrit

        freedom = np.divide(total**2, spent, out=np.full(total.shape, MOST_FREEDOM), where=spent > 0)
        factor = stdtrit(np.minimum(freedom, MOST_FREEDOM), (1 + COVERAGE) / 2)
    found: Floats = factor * np.sqrt(total)
    return found
