"""The order of objects by their ratios, to a stated risk of error: which pairs are told, and what others would take.

    family = Family(objects=2, risk=0.05, most=5, prior_u=0.041, prior_freedom=7)
    found = order(family, {"a": [0.31, 0.32], "b": [0.27]})
    found.names, found.not_told

All pairs are told together: the risk is that of one wrong pair anywhere in the order. Of the risk a fifth is spent by
looks after each set of the object that is mounted, so that it can be taken off early (divided among looks and pairs,
Bonferroni), and the rest by one last look at the end (S. Holm, Scand. J. Statist. 6, 65, 1979). What all objects have
in common, such as the films' calibration, changes no order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from palpate.instrument.allocation.lines import BudgetLine, Costs, budget, falling
from palpate.instrument.allocation.stopping import pooled
from palpate.instrument.allocation.table import Allocation, allocation
from palpate.instrument.uncertainty.budget import COVERAGE

EARLY = 0.2  # share of the risk that early looks spend
MOST_TOLD = 1e9  # sets; a greater number is not told
POWER = COVERAGE  # probability with which a planned number of sets tells a pair

Pair = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Family:
    """All comparisons of a run.

    Attributes:
        objects: number of objects of the run.
        risk: greatest risk of a wrong pair anywhere in the order.
        most: greatest number of sets of an object.
        prior_u: relative standard deviation of a set's ratio, before the run.
        prior_freedom: its degrees of freedom.
    """

    objects: int
    risk: float
    most: int
    prior_u: float
    prior_freedom: float

    @property
    def pairs(self) -> int:
        return self.objects * (self.objects - 1) // 2

    @property
    def early(self) -> float:
        """Risk of one pair in one early look."""
        return EARLY * self.risk / max(1, self.pairs * (self.most - 1))

    @property
    def last(self) -> float:
        """Risk of all pairs in the last look."""
        return (1 - EARLY) * self.risk


@dataclass(frozen=True, slots=True)
class RatioRanking:
    """Objects from the largest ratio to the smallest.

    Attributes:
        names: the objects, from the largest mean ratio to the smallest.
        not_told: pairs whose order is not known to the risk, the larger ratio first.
        risk: smallest risk to which all other pairs are known; None: no pair is.
        scatter: relative standard deviation of a set's ratio, by the prior and by all sets.
        refuted: whether the sets refute the prior.
    """

    names: tuple[str, ...]
    not_told: tuple[Pair, ...]
    risk: float | None
    scatter: float
    refuted: bool


def early_pairs(family: Family, ratios: Mapping[str, Sequence[float]]) -> frozenset[Pair]:
    """Pairs that an early look told, the larger ratio first.

    Args:
        family: all comparisons of the run.
        ratios: ratios of each object's sets, in the order in which both were measured.

    Raises:
        RangeError: a ratio is not above 0.
    """
    taken: dict[str, Sequence[float]] = {}
    decided: set[Pair] = set()
    for name, sets in ratios.items():
        decided |= _looks(family, taken, name, sets)
        if sets:
            taken[name] = sets
    return frozenset(decided)


def is_told(family: Family, ratios: Mapping[str, Sequence[float]], name: str) -> bool:
    """Whether early looks told an object from all that were measured before it. Raises as `early_pairs`."""
    before: dict[str, Sequence[float]] = {}
    for other, sets in ratios.items():
        if other == name:
            break
        if sets:
            before[other] = sets
    sets = ratios.get(name, ())
    return bool(sets) and len(_looks(family, before, name, sets)) == len(before)


def _looks(family: Family, before: Mapping[str, Sequence[float]], name: str, sets: Sequence[float]) -> set[Pair]:
    """Pairs of an object and those measured before it that a look after one of its sets told."""
    decided: set[Pair] = set()
    for number in range(1, min(len(sets), family.most - 1) + 1):
        errors = _errors(family, {**before, name: sets[:number]}, name)
        decided |= {pair for pair, p in errors.items() if p <= family.early}
        if len(decided) == len(before):
            break
    return decided


def order(family: Family, ratios: Mapping[str, Sequence[float]]) -> RatioRanking:
    """The order by all sets of a run. Arguments and errors as `early_pairs`."""
    errors = _errors(family, ratios)
    early = early_pairs(family, ratios)
    decided, worst, stopped = set(early) & errors.keys(), 0.0, False
    for rank, pair in enumerate(sorted(errors, key=lambda each: errors[each])):
        worst = max(worst, errors[pair] * (family.pairs - rank) / (1 - EARLY))
        stopped = stopped or worst > family.risk
        if not stopped:
            decided.add(pair)
    left = tuple(pair for pair in errors if pair not in decided)
    found = [sets for sets in ratios.values() if sets]
    scatter = pooled(family.prior_u, family.prior_freedom, *found)
    names = sorted((name for name, sets in ratios.items() if sets), key=lambda name: -_mean(ratios[name]))
    risk = (worst if not stopped else family.risk) if decided else None
    return RatioRanking(tuple(names), left, risk, scatter.u, scatter.refuted)


def needed(family: Family, lines: Sequence[BudgetLine], dwell: float, gap: float) -> int | None:
    """Number of sets of each of two objects that tells them apart with 95 % probability; None: more than there are.

    Args:
        family: all comparisons of the run.
        lines: lines of a set's ratio.
        dwell: dwell of a set [s].
        gap: difference of the logarithms of their ratios.
    """
    for sets in range(1, family.most + 1):
        u = math.sqrt(2) * budget(lines, 1, sets, dwell).u
        if gap >= (_factor(family, sets) + _quantile(POWER, math.inf)) * u:
            return sets
    return None


def expected_sets(
    family: Family, lines: Sequence[BudgetLine], dwell: float, gap: float, before: int, freedom: float
) -> int:
    """Expected number of sets of an object until an early look tells it from one that has been measured.

    Args:
        family, lines, dwell, gap: as for `needed`.
        before: number of sets of the other object.
        freedom: degrees of freedom of the scatter before the first set.
    """
    for sets in range(1, family.most):
        u = math.sqrt(1 / before + 1 / sets) * budget(lines, 1, 1, dwell).u
        if gap >= _quantile(1 - family.early, freedom + sets - 1) * u:
            return sets
    return family.most


def least_risk(family: Family, lines: Sequence[BudgetLine], dwell: float, gap: float) -> float:
    """Smallest risk to which the most sets tell two objects apart in every second run. Arguments as `needed`."""
    u = math.sqrt(2) * budget(lines, 1, family.most, dwell).u
    return min(1.0, _tail(gap / u, _freedom(family, family.most)) * max(1, family.objects - 1) / (1 - EARLY))


def what_it_takes(
    family: Family, lines: Sequence[BudgetLine], costs: Costs, dwell: float, gap: float
) -> Allocation | None:
    """The sets of each of two objects that tell them apart with 95 % probability; None: no number worth telling.

    Arguments as `needed`; `costs`: bench times.
    """
    factor = _factor(family, family.most) + _quantile(POWER, math.inf)
    lowered = falling(lines)
    free = (gap / (math.sqrt(2) * factor)) ** 2 - math.fsum(line.u**2 for line in lines if line not in lowered)
    sets = budget(lowered, 1, 1, dwell).u ** 2 / free if free > 0 else math.inf
    return allocation(lines, costs, 1, max(1, math.ceil(sets)), dwell) if sets <= MOST_TOLD else None


def _errors(family: Family, ratios: Mapping[str, Sequence[float]], of: str = "") -> dict[Pair, float]:
    """Probability that two equal objects differ so much, for each pair, or those `of` one; the larger ratio first."""
    found = {name: sets for name, sets in ratios.items() if sets}
    if not found:
        return {}
    scatter = pooled(family.prior_u, family.prior_freedom, *found.values())
    means = {name: _mean(sets) for name, sets in found.items()}
    errors = {}
    for one, other in combinations(found, 2):
        if of and of not in (one, other):
            continue
        pair = (one, other) if means[one] >= means[other] else (other, one)
        u = scatter.u * math.sqrt(1 / len(found[one]) + 1 / len(found[other]))
        distance = abs(means[one] - means[other])
        errors[pair] = _tail(distance / u if u > 0 else math.inf, scatter.degrees_of_freedom)
    return errors


def _mean(ratios: Sequence[float]) -> float:
    return math.fsum(map(math.log, ratios)) / len(ratios)


def _freedom(family: Family, sets: int) -> float:
    """Degrees of freedom of the scatter at the end of a run in which each object has so many sets."""
    return family.prior_freedom + family.objects * (sets - 1)


def _factor(family: Family, sets: int) -> float:
    """Distance of neighbours in standard uncertainties that the last look asks for, where all other pairs are told."""
    return _quantile(1 - family.last / max(1, family.objects - 1), _freedom(family, sets))


def _quantile(probability: float, freedom: float) -> float:
    from scipy.special import ndtri, stdtrit

    return float(ndtri(probability) if math.isinf(freedom) else stdtrit(freedom, probability))


def _tail(distance: float, freedom: float) -> float:
    from scipy.special import ndtr, stdtr

    return float(ndtr(-distance) if math.isinf(freedom) else stdtr(freedom, -distance))
