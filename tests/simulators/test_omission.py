"""Leaving an effect out never changes a result by more than its own bound says."""

from __future__ import annotations

import math
from dataclasses import replace

from hypothesis import HealthCheck, assume, given, reject, settings
from hypothesis import strategies as st

from instrument.sample import SAMPLES
from simulators.effects import EFFECTS
from simulators.effects.effect import Bound
from simulators.plan import Question, case_of
from simulators.scene import read_scene
from tests.simulators.measured import force_and_ratio
from tests.simulators.strong import STRONG

THESIS = read_scene("thesis_single")
# Of two results that agree to this, the bound may well be 0: rounding of the fit.
ROUNDING = 1e-10


# Beside a limit that acts the load is another than the one that was set.
CLIPPED = ("mains_hum", frozenset({"amplifier_clip"}), Question("1", 2.0, 2.0), 0, False)


def change(
    name: str, others: frozenset[str], question: Question, seed: int, strong: bool
) -> tuple[Bound, float, float]:
    """The bound of an effect beside some others, and what it really changes in force and ratio."""
    effect = STRONG[name] if strong else type(STRONG[name])()
    without = replace(THESIS, effects={each: STRONG[each] for each in EFFECTS if each in others}, seed=seed)
    both = {**without.effects, name: effect}
    with_it = replace(without, effects={each: both[each] for each in EFFECTS if each in both})
    bound = effect.bound(case_of(THESIS.design, THESIS.model, without.effects, question))
    (force, ratio), (more_force, more_ratio) = (force_and_ratio(each, question) for each in (without, with_it))
    if not (force > 0 and ratio > 0):
        reject()  # a coarse converter may see nothing at all
    return bound, abs(more_force / force - 1), abs(more_ratio / ratio - 1)


@given(
    name=st.sampled_from(sorted(EFFECTS)),
    others=st.frozensets(st.sampled_from(sorted(EFFECTS)), max_size=4),
    sample=st.sampled_from(sorted(SAMPLES)),
    load=st.floats(1.5, 4.0),
    frequency=st.sampled_from([2.0, 5.0, 10.0, 20.0]),
    seed=st.integers(0, 2**31),
    strong=st.booleans(),
)
@settings(max_examples=6, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.filter_too_much])
def test_the_bound_of_an_effect_holds_in_random_scenes(
    name: str, others: frozenset[str], sample: str, load: float, frequency: float, seed: int, strong: bool
) -> None:
    excluded = {*STRONG[name].excludes, name}
    beside = frozenset(other for other in others if other not in excluded and name not in STRONG[other].excludes)
    assume(not any(set(STRONG[a].excludes) & beside for a in beside))
    question = Question(sample, load, frequency)
    bound, force, ratio = change(name, beside, question, seed, strong)
    assert force <= bound.force + ROUNDING
    assert ratio <= bound.ratio + ROUNDING


def test_beside_a_limit_that_acts_no_bound_is_given() -> None:
    bound, force, ratio = change(*CLIPPED)
    assert bound == Bound(math.inf, math.inf)
    assert force > 1e-4 and ratio > 1e-3
