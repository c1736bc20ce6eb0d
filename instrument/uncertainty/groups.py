"""How much groups of repeats scatter beyond what the repeats within them do, and whether that can be told from nothing.

found = between_groups([[0.221, 0.230, 0.226], [0.215, 0.223, 0.219], [0.228, 0.224, 0.233]])
found.u, found.bound_u, found.significant
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.instrument.errors import RangeError
from palpate.instrument.uncertainty.budget import COVERAGE


@dataclass(frozen=True, slots=True)
class Between:
    """Relative scatter of groups, by the means of some of them.

    Attributes:
        means_u: relative standard deviation of the groups' means.
        degrees_of_freedom: its degrees of freedom, groups less one.
        within_u: what the repeats within the groups alone add to it.
        within_freedom: the degrees of freedom of that.
    """

    means_u: float
    degrees_of_freedom: int
    within_u: float
    within_freedom: int

    @property
    def u(self) -> float:
        """Relative standard deviation from group to group beyond that of their repeats; 0: the means lie closer."""
        return math.sqrt(max(self.means_u**2 - self.within_u**2, 0.0))

    @property
    def significant(self) -> bool:
        """Whether the means lie farther apart than those of groups that are alike do in 95 % of cases (F)."""
        from scipy.special import fdtri

        limit = float(fdtri(self.degrees_of_freedom, self.within_freedom, COVERAGE))
        return self.means_u**2 > limit * self.within_u**2

    @property
    def bound_u(self) -> float:
        """The scatter that groups have at most, in 95 % of cases (χ²); what their repeats add is left in it."""
        from scipy.special import chdtri

        return self.means_u * math.sqrt(self.degrees_of_freedom / float(chdtri(self.degrees_of_freedom, COVERAGE)))


def between_groups(groups: Sequence[Sequence[float]]) -> Between:
    """The scatter of groups of values above 0. Raises RangeError: they are not two or more, of two values or more."""
    if len(groups) < 2 or min(map(len, groups)) < 2:
        raise RangeError("a scatter of groups needs two groups or more, of two values or more; measure more")
    logs = [[math.log(value) for value in group] for group in groups]
    within = math.fsum(statistics.variance(group) / len(group) for group in logs) / len(logs)
    means = statistics.stdev(math.fsum(group) / len(group) for group in logs)
    return Between(means, len(logs) - 1, math.sqrt(within), sum(map(len, logs)) - len(logs))
