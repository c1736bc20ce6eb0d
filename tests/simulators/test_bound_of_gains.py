"""Bounds where the films' gains scatter: all gains within reach count, those too at which a film vanishes."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.simulators.bounds import Side, _gains, _least
from palpate.simulators.effects.gain_scatter import GainScatter
from palpate.simulators.effects.off_axis import OffAxis
from palpate.simulators.effects.triboelectric import Triboelectric
from palpate.simulators.effects.white_noise import WhiteNoise
from palpate.simulators.physics.effect import Bound
from palpate.simulators.planning.plan import Question
from tests.simulators.measured import changes
from tests.simulators.omitted import beside, bounded

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


def test_where_a_gain_may_vanish_noise_has_no_bound_but_what_changes_all_films_alike_has_one() -> None:
    question, scatter = Question("2", 3.0, dwell=0.5), GainScatter(strength=8.0)
    noise = beside({"gain_scatter": scatter}, "white_noise", WhiteNoise())
    assert bounded("white_noise", *noise, question) == Bound(math.inf, math.inf)
    bound = bounded("off_axis", *beside({"gain_scatter": scatter}, "off_axis", OffAxis()), question)
    assert bound.force == pytest.approx(1 - math.cos(math.radians(10)), rel=1e-9)
    assert bound.ratio < 1e-12


def test_gains_that_scatter_change_what_passes_them_and_not_what_is_added_behind() -> None:
    """The cables give a hundred times the films' charge."""
    question = Question("2", 3.0, dwell=0.5)
    without, with_it = beside(
        {"triboelectric": Triboelectric(charge="1 nC", load="1 N")}, "gain_scatter", GainScatter()
    )
    bound = bounded("gain_scatter", without, with_it, question)
    found = changes(without, with_it, question, phases=8)
    assert 0 < max(force for force, _ in found) <= bound.force < 0.002
    assert 0 < max(ratio for _, ratio in found) <= bound.ratio < 0.01
