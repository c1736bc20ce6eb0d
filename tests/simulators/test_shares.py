"""Effects on the share of the force that teeth take, and gains that a mounting draws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.models.validation import validate
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.clock import VirtualClock
from palpate.simulators.physics.effect import Effect
from palpate.simulators.planning.plan import Question
from palpate.simulators.randomness import Stream
from palpate.simulators.rig import Rig
from tests.simulators.measured import beside, bounded, changes
from tests.simulators.rigs import BALANCE, STRONG, an_effect, scene, waveform

FREQUENCY, SETTLING = 10.0, 2.0


def bench(*effects: Effect, seed: int = 1) -> Rig:
    clock = VirtualClock()
    rig = Rig(replace(scene(), effects={each.name: each for each in effects}, seed=seed), clock)
    clock.add(rig)
    return rig


def gains(rig: Rig, sample: str, sets: int = 1) -> Floats:
    """Transfer functions (sets, films + 1) of some load sets of one mounting."""
    rig.mount(SAMPLES[sample])
    rig.set_position(BALANCE + 2e-3)
    found = []
    for number in range(sets):
        rig.set_voltage(waveform("sine", 1.0 + 0.1 * number))
        rig.clock.wait(SETTLING)
        found.append(np.abs(rig.transfer(FREQUENCY)))
    return np.array(found)


def ratios(rig: Rig, samples: Sequence[str], sets: int = 1) -> Floats:
    """Logarithms (mountings, sets) of force ratios over the ratios without effects."""
    found = []
    for sample in samples:
        was, now = gains(bench(), sample)[0], gains(rig, sample, sets)
        found.append(np.log(now[:, 0] / now[:, 1] / (was[0] / was[1])))
    return np.array(found)


def test_a_mounting_draws_the_ratio_and_its_load_sets_share_it() -> None:
    found = ratios(bench(an_effect("mounting_scatter", scatter=0.02)), ["2"] * 12, sets=2)
    assert np.ptp(found, axis=1).max() < 1e-9
    assert len(set(found[:, 0].round(9))) == 12
    stream, scatter = Stream(1, "mounting_scatter"), an_effect("mounting_scatter", scatter=0.02)
    drawn_at = np.array([scatter.ln_change(SAMPLES["2"], stream, 10**9 * number) for number in range(1000)])
    assert drawn_at.std() == pytest.approx(0.02, rel=0.07)  # three standard deviations of the deviation


def test_an_object_lies_off_the_curve_by_the_same_amount_each_time_it_is_mounted() -> None:
    found = ratios(bench(an_effect("curve_error")), ["2", "4", "2"])[:, 0]
    assert found[0] == pytest.approx(found[2], rel=1e-9)
    assert abs(found[0] - found[1]) > 1e-3
    assert ratios(bench(an_effect("curve_error"), seed=2), ["2"])[0, 0] != pytest.approx(found[0], abs=1e-3)


def test_the_distance_of_objects_from_the_curve_has_the_stated_constant_and_spread() -> None:
    own = an_effect("curve_error", constant=-0.2, spread=0.05)
    streams = [Stream(seed, "curve_error") for seed in range(200)]
    found = np.array([[own.ln_change(SAMPLES[name], stream, 0) for name in SAMPLES] for stream in streams])
    assert found.mean() == pytest.approx(-0.2, abs=3 * 0.05 / math.sqrt(found.size))
    assert found.std(ddof=1) == pytest.approx(0.05, rel=3 / math.sqrt(2 * found.size))
    assert abs(np.corrcoef(found.T)[np.triu_indices(6, 1)]).max() < 0.25


def test_without_parameters_the_truth_is_as_far_from_the_curve_as_the_thesis_is_from_the_model_surface() -> None:
    percent = validate("single", "physical", "surface").percent
    errors = -np.log1p(np.array(list(percent.values())) / 100)
    assert an_effect("curve_error").constant == pytest.approx(errors.mean(), abs=1e-3)
    assert an_effect("curve_error").spread == pytest.approx(errors.std(ddof=1), abs=1e-3)


def test_the_teeth_take_from_the_ring_what_these_effects_give_them() -> None:
    was, now = (
        gains(bench(), "2")[0],
        gains(bench(an_effect("curve_error"), an_effect("mounting_scatter", scatter=0.1)), "2")[0],
    )
    assert now[1:] == pytest.approx(was[1:], rel=1e-9)  # base film and load cell
    assert now[0] != pytest.approx(was[0], rel=1e-2)


def test_a_pin_on_a_tooth_calibrates_its_film_whatever_objects_do() -> None:
    found = []
    for effects in ((), (an_effect("curve_error"), an_effect("mounting_scatter", scatter=0.1))):
        rig = bench(*effects)
        rig.press_tooth(0)
        rig.set_position(12.5e-3)
        rig.set_voltage(waveform("sine", 0.1))
        found.append(rig.transfer(FREQUENCY))
    assert np.array_equal(*found)


def test_gains_are_drawn_for_each_set_or_for_each_mounting() -> None:
    by_set, by_mounting = (
        ratios(bench(an_effect("gain_scatter", redrawn=of)), ["2"] * 4, 3) for of in ("set", "mounting")
    )
    assert len(set(by_set.ravel().round(9))) == 12
    assert np.ptp(by_mounting, axis=1).max() < 1e-9
    assert len(set(by_mounting[:, 0].round(9))) == 4


def test_teeth_that_would_take_more_than_the_whole_force_are_refused() -> None:
    rig = bench(an_effect("curve_error", constant=2.0), an_effect("mounting_scatter"))
    with pytest.raises(RangeError, match=r"sample '6' .* by curve_error, mounting_scatter, which is not below 1"):
        rig.mount(SAMPLES["6"])
    assert rig.sample is None


# --- bounds --------------------------------------------------------------------------------------------

QUESTION = Question("2", 3.0, dwell=0.5)


@pytest.mark.parametrize(
    "effect", [an_effect("curve_error"), an_effect("mounting_scatter", scatter=0.1)], ids=lambda effect: effect.name
)
@pytest.mark.parametrize(
    "others",
    [
        pytest.param({}, id="alone"),
        pytest.param(
            {"viscoelastic": an_effect("viscoelastic", material="soft_tissue")}, id="creep", marks=pytest.mark.slow
        ),
        pytest.param({"hysteresis": an_effect("hysteresis")}, id="plays", marks=pytest.mark.slow),
        pytest.param(
            {name: STRONG[name] for name in ("gain_scatter", "triboelectric", "adc")},
            id="gains, cables and steps",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_leaving_it_out_changes_no_more_than_its_bound(effect: Effect, others: dict[str, Effect]) -> None:
    without, with_it = beside(others, effect.name, effect)
    bound = bounded(effect.name, without, with_it, QUESTION)
    for force, ratio in changes(without, with_it, QUESTION, phases=6):
        assert force <= bound.force + 1e-9
        assert ratio <= bound.ratio + 1e-9


def test_what_another_effect_changes_is_bounded_for_every_share_that_may_be_drawn() -> None:
    """A ratio of half the size feels twice as much of what cables add."""
    cables = an_effect("triboelectric")
    alone = bounded("triboelectric", *beside({}, "triboelectric", cables), QUESTION)
    without, with_it = beside({"curve_error": an_effect("curve_error", constant=-0.7)}, "triboelectric", cables)
    bound = bounded("triboelectric", without, with_it, QUESTION)
    assert bound.ratio > 1.9 * alone.ratio
    for _, ratio in changes(without, with_it, QUESTION, phases=6):
        assert alone.ratio < ratio <= bound.ratio


def test_beside_shares_that_may_exceed_the_whole_force_there_is_no_bound() -> None:
    without, with_it = beside(
        {"mounting_scatter": an_effect("mounting_scatter", scatter=0.5)}, "triboelectric", an_effect("triboelectric")
    )
    assert bounded("triboelectric", without, with_it, QUESTION).ratio == math.inf
