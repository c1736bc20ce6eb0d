"""The bench work of the measurement of one object's modulus."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeVar

from palpate.drivers.roles import SampleChanger
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.engine.plan import Step
from palpate.procedures.engine.procedure import Measurement
from palpate.procedures.lab.lab import Lab
from palpate.procedures.measurements.dynamic_load import DynamicLoadWork
from palpate.procedures.measurements.object_modulus.course import Course
from palpate.procedures.measurements.object_modulus.result import ModulusPoint
from palpate.procedures.records.columns import gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.approach import approach
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.probe import mount, other_sample, withdraw

T = TypeVar("T")


class Measuring(DynamicLoadWork):
    """The bench work: one set after the other, with the object mounted again when the course says so."""

    def __init__(self, lab: Lab, record: Recorder, course: Course, touched: Sample) -> None:
        self._spent, self._bench = 0.0, lab.bench
        self._course, self._object = course, touched
        self._points: list[ModulusPoint] = record.finished(ModulusPoint)
        self._mounting = self._points[-1].mounting if self._points else 0
        self._free, self._loaded = 0.0, False
        self._plan = self._course.prospect
        if self._plan.allocation.mountings > 1 and (changer := lab.bench.maybe(SampleChanger)):
            other_sample(changer, touched)
        set_up = super().__init__
        self._timed(lambda: set_up(lab, record, (self._plan.load,), course.wanted.frequency, (self._object.name,)))

    def arrange(self, step: Step) -> None:
        self._timed(partial(self._mount, anew=self._mounting > 0))  # after an interruption the object may have moved

    def take(self, step: Step) -> Measurement[ModulusPoint]:
        if self._loaded and self._course.remounts(self._points):
            self._timed(partial(self._mount, anew=True))
        measured = self._timed(partial(self._set, step.what))
        self._loaded = True
        point = gathered(
            ModulusPoint, measured, measured.forces(self.lab.design),
            mounting=self._mounting, load_N=self._plan.load, seconds=self._spent, free_m=self._free,
        )  # fmt: skip
        self._spent = 0.0
        self._points.append(point)
        return Measurement(point, measured.waveforms(self.lab.design))

    def _mount(self, anew: bool = False) -> None:
        withdraw(self.lab.bench)
        mount(self.lab.bench, self._object, anew)
        self._mounting += 1
        onto = f"sample {self._object.name}"
        found = approach(self.lab.bench, self.lab.calibration, self.preload, onto, known=self._free)
        self._free, self._loaded = found.free, False
        self.hold(found.force)

    def _set(self, what: str) -> FilmPoint:
        """A set by the load cell after a mounting, and by the amplitude that this gave from then on."""
        return (self.again if self._loaded else self.measured)(self._plan.load, what, self._plan.allocation.dwell)

    def _timed(self, step: Callable[[], T]) -> T:
        began = self._bench.clock.now_ns()
        try:
            return step()
        finally:
            self._spent += 1e-9 * (self._bench.clock.now_ns() - began)
