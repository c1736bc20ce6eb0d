"""The Young modulus of one object to a tolerance: planned before anything moves, and ended as soon as it is reached."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, TypeVar

from palpate.instrument.allocation.allocate import BelowFloor
from palpate.instrument.errors import RangeError, UsageError
from palpate.instrument.findings.film_forces import film_forces
from palpate.instrument.findings.object_modulus import ByReferences, answering
from palpate.instrument.models.ratio import Question
from palpate.instrument.models.response import response
from palpate.instrument.quantity import check_tolerance, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.load import Load
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.procedures.engine.plan import Plan, Predicted, Step
from palpate.procedures.engine.procedure import Measurement, Procedure, Report, RequiredLoads
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import probable_references
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.measurements.dynamic_load import DynamicLoadWork
from palpate.procedures.measurements.object_modulus.course import Course
from palpate.procedures.measurements.object_modulus.prospect import (
    Prospect,
    Wanted,
    best_of,
    costs_of,
    curve_of,
    expected,
    for_bound,
    shortest,
)
from palpate.procedures.measurements.object_modulus.refusal import below_floor, check_mountings, not_known
from palpate.procedures.measurements.object_modulus.result import ModulusPoint, ObjectModulusResult
from palpate.procedures.measurements.object_modulus.telling import planned_lines
from palpate.procedures.measurements.settings import Frequency
from palpate.procedures.measurements.softness.procedure import SLOW
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.approach import approach
from palpate.procedures.steps.checks import check_force, check_frequency, check_time
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.probe import mount, withdraw

LOADS = (2.0, 3.0, 4.0)  # N, among which the plan chooses
UNKNOWN = 50e3  # Pa, expected of an object of which nothing is known
MOST = 5, 20  # times the planned sets, and sets besides: a run that needs more ends without its tolerance
MOST_MOUNTINGS, MOST_SETS = 100, 10_000
LARGEST_SCATTER = 0.5

T = TypeVar("T")


@dataclass(frozen=True)
class ObjectModulus(Procedure[Step, ModulusPoint, ObjectModulusResult]):
    """Measure the Young modulus of one object to a tolerance, or as well as a time allows."""

    name = "measure-modulus"
    point = ModulusPoint
    resumable_on_real_bench = True
    pausable = True

    object: Annotated[Sample, Setting(help="Rubber sample.", read=get_sample)]
    tolerance: Annotated[float | None, Setting(help="Relative standard uncertainty of the modulus, such as '5 %'.")] = (
        None
    )
    time: Annotated[float | None, Setting("s", "Bench time that is not exceeded, the person's part included.")] = None
    relative_to_model: Annotated[
        bool, Setting(help="Leave the model's validation error out of the tolerance: on the model's scale.")
    ] = False
    model: Annotated[str, Setting(help="Sensor model that turns the force ratio into the modulus.")] = "auto"
    load: Annotated[float | None, Setting("N", "Load, peak to peak; chosen by the plan if it is not given.")] = None
    frequency: Frequency = 10.0
    mountings: Annotated[
        int | None, Setting(help="Number of times that the object is mounted; chosen by the plan if not given.")
    ] = None
    mounting_scatter: Annotated[
        float | None,
        Setting(help="Relative standard deviation of the ratio from mounting to mounting, by earlier measurements."),
    ] = None

    def check(self, target: Target) -> None:
        """Check the settings, and plan, before anything is sent to a device.

        Raises:
            UsageError: neither tolerance nor time is given, or the tolerance needs a scatter of mountings that was
                never measured.
            RangeError: a setting is outside its limits, not one set fits into the time, or no time on the bench reaches
                the tolerance; the message names the line that binds, and other ways.
            UnknownName: there is no such model.
        """
        if self.tolerance is None and self.time is None:
            raise UsageError("--tolerance or --time is missing: say how well, or how long, or both")
        if self.tolerance is not None:
            check_tolerance(self.tolerance, f"--tolerance {self.tolerance:g}")
        if self.time is not None and not 0 < self.time < math.inf:
            raise RangeError(f"--time {self.time:g} s is not above 0 and finite; give a time such as '2 min'")
        if self.mountings is not None and not 1 <= self.mountings <= MOST_MOUNTINGS:
            raise RangeError(f"--mountings {self.mountings} is outside 1 to {MOST_MOUNTINGS}; give a number inside")
        if self.mounting_scatter is not None and not 0 <= self.mounting_scatter <= LARGEST_SCATTER:
            raise RangeError(
                f"--mounting-scatter {self.mounting_scatter:g} is outside 0 to {LARGEST_SCATTER:g}; give a share such"
                " as '1 %'"
            )
        check_nodes(target.design, target.nodes, target.channels)
        check_force(self.loads_on(target), target.force_limit)
        check_frequency(self.frequency, target)
        check_time(shortest(self.frequency), self.frequency)
        if target.model is not None and target.model not in SLOW:
            response(target.design, Load(1.0, self.object), target.model)
        self.prospect(target)

    def required_loads(self) -> RequiredLoads | None:
        return None if self.load is None else RequiredLoads((self.load,))

    @property
    def wanted(self) -> Wanted:
        """What is asked for."""
        return Wanted(
            self.tolerance, self.time, self.relative_to_model, self.frequency, self.mountings, self.mounting_scatter
        )

    def prospect(self, target: Target) -> Prospect:
        """What is planned, and what it is expected to give. Raises as `check`."""
        return _prospect(self, target.design, self.loads_on(target), self.references_on(target))

    def references_on(self, target: Target) -> ByReferences | None:
        """The model's calibration by references; before the bench is open, the one that it probably has."""
        if target.calibrated is not None:
            return target.references
        return probable_references(self.model_question(target.design), target.model is not None)

    def loads_on(self, target: Target) -> tuple[float, ...]:
        """The loads among which the plan chooses: the given one, or all that the load cell is calibrated for."""
        if self.load is not None:
            return (self.load,)
        low, high = target.calibrated or (0.0, math.inf)
        return tuple(load for load in LOADS if low <= load <= high) or (low,)

    def model_question(self, design: Design) -> Question:
        """The question for the model that turns the ratio into the modulus; "auto" is the model that it chooses."""
        return _question(design.name, self.model, self.object.thickness)

    def course(self, lab: Lab) -> Course:
        """The course of the measurement on an open bench."""
        return _course(self, lab.design, self.loads_on(lab.target), self.references_on(lab.target))

    def plan(self, target: Target) -> Plan[Step]:
        """The most load sets that there can be, and what is predicted."""
        prospect = self.prospect(target)
        plan, costs = prospect.allocation, costs_of(prospect.load, self.frequency)
        most = (MOST[0] if self.tolerance is not None else 1) * plan.sets + MOST[1]
        group = f"mount {self.object.name}"
        each = costs.set + plan.dwell
        steps = [
            Step(
                plan.dwell,
                each + (costs.start + costs.mounting if number == 1 else 0.0),
                target.design.ratio_scatter,
                what=f"{self.object.name}, {show(prospect.load, 'N')}, set {number}",
                group=group,
            )
            for number in range(1, min(most, MOST_SETS) + 1)
        ]
        u = prospect.scale_u if self.relative_to_model else prospect.absolute_u
        told = {"planned": prospect.summary()}
        return Plan(self.name, steps, Predicted(plan.seconds, u, told, planned_lines(self.wanted, prospect)))

    def begin(self, lab: Lab, record: Recorder) -> Measuring:
        return Measuring(lab, record, self)

    def enough(self, points: Sequence[ModulusPoint], lab: Lab) -> str:
        """Why the sets so far are enough."""
        return self.course(lab).verdict(points).why if points else ""

    def evaluate(self, points: Sequence[ModulusPoint], lab: Lab) -> ObjectModulusResult:
        course = self.course(lab)
        stopped = (
            course.verdict(points).why or "the most sets that were planned are taken; the tolerance is not reached"
        )
        return ObjectModulusResult(
            list(points), self.wanted, course.prospect, course.answer(points), stopped, course.notes(points)
        )

    def report(self, result: ObjectModulusResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.object_modulus.report import plot_modulus, print_modulus

        return Report(partial(print_modulus, result), partial(plot_modulus, result, lab.bench.simulated))


@functools.lru_cache(maxsize=16)
def _question(design: str, model: str, thickness: float) -> Question:
    """The question for a model by its own name: "auto" answers only for moduli for which its error is known."""
    asked = Question(design, model, settings={"sensed_thickness": thickness})
    return replace(asked, model=answering(asked))


@functools.lru_cache(maxsize=16)
def _prospect(
    procedure: ObjectModulus, design: Design, loads: tuple[float, ...], references: ByReferences | None
) -> Prospect:
    """The plan of a procedure for one of some loads [N]; the same question comes with every set."""
    question, wanted = procedure.model_question(design), procedure.wanted
    found, tolerance = expected(question, procedure.object.modulus, references), wanted.tolerance
    if found.sensitivity is None:
        return for_bound(found, wanted, loads[0])
    if tolerance is not None and found.validation.u is None and not wanted.relative:
        raise not_known(wanted, found, design)
    try:
        prospect = best_of(design, found, wanted, loads)
    except BelowFloor as error:
        raise below_floor(wanted, question, found, design, error) from None
    if tolerance is not None:
        check_mountings(wanted, found, tolerance)
    if (sets := prospect.allocation.sets) > MOST_SETS:
        raise RangeError(
            f"the plan has {sets} sets, above {MOST_SETS}; ask for a greater --tolerance, or give less --time"
        )
    return prospect


@functools.lru_cache(maxsize=16)
def _course(
    procedure: ObjectModulus, design: Design, loads: tuple[float, ...], references: ByReferences | None
) -> Course:
    question = procedure.model_question(design)
    prospect = _prospect(procedure, design, loads, references)
    return Course(design, question, curve_of(question, references), procedure.wanted, prospect)


class Measuring(DynamicLoadWork):
    """The bench work: one set after the other, with the object mounted again when the course says so."""

    def __init__(self, lab: Lab, record: Recorder, asked: ObjectModulus) -> None:
        self._spent, self._bench = 0.0, lab.bench
        self._course, self._object = asked.course(lab), asked.object
        self._points: list[ModulusPoint] = record.finished(ModulusPoint)
        self._mounting = self._points[-1].mounting if self._points else 1
        self._free, self._loaded = 0.0, False
        self._plan = self._course.prospect
        set_up = super().__init__
        self._timed(lambda: set_up(lab, record, (self._plan.load,), asked.frequency, (self._object.name,)))

    def arrange(self, step: Step) -> None:
        self._timed(self._mount)

    def take(self, step: Step) -> Measurement[ModulusPoint]:
        if self._loaded and self._course.remounts(self._points):
            self._mounting += 1
            self._timed(self._mount)
        measured = self._timed(partial(self._set, step.what))
        self._loaded = True
        point = self._point(measured)
        self._spent = 0.0
        self._points.append(point)
        return Measurement(point, measured.waveforms(self.lab.design))

    def _mount(self) -> None:
        withdraw(self.lab.bench)
        mount(self.lab.bench, self._object)
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

    def _point(self, measured: FilmPoint) -> ModulusPoint:
        forces = film_forces(self.lab.design, measured.fit)
        return ModulusPoint(
            mounting=self._mounting,
            load_N=self._plan.load,
            load_measured_N=measured.load_N,
            load_measured_u=measured.load_u,
            force_ratio=forces.force_ratio,
            force_ratio_u=forces.force_ratio_u,
            noise_u=forces.noise_u,
            calibration_u=forces.calibration_u,
            pickup_u=forces.pickup_u,
            degrees_of_freedom=forces.degrees_of_freedom,
            dwell_s=measured.dwell,
            seconds=self._spent,
            valid=measured.valid,
            flags=measured.flags,
            attempts=measured.attempts,
            incidents=measured.incidents,
            free_m=self._free,
        )
