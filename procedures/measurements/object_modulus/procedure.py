"""The Young modulus of one object to a tolerance: planned before anything moves, and ended as soon as it is reached."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from typing import Annotated, TypeVar

from palpate.drivers.roles import SampleChanger, SensorNode
from palpate.instrument.allocation.lines import MOST_FREEDOM, BudgetLine, Costs, RepeatUnit
from palpate.instrument.allocation.stopping import Ratios, StoppingVerdict, answer, enough, first_sets, pooled
from palpate.instrument.allocation.table import FIRST, OutOfReach
from palpate.instrument.calibration.calibration import ANY, CalibrationOwner
from palpate.instrument.calibration.films import MountingScatterCalibration
from palpate.instrument.errors import RangeError, UsageError
from palpate.instrument.findings.film_forces import PRIOR_FREEDOM
from palpate.instrument.findings.object_modulus import answering
from palpate.instrument.models.curve import RatioCurve
from palpate.instrument.models.response import FIXED, RatioQuestion
from palpate.instrument.quantity import check_tolerance, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import SAMPLES, Sample, get_sample
from palpate.procedures.engine.plan import Plan, Step, expected_noise, noise_of
from palpate.procedures.engine.procedure import (
    Expected,
    Finished,
    Measurement,
    Procedure,
    Report,
    RequiredLoads,
    foreseen,
)
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import check_store, keep, mountings_of, references_on, with_films
from palpate.procedures.lab.lab import Dwells, Lab, Target
from palpate.procedures.lab.session import CalibrationKeys
from palpate.procedures.measurements.object_modulus.planning import (
    BOUND_SETS,
    CURVE,
    MOUNTED,
    NEVER_MEASURED,
    ModulusPlans,
    Prospect,
    Wanted,
    cost_of_trend,
    costs_of,
    curve_of,
    end_seconds,
    expected,
    lines_of,
    missed_by,
    most_sets,
    planned_lines,
    scatter_told,
    sensitivity_at,
    shortest,
    worth_lines,
)
from palpate.procedures.measurements.object_modulus.report import (
    ModulusPoint,
    ObjectModulusAnswer,
    ObjectModulusResult,
    answered,
    mounting_scatter,
    ratios_of,
)
from palpate.procedures.measurements.settings import Frequency, bench_time, model_name, tolerance_setting
from palpate.procedures.measurements.softness import check_simulated
from palpate.procedures.measurements.work import DynamicLoadWork
from palpate.procedures.records.columns import gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import check_bench_time, check_force, check_frequency, check_time
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.probe import approach, mount, other_sample, withdraw

# --- The course of a measurement: whether the sets so far are enough, and when the object is mounted again

RESERVE = 1.0  # s, for what takes longer than usual
NOISY, MATTERS = 1.5, 0.3  # times the planned noise that is told, and the share of the scatter from which on
IN_A_ROW = 5  # sets that are not valid, after which the measurement ends
TOO_ALIKE = 0.001  # probability that sets repeat so well by chance, if their gains scatter as the design's do


@dataclass(frozen=True, slots=True)
class Course:
    """The course of a measurement by its plan.

    Attributes:
        design: the sensor.
        question: the model that turns a ratio into a modulus, and the thickness of the object.
        curve: the curve of that model, corrected by references.
        wanted: what is asked for.
        prospect: the plan.
    """

    design: Design
    question: RatioQuestion
    curve: RatioCurve
    wanted: Wanted
    prospect: Prospect

    @property
    def costs(self) -> Costs:
        """Bench times, by which further mountings and sets are chosen."""
        return costs_of(self.prospect.allocation.load, self.wanted.frequency, self.wanted.mounts)

    def verdict(self, points: Sequence[ModulusPoint]) -> StoppingVerdict:
        """Whether the points are enough, and how many mountings and sets there will be in all."""
        found = self._whatever_it_takes(points)
        return found if found.why or not points else self._within_time(points, found)

    def _whatever_it_takes(self, points: Sequence[ModulusPoint]) -> StoppingVerdict:
        """The verdict if time were no matter."""
        plan, ratios = self.prospect.allocation, ratios_of(points)
        found = StoppingVerdict(plan.mountings, plan.sets, _unusable(points))
        if found.why or not ratios:
            return found
        slope = self._sensitivity(ratios)
        if slope is None:
            why = "the ratio is only good for a bound, however many sets there are"
            return replace(found, why=why) if sum(map(len, ratios)) >= BOUND_SETS else found
        if self.wanted.tolerance is None:
            return found
        return self._for_tolerance(self.wanted.tolerance, slope, ratios)

    def _for_tolerance(self, tolerance: float, slope: float, ratios: Ratios) -> StoppingVerdict:
        plan = self.prospect.allocation
        lines = self._lines(ratios, slope, absolute=not self.wanted.relative)
        try:
            found = enough(lines, self.costs, tolerance, plan, slope, ratios)
        except OutOfReach as error:
            return StoppingVerdict(plan.mountings, plan.sets, f"by the scatter that was found {error.why}")
        asked, each = plan.mountings, plan.sets // plan.mountings
        missing = asked - sum(len(sets) >= each for sets in ratios)  # one that was interrupted does not count
        if self.wanted.mountings is None or missing <= 0:
            return found
        asked = len(ratios) + missing - (len(ratios[-1]) < each)
        if not found.why and found.mountings >= asked:
            return found
        each = each if found.why else max(each, math.ceil(found.sets / asked))
        return StoppingVerdict(asked, asked * each, "")

    def _within_time(self, points: Sequence[ModulusPoint], found: StoppingVerdict) -> StoppingVerdict:
        """The verdict; a set that would not fit into the time ends the measurement before it.

        That time is the given one, or else the printed bound, which leaves the first sets of each mounting alone.
        """
        bound = self.prospect.times.longest
        limit = bound if self.wanted.time is None else self.wanted.time
        if self._seconds_after(points, found) <= limit:
            return found
        if self.wanted.time is not None:
            return replace(found, why=f"another set would not end within {limit:g} s")
        if self._first_are_due(ratios_of(points)):
            return found
        needed = self.costs.seconds(found.mountings, found.sets, self.prospect.allocation.dwell)
        why = f"the bound of {limit:.0f} s is spent; as the first sets scatter it takes {needed:.0f} s (--time)"
        return replace(found, why=why)

    def _first_are_due(self, ratios: Ratios) -> bool:
        """Whether planned mountings lack sets of those that decide how many there are in all."""
        plan = self.prospect.allocation
        first = first_sets(plan)
        return sum(min(len(sets), first) for sets in ratios) < first * (self.wanted.mountings or 1)

    def _seconds_after(self, points: Sequence[ModulusPoint], found: StoppingVerdict) -> float:
        """Bench time at the end of a measurement that takes another set [s]."""
        costs, taken = self.costs, math.fsum(point.seconds for point in points)
        following = costs.set + self.prospect.allocation.dwell
        following += costs.mounting if mounts_again(points, found) else 0.0
        return taken + following + end_seconds(self.prospect.allocation.load) + RESERVE

    def remounts(self, points: Sequence[ModulusPoint]) -> bool:
        """Whether the object is mounted again before the next set."""
        return mounts_again(points, self.verdict(points))

    def answer(self, points: Sequence[ModulusPoint]) -> ObjectModulusAnswer | None:
        """The modulus by the valid points; None: there is none. Raises EstimateError."""
        ratios = ratios_of(points)
        if not ratios:
            return None
        lines = [line for line in self._lines(ratios, 1.0, absolute=False) if line.name != CURVE]
        found = answer(lines, self.prospect.allocation, 1.0, ratios, by_time=self.wanted.tolerance is None)
        return answered(found.ratio, found.budget, self.question, self.prospect.found)

    def notes(self, points: Sequence[ModulusPoint]) -> tuple[str, ...]:
        """What else to know of the answer, for people."""
        ratios, found = ratios_of(points), []
        slope = self._sensitivity(ratios) if ratios else None
        if ratios and slope is None:
            low, high = (show(end, "Pa", 2) for end in self.curve.moduli)
            found.append(
                f"the ratio is at an end of what model {self.prospect.found.model!r} tells ({low} to {high}): a sensor "
                "with a ring more like the object, or palpate test modulus, would do better"
            )
        if ratios and (late := self._late(points, ratios)):
            found.append(late)
        if ratios and (noisy := self._noisy(points)):
            found.append(noisy)
        if ratios and self.too_alike(ratios):
            found.append(
                "the sets repeat far better than gains are known to scatter from set to set, so that this scatter "
                "counts for mountings"
            )
        return tuple(found)

    def _late(self, points: Sequence[ModulusPoint], ratios: Ratios) -> str:
        """Why the measurement needed more than the bound, which is enough for most runs; empty: it did not."""
        bound, plan = self.prospect.times.longest, self.prospect.allocation
        found, taken = self._whatever_it_takes(points), math.fsum(point.seconds for point in points)
        within = taken + end_seconds(self.prospect.allocation.load) if found.why else self._seconds_after(points, found)
        if self.wanted.tolerance is None or within <= bound:
            return ""
        expected = math.hypot(self.design.ratio_scatter, self._set_noise)
        text = f"the {bound:.0f} s that are enough for 95 % of runs were not: sets"
        if any(len(sets) > 1 for sets in ratios):
            text += f" scatter by {100 * pooled(0.0, 0.0, *ratios).u:.2g} %, and"
        text += f" were expected to by {100 * expected:.2g} %"
        if len(ratios) > plan.mountings:
            text += f"; {len(ratios)} mountings were made, not {plan.mountings}"
        return text

    @property
    def _cycles(self) -> int:
        return round(self.prospect.allocation.dwell * self.wanted.frequency)

    @property
    def _set_noise(self) -> float:
        """Relative standard deviation of the ratio of a set by noise that is expected."""
        noise = expected_noise(self.design, self.prospect.allocation.load, self.prospect.found.ratio)
        return noise * cost_of_trend(self._cycles) / math.sqrt(self.prospect.allocation.dwell)

    def noise_density(self, points: Sequence[ModulusPoint]) -> float | None:
        """Amplitude density of the films' noise by the points [V/√Hz]; None: no point is valid."""
        parts = [point.noise_u / point.force_ratio for point in points if point.valid and point.force_ratio > 0]
        if not parts:
            return None
        measured = math.hypot(*parts) / math.sqrt(len(parts))
        return noise_of(self.design) * measured / self._set_noise

    def _noisy(self, points: Sequence[ModulusPoint]) -> str:
        """That films were noisier than the plan says, where it matters; empty: they were not."""
        density, planned = self.noise_density(points), noise_of(self.design)
        if density is None or density < NOISY * planned:
            return ""
        if self._set_noise * density / planned < MATTERS * self.design.ratio_scatter:
            return ""
        noise = show(density, "V/√Hz", 2)
        return (
            f"noise of the films was {noise}, not {show(planned, 'V/√Hz', 2)}: with noise = {noise!r} in the bench file"
            " the next plan has longer dwells"
        )

    def too_alike(self, ratios: Ratios) -> bool:
        """Whether the sets repeat far better than gains are known to scatter from set to set.

        Then that scatter may come with the mounting instead, and sets do not lower it. What is known of the scatter is
        an estimate, too: many sets that scatter by half as much are still no sign of that.
        """
        freedom = sum(len(each) - 1 for each in ratios)
        if freedom < FIRST - 1:
            return False
        from scipy.special import fdtr

        share = (pooled(0.0, 0.0, *ratios).u / self.design.ratio_scatter) ** 2
        return float(fdtr(freedom, min(PRIOR_FREEDOM, MOST_FREEDOM), share)) < TOO_ALIKE

    def _sensitivity(self, ratios: Ratios) -> float | None:
        return sensitivity_at(self.curve, _mean(ratios))

    def _lines(self, ratios: Ratios, slope: float, *, absolute: bool) -> list[BudgetLine]:
        """The lines of the plan at the measured ratio; a scatter that sets do not show counts for mountings."""
        found = replace(self.prospect.found, ratio=_mean(ratios), sensitivity=slope)
        lines = lines_of(self.design, found, self.prospect.allocation.load, self.wanted, absolute, self._cycles)
        if self.too_alike(ratios):
            scatter = math.hypot(self.design.ratio_scatter, self.wanted.mounted)
            mounted = BudgetLine(MOUNTED, slope * scatter, RepeatUnit.MOUNTING, PRIOR_FREEDOM)
            return [*(line for line in lines if line.name != MOUNTED), mounted]
        return list(lines)


def mounts_again(points: Sequence[ModulusPoint], verdict: StoppingVerdict) -> bool:
    ratios = ratios_of(points)
    each = max(1, verdict.sets // verdict.mountings)
    return bool(ratios) and len(ratios) < verdict.mountings and len(ratios[-1]) >= each


def _mean(ratios: Ratios) -> float:
    """Geometric mean of the geometric means of the mountings."""
    means = [math.fsum(map(math.log, each)) / len(each) for each in ratios]
    return math.exp(math.fsum(means) / len(means))


def _unusable(points: Sequence[ModulusPoint]) -> str:
    last = points[-IN_A_ROW:]
    if len(last) == IN_A_ROW and not any(point.valid for point in last):
        return f"the last {IN_A_ROW} sets are not valid: {', '.join(last[-1].flags)}"
    return ""


# --- The bench work of the measurement of one object's modulus -----------------------------------------

T = TypeVar("T")


class Measuring(DynamicLoadWork):
    """The bench work: one set after the other, with the object mounted again when the course says so."""

    def __init__(self, lab: Lab, record: Recorder, course: Course, touched: Sample) -> None:
        self._spent, self._bench = 0.0, lab.bench
        self._course, self._object = course, touched
        self._points: list[ModulusPoint] = record.finished(ModulusPoint)
        self._mounting = self._points[-1].mounting if self._points else 0
        self._free, self._loaded = 0.0, False
        self._plan = course.prospect.allocation
        if self._plan.mountings > 1 and (changer := lab.bench.maybe(SampleChanger)):
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
        return self.measurement(point, measured)

    def _mount(self, anew: bool = False) -> None:
        withdraw(self.lab.bench)
        mount(self.lab.bench, self._object, anew)
        self._mounting += 1
        onto = f"sample {self._object.name}"
        found = approach(self.lab.bench, self.lab.calibration, self.preload, onto, free_until=self._free)
        self._free, self._loaded = found.free, False
        self.hold(found.force)

    def _set(self, what: str) -> FilmPoint:
        """A set by the load cell after a mounting, and by the amplitude that this gave from then on."""
        return (self.again if self._loaded else self.measured)(self._plan.load, what, self._plan.dwell)

    def _timed(self, step: Callable[[], T]) -> T:
        began = self._bench.clock.now_ns()
        try:
            return step()
        finally:
            self._spent += 1e-9 * (self._bench.clock.now_ns() - began)


# --- the procedure -------------------------------------------------------------------------------------

LOADS = (2.0, 3.0, 4.0)  # N, among which the plan chooses
THICKNESS = "sensed_thickness"  # setting of a model
UNKNOWN = 50e3  # Pa, expected of an object of which nothing is known
MOST_MOUNTINGS = 100
LARGEST_SCATTER = 0.5
# Relative scatter of the ratio from mounting to mounting where it was never measured, and its degrees of freedom [A]:
# six samples of the thesis on two sensors scatter by 1.05 % beyond their sets (median), and below 3.7 % (95 %).
UNMEASURED = 0.01, 2.0
VALID_DAYS = 365  # of a scatter of mountings


@dataclass(frozen=True)
class ObjectModulus(Procedure[Step, ModulusPoint, ObjectModulusResult, Course]):
    """Measure the Young modulus of one object to a tolerance, or as well as a time allows."""

    name = "measure-modulus"
    point = ModulusPoint
    resumable_on_real_bench = True
    pausable = True

    object: Annotated[Sample, Setting(help="Rubber sample.", read=get_sample, option="--sample")]
    tolerance: Annotated[float | None, tolerance_setting("of the modulus, absolute.")] = None
    time: Annotated[float | None, bench_time("Bench time that is not exceeded, mountings included.")] = None
    relative_to_model: Annotated[bool, Setting(help="The tolerance is about the model's scale, not absolute.")] = False
    model: Annotated[str, model_name("Sensor model that turns the ratio into the modulus.")] = "auto"
    load: Annotated[float | None, Setting("N", "Load, peak to peak (default: the plan chooses it).")] = None
    frequency: Frequency = 10.0
    mountings: Annotated[
        int | None, Setting(help="How often the object is mounted (default: the plan chooses it).")
    ] = None
    mounting_scatter: Annotated[
        float | None,
        Setting(
            help="Relative standard deviation of the ratio from mounting to mounting, if it is known.",
            metavar="SHARE",
            example="1 %",
        ),
    ] = None
    mounting_freedom: Annotated[
        float | None,
        Setting(help="Degrees of freedom of --mounting-scatter, where it is an estimate (default: it is exact)."),
    ] = None

    def check(self, target: Target) -> None:
        if self.tolerance is None and self.time is None:
            raise UsageError("--tolerance or --time is missing: say how well, or how long, or both")
        if self.tolerance is not None:
            check_tolerance(self.tolerance, f"--tolerance {self.tolerance:g}")
        check_bench_time(self.time, "2 min")
        if self.mountings is not None and not 1 <= self.mountings <= MOST_MOUNTINGS:
            raise RangeError(f"--mountings {self.mountings} is outside 1 to {MOST_MOUNTINGS}; give a number inside")
        if self.mounting_scatter is not None and not 0 <= self.mounting_scatter <= LARGEST_SCATTER:
            raise RangeError(
                f"--mounting-scatter {100 * self.mounting_scatter:g} % is outside 0 to {100 * LARGEST_SCATTER:g} %;"
                " give a share such as '1 %'"
            )
        if self.mounting_freedom is not None and self.mounting_scatter is None:
            raise UsageError("--mounting-freedom says how well --mounting-scatter is known: give both, or neither")
        if self.mounting_freedom is not None and not self.mounting_freedom >= 1:
            raise RangeError(
                f"--mounting-freedom {self.mounting_freedom:g} is below 1: the scatter of three mountings has 2; give"
                " 1 or more, or leave it out where the scatter is exact"
            )
        check_nodes(target.design, target.nodes, target.channels)
        check_force(self.loads_on(target), target.force_limit)
        if self.load is not None and target.calibrated is None:  # else the plan would blame what it cannot reach
            check_store((self.load,), False, target.scene, datetime.now(UTC).date())
        check_frequency(self.frequency, target)
        check_time(shortest(self.frequency), self.frequency)
        check_simulated((self.object,), target)

    def required_loads(self) -> RequiredLoads | None:
        return None if self.load is None else RequiredLoads((self.load,))

    def dwells(self) -> Dwells:
        loads = LOADS if self.load is None else (self.load,)
        return Dwells((self.object,), (min(loads), max(loads)), self.frequency, shortest(self.frequency))

    def wanted(self, target: Target) -> Wanted:
        """What is asked for, with the scatter of mountings that is stated, or else stored, or else assumed."""
        asked = self.tolerance, self.time, self.relative_to_model, self.frequency, self.mountings
        of = target.mounts, self.object.name if SAMPLES.get(self.object.name) == self.object else ""
        if self.mounting_scatter is not None:
            return Wanted(*asked, self.mounting_scatter, self.mounting_freedom or math.inf, "scatter as stated", *of)
        stored = self.mountings_on(target)
        if stored is None:
            return Wanted(*asked, *UNMEASURED, f"{NEVER_MEASURED}; --mountings 12 does so, once", *of)
        source = f"{scatter_told(stored.found)}: {stored.source}{stored.marks()}"
        return Wanted(*asked, stored.means_u, float(stored.degrees_of_freedom), source, *of)

    def mountings_on(self, target: Target) -> MountingScatterCalibration | None:
        """The stored scatter of mountings that the plan takes; before the bench is open, the one that it probably has.

        None: none is stored, or another one is stated.
        """
        if self.mounting_scatter is not None:
            return None
        if target.calibrated is not None:
            return target.mountings
        whose = CalibrationOwner(ANY, target.scene, target.scene is not None, (target.design.name,))
        return mountings_of(whose, datetime.now(UTC).date())

    def plans_on(self, target: Target) -> ModulusPlans:
        """All plans; before the bench is open, with the calibration by references that it probably has.

        Raises RangeError: the model does not answer for this sensor.
        """
        question = self.model_question(target.design)
        found = expected(question, self.object.modulus, references_on(target, question))
        return ModulusPlans(question, found, self.wanted(target), target, self.loads_on(target))

    def course_on(self, target: Target) -> Course:
        """The course of the measurement by its plan.

        Raises:
            RangeError: not one set fits into the time, or no time on the bench reaches the tolerance; the message names
                the line that binds, and other ways.
        """
        return self._course(self.plans_on(target))

    def _course(self, plans: ModulusPlans) -> Course:
        curve = curve_of(plans.question, plans.found.references)
        return Course(plans.design, plans.question, curve, plans.wanted, plans.prospect())

    def loads_on(self, target: Target) -> tuple[float, ...]:
        """The loads among which the plan chooses: the given one, or all that the load cell is calibrated for."""
        if self.load is not None:
            return (self.load,)
        low, high = target.calibrated or (0.0, math.inf)
        return tuple(load for load in LOADS if low <= load <= high) or (low,)

    def model_question(self, design: Design) -> RatioQuestion:
        """The question for the model that turns the ratio into the modulus; "auto" is the model that it chooses.

        Raises RangeError: the model takes no thickness of an object.
        """
        if THICKNESS in FIXED.get(self.model, ()):
            raise RangeError(
                f"--model {self.model}: it cannot be told how thick an object is, so that it turns no ratio into a"
                " modulus; take another one, such as --model auto"
            )
        asked = RatioQuestion(design.name, self.model, settings={THICKNESS: self.object.thickness})
        return replace(asked, model=answering(asked))

    def plan(self, target: Target) -> Plan[Step, Course]:
        """The most load sets that there can be, and what is predicted. Raises as `course_on`."""
        target = with_films(target)
        plans = self.plans_on(target)
        course = self._course(plans)
        prospect, wanted = course.prospect, course.wanted
        plan, costs = prospect.allocation, costs_of(prospect.allocation.load, self.frequency, target.mounts)
        group = f"mount {self.object.name}"
        each = costs.set + plan.dwell
        steps = [
            Step(
                plan.dwell,
                each + (costs.start + costs.mounting if number == 1 else 0.0),
                target.design.ratio_scatter,
                what=f"{self.object.name}, {show(prospect.allocation.load, 'N')}, set {number}",
                group=group,
            )
            for number in range(1, most_sets(prospect, wanted) + 1)
        ]
        us = {"modulus, scale": prospect.scale_u, "modulus, absolute": prospect.absolute_u}
        results = [Expected(name, each) for name, each in us.items() if each is not None]
        u = prospect.scale_u if self.relative_to_model else prospect.absolute_u
        offered = plans.alternatives(prospect)
        details = {
            "planned": prospect.summary(),
            "mounting_scatter": wanted.mounted,
            "mounting_scatter_freedom": None if math.isinf(wanted.mounted_freedom) else wanted.mounted_freedom,
            "alternatives": [each.summary() for each in offered],
        }
        lines = [*planned_lines(wanted, prospect), *worth_lines(offered)]
        return Plan(self.name, steps, foreseen(prospect.times.mean, u, results, lines, **details), course)

    def begin(self, plan: Plan[Step, Course], lab: Lab, record: Recorder) -> Measuring:
        return Measuring(lab, record, plan.basis, self.object)

    def course(self, plan: Plan[Step, Course], points: Sequence[ModulusPoint], lab: Lab) -> Generator[int, None, str]:
        """The run ends once the sets so far are enough."""
        for number in range(len(plan.steps)):
            if points and (why := plan.basis.verdict(points).why):
                return why
            yield number
        return ""

    def evaluate(self, points: Sequence[ModulusPoint], plan: Plan[Step, Course], lab: Lab) -> ObjectModulusResult:
        course = plan.basis
        stopped = course.verdict(points).why or "the most sets that were planned are taken"
        found = ObjectModulusResult(
            list(points),
            course.wanted,
            course.prospect,
            course.answer(points),
            stopped,
            course.notes(points),
            course.noise_density(points),
        )
        return replace(found, stopped=f"{stopped}{missed_by(course.wanted, found.reached)}")

    def save_calibration(self, done: Finished[ObjectModulusResult]) -> CalibrationKeys:
        """Store what three mountings or more of this run scattered."""
        found, lab = mounting_scatter(ratios_of(done.result.points)), done.session.lab
        if found is None or not found.means_u > 0:
            return {}
        scatter = MountingScatterCalibration(
            means_u=found.means_u,
            degrees_of_freedom=found.degrees_of_freedom,
            sets_u=found.within_u,
            sets_freedom=found.within_freedom,
            design=lab.design.name,
            **lab.origin(SensorNode, VALID_DAYS),
        )
        return {"mounting_scatter_file": str(keep(scatter, done.folder, done.replayed))}

    def report(self, result: ObjectModulusResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.object_modulus.report import plot_modulus, show_modulus

        return Report(partial(show_modulus, result), partial(plot_modulus, result, lab.bench.simulated))
