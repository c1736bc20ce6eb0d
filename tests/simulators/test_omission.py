"""Leaving an effect out never changes a result by more than its own bound says."""

from __future__ import annotations

import math
import os
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

from instrument.sample import SAMPLES
from simulators.effects import EFFECTS
from simulators.effects.effect import Bound, Effect
from simulators.effects.white_noise import WhiteNoise
from simulators.planning.plan import Question, case_of
from simulators.scene import Scene, read_scene
from tests.simulators.measured import force_and_ratio
from tests.simulators.strong import STRONG

THESIS = read_scene("thesis_single")
# Of two results that agree to this, the bound may well be 0: rounding of the fit.
ROUNDING = 1e-10
LIMITS = {"amplifier_clip", "current_limit", "end_stops"}  # strong ones act, and beside one that acts no bound is given

# PALPATE_EXAMPLES=1000: so many scenes, with fresh seeds, in place of the same few.
EXAMPLES = int(os.environ.get("PALPATE_EXAMPLES", "0"))


def scenes(name: str, others: frozenset[str], seed: int, strong: bool) -> tuple[Scene, Scene]:
    """The thesis' bench with some effects, without one and with it."""
    effect = STRONG[name] if strong else type(STRONG[name])()
    without = replace(THESIS, effects={each: STRONG[each] for each in EFFECTS if each in others}, seed=seed)
    both = {**without.effects, name: effect}
    return without, replace(without, effects={each: both[each] for each in EFFECTS if each in both})


def bounded(name: str, without: Scene, with_it: Scene, question: Question) -> Bound:
    return with_it.effects[name].bound(case_of(without.design, without.model, without.effects, question))


def changed(without: Scene, with_it: Scene, question: Question) -> Bound | None:
    """What an effect really changes in force and ratio."""
    (force, ratio), (more_force, more_ratio) = (force_and_ratio(each, question) for each in (without, with_it))
    if not (force > 0 and ratio > 0):
        return None  # a coarse converter may see nothing at all
    return Bound(abs(more_force / force - 1), abs(more_ratio / ratio - 1))


@given(
    name=st.sampled_from(sorted(EFFECTS)),
    others=st.frozensets(st.sampled_from(sorted(set(EFFECTS) - LIMITS)), max_size=4),
    sample=st.sampled_from(sorted(SAMPLES)),
    load=st.floats(1.5, 4.0),
    frequency=st.sampled_from([2.0, 5.0, 10.0, 20.0]),
    seed=st.integers(0, 2**31),
    strong=st.booleans(),
)
@settings(
    max_examples=EXAMPLES or 25,
    deadline=None,
    derandomize=not EXAMPLES,
    suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow],
    phases=[Phase.explicit, Phase.reuse, Phase.generate] if EXAMPLES else list(Phase),
)
def test_the_bound_of_an_effect_holds_in_random_scenes(
    name: str, others: frozenset[str], sample: str, load: float, frequency: float, seed: int, strong: bool
) -> None:
    excluded = {*STRONG[name].excludes, name}
    beside = frozenset(other for other in others if other not in excluded and name not in STRONG[other].excludes)
    assume(not any(set(STRONG[a].excludes) & beside for a in beside))
    question = Question(sample, load, frequency, dwell=0.5)
    without, with_it = scenes(name, beside, seed, strong)
    bound = bounded(name, without, with_it, question)
    assume(min(bound.force, bound.ratio) < math.inf)
    change = changed(without, with_it, question)
    assume(change is not None)
    assert change.force <= bound.force + ROUNDING
    assert change.ratio <= bound.ratio + ROUNDING


def test_no_bound_of_a_converter_is_given_where_warming_drives_a_film_to_its_rail() -> None:
    question = Question("1", 2.0, 2.0, dwell=0.5)
    without, with_it = scenes("adc", frozenset({"pyroelectric"}), 0, strong=False)
    change = changed(without, with_it, question)
    assert change is not None and change.force > 0.4
    assert bounded("adc", without, with_it, question) == Bound(math.inf, math.inf)


def test_noise_of_a_step_makes_the_bound_of_rounding_fall_with_the_dwell_and_it_holds() -> None:
    bounds = {}
    for dwell in (0.5, 2.0):
        question = Question("2", 3.0, dwell=dwell)
        for seed in range(10):
            quiet, dithered = scenes("adc", frozenset(), seed, strong=False)
            noise: dict[str, Effect] = {"white_noise": WhiteNoise(density="14 µV/√Hz")}  # 157 µV, a step is 153
            without, with_it = (replace(each, effects={**noise, **each.effects}) for each in (quiet, dithered))
            change, bound = changed(without, with_it, question), bounded("adc", without, with_it, question)
            assert change is not None and change.ratio <= bound.ratio
        bounds[dwell] = bound.ratio, bounded("adc", quiet, dithered, question).ratio
    assert bounds[2.0][0] < 0.55 * bounds[0.5][0]
    assert bounds[2.0][0] < 0.35 * bounds[2.0][1]
    assert bounds[2.0][1] == pytest.approx(bounds[0.5][1], rel=0.05)


def test_films_of_unlike_phase_are_fitted_unlike_by_a_frequency_that_is_not_theirs() -> None:
    """Beside a voltage amplifier, over a single cycle."""
    question = Question("1", 2.0, 2.0, dwell=0.5)
    without, with_it = scenes("frequency_error", frozenset({"voltage_amplifier"}), 0, strong=True)
    change, bound = changed(without, with_it, question), bounded("frequency_error", without, with_it, question)
    assert change is not None and 0.01 < change.ratio < bound.ratio < 0.1


def test_beside_a_limit_that_acts_no_bound_is_given() -> None:
    """The load is another there than the one that was set."""
    question = Question("1", 2.0, 2.0)
    without, with_it = scenes("pink_noise", frozenset({"amplifier_clip"}), 0, strong=True)
    assert bounded("pink_noise", without, with_it, question) == Bound(math.inf, math.inf)
    change = changed(without, with_it, question)
    assert change is not None and change.force > 1e-4 and change.ratio > 1e-3
