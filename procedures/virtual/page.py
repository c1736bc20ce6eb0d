"""Collects how much time accuracy costs: the stored prices of models, and the rest measured now."""

from __future__ import annotations

from palpate.instrument.models.price_list import stored
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.accuracy import arithmetic
from palpate.procedures.accuracy.modulus.front import ModulusFront, PlanningCase
from palpate.procedures.accuracy.page import (
    MethodPoint,
    PagePart,
    of_arithmetic,
    of_dwells,
    of_integrators,
    of_models,
    of_modulus,
)
from palpate.procedures.console.progress import Progress
from palpate.procedures.measurements.object_modulus.procedure import LOADS
from palpate.procedures.measurements.object_modulus.prospect import Wanted
from palpate.procedures.virtual.waveforms import SAMPLES_PER_CYCLE, price
from palpate.simulators.linear import integrators
from palpate.simulators.planning.plan import Question

DESIGN, SCENE = "single", "thesis_single"
OBJECT, MODEL = "4", "auto"  # as palpate accuracy modulus has them


def collect(progress: Progress) -> list[PagePart]:
    """The parts of the page: modulus, dwell, models, time integration, arithmetic."""
    integrated = []
    for done in integrators.compare():
        step = "" if done.setting is None else f"{done.setting:.3g}"
        integrated.append(MethodPoint(done.method, step, done.error, done.seconds))
        progress(len(integrated), 0, done.method)
    progress(0, 0, "dwell")
    question = Question()
    dwells = price(SCENE, None, question, SAMPLES_PER_CYCLE * question.frequency)
    progress(0, 0, "arithmetic")
    measured = list(arithmetic.measure())
    object_ = SAMPLES[OBJECT]
    asked = RatioQuestion(DESIGN, MODEL, settings={"sensed_thickness": object_.thickness})
    setting = PlanningCase(get_design(DESIGN), asked, LOADS, Wanted(None, None, True, question.frequency, None, None))
    front = ModulusFront.of(setting, object_.modulus)
    return [
        of_modulus(front),
        of_dwells(dwells, SCENE),
        of_models(stored(), DESIGN),
        of_integrators(integrated),
        *of_arithmetic(measured),
    ]
