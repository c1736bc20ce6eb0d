"""The capped interface: a rigid cap that cannot tilt keeps the ring's top level, and the object slides on it.

Over a level ring the object is a spring between load, tooth and cap, whatever its shape, and the ring another one
below the cap. On a rigid support the odds, tooth force over ring force, are then a straight line in the ratio of the
moduli, exactly: what is known at two moduli is known at all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.errors import RangeError
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.parameters import RoundParameters, SolidParameters
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.models.solid.system import System
from palpate.procedures.reproduce import chapter4
from palpate.procedures.reproduce.curves import Curves, Solutions
from tests.instrument import direct_round

ROUND = RoundParameters(interface="capped", support="rigid", sensed_thickness=1e-3)
SQUARE = SolidParameters(interface="capped", support="rigid", sensed_thickness=1e-3)
PAIR = replace(SQUARE, cell_length=12e-3, cell_width=12e-3, columns=2)
SMALL = Resolution(layers=1, ratio=0.2, sectors=1, degree=2)


def round_odds(ratio: float, refinement: int = 1, **changed: float | str) -> float:
    """The odds of the round model at a ratio of the moduli of object and ring."""
    asked = replace(ROUND, sensed_modulus=ratio * 24e3, **changed)  # type: ignore[arg-type]
    found = axisymmetric.solve(asked, refinement).force_ratio
    return found / (1 - found)


def solid_odds(parameters: SolidParameters, ratio: float) -> float:
    found = solid.solve_on(replace(parameters, sensed_modulus=ratio * 24e3), SMALL).force_ratio
    return found / (1 - found)


def curvature(odds: list[float], ratios: list[float]) -> float:
    """How far the middle one of three odds is off the line through the others, over itself."""
    share = (ratios[1] - ratios[0]) / (ratios[2] - ratios[0])
    return abs(odds[0] + share * (odds[2] - odds[0]) - odds[1]) / odds[1]


RATIOS = [1e-3, 2.0, 50.0]


def test_over_a_level_ring_the_odds_are_a_straight_line_in_the_ratio_of_moduli_by_both_models() -> None:
    assert curvature([round_odds(ratio) for ratio in RATIOS], RATIOS) < 1e-9
    assert curvature([solid_odds(SQUARE, ratio) for ratio in RATIOS], RATIOS) < 1e-9


def test_over_a_free_ring_they_are_none() -> None:
    assert curvature([round_odds(ratio, interface="frictionless") for ratio in RATIOS], RATIOS) > 0.1


def test_from_a_very_soft_object_to_a_very_hard_one_the_line_goes_on() -> None:
    slope = (round_odds(10) - round_odds(1e-3)) / (10 - 1e-3)
    start = round_odds(1e-3) - 1e-3 * slope
    assert round_odds(1e-7) == pytest.approx(start + 1e-7 * slope, rel=1e-9)
    for ratio in (1e2, 4e4, 1e6):
        found = direct_round.solve(replace(ROUND, sensed_modulus=ratio * 24e3), 1)
        assert 1 - found.force_ratio == pytest.approx(1 / (1 + start + slope * ratio), rel=1e-10)
        assert found.imbalance < 1e-14


@pytest.mark.slow
def test_both_models_agree_within_their_estimates_on_a_disc() -> None:
    exact, _ = axisymmetric.solve_to(RoundParameters(interface="capped"), 1e-6)
    found, estimate = solid.solve_to(SolidParameters(interface="capped", outline="round"), 0.05)
    assert abs(found.force_ratio - exact.force_ratio) < estimate


@pytest.mark.slow
def test_of_a_pair_too_and_half_of_it_gives_what_the_whole_does_and_all_forces_reach_the_floor() -> None:
    assert curvature([solid_odds(PAIR, ratio) for ratio in RATIOS], RATIOS) < 1e-9
    whole = System(PAIR, SMALL, mirrored=(False, False))
    half = solid.solve_on(PAIR, SMALL)
    goals = whole.curve([whole.load(None)]).poles.values(np.array([PAIR.sensed_modulus]))[0, :, 0]
    assert (*half.tooth_forces, half.total_force) == pytest.approx(goals, rel=1e-10)
    assert half.total_force == pytest.approx(1, abs=1e-10)


@pytest.mark.parametrize("parameters", [ROUND, SQUARE])
@pytest.mark.parametrize("gap", [0.0, 1e-6])
def test_a_cap_that_touches_the_tooth_is_refused(parameters: RoundParameters | SolidParameters, gap: float) -> None:
    with pytest.raises(RangeError, match="the cap would hang on the tooth; widen the gap"):
        replace(parameters, ring_inner_radius=1.4e-3 + gap)


def test_the_capped_set_meets_table_a2_7_to_38_mn_and_14_rms() -> None:
    """A fit to this very table: thickness, modulus and Poisson ratios were chosen to meet it."""
    comparison = chapter4.compare_position(("identified",), Curves([], solutions=Solutions.shipped()))
    found = {(d.quantity, d.parameters): d for d in comparison.deviations()}
    for tooth in ("force_pvdf3_N", "force_pvdf1_N"):
        capped, identified = found[tooth, "capped"], found[tooth, "identified"]
        assert (abs(capped.worst), capped.rms) == pytest.approx((0.0383, 0.0142), abs=1e-4)
        assert (abs(identified.worst), identified.rms) == pytest.approx((0.21, 0.106), abs=1e-2)
    assert any("the capped set is a fit to this table" in sentence for sentence in comparison.sentences)
