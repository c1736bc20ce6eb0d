"""The scatter of groups beyond that of their repeats: what is left of the repeats passes for no scatter of groups."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.instrument.errors import RangeError
from palpate.instrument.uncertainty.budget import Between, between_groups

WITHIN, GROUPS, REPEATS, SEEDS = 0.041, 3, 10, 600


def found(scatter: float) -> list[Between]:
    rng = np.random.default_rng(20)
    shifts = scatter * rng.standard_normal((SEEDS, GROUPS, 1))
    drawn = np.exp(shifts + WITHIN * rng.standard_normal((SEEDS, GROUPS, REPEATS)))
    return [between_groups(groups.tolist()) for groups in drawn]


def test_groups_that_are_alike_are_told_apart_in_one_of_twenty_cases_and_their_scatter_is_right_on_average() -> None:
    alike = found(0.0)
    assert np.mean([each.significant for each in alike]) == pytest.approx(0.05, abs=0.02)
    assert np.mean([each.means_u**2 - each.within_u**2 for each in alike]) == pytest.approx(0.0, abs=2e-5)
    assert np.mean([each.u == 0 for each in alike]) > 0.5


def test_groups_that_scatter_by_more_are_told_and_do_not_exceed_the_bound_in_95_percent() -> None:
    for scatter in (0.01, 0.05):
        apart = found(scatter)
        assert np.mean([each.bound_u >= scatter for each in apart]) >= 0.94
        assert np.mean([each.means_u**2 - each.within_u**2 for each in apart]) == pytest.approx(scatter**2, rel=0.15)
    assert np.mean([each.significant for each in apart]) > 0.7


@pytest.mark.parametrize("groups", [[[1.0, 2.0]], [[1.0, 2.0], [1.0]]])
def test_one_group_or_one_value_tells_no_scatter(groups: list[list[float]]) -> None:
    with pytest.raises(RangeError, match="two groups or more, of two values or more"):
        between_groups(groups)
