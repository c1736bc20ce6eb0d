"""Collects how much time accuracy costs: the stored prices of models, and the rest measured now."""

from __future__ import annotations

from palpate.instrument.models.prices.price_list import stored
from palpate.procedures.accuracy import arithmetic
from palpate.procedures.accuracy.page import Part, Way, of_arithmetic, of_dwells, of_integrators, of_models
from palpate.procedures.console.progress import Progress
from palpate.procedures.virtual.dwell import SAMPLES_PER_CYCLE, price
from palpate.simulators.linear import integrators
from palpate.simulators.planning.plan import Question

DESIGN, SCENE = "single", "thesis_single"


def collect(progress: Progress) -> list[Part]:
    """The parts of the page: models, time integration, dwell, arithmetic."""
    integrated = []
    for done in integrators.compare():
        setting = "" if done.setting is None else f"{done.setting:.3g}"
        integrated.append(Way(done.method, setting, done.error, done.seconds))
        progress(len(integrated), 0, done.method)
    progress(0, 0, "dwell")
    question = Question()
    dwells = price(SCENE, None, question, SAMPLES_PER_CYCLE * question.frequency)
    progress(0, 0, "arithmetic")
    measured = list(arithmetic.measure())
    return [of_models(stored(), DESIGN), of_integrators(integrated), of_dwells(dwells, SCENE), *of_arithmetic(measured)]
