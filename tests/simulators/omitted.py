"""The thesis' bench with some effects and one that is left out, and the bound of that."""

from __future__ import annotations

from dataclasses import replace

from palpate.simulators.bounds import bound_of
from palpate.simulators.effects import EFFECTS
from palpate.simulators.physics.effect import Bound, Effect
from palpate.simulators.planning.plan import Question, case_of
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene

THESIS = read_scene("thesis_single")


def beside(others: dict[str, Effect], name: str, effect: Effect, seed: int = 1) -> tuple[Scene, Scene]:
    without = replace(THESIS, effects={each: others[each] for each in EFFECTS if each in others}, seed=seed)
    both = {**without.effects, name: effect}
    return without, replace(without, effects={each: both[each] for each in EFFECTS if each in both})


def bounded(name: str, without: Scene, with_it: Scene, question: Question) -> Bound:
    return bound_of(case_of(without.design, without.model, without.effects, question), with_it.effects[name])
