"""The softness test: Young moduli of objects from their force ratios, and their order (thesis 4.1, 5.4)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.allocation.order import (
    Family,
    Pair,
    expected_sets,
    is_told,
    least_risk,
    needed,
    order,
    what_it_takes,
)
from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import CALIBRATION, NOISE, PRIOR_FREEDOM, SCATTER, apart, mean_ratio
from palpate.instrument.findings.object_modulus import COVERAGE, ByReferences, answering, estimate, validation_of
from palpate.instrument.models.curve import ratio_curve
from palpate.instrument.models.price_list import stored
from palpate.instrument.models.response import RatioQuestion, response
from palpate.instrument.models.springs import force_ratio
from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.quantity import counted, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import SAMPLES, Load, Sample, get_sample, parse_samples
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.engine.plan import Plan, Predicted, Step, expected_noise, point_seconds
from palpate.procedures.engine.procedure import (
    RESULTS,
    Expected,
    Measurement,
    Procedure,
    Report,
    RequiredLoads,
    greatest,
    predicted,
    until_full,
)
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import references_on
from palpate.procedures.lab.lab import BY_HAND, Dwells, Lab, Mounts, Target
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.measurements.prospects import expected_mean, expected_ratio
from palpate.procedures.measurements.settings import DwellTime, Frequency, LoadSets, model_name, share_setting
from palpate.procedures.measurements.work import DynamicLoadWork
from palpate.procedures.records.columns import LAST, Column, columns_of, gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.showing import moduli
from palpate.procedures.showing.figure import logarithmic, name_all, new_figure, plot_over_loads, save
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import MARKS, legend, stamped
from palpate.procedures.steps.checks import check_force, check_frequency, check_increasing, check_time, set_names
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.flags import CLIPPED

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# --- The points and the result of a softness test: Young moduli, and the objects from hard to soft -----

MOST_SETS = 100  # of an object
OBJECT = Column("name of the object", head="object")


@dataclass(frozen=True, slots=True)
class SoftnessPoint:
    """One load on one object. Loads are peak to peak."""

    object: Annotated[str, OBJECT]
    load_N: columns.AskedLoad
    load_measured_N: columns.MeasuredLoad
    load_measured_u: float
    force_ratio: columns.ForceRatio
    force_ratio_u: columns.ForceRatioU
    noise_u: columns.NoiseU
    valid: columns.Valid
    flags: columns.Flags
    calibration_u: columns.CalibrationU = 0.0
    pickup_u: columns.PickupU = 0.0
    degrees_of_freedom: Annotated[float | None, columns.FREEDOM] = None


@dataclass(frozen=True, slots=True)
class Softness:
    """What is found of one object. Without a valid point it has neither ratio nor modulus."""

    object: Annotated[str, OBJECT]
    valid_points: Annotated[int, Column("number of valid points", head="valid", after=LAST)]
    saturated: Annotated[bool, Column("whether a film was saturated at one of the loads")]
    force_ratio: Annotated[
        float | None, Column("mean over the valid points", "", "force ratio", "z.4g", u="force_ratio_u")
    ] = None
    force_ratio_u: Annotated[float | None, Column(head="u", cell="z.4g")] = None
    modulus_Pa: Annotated[float | None, Column("Young modulus by the model; null: only a bound is known", "Pa")] = None
    scale_u: Annotated[
        float | None, Column("its relative standard uncertainty on the model's curve; null: only a bound is known")
    ] = None
    scale_low_Pa: Annotated[float | None, Column("low end of that coverage interval; null: there is none", "Pa")] = None
    scale_high_Pa: Annotated[float | None, Column("high end of it; null: there is none", "Pa")] = None
    absolute_u: Annotated[float | None, Column("the same as `scale_u`, with the model's validation error")] = None
    absolute_low_Pa: Annotated[float | None, Column("the same as `scale_low_Pa`, with it", "Pa")] = None
    absolute_high_Pa: Annotated[float | None, Column("the same as `scale_high_Pa`, with it", "Pa")] = None
    absolute_kind: Annotated[
        str | None,
        Column("what the absolute ends say, as `kind`; null: the validation error is not known, so neither are they"),
    ] = None
    sensitivity: Annotated[float | None, Column("relative change of the modulus over that of the ratio")] = None
    kind: Annotated[
        str | None, Column('"interval", "at least", "at most" or "any": what the ends on the scale say')
    ] = None
    note: Annotated[str, Column("why there is only a bound")] = ""
    model_error: Annotated[float | None, Column("the model's error, as a ratio; null: it is not known")] = None
    curve_error: Annotated[
        float,
        Column(
            "what the intervals allow for the error of the model's curve, as a ratio: its discretisation, and"
            " `model_error` where it is known"
        ),
    ] = 0.0


@dataclass(frozen=True, slots=True)
class NotTold:
    """Two objects whose order is not known to the risk.

    `sets` and `seconds` tell them apart with 95 % probability, in a run of these two; null: no number of sets does.
    """

    objects: Annotated[tuple[str, str], Column("their names, the one with the larger ratio first")]
    sets: Annotated[int | None, Column("load sets of each")]
    seconds: Annotated[float | None, Column("bench time", "s")]


@dataclass(frozen=True, slots=True)
class Ranked:
    """What a run told of the order.

    Attributes:
        risk: greatest risk of a wrong pair in the order that was asked for.
        achieved_risk: risk to which all pairs are known that are not in `not_told`; None: no pair is.
        sets: number of valid load sets of each object.
        not_told: the other pairs.
        scatter: relative standard deviation of the ratio from set to set, by what was known before and by this run.
    """

    risk: float
    achieved_risk: float | None
    sets: Mapping[str, int]
    not_told: tuple[NotTold, ...]
    scatter: float

    def summary(self) -> dict[str, Any]:
        """The values under the names of JSON."""
        left = [{"objects": list(each.objects), "sets": each.sets, "seconds": each.seconds} for each in self.not_told]
        return {
            "risk": self.risk,
            "achieved_risk": self.achieved_risk,
            "sets": dict(self.sets),
            "not_told": left,
            "set_scatter": self.scatter,
        }


@dataclass(frozen=True, slots=True)
class SoftnessResult:
    """The result of a softness test.

    Attributes:
        points: the points.
        objects: what is found of each object.
        softness_order: names of the objects with a valid point, from hard to soft.
        alike: neighbours in this order that may be exchanged: their ratios do not differ with 95 % confidence.
        model: name of the model that turned ratios into moduli.
        price: what is known of the model's own error, in a sentence.
        validation: the model's validation error.
        budgets: uncertainty budget of each mean ratio and of each modulus that is known, on the model's scale and,
            where the validation error is known, absolute. A modulus has a linear budget; its intervals are found
            without that approximation.
        ranked: what the sets told of the order to a risk of error, and `alike` are then the pairs that they did not
            tell; None: none was asked for.
    """

    points: list[SoftnessPoint]
    objects: list[Softness]
    softness_order: list[str]
    alike: list[tuple[str, str]]
    model: str
    price: str
    validation: ValidationLine
    budgets: list[Budget]
    ranked: Ranked | None = None

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        return {
            "objects": [asdict(each) for each in self.objects],
            "softness_order": self.softness_order,
            "alike": [list(pair) for pair in self.alike],
            **({} if self.ranked is None else self.ranked.summary()),
            "coverage": COVERAGE,
            "answered_by": self.model,
            "price": self.price,
            "validation_line": self.validation.summary(),
        }


def evaluate(
    points: Sequence[SoftnessPoint],
    design: Design,
    question: RatioQuestion,
    calibration: ModelCalibration | None = None,
    same_films: bool = False,
) -> SoftnessResult:
    """Find moduli from the mean ratios over the valid points, and the order of the objects.

    Args:
        points: the points.
        design: the sensor.
        question: names the model that turns a ratio into a modulus, and the thickness of the objects.
        calibration: the model's calibration by references; None: there is none.
        same_films: whether the references were measured with the films' calibration of the points.
    """
    means: dict[str, Budget] = {}
    found: dict[str, Softness] = {}
    for name in dict.fromkeys(point.object for point in points):
        own = [point for point in points if point.object == name]
        valid = [point for point in own if point.valid]
        found[name] = Softness(name, len(valid), any(CLIPPED in point.flags for point in own))
        if valid:
            means[name] = mean_ratio(f"force ratio of {name}", valid, design.film_freedom)
    model, references = answering(question), None
    if means:
        if calibration is not None:
            shared = [_films(mean) if same_films else 0.0 for mean in means.values()]
            references = ByReferences(calibration, same_films, shared)
        ratios, uncertainties, freedom = zip(
            *((mean.value, mean.u, mean.degrees_of_freedom) for mean in means.values()), strict=True
        )
        rows = estimate(question, ratios, uncertainties, freedom, references)
        for name, row in zip(means, rows, strict=True):
            del row["model"]
            found[name] = Softness(name, found[name].valid_points, found[name].saturated, **row)
    order = sorted(means, key=lambda name: means[name].value, reverse=True)
    alike = [pair for pair in itertools.pairwise(order) if not apart(means[pair[0]], means[pair[1]])]
    line = validation_of(question, model, references)
    cancelled = CALIBRATION if calibration is not None and same_films else ""
    budgets = [budget for name, mean in means.items() for budget in budgets_of(found[name], mean, line, cancelled)]
    price = price_of(design, model)
    return SoftnessResult(list(points), list(found.values()), order, alike, model, price, line, budgets)


def _films(mean: Budget) -> float:
    """Part of a mean ratio's uncertainty by the films' calibration."""
    return math.fsum(part.u for part in mean.components if part.name == CALIBRATION)


def budgets_of(each: Softness, mean: Budget, line: ValidationLine, cancelled: str = "") -> Iterator[Budget]:
    """The budget of the mean ratio, and those of the modulus if it is known. The latter contain the model's error.

    `cancelled` names the component that object and references share, which the absolute budget leaves out.
    """
    yield mean
    if each.modulus_Pa is None or each.sensitivity is None:
        return
    slope = each.sensitivity * each.modulus_Pa / mean.value
    # The error of the curve is a bound: a rectangle of that half width.
    model = Component("model", each.curve_error / math.sqrt(3), slope)
    parts = tuple(replace(part, sensitivity=slope) for part in mean.components)
    yield Budget(f"modulus of {each.object}, scale", each.modulus_Pa, "Pa", (*parts, model))
    if line.u is not None:
        error = Component("validation", line.u, each.sensitivity * each.modulus_Pa, line.degrees_of_freedom)
        own = [part for part in parts if part.name != cancelled]
        yield Budget(f"modulus of {each.object}, absolute", each.modulus_Pa, "Pa", (*own, model, error))


def price_of(design: Design, model: str) -> str:
    """A sentence with the model's error for this design, from the price list."""
    priced = [
        (max(bounds), price)
        for price in stored().prices
        if price.design == design.name and price.model == model and (bounds := price.bounds(slice(None)))
    ]
    if not priced:
        return f"model {model!r} has no price for design {design.name!r}: its own error is not known"
    error, price = min(priced, key=lambda each: each[0])
    return f"model {model!r} ({price.refinement}): error of the ratio at most {error:.1e} by the price list"


# --- The order of objects to a stated risk of error: how many load sets each gets, and what they told in the end

SMALLEST_RISK, LARGEST_RISK = 1e-6, 0.5
MOST = 5  # sets of an object, usually
LEAST_RATIO = 0.1  # by which the noise of an unknown object is judged


@dataclass(frozen=True)
class Ranking:
    """The course of a softness test that ends when the order is known.

    Attributes:
        design: the sensor.
        test: its settings; objects are mounted in their order, and the sets of each take the loads in turn.
        risk: greatest risk of a wrong pair in the order.
        mounts: who mounts the objects, and how long that takes.
    """

    design: Design
    test: SoftnessTest
    risk: float
    mounts: Mounts = BY_HAND

    def check(self) -> None:
        """Refuse what cannot be, before anything moves.

        Raises:
            RangeError: the risk, the number of sets or that of the objects is outside its limits, or two objects are
                expected to be so much alike that so many sets do not tell them apart in every second run.
        """
        if len(self.test.objects) < 2:
            raise RangeError("--risk: one object has no order; name two or more, or leave --risk out")
        if not SMALLEST_RISK <= self.risk <= LARGEST_RISK:
            raise RangeError(
                f"--risk {self.risk:g} is outside {SMALLEST_RISK:g} to {LARGEST_RISK:g}; give a share such as '5 %'"
            )
        if not 1 <= self.test.sets <= MOST_SETS:
            raise RangeError(f"--sets {self.test.sets} is outside 1 to {MOST_SETS}; give a number inside")
        worst = [(risk, pair) for pair in self._expected_pairs if (risk := self._least_risk(pair)) > self.risk]
        if worst:
            raise self._refusal(*max(worst))

    @cached_property
    def family(self) -> Family:
        """All comparisons of the run, with what is known of the scatter of sets."""
        u = budget(self._lines(), 1, 1, self.test.dwell).u
        return Family(len(self.test.objects), self.risk, self.test.sets, u, PRIOR_FREEDOM)

    @property
    def costs(self) -> Costs:
        """Bench times of one object; the first of its sets takes longer, which counts for the mounting."""
        first, later = (
            point_seconds(self.test.frequency, self.test.dwell, first=first, mounts=self.mounts)
            for first in (True, False)
        )
        return Costs(0.0, first - later, later - self.test.dwell, self.mounts.person)

    def has_enough(self, name: str, points: Sequence[SoftnessPoint]) -> bool:
        """Whether an object has enough sets: it is told from those before it, and has what those after it need."""
        ratios = ratios_of(points)
        return len(ratios.get(name, ())) >= self._least(name) and is_told(self.family, ratios, name)

    def ranked(self, points: Sequence[SoftnessPoint]) -> Ranked:
        """What the points told. Raises RangeError: none is valid."""
        ratios = ratios_of(points)
        found = order(self.family, ratios)
        return Ranked(
            self.risk,
            found.risk,
            {each.name: len(ratios.get(each.name, ())) for each in self.test.objects},
            tuple(self._not_told(pair, ratios, found.scatter) for pair in found.not_told),
            found.scatter,
        )

    def predicted(self) -> Predicted:
        """What the run is predicted to take; a plan for people."""
        sets = self._planned()
        seconds = math.fsum(self.costs.seconds(1, number, self.test.dwell) for number in sets.values())
        each = ", ".join(f"{name}: {number}" for name, number in sets.items())
        shares = {row["name"]: row["share"] for row in budget(self._lines(), 1, 1, self.test.dwell).rows()}
        binds = max(shares, key=lambda name: shares[name])
        left = [pair for pair in self._expected_pairs if self._needed(pair) is None]
        objects = counted(len(self.test.objects), "object")
        lines = [
            f"wanted         the order of {objects} to a risk of {100 * self.risk:.3g} %",
            f"plan           up to {counted(self.test.sets, 'set')} of each object; it goes on as soon as it is told",
            f"expected       sets of each: {each}: {duration(seconds)} ({self.mounts.described(len(sets))})",
            f"binds          {binds}, {shares[binds]:.0%} of the variance of a set",
            *([f"doubtful       {told_pairs(left)}: may need more than {self.test.sets} sets"] if left else []),
        ]
        details = {"risk": self.risk, "planned": {"sets": sets, "seconds": seconds, "shares": shares, "binds": binds}}
        return Predicted(seconds, None, details, lines)

    @cached_property
    def _ratios(self) -> dict[str, float]:
        """Expected ratio of each object that is one of the known samples; nothing is expected of others."""
        samples = [each for each in self.test.objects if SAMPLES.get(each.name) == each]
        return {each.name: expected_ratio(self.design, each.name) for each in samples}

    def _lines(self, scatter: float | None = None) -> list[BudgetLine]:
        """Lines of the ratio of one set; what all objects have in common, such as the films' calibration, is left out.

        `scatter`: that of sets, noise included, where a run told it.
        """
        if scatter is not None:
            return [BudgetLine(SCATTER, scatter, RepeatUnit.SET)]
        noise = expected_noise(self.design, min(self.test.loads), min(self._ratios.values(), default=LEAST_RATIO))
        return [
            BudgetLine(SCATTER, self.design.ratio_scatter, RepeatUnit.SET, PRIOR_FREEDOM),
            BudgetLine(NOISE, noise, RepeatUnit.SECOND),
        ]

    @cached_property
    def _expected_pairs(self) -> tuple[Pair, ...]:
        names = list(self._ratios)
        return tuple((one, other) for n, one in enumerate(names) for other in names[n + 1 :])

    def _gap(self, pair: Pair) -> float:
        one, other = (self._ratios[name] for name in pair)
        return abs(math.log(one / other))

    def _needed(self, pair: Pair) -> int | None:
        return needed(self.family, self._lines(), self.test.dwell, self._gap(pair))

    def _least_risk(self, pair: Pair) -> float:
        return least_risk(self.family, self._lines(), self.test.dwell, self._gap(pair))

    def _least(self, name: str) -> int:
        """Sets that an object needs to be told later from those that are mounted after it."""
        names = [each.name for each in self.test.objects]
        after = names[names.index(name) + 1 :]
        if any(each not in self._ratios for each in (*after, *([name] if after else []))):
            return self.test.sets
        return max((self._needed((name, other)) or self.test.sets for other in after), default=1)

    def _planned(self) -> dict[str, int]:
        """Expected number of sets of each object."""
        sets: dict[str, int] = {}
        for each in self.test.objects:
            name = each.name
            number, freedom = self._least(name), PRIOR_FREEDOM + sum(sets.values()) - len(sets)
            for before, others in sets.items():
                both_known = name in self._ratios and before in self._ratios
                gap = self._gap((before, name)) if both_known else 0.0
                number = max(number, expected_sets(self.family, self._lines(), self.test.dwell, gap, others, freedom))
            sets[name] = number
        return sets

    def _not_told(self, pair: Pair, ratios: Mapping[str, Sequence[float]], scatter: float) -> NotTold:
        one, other = (math.fsum(map(math.log, ratios[name])) / len(ratios[name]) for name in pair)
        alone = Family(2, self.risk, MOST_SETS, scatter, PRIOR_FREEDOM)
        plan = what_it_takes(alone, self._lines(scatter), self.costs, self.test.dwell, one - other)
        return NotTold(pair, None, None) if plan is None else NotTold(pair, plan.sets, 2 * plan.seconds)

    def _refusal(self, least: float, pair: Pair) -> RangeError:
        plan = what_it_takes(self.family, self._lines(), self.costs, self.test.dwell, self._gap(pair))
        shares = budget(self._lines(), 1, 1, self.test.dwell).rows()
        binds = max(shares, key=lambda row: row["share"])["name"]
        pair_text, asked = " and ".join(pair), f"--risk '{100 * self.risk:.3g} %'"
        lines = [
            f"{asked} cannot be expected of {counted(self.test.sets, 'set')} of each object: {binds} leaves a risk of "
            f"{100 * least:.2g} % that {pair_text} are in the wrong order",
            f"best now  --risk '{100 * 1.01 * least:.2g} %'"
            if least < LARGEST_RISK
            else "best now  no risk worth naming",
        ]
        if plan is not None and plan.sets <= MOST_SETS:
            lines.append(f"or        --sets {plan.sets}")
        else:
            lines.append(f"or        leave {pair[0]} or {pair[1]} out: no {MOST_SETS} sets tell them apart")
        return RangeError("\n  ".join(lines))


def ratios_of(points: Sequence[SoftnessPoint]) -> dict[str, list[float]]:
    """Ratios of the valid points of each object, in the order of the points."""
    groups: dict[str, list[float]] = {}
    for point in points:
        if point.valid and point.force_ratio > 0:
            groups.setdefault(point.object, []).append(point.force_ratio)
    return groups


def told_pairs(pairs: Sequence[Pair]) -> str:
    """Pairs of objects for people."""
    return ", ".join(" and ".join(pair) for pair in pairs)


# --- the procedure -------------------------------------------------------------------------------------

EDGE = 1e-9  # distance that an expected ratio keeps from 0 and 1
SLOW = ("axisymmetric", "solid")  # their curve takes 20 s and half an hour


@dataclass(frozen=True, slots=True)
class TouchStep(Step):
    """One load on one object, peak to peak."""

    object: str
    load_N: float


RankingPlan = Plan[TouchStep, Ranking | None]


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
        names = [each.name for each in self.objects]
        if not names or len(set(names)) < len(names):
            listed = f"'{', '.join(names)}'"
            raise RangeError(f"objects {listed}: give at least one, and each only once")
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

    def plan(self, target: Target) -> RankingPlan:
        """All points: every load on every object; with a risk, the most sets of each object."""
        sets = list(zip(self.loads, set_names(self.loads), strict=True))
        ranking: Ranking | None = None
        if self.risk is not None:
            ranking = Ranking(target.design, self, self.risk, target.mounts)
            ranking.check()
            turns = range(1, self.sets + 1)
            sets = [(self.loads[(n - 1) % len(self.loads)], f"set {n} of at most {self.sets}") for n in turns]
        steps = [
            self._step(target, each.name, load, load_text, first=not number)
            for each in self.objects
            for number, (load, load_text) in enumerate(sets)
        ]
        if ranking is None:
            taken = {each.name: len(self.loads) for each in self.objects}
            return Plan(self.name, steps, predicted(steps, self._expected(target, taken)))
        forecast = ranking.predicted()
        found = self._expected(target, forecast.details["planned"]["sets"])
        details = {**forecast.details, RESULTS: [asdict(each) for each in found]}
        return Plan(self.name, steps, replace(forecast, u=greatest(found), details=details), ranking)

    def _expected(self, target: Target, sets: Mapping[str, int]) -> list[Expected]:
        """Relative uncertainties of each object's mean ratio, and of its modulus on the model's scale and absolute.

        Sets take the loads in turn. Ratios are the thesis' means [M]; for other objects they are those of the model
        that answers, at the object's modulus. A model that takes too long to answer beforehand tells no modulus.
        """
        design, slow = target.design, self.model in SLOW
        question = None if slow else self.model_question(design)
        ratios = {each.name: _ratio(design, each, question) for each in self.objects}
        means = {}
        for name, ratio in ratios.items():
            loads = [self.loads[n % len(self.loads)] for n in range(sets[name])]
            means[name] = expected_mean(f"force ratio of {name}", design, ratio, loads, [self.dwell] * len(loads))
        found = [Expected.of(mean) for mean in means.values()]
        if question is None:
            return found
        values, us, freedom = zip(*((m.value, m.u, m.degrees_of_freedom) for m in means.values()), strict=True)
        rows = estimate(question, values, us, freedom, references_on(target, question))
        for name, row in zip(means, rows, strict=True):
            for kind in ("scale", "absolute"):
                if row["modulus_Pa"] is not None and row[f"{kind}_u"] is not None:
                    found.append(Expected(f"modulus of {name}, {kind}", row[f"{kind}_u"]))
        return found

    def _step(self, target: Target, name: str, load: float, load_text: str, first: bool) -> TouchStep:
        seconds = point_seconds(self.frequency, self.dwell, first=first, mounts=target.mounts)
        what, group = f"{name}, {load_text}", f"mount {name}"
        return TouchStep(self.dwell, seconds, target.design.ratio_scatter, name, load, what=what, group=group)

    def begin(self, plan: RankingPlan, lab: Lab, record: Recorder) -> Touching:
        return Touching(lab, record, self)

    def course(self, plan: RankingPlan, points: Sequence[SoftnessPoint], lab: Lab) -> Generator[int, None, str]:
        """Each object ends once it has enough sets for the order."""
        ranking = plan.basis

        def full(step: TouchStep, _own: Sequence[SoftnessPoint]) -> bool:
            return ranking is not None and ranking.has_enough(step.object, points)

        return until_full(plan.steps, points, lambda step: step.object, full)

    def evaluate(self, points: Sequence[SoftnessPoint], plan: RankingPlan, lab: Lab) -> SoftnessResult:
        question = self.model_question(lab.design)
        found = evaluate(points, lab.design, question, lab.references, lab.same_films)
        if plan.basis is None or not found.softness_order:
            return found
        ranked = plan.basis.ranked(points)
        return replace(found, alike=[each.objects for each in ranked.not_told], ranked=ranked)

    def model_question(self, design: Design) -> RatioQuestion:
        return RatioQuestion(design.name, self.model, settings={"sensed_thickness": self.objects[0].thickness})

    def report(self, result: SoftnessResult, lab: Lab) -> Report:
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
        return self.measurement(point, measured)


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


# --- what it shows -------------------------------------------------------------------------------------


ABSOLUTE, SCALE = ("0.75", 7.0), ("C0", 1.5)  # colour and width of an interval's bar


def show_softness(result: SoftnessResult, outcome: Outcome) -> list[object]:
    """Ratio and modulus of each object, on the model's scale and absolute, their order, and the model's error."""
    note = Column(head="note", cell=partial(_note, result.points), after=LAST)
    columns = columns_of(Softness) | moduli.COLUMNS | {"note": note}
    table = table_of(stamped(outcome["simulated"], f"Softness, by model {result.model!r}"), result.objects, columns)
    alike = ", ".join(f"{one} and {other}" for one, other in result.alike)
    return [
        table,
        *legend(table, marks={**MARKS, "any": "every modulus agrees with the ratio"}),
        f"softness order, hard to soft: {' > '.join(result.softness_order) or 'none, no point is valid'}",
        *([f"cannot be told apart at 95 %: {alike}"] if alike and result.ranked is None else []),
        *([] if result.ranked is None else [*ranked_lines(result.ranked), _seconds(outcome)]),
        moduli.absolute_line(result.validation),
        *moduli.bound_line(each.modulus_Pa is not None for each in result.objects if each.valid_points),
        f"price          {result.price}",
    ]


def _note(points: Sequence[SoftnessPoint], each: Softness) -> str:
    """What to know about what is found of an object."""
    flags = dict.fromkeys(f for p in points if p.object == each.object and not p.valid for f in p.flags)
    notes = [
        *([f"not used: {' '.join(flags)}"] if flags else []),
        *(["a film is saturated: take a smaller load"] if each.saturated else []),
        *([each.note] * bool(each.note)),
    ]
    return "; ".join(notes)


def ranked_lines(ranked: Ranked) -> list[str]:
    """What a run told of the order, for people."""
    asked = f"{100 * ranked.risk:.3g} %"
    sets = ", ".join(f"{name}: {number}" for name, number in ranked.sets.items())
    reached = None if ranked.achieved_risk is None else f"{100 * ranked.achieved_risk:.2g} %"
    which = "the order is" if not ranked.not_told else "the other pairs are"
    outcome = "no pair is known to that risk" if reached is None else f"{which} known to a risk of {reached}"
    lines = [
        f"risk           {asked} of a wrong pair was asked for; {outcome}",
        f"sets           {sets}; from set to set the ratio scatters by {100 * ranked.scatter:.2g} %",
    ]
    for each in ranked.not_told:
        outcome = " and ".join(each.objects)
        if each.sets is None or each.seconds is None or each.sets > MOST_SETS:
            lines.append(f"not told       {outcome}: no {MOST_SETS} sets would tell them apart")
        else:
            names = ",".join(each.objects)
            lines.append(
                f"not told       {outcome}: {counted(each.sets, 'set')} of each would, in {duration(each.seconds)}: the"
                f" same command for {names} with --sets {each.sets}"
            )
    return [
        *lines,
        "note           each object is mounted once; what mountings scatter is not known and counts as none",
    ]


def _seconds(outcome: Outcome) -> str:
    """A line with the bench time that was predicted and taken."""
    predicted, achieved = outcome["predicted_seconds"], outcome["achieved_seconds"]
    times = [("predicted", predicted), ("taken", achieved)]
    return "bench time     " + ", ".join(f"{s:z.0f} s {name}" for name, s in times if s is not None)


def plot_softness(result: SoftnessResult, simulated: bool, folder: Path) -> Path:
    """Plot ratios over loads, and the moduli with their intervals. Returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"softness by model {result.model}")
    for place, each in enumerate(result.objects):
        points = [p for p in result.points if p.object == each.object]
        plot_over_loads(left, place, each.object, points)
    left.set(xlabel="load, peak to peak (N)", ylabel="force ratio (bars: standard uncertainty)")
    name_all(left, 6, title="object")
    bounded = [each for each in result.objects if each.scale_low_Pa or each.scale_high_Pa]
    for place, each in enumerate(bounded):
        if each.absolute_low_Pa or each.absolute_high_Pa:
            _bar(right, place, each.absolute_low_Pa, each.modulus_Pa, each.absolute_high_Pa, ABSOLUTE)
        _bar(right, place, each.scale_low_Pa, each.modulus_Pa, each.scale_high_Pa, SCALE)
    drawn = "thick absolute, thin scale" if result.validation.u is not None else "scale; absolute not known"
    right.set(xlabel=f"modulus (kPa; 95 %: {drawn}; arrows: bounds)", ylabel="object")
    right.set(yticks=range(len(bounded)), yticklabels=[e.object for e in bounded])
    right.set_xscale("log")
    logarithmic(right, *right.get_xlim())
    return save(figure, folder)


def _bar(
    axes: Axes, place: int, low: float | None, middle: float | None, high: float | None, look: tuple[str, float]
) -> None:
    """Draw an interval of moduli [Pa] in kPa; an arrow at its end says that there is no bound on the other side."""
    color, width = look
    ends = [1e-3 * end for end in (low, middle, high) if end]
    axes.plot(ends, [place] * len(ends), "-", color=color, lw=width, solid_capstyle="butt")
    for end, marker in ((low, "|" if high else ">"), (middle, "o"), (high, "|" if low else "<")):
        if end:
            axes.plot(1e-3 * end, place, marker, color=color)
