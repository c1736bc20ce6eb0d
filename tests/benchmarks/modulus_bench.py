"""The bench of a run of `measure modulus`: on the wire, or one that draws ratios as the simulated bench does.

The second is fast: it draws gains, mountings and the distance of each object from the curve by the scene's own effects,
at clock times of its own. Its noise is that of a least-squares sine in white noise. Plan, course and answer are the
procedure's own.
"""

from __future__ import annotations

import functools
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from palpate.drivers.bench import Bench
from palpate.instrument.allocation.stopping import first_sets
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.findings.object_modulus import ByReferences
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.lab import Lab, Target, with_kinds
from palpate.procedures.measurements.object_modulus.planning import END, costs_of, most_sets
from palpate.procedures.measurements.object_modulus.procedure import ObjectModulus, mounts_again
from palpate.procedures.measurements.object_modulus.report import ModulusPoint, ObjectModulusAnswer
from palpate.procedures.measurements.softness import unknown_object
from palpate.procedures.records.record import Recorder
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.effects import effect_class, in_order
from palpate.simulators.physics.effect import Effect, Effects
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.randomness import Stream
from palpate.simulators.scenes.scene import Scene
from palpate.testing import steps

MODEL = "surface"
SCENE = "poor_seating"  # whose chain and model are taken; effects that draw are those of the truth
DRAWING = ("curve_error", "mounting_scatter", "gain_scatter", "triboelectric")
DENSITY = 2e-6  # V/√Hz, white noise of that scene


@dataclass(frozen=True)
class Truth:
    """A bench with an object of known modulus [Pa] and effects that draw, by name with their parameters.

    `phased`: the pick-up of each film's cable has a phase of its own, which no effect of a scene has.
    """

    modulus: float
    effects: dict[str, dict[str, Any]] = field(default_factory=dict)
    seed: int = 1
    references: ByReferences | None = None
    phased: bool = False

    @cached_property
    def scene(self) -> Scene:
        plain = _plain()
        own: dict[str, Effect] = {name: effect_class(name).model_validate(of) for name, of in self.effects.items()}
        others = {name: effect for name, effect in plain.effects.items() if name not in DRAWING}
        effects = in_order({**others, **own})
        return replace(plain, effects=effects, called=dict.fromkeys(effects, "called for"), seed=self.seed)

    @cached_property
    def object(self) -> Sample:
        return unknown_object(self.scene.design, modulus=self.modulus)

    @property
    def design(self) -> Design:
        """As the bench file states it, with the pick-up of its cables."""
        return self.scene.design.with_pickup(self.scene.pickup)

    @property
    def target(self) -> Target:
        force_limit = BenchDescription.model_fields["force_limit"].default
        calibrated = (THESIS_LOAD_CELL.least_N, THESIS_LOAD_CELL.greatest_N)
        target = Target(self.design, force_limit, self.scene.nodes, calibrated=calibrated, references=self.references)
        return with_kinds(target, self.scene.kind_in)


@functools.cache
def _plain() -> Scene:
    return read_scene(SCENE)


@functools.cache
def _on_the_curve(modulus: float) -> float:
    """Force ratio of an object by the scene's model."""
    return _plain().answer(Truth(modulus).object).force_ratio


class Draws:
    """Force ratios of one truth, as the rig would have them."""

    def __init__(self, truth: Truth) -> None:
        self._truth, self._effects = truth, Effects(truth.scene.effects)
        self._plain = _on_the_curve(truth.modulus)
        drawing = (*self._effects.share, *self._effects.films)
        phases = np.random.default_rng([7, truth.seed]).uniform(0, 2 * math.pi, 2) if truth.phased else np.zeros(2)
        self._pickup = truth.scene.pickup * np.cos(phases)
        self._streams = {effect.name: Stream(truth.seed, effect.name) for effect in drawing}

    def ratio(self, set_at_ns: int, mounted_at_ns: int) -> float:
        """The ratio of a set without noise."""
        design, films = self._truth.scene.design, self._effects.films
        changes = [
            effect.ln_change(self._truth.object, self._streams[effect.name], mounted_at_ns)
            for effect in self._effects.share
        ]
        forces = np.array([self._plain * math.exp(math.fsum(changes)), 1.0])
        for effect in films:
            drawn_at_ns = mounted_at_ns if effect.by_mounting else set_at_ns
            forces = effect.matrix(design, self._streams[effect.name], drawn_at_ns) @ forces
        rigid, total = forces + self._pickup
        return float(rigid / total)

    def noise(self, load: float, dwell: float, ratio: float) -> float:
        """Relative standard deviation of a set's ratio by white noise, under a load [N, peak to peak]."""
        rigid, total = (film.sensitivity * load / 2 for film in self._truth.scene.design.films)
        return DENSITY / math.sqrt(dwell) * math.hypot(1 / (rigid * ratio), 1 / total)


@dataclass(frozen=True, slots=True)
class Done:
    """A run: its points and answer, bench time [s], for each set when it began and when its object was mounted [ns]."""

    points: list[ModulusPoint]
    answer: ObjectModulusAnswer | None
    seconds: float
    began: list[tuple[int, int]]


def fast(asked: ObjectModulus, truth: Truth, steps: int | None = None, *, every: bool = False) -> Done:
    """A run by the procedure's own plan, course and answer, on drawn ratios; at most so many sets.

    The course is asked after every set, as a procedure asks it, only with `every`. Else it is asked again after half of
    the sets that it still wants in a mounting: what it wants moves by less than that. Part of the last of several
    mountings may be enough: there it is asked after every set, too.
    """
    course, draws = asked.course_on(truth.target), Draws(truth)
    load, plan = course.prospect.allocation.load, course.prospect.allocation
    costs = costs_of(load, asked.frequency)
    rng = np.random.default_rng(truth.seed)
    points: list[ModulusPoint] = []
    began: list[tuple[int, int]] = []
    taken, spent, mounting, mounted = costs.start - END, costs.start - END, 0, 0
    following = 1 if every else first_sets(plan)  # before the first sets are complete, a tolerance alone goes on
    for number in range(most_sets(course.prospect, course.wanted) if steps is None else steps):
        verdict = course.verdict(points) if number >= following else None
        if verdict and verdict.why:
            break
        if not points or (verdict and mounts_again(points, verdict)):
            mounting += 1
            mounted = round(1e9 * taken)
            spent += costs.mounting
            taken += costs.mounting
        if verdict:
            more = verdict.sets // verdict.mountings - sum(point.mounting == mounting for point in points)
            left = int((course.prospect.times.longest - taken - END) / (costs.set + plan.dwell))  # until the bound
            following = number + (1 if every or mounting > 1 else max(1, min(more, left) // 2))
        began.append((round(1e9 * taken), mounted))
        ratio = draws.ratio(*began[-1])
        noise = draws.noise(load, plan.dwell, ratio)
        ratio *= 1 + noise * float(rng.standard_normal())
        spent, taken = spent + costs.set + plan.dwell, taken + costs.set + plan.dwell
        points.append(_point(mounting, load, ratio, ratio * noise, plan.dwell, spent))
        spent = 0.0
    return Done(points, course.answer(points), taken + END, began)


def _point(mounting: int, load: float, ratio: float, noise: float, dwell: float, seconds: float) -> ModulusPoint:
    return ModulusPoint(
        mounting=mounting,
        load_N=load,
        load_measured_N=load,
        load_measured_u=0.0,
        force_ratio=ratio,
        force_ratio_u=noise,
        noise_u=noise,
        calibration_u=0.0,
        pickup_u=0.0,
        degrees_of_freedom=math.inf,
        dwell_s=dwell,
        seconds=seconds,
        valid=True,
        flags=(),
        attempts=1,
        incidents=0,
        free_m=0.0,
    )


def on_the_wire(asked: ObjectModulus, truth: Truth) -> Done:
    """The same run on the simulated bench, by its devices and buses."""
    header = {"procedure": asked.name, "simulated": True, "started": "2000-01-01T00:00:00+00:00"}
    began: list[tuple[int, int]] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        SimulatedBench(truth.scene) as simulated,
        Bench(simulated.description, simulated.clock, simulated.operator) as bench,
    ):

        def seen(done: int, _total: int, _what: str) -> None:
            if done > len(began):
                began.append((simulated.rig.set_at_ns, simulated.rig.mounted_at_ns))

        with Recorder.create(Path(folder), header, steps(seen)) as record:
            result = conduct(asked, Lab(bench, truth.design, THESIS_LOAD_CELL), record)
            record.finish("complete", {})
        return Done(result.points, result.answer, 1e-9 * simulated.clock.now_ns(), began)


def differences(done: Done, truth: Truth) -> Iterator[float]:
    """Ratios of a run on the wire less those that are drawn for its own times, in standard deviations of noise."""
    draws = Draws(truth)
    for point, times in zip(done.points, done.began, strict=True):
        yield (point.force_ratio - draws.ratio(*times)) / point.noise_u
