"""The softness test: Young moduli of objects from their force ratios, and their order (thesis 4.1, 5.4)."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Annotated

from palpate.instrument.errors import RangeError
from palpate.instrument.findings.object_modulus import ByReferences, estimate
from palpate.instrument.models.curve import ratio_curve
from palpate.instrument.models.response import RatioQuestion, response
from palpate.instrument.models.springs import force_ratio
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Load, Sample, get_sample, parse_samples
from palpate.procedures.engine.plan import Plan, Step, point_seconds
from palpate.procedures.engine.procedure import Measurement, Procedure, Report, RequiredLoads, until_full
from palpate.procedures.engine.promise import RESULTS, Expected, greatest, predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import references_on
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.measurements.prospects import expected_mean
from palpate.procedures.measurements.settings import DwellTime, Frequency, LoadSets, model_name, share_setting
from palpate.procedures.measurements.softness.ranking import MOST, Ranking
from palpate.procedures.measurements.softness.result import SoftnessPoint, SoftnessResult, evaluate
from palpate.procedures.measurements.work import DynamicLoadWork
from palpate.procedures.records.columns import gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import check_force, check_frequency, check_increasing, check_time, told_sets
from palpate.procedures.steps.dwells import Dwells
from palpate.procedures.steps.films import check_nodes

# -------------------------------------------------------------------------------------------------------
# What a softness test is expected to give: the mean force ratio of each object, and its modulus by the model
#
# Ratios are the thesis' means [M]; for other objects they are those of the model that answers, at the object's
# modulus. The uncertainty of a modulus is that of `estimate` for the expected mean.


def expected_moduli(
    design: Design,
    ratios: Mapping[str, float],
    loads: Mapping[str, Sequence[float]],
    dwell: float,
    question: RatioQuestion | None,
    references: ByReferences | None = None,
) -> list[Expected]:
    """Relative uncertainties of the mean ratio and of the modulus of each object, on the model's scale and absolute.

    Args:
        design: design of the sensor.
        ratios: expected force ratio of each object, by its name.
        loads: load of each load set of each object, peak to peak [N].
        dwell: dwell of each [s].
        question: what the model is asked; None: it takes too long to answer beforehand.
        references: the model's calibration by references; None: there is none.
    """
    means = {
        name: expected_mean(f"force ratio of {name}", design, ratio, loads[name], [dwell] * len(loads[name]))
        for name, ratio in ratios.items()
    }
    found = [Expected.of(mean) for mean in means.values()]
    if question is None:
        return found
    values, us, freedom = zip(*((m.value, m.u, m.degrees_of_freedom) for m in means.values()), strict=True)
    rows = estimate(question, values, us, freedom, references)
    for name, row in zip(means, rows, strict=True):
        for told in ("scale", "absolute"):
            if row["modulus_Pa"] is not None and row[f"{told}_u"] is not None:
                found.append(Expected(f"modulus of {name}, {told}", row[f"{told}_u"]))
    return found


# --- the procedure -------------------------------------------------------------------------------------

EDGE = 1e-9  # distance that an expected ratio keeps from 0 and 1
SLOW = ("axisymmetric", "solid")  # their curve takes 20 s and half an hour


@dataclass(frozen=True, slots=True)
class TouchStep(Step):
    """One load on one object, peak to peak."""

    object: str
    load_N: float


def _samples(text: str) -> tuple[Sample, ...]:
    return tuple(get_sample(name) for name in parse_samples(text))


@dataclass(frozen=True)
class SoftnessTest(Procedure[TouchStep, SoftnessPoint, SoftnessResult, Ranking | None]):
    """Find the Young modulus of unknown objects from the force ratio, and their order from hard to soft."""

    name = "softness"
    point = SoftnessPoint

    objects: Annotated[tuple[Sample, ...], Setting(help="Rubber samples, in order.", read=_samples, option="--samples")]
    loads: LoadSets = (2.0, 3.0, 4.0)
    dwell: DwellTime = 1.0
    frequency: Frequency = 10.0
    model: Annotated[
        str, model_name("Sensor model that turns force ratios into moduli, such as experiment, auto or column.")
    ] = "experiment"
    risk: Annotated[
        float | None,
        share_setting("Risk of a wrong pair in the order, such as 5%: the test ends as soon as the order is known."),
    ] = None
    sets: Annotated[int, Setting(help="With --risk: most load sets of each object, which take --loads in turn.")] = MOST

    def check(self, target: Target) -> None:
        """Check the settings before anything is sent to a device.

        Raises:
            RangeError: there is no object, one is named twice, or they have several thicknesses; a load exceeds the
                force limit, the frequency or the dwell is outside its limits, or the bench has too few sensor nodes;
                the model does not know this sensor, or the simulated bench's model does not know one of the objects;
                so many sets are not expected to give the order to the risk.
            UnknownName: there is no such model.
        """
        names = [each.name for each in self.objects]
        if not names or len(set(names)) < len(names):
            told = f"'{', '.join(names)}'"
            raise RangeError(f"objects {told}: give at least one, and each only once")
        if len({each.thickness for each in self.objects}) > 1:
            raise RangeError(
                "the objects have different thicknesses, each of which needs its own ratio curve; measure them in "
                "separate runs"
            )
        check_nodes(target.design, target.nodes, target.channels)
        check_force(self.loads, target.force_limit)
        check_increasing("loads", self.loads, "N", repeated=True)
        check_frequency(self.frequency, target)
        check_time(self.dwell, self.frequency)
        question = self.model_question(target.design)
        if self.model not in SLOW:
            estimate(question, [0.5], None)
        check_simulated(self.objects, target)

    def required_loads(self) -> RequiredLoads:
        return RequiredLoads(self.loads)

    def dwells(self) -> Dwells:
        return Dwells(self.objects, (min(self.loads), max(self.loads)), self.frequency, self.dwell)

    def plan(self, target: Target) -> Plan[TouchStep, Ranking | None]:
        """All points: every load on every object; with a risk, the most sets of each object."""
        sets = list(zip(self.loads, told_sets(self.loads), strict=True))
        ranking: Ranking | None = None
        if self.risk is not None:
            asked = self.objects, tuple(self.loads), self.frequency, self.dwell, self.risk, self.sets
            ranking = Ranking(target.design, *asked, target.mounts)
            ranking.check()
            turns = range(1, self.sets + 1)
            sets = [(self.loads[(n - 1) % len(self.loads)], f"set {n} of at most {self.sets}") for n in turns]
        steps = [
            self._step(target, each.name, load, told, first=not number)
            for each in self.objects
            for number, (load, told) in enumerate(sets)
        ]
        if ranking is None:
            taken = {each.name: len(self.loads) for each in self.objects}
            return Plan(self.name, steps, predicted(steps, self._expected(target, taken)))
        likely = ranking.predicted()
        found = self._expected(target, likely.details["planned"]["sets"])
        told = {**likely.details, RESULTS: [asdict(each) for each in found]}
        return Plan(self.name, steps, replace(likely, u=greatest(found), details=told), ranking)

    def _expected(self, target: Target, sets: Mapping[str, int]) -> list[Expected]:
        """What is expected of ratios and moduli, for each object's number of sets, which take the loads in turn."""
        design, slow = target.design, self.model in SLOW
        question = None if slow else self.model_question(design)
        ratios = {each.name: _ratio(design, each, question) for each in self.objects}
        loads = {name: [self.loads[n % len(self.loads)] for n in range(number)] for name, number in sets.items()}
        references = None if question is None else references_on(target, question)
        return expected_moduli(design, ratios, loads, self.dwell, question, references)

    def _step(self, target: Target, name: str, load: float, told: str, first: bool) -> TouchStep:
        seconds = point_seconds(self.frequency, self.dwell, first=first, mounts=target.mounts)
        what, group = f"{name}, {told}", f"mount {name}"
        return TouchStep(self.dwell, seconds, target.design.ratio_scatter, name, load, what=what, group=group)

    def begin(self, plan: Plan[TouchStep, Ranking | None], lab: Lab, record: Recorder) -> Touching:
        return Touching(lab, record, self)

    def course(
        self, plan: Plan[TouchStep, Ranking | None], points: Sequence[SoftnessPoint], lab: Lab
    ) -> Generator[int, None, str]:
        """Each object ends once it has enough sets for the order."""
        ranking = plan.basis

        def full(step: TouchStep, _own: Sequence[SoftnessPoint]) -> bool:
            return ranking is not None and ranking.has_enough(step.object, points)

        return until_full(plan.steps, points, lambda step: step.object, full)

    def evaluate(
        self, points: Sequence[SoftnessPoint], plan: Plan[TouchStep, Ranking | None], lab: Lab
    ) -> SoftnessResult:
        question = self.model_question(lab.design)
        found = evaluate(points, lab.design, question, lab.references, lab.same_films)
        if plan.basis is None or not found.softness_order:
            return found
        ranked = plan.basis.ranked(points)
        return replace(found, alike=[each.objects for each in ranked.not_told], ranked=ranked)

    def model_question(self, design: Design) -> RatioQuestion:
        return RatioQuestion(design.name, self.model, settings={"sensed_thickness": self.objects[0].thickness})

    def report(self, result: SoftnessResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.softness.report import plot_softness, show_softness

        return Report(partial(show_softness, result), partial(plot_softness, result, lab.bench.simulated))


def _ratio(design: Design, each: Sample, question: RatioQuestion | None) -> float:
    """The force ratio that is expected of an object: the thesis' mean, or that of the model which answers."""
    if question is None or each.name in design.thesis_force_ratio:
        return design.thesis_force_ratio.get(each.name) or force_ratio(design, each)
    curve = ratio_curve(question.sensor(), question.load(each.modulus), question.model, question.tolerance)
    low, high = curve.moduli
    return min(max(float(curve.force_ratio(min(max(each.modulus, low), high))), EDGE), 1 - EDGE)


class Touching(DynamicLoadWork):
    """The bench work: one load after the other on each object."""

    def __init__(self, lab: Lab, record: Recorder, test: SoftnessTest) -> None:
        super().__init__(lab, record, test.loads, test.frequency, [each.name for each in test.objects])
        self._dwell = test.dwell
        self._objects = {each.name: each for each in test.objects}

    def arrange(self, step: TouchStep) -> None:
        self.press(self._objects[step.object])

    def take(self, step: TouchStep) -> Measurement[SoftnessPoint]:
        design = self.lab.design
        measured = self.load_set(step.load_N, step.what, self._dwell)
        point = gathered(SoftnessPoint, step, measured, measured.forces(design))
        return Measurement(point, measured.waveforms(design))


def check_simulated(objects: Sequence[Sample], target: Target) -> None:
    """Check that a simulated bench has a force ratio for each object.

    Raises RangeError: the sensor model of its scene knows one of them not.
    """
    if target.model is None or target.model in SLOW:
        return
    for each in objects:
        try:
            response(target.design, Load(1.0, each), target.model)
        except RangeError as error:
            raise RangeError(
                f"the simulated bench takes its force ratios from model {target.model!r}: {error}; give a scene with "
                "another model, such as --scene poor_seating"
            ) from None


def default_model(design: Design) -> str:
    """Name of the model for a design. A curve measured with it is best, as it contains what no model knows."""
    return "experiment" if design.thesis_force_ratio else "auto"


def unknown_object(
    design: Design, thickness: float = 3e-3, modulus: float | None = None, name: str | None = None
) -> Sample:
    """An object that is none of the rubber samples, as large as they are.

    Args:
        design: design of the sensor.
        thickness: thickness of the object [m].
        modulus: Young modulus [Pa], for a simulated bench; None: a real object has its own, and it is what is sought.
        name: name of the object; None: its modulus, or "unknown".

    Raises:
        RangeError: a thickness or modulus that is not above zero.
    """
    if modulus is None:  # a number must stand where a modulus is sought: it is that of the sensor's ring
        return object_of(design.ring.material.modulus, thickness, name or "unknown")
    return object_of(modulus, thickness, name or show(modulus, "Pa"))


def object_of(modulus: float, thickness: float, name: str) -> Sample:
    """An object of a Young modulus [Pa] and a thickness [m] that is as large as the rubber samples."""
    sample = get_sample("1")
    return Sample(name, "unknown", modulus, thickness, sample.area, sample.poisson, "unknown")
