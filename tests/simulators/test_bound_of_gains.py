"""Gains within reach; private, as a scene has one gain of a film at a time, and a bound holds for all of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.simulators.bounds import Side, _gains, _least

GRID = np.linspace(0.1, 1.9, 2001)[:, np.newaxis, np.newaxis]


@pytest.fixture
def both() -> tuple[Side, Side]:
    """Films before and after, at random, whose gains lie on the grid."""
    chance = np.random.default_rng(7)
    passed, added, others, more = chance.normal(size=(4, 5, 8)) + 1j * chance.normal(size=(4, 5, 8))
    scatter = np.full(8, 0.9)
    before, after = (SimpleNamespace(passed=p, added=a, scatter=scatter) for p, a in ((passed, added), (others, more)))
    return cast(Side, before), cast(Side, after)


def test_no_gain_within_reach_changes_a_film_more_or_less_than_those_that_are_looked_at(
    both: tuple[Side, Side],
) -> None:
    before, after = both

    def sizes_and_distances(gains: Floats) -> tuple[Floats, Floats]:
        factors = (gains * after.passed + after.added) / (gains * before.passed + before.added)
        return np.abs(factors), np.abs(1 - factors)

    (found, far), (sizes, distances) = (sizes_and_distances(gains) for gains in (_gains(before, after), GRID))
    assert (sizes.max(axis=0) <= found.max(axis=0) * (1 + 1e-12)).all()
    assert (sizes.min(axis=0) >= found.min(axis=0) * (1 - 1e-12)).all()
    assert (distances.max(axis=0) <= far.max(axis=0) * (1 + 1e-12)).all()


def test_no_gain_within_reach_makes_a_film_smaller_than_its_least_amplitude(both: tuple[Side, Side]) -> None:
    for side in both:
        least = np.abs(GRID * side.passed + side.added).min(axis=0)
        assert (_least(side) <= least * (1 + 1e-12)).all()
        assert (_least(side) >= least - 0.5 * np.ptp(GRID) / 2000 * np.abs(side.passed)).all()
