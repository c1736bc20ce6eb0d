"""Collects the methods of `palpate accuracy numerics`: the models' stored prices, and the rest measured now."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from palpate.instrument.models.price_list import stored
from palpate.procedures.accuracy.numerics import Task, Way, arithmetic_tasks, of_estimators, of_models
from palpate.procedures.console.terminal import Progress
from palpate.simulators.linear import bouc_wen, integrators
from palpate.simulators.linear.integrators import IntegratorError
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.waveforms import long_record

SECONDS = 15.0  # s of processor time that all takes [M]
SCENE = "thesis_single"
RECORD = 400.0  # s
SAMPLES_PER_CYCLE = 25
ROUNDED = 1.1e-16  # of the chain's reference, in 60 digits, a double keeps these


def collect(design: str, progress: Progress) -> list[Task]:
    """Every task: models of a design, estimators, integrators, and arithmetic."""

    def integrated(name: str, found: Iterable[IntegratorError], method: str, order: float, reference: float) -> Task:
        ways = []
        for done in found:
            setting = "" if done.setting is None else f"{done.setting:.3g}"
            ways.append(Way(done.method, setting, done.error, done.seconds, done.failure))
            progress(len(ways), 0, done.method)
        return Task(name, "processor", tuple(ways), reference=reference, slopes={method: order})

    chain = f"output of a chain of {integrators.STATES} states, stiffness {integrators.STIFFNESS:.0e}"
    tasks = [
        of_models(stored(), design),
        integrated(chain, integrators.compare(), "trapezoid", 2.0, ROUNDED),
        integrated("force with hysteresis, Bouc and Wen", bouc_wen.compare(), "Bouc-Wen, explicit Euler", 1.0, 0.0),
    ]
    progress(0, 0, "estimators")
    question = Question()
    record = long_record(read_scene(SCENE), replace(question, dwell=RECORD), SAMPLES_PER_CYCLE * question.frequency)
    where = f"scene {SCENE}, one load set"
    tasks.insert(1, of_estimators(record.time, record.voltage, record.ratio, question.frequency, where))
    progress(0, 0, "arithmetic")
    return [*tasks, *arithmetic_tasks()]
