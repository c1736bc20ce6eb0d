"""Calibration of a sensor model by references: each is mounted, and its force ratio is measured over load sets."""

from __future__ import annotations

import math
import re
import statistics
import tomllib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from palpate.drivers.roles import SensorNode
from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.model_calibration import (
    REACH,
    MeasuredReference,
    ModelCalibration,
    expected_u,
    fit_model,
)
from palpate.instrument.config import check
from palpate.instrument.errors import (
    ConfigError,
    EstimateError,
    QuantityError,
    RangeError,
    RecordError,
    UsageError,
    quoted,
)
from palpate.instrument.findings.film_forces import (
    CALIBRATION,
    NOISE,
    PICKUP,
    SCATTER,
    calibration_u,
    mean_ratio,
    pickup_u,
)
from palpate.instrument.findings.object_modulus import MOST_SENSITIVE
from palpate.instrument.models.curve import RatioCurve, ratio_curve
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.validation import ValidationLine, validate
from palpate.instrument.quantity import counted, parse, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import SAMPLES, Sample, get_sample
from palpate.instrument.uncertainty.budget import NORMAL_FACTOR, Budget, Component, coverage_factor
from palpate.procedures.engine.plan import Plan
from palpate.procedures.engine.procedure import Expected, Finished, Procedure, Report, predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import check_nameable, keep
from palpate.procedures.lab.lab import Dwells, Lab, Target
from palpate.procedures.lab.session import CalibrationKeys, Outcome
from palpate.procedures.lab.store import store
from palpate.procedures.measurements.modulus import DisplaysPoint, ModulusTest
from palpate.procedures.measurements.prospects import expected_mean
from palpate.procedures.measurements.settings import (
    DwellTime,
    Frequency,
    LoadSets,
    ValidDays,
    check_valid_days,
    model_name,
)
from palpate.procedures.measurements.softness import SLOW, SoftnessPoint, SoftnessTest, Touching, TouchStep, object_of
from palpate.procedures.records.columns import Column
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.resumed import values_of
from palpate.procedures.records.run import Run, find_run
from palpate.procedures.showing import moduli
from palpate.procedures.showing.figure import logarithmic, name_all, new_figure, save
from palpate.procedures.showing.text import new_table, number, stamped

# --- References: objects whose Young modulus is known, by a statement or by a compression test ---------
#
# read_reference("A: 48 kPa ± 4 %") read_reference("A: runs/20261123T101500Z-test-modulus")

STATED = "stated"
LARGEST = 0.5  # relative uncertainty of a reference's modulus; more tells nothing of a model
EXAMPLE = "write for example 'A: 48 kPa ± 4 %', or 'A: runs/NAME' of a run of palpate test modulus"
_NAME = re.compile(r"[\w.-]+(?: [\w.-]+)*")
_BETWEEN = re.compile(r"±|\+/-|\+-")


@dataclass(frozen=True, slots=True)
class Reference:
    """An object of known modulus.

    Attributes:
        name: name of the object.
        modulus: Young modulus [Pa].
        u: relative standard uncertainty of the modulus.
        source: "stated", or the name of the run that measured it.
        digest: digest of that run; empty: it is stated.
        sample: rubber sample that it is; empty: none.
        simulated: whether a simulated bench measured it; None: it is stated.
        scene: identity of the scene that simulated that bench.

    Raises:
        UsageError: the name has other characters than letters, digits, spaces and ._-, or more than 40.
        RangeError: the modulus is not above 0 and finite, or the uncertainty is not above 0 or above 50 %.
    """

    name: str
    modulus: float
    u: float
    source: str = STATED
    digest: str = ""
    sample: str = ""
    simulated: bool | None = None
    scene: str | None = None

    def __post_init__(self) -> None:
        if len(self.name) > 40 or not _NAME.fullmatch(self.name):
            raise UsageError(f"name {quoted(self.name)} of a reference: give letters, digits, single spaces, or ._-")
        if not 0 < self.modulus < math.inf:
            raise RangeError(
                f"modulus {self.modulus:g} Pa of reference {self.name!r} is not above 0 and finite; give a positive one"
            )
        if not 0 < self.u <= LARGEST:
            raise RangeError(
                f"uncertainty {100 * self.u:.4g} % of reference {self.name!r} is not above 0 and at most"
                f" {100 * LARGEST:g} %; give the standard uncertainty of its modulus, or another reference"
            )

    @property
    def origin(self) -> str:
        """Where the modulus comes from, for people and the file."""
        return f"{self.source}, digest {self.digest[:12]}" if self.digest else self.source

    def object(self, thickness: float) -> Sample:
        """What is mounted: on a simulated bench a rubber sample, or an object of the stated modulus."""
        if self.sample:
            return replace(get_sample(self.sample), name=self.name)
        return object_of(self.modulus, thickness, self.name)


def read_reference(text: str) -> Reference:
    """The reference of a text: its name, and its modulus ± the half-width of its 95 % interval, or a run of it.

    Raises:
        UsageError: the text is no reference, or the run is no complete test of a modulus.
        QuantityError, RangeError: modulus or uncertainty are no quantity, or outside their limits.
        UnknownName: there is no such run. RecordError: it is damaged.
    """
    name, _, rest = (part.strip() for part in text.partition(":"))
    if not name or not rest:
        raise UsageError(f"{quoted(text)} is no reference; {EXAMPLE}")
    modulus, *uncertainty = (part.strip() for part in _BETWEEN.split(rest))
    if len(uncertainty) == 1:
        return _stated(name, parse(modulus, "Pa", "48 kPa"), uncertainty[0])
    if not _is_quantity(modulus, "Pa") and not _is_quantity(modulus, ""):
        return _measured(name, rest)
    raise UsageError(f"{quoted(text)} lacks the unit or the uncertainty of the modulus; {EXAMPLE}")


def _is_quantity(text: str, unit: str) -> bool:
    try:
        parse(text, unit)
    except QuantityError:
        return False
    return True


def _stated(name: str, modulus: float, uncertainty: str) -> Reference:
    if not modulus > 0:
        raise RangeError(f"modulus {show(modulus, 'Pa')} of reference {name!r} is not above 0; give a positive one")
    half = parse(uncertainty, "", "4 %") if uncertainty.endswith("%") else parse(uncertainty, "Pa", "4 %") / modulus
    if not 0 < half <= LARGEST:
        raise RangeError(
            f"± {100 * half:.4g} % of reference {name!r} is not above 0 and at most {100 * LARGEST:g} %; give the"
            " half-width of the 95 % interval of its modulus, or another reference"
        )
    return Reference(name, modulus, half / NORMAL_FACTOR, sample=name if name in SAMPLES else "")


def _measured(name: str, text: str) -> Reference:
    """The tangent modulus of a compression test. Student's factor for its degrees of freedom widens its uncertainty."""
    run = Run.open(find_run(text, store()))
    if run.procedure != ModulusTest.name:
        raise UsageError(f"{run.folder}: is a run of {run.procedure}, which tells no modulus; {EXAMPLE}")
    if run.status != "complete":
        raise UsageError(f"{run.folder}: the run is {run.status}, not complete; resume it, or test the object anew")
    test, header = ModulusTest.recorded(run), run.header
    rows: list[Any] = [{k: v for k, v in row.items() if k not in ("id", "bench_ns")} for row in run.points()]
    points = values_of(DisplaysPoint, rows, f"{run.folder}: its points")
    given = header.get("calibration")
    try:
        calibration = check(given if isinstance(given, dict) else {}, LoadCellCalibration, str(run.folder))
    except ConfigError as error:
        raise RecordError(f"{error}; test the object anew") from None
    found = test.result_of(points, calibration).compression.tangent
    factor = coverage_factor(found.budget.degrees_of_freedom) / NORMAL_FACTOR
    u = factor * found.u / found.value
    return Reference(name, found.value, u, run.folder.name, run.digest(), test.sample, run.simulated, _scene(run))


def _scene(run: Run) -> str | None:
    """Identity of the scene that simulated the bench of a run; None: its bench was real, or nobody knows it."""
    with suppress(tomllib.TOMLDecodeError):
        scene = tomllib.loads(str(run.header["bench"])).get("scene")
        return scene if isinstance(scene, str) else None
    return None


# --- the result ----------------------------------------------------------------------------------------

MODULUS = "modulus of an object"


@dataclass(frozen=True, slots=True)
class ModulusAccuracy:
    """What a number of references is worth for the modulus of an object."""

    references: Annotated[int | None, Column("their number; null: so many that more change nothing")]
    modulus_u: Annotated[float, Column("relative standard uncertainty of a modulus by the calibration alone")]
    half_width: Annotated[float, Column("half of the 95 % interval of ln of the modulus")]


@dataclass(frozen=True, slots=True)
class ReferencesResult:
    """A calibrated model.

    Attributes:
        points: the points.
        calibration: the calibration.
        line: what is left of the validation error for objects that are measured with the same films' calibration.
        accuracies: of a modulus with these references, with another one, and with any number; empty: the spread is not
            known.
        budgets: budgets of the references' mean ratios, and of the constant.
    """

    points: Sequence[SoftnessPoint]
    calibration: ModelCalibration
    line: ValidationLine
    accuracies: tuple[ModulusAccuracy, ...]
    budgets: Sequence[Budget]

    @property
    def achieved_u(self) -> float | None:
        """Relative standard uncertainty of a modulus by the calibration alone; None: the spread is not known."""
        return self.accuracies[0].modulus_u if self.accuracies else None

    @property
    def unbudgeted(self) -> dict[str, tuple[float, float]]:
        """The modulus of an object in units of itself, with the uncertainty that the calibration alone leaves it."""
        return {} if self.achieved_u is None else {MODULUS: (1.0, self.achieved_u)}

    def summary(self) -> dict[str, Any]:
        """The calibration for JSON, without its origin."""
        found = self.calibration.model_dump()
        names = ("parameters", "thickness_m", "references", "constant", "constant_u", "films_u", "pickup_u",
                 "spread", "spread_degrees_of_freedom", "prior", "expires")  # fmt: skip
        return {
            "answered_by": self.calibration.model,
            **{name: found[name] for name in names},
            "factor": math.exp(self.calibration.constant),
            "validation_line": self.line.summary(),
            "worth": [asdict(each) for each in self.accuracies],
        }


def check_range(reference: Reference, curve: RatioCurve) -> float:
    """Sensitivity d ln E / d ln R of a model's curve at a reference.

    Raises:
        RangeError: the curve does not reach to it, or is so flat there that the reference says nothing.
    """
    low, high = curve.moduli
    head = f"reference {reference.name!r} of {show(reference.modulus, 'Pa')}"
    if not low <= reference.modulus <= high:
        raise RangeError(
            f"{head} is outside the {show(low, 'Pa')} to {show(high, 'Pa')} that model {curve.model!r} knows, where a"
            " ratio gives a bound alone; take a reference inside, or another model"
        )
    at = math.log(reference.modulus)
    slope = abs(float(curve.line(at, 1)))
    ratio = float(curve.line(at))
    if not ratio < MOST_SENSITIVE * slope:
        raise RangeError(
            f"{head} lies where 1 % of the ratio of model {curve.model!r} is more than {MOST_SENSITIVE:g} % of the"
            " modulus, so that it tells nothing of the model; take a reference nearer to the stiffness of the sensor's"
            " ring, and test such objects by palpate test modulus"
        )
    return ratio / slope


def evaluate(
    points: Sequence[SoftnessPoint],
    references: Sequence[Reference],
    design: Design,
    question: RatioQuestion,
    curve: RatioCurve,
    origin: Mapping[str, Any],
) -> ReferencesResult:
    """Calibrate a model by the mean ratios over the valid points of each reference.

    Args:
        points: the points.
        references: the references.
        design: the sensor, with the sensitivities of its films.
        question: names the model and its parameter set.
        curve: the model's curve.
        origin: where the calibration comes from: fields of `ModelCalibration`.

    Raises:
        EstimateError: a reference has no valid point, or they contradict each other or the curve.
        RangeError: the curve says nothing at a reference.
    """
    measured, budgets = [], []
    for each in references:
        valid = [point for point in points if point.object == each.name and point.valid]
        if not valid:
            raise EstimateError(
                f"no point of reference {each.name!r} is valid; remove what their flags name, and repeat"
            )
        mean = mean_ratio(f"force ratio of {each.name}", valid, design.film_freedom)
        budgets.append(mean)
        part = dict.fromkeys((SCATTER, NOISE, CALIBRATION, PICKUP), 0.0) | {c.name: c.u for c in mean.components}
        measured.append(
            MeasuredReference(
                each.name,
                each.modulus,
                each.u,
                each.origin,
                mean.value,
                math.hypot(part[SCATTER], part[NOISE]) / mean.value,
                part[CALIBRATION] / mean.value,
                part[PICKUP] / mean.value,
                float(curve.force_ratio(each.modulus)),
                check_range(each, curve),
            )
        )
    validation = validate(question.design, question.parameters, curve.model)
    about = {
        "design": question.design,
        "model": curve.model,
        "parameters": question.parameters,
        "films_degrees_of_freedom": design.film_freedom,
        **origin,
    }
    found = fit_model(measured, validation, about)
    line = found.line(same_films=True)
    return ReferencesResult(points, found, line, _accuracies(found, line), [*budgets, _budget(found)])


def _accuracies(found: ModelCalibration, line: ValidationLine) -> tuple[ModulusAccuracy, ...]:
    count = len(found.references)
    sensitivity = statistics.median(each.sensitivity for each in found.references)
    lines = ((count, line), (count + 1, found.with_more(count + 1)), (None, found.with_more(10**6)))
    return tuple(
        ModulusAccuracy(number, sensitivity * each.u, sensitivity * each.u * coverage_factor(each.degrees_of_freedom))
        for number, each in lines
        if each is not None and each.u is not None
    )


def _budget(found: ModelCalibration) -> Budget:
    """Budget of the constant."""
    freedom = found.spread_degrees_of_freedom or math.inf
    films = found.films_degrees_of_freedom or math.inf
    parts = (
        Component("spread of objects", (found.spread or 0.0) * math.sqrt(found.weight), degrees_of_freedom=freedom),
        Component("moduli, scatter and noise of the references", found.constant_u),
        Component(CALIBRATION, found.films_u, degrees_of_freedom=films),
        Component(PICKUP, found.pickup_u),
    )
    return Budget(f"constant of model {found.model}", found.constant, "", parts)


# --- the procedure -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ReferenceSeries(Procedure[TouchStep, SoftnessPoint, ReferencesResult]):
    """Calibrate a sensor model by references: the constant between its curve and real force ratios, and its spread."""

    name = "calibrate-model"
    point = SoftnessPoint
    calibrates = True

    references: tuple[
        Annotated[
            Reference,
            Setting(
                help="Object of known modulus ± the half-width of its 95 % interval, or 'NAME: RUN' of palpate test"
                " modulus; repeatable.",
                read=read_reference,
                option="--reference",
                metavar="'NAME: MODULUS ± U'",
                repeated=True,
            ),
        ],
        ...,
    ]
    loads: LoadSets = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
    dwell: DwellTime = 1.0
    frequency: Frequency = 10.0
    model: Annotated[str, model_name("Sensor model that is calibrated.")] = "auto"
    parameters: Annotated[str, Setting(help="Its parameter set: thesis, physical, identified or capped.")] = "physical"
    thickness: Annotated[float, Setting("m", "Thickness of the references.")] = 3e-3
    valid_days: ValidDays = 365

    def check(self, target: Target) -> None:
        if not self.references:
            raise RangeError("no reference is given; give at least one")
        for place, each in enumerate(self.references):
            for other in self.references[:place]:
                if each.name == other.name or (each.digest and each.digest == other.digest):
                    names = f"references {other.name!r} and {each.name!r}" if each.name != other.name else ""
                    raise RangeError(
                        f"{names or f'reference {each.name!r}'}: the same is given twice, which would count it double;"
                        " give each once"
                    )
            if target.model is not None and each.simulated is False:
                raise RangeError(
                    f"reference {each.name!r} was measured on hardware, and this bench is simulated; give one that a"
                    " simulated bench measured, or state its modulus"
                )
            if (own := each.object(self.thickness).thickness) != self.thickness:
                raise RangeError(
                    f"reference {each.name!r} is rubber sample {each.sample!r} of {show(own, 'm')}, not of"
                    f" {show(self.thickness, 'm')}; leave --thickness out, or give another object another name"
                )
        check_valid_days(self.valid_days)
        question = self._question(target.design)
        if self.model not in SLOW:
            curve = _curve(question)
            for each in self.references:
                check_range(each, curve)
        self._touches(target.design).check(target)

    def dwells(self) -> Dwells:
        objects = tuple(each.object(self.thickness) for each in self.references)
        return Dwells(objects, (min(self.loads), max(self.loads)), self.frequency, self.dwell)

    def plan(self, target: Target) -> Plan[TouchStep]:
        """All points: every load on every reference; predicted is the uncertainty of a modulus by the calibration."""
        steps = self._touches(target.design).plan(target).steps
        if self.model in SLOW:
            return Plan(self.name, steps)
        curve = _curve(self._question(target.design))
        found, u = self._expected(target.design, curve), self._predicted_u(target.design, curve)
        moduli = [] if u is None else [Expected(MODULUS, u)]
        return Plan(self.name, steps, predicted(steps, [*found, *moduli], u))

    def _expected(self, design: Design, curve: RatioCurve) -> list[Expected]:
        """Relative uncertainty of each reference's mean ratio, and that of the factor between curve and real ratios.

        The ratios are those of the model for the references' moduli, which need not be true: the constant is unknown
        before. Objects are expected to spread about it as the thesis' samples do [M]; where that is not known, no
        spread is expected.
        """
        dwells = [self.dwell] * len(self.loads)
        means, ratios, weights = [], [], []
        spread = validate(design.name, self.parameters, curve.model).ln_spread or 0.0
        for each in self.references:
            ratio = float(curve.force_ratio(each.modulus))
            mean = expected_mean(f"force ratio of {each.name}", design, ratio, self.loads, dwells)
            shared = ratio * math.hypot(calibration_u(design), pickup_u(design) * math.hypot(1.0, 1 / ratio))
            means.append(Expected.of(mean))
            ratios.append(ratio)
            own = math.sqrt(mean.u**2 - shared**2) / ratio
            weights.append(1 / (spread**2 + own**2 + (each.u / check_range(each, curve)) ** 2))
        pickup = math.fsum(pickup_u(design) * math.hypot(1.0, 1 / ratio) for ratio in ratios) / len(ratios)
        constant = math.hypot(1 / math.sqrt(math.fsum(weights)), calibration_u(design), pickup)
        return [*means, Expected(f"constant of model {curve.model}", constant, "ln")]

    def _predicted_u(self, design: Design, curve: RatioCurve) -> float | None:
        """Relative uncertainty of a modulus by the calibration alone; None: the thesis tells no spread."""
        sensitivities = [check_range(each, curve) for each in self.references]
        moduli = [each.u / slope for each, slope in zip(self.references, sensitivities, strict=True)]
        validation = validate(design.name, self.parameters, curve.model)
        ratio_u = expected_u(validation, moduli, design.ratio_scatter / math.sqrt(len(self.loads)))
        return None if ratio_u is None else statistics.median(sensitivities) * ratio_u

    def begin(self, plan: Plan[TouchStep], lab: Lab, record: Recorder) -> Touching:
        check_nameable(lab.bench, "sensor_node")
        for each in self.references:
            if each.simulated is True and not lab.bench.simulated:
                raise ConfigError(
                    f"reference {each.name!r} was measured on a simulated bench, and this one is real; measure it here:"
                    " palpate test modulus"
                )
            if each.simulated and each.scene != lab.scene:
                raise ConfigError(
                    f"reference {each.name!r} was measured on the simulated bench of scene {each.scene or 'unknown'},"
                    f" and this one is of scene {lab.scene or 'unknown'}; measure it here: palpate"
                    " test modulus"
                )
        return Touching(lab, record, self._touches(lab.design))

    def evaluate(self, points: Sequence[SoftnessPoint], plan: Plan[TouchStep], lab: Lab) -> ReferencesResult:
        question = self._question(lab.design)
        origin = {
            "thickness_m": self.thickness,
            "film_calibration": lab.film_hash,
            **lab.origin(SensorNode, self.valid_days),
        }
        return evaluate(points, self.references, lab.design, question, _curve(question), origin)

    def save_calibration(self, done: Finished[ReferencesResult]) -> CalibrationKeys:
        path = keep(done.result.calibration, done.folder, done.replayed)
        return {"model_calibration_file": str(path)}

    def _question(self, design: Design) -> RatioQuestion:
        return RatioQuestion(design.name, self.model, self.parameters, {"sensed_thickness": self.thickness})

    def _touches(self, design: Design) -> SoftnessTest:
        """The softness test of the references, which is how they are measured."""
        objects = tuple(each.object(self.thickness) for each in self.references)
        return SoftnessTest(objects, self.loads, self.dwell, self.frequency, self.model)

    def report(self, result: ReferencesResult, lab: Lab) -> Report:
        curve = _curve(self._question(lab.design))
        return Report(partial(show_references, result, lab.films), partial(plot_references, result, curve))


def _curve(question: RatioQuestion) -> RatioCurve:
    sensor = question.sensor()
    return ratio_curve(sensor, question.load(sensor.ring.material.modulus), question.model)


# --- what it shows -------------------------------------------------------------------------------------


def show_references(result: ReferencesResult, films: FilmCalibration | None, outcome: Outcome) -> list[object]:
    """The references beside the model, the constant and its spread, and what another reference would buy."""
    c = result.calibration
    table = new_table(
        stamped(c.simulated, f"Calibration of model {c.model!r} ({c.parameters} set, {c.design})"),
        "reference", "modulus", "u %", "force\nratio", "u %", "by the\nmodel", "model over\nmeasured", "u %", "source",
    )  # fmt: skip
    for each in c.references:
        table.add_row(
            each.name, show(each.modulus_Pa, "Pa", 4), f"{100 * each.modulus_u:.2g}", number(each.force_ratio),
            f"{100 * math.hypot(each.force_ratio_u, each.films_u, each.pickup_u):.2g}", number(each.model_force_ratio),
            f"{math.exp(each.ln_error):z.4f}", f"{100 * each.ln_error_u:.2g}", each.source,
        )  # fmt: skip
    spread = "not known" if c.spread is None else f"{100 * c.spread:.2g} % of the ratio"
    freedom = "" if c.spread_degrees_of_freedom is None else f" ({moduli.degrees(c.spread_degrees_of_freedom)})"
    return [
        table,
        f"constant       {math.exp(c.constant):z.4f}, by which the model's ratios are divided",
        f"spread         {spread}{freedom}: {c.prior}",
        moduli.absolute_line(result.line),
        f"films          {_films_text(films)}",
        *_modulus_lines(result),
        f"stored in      {outcome['model_calibration_file']}, until {c.expires}",
    ]


def _films_text(films: FilmCalibration | None) -> str:
    if films is None:
        return "not calibrated; what their sensitivities are off by is the same for references and objects, and cancels"
    return f"calibration {films.source}; its error cancels for objects that are measured with it"


def _modulus_lines(result: ReferencesResult) -> list[str]:
    """How accurate a modulus is by the calibration, and what another reference would change."""
    if not result.accuracies:
        return ["another        a second reference tells the spread; until then the absolute uncertainty is not known"]

    def accuracy(u: float, half: float) -> str:
        return f"u {100 * u:.3g} %, 95 % within a factor of {math.exp(half):.3g}"

    now, another, any_number = result.accuracies
    count = counted(now.references or 0, "reference")
    return [
        f"modulus        by {count} {accuracy(now.modulus_u, now.half_width)}",
        f"another        {accuracy(another.modulus_u, another.half_width)}; any number:"
        f" {100 * any_number.modulus_u:.3g} %",
    ]


def plot_references(result: ReferencesResult, curve: RatioCurve, folder: Path) -> Path:
    """Plot ratios over moduli with the model's curve, own and corrected, and the errors; returns the PNG file."""
    c = result.calibration
    figure, (left, right) = new_figure(c.simulated, 2, f"calibration of model {c.model}, design {c.design}")
    given = np.array([each.modulus_Pa for each in c.references])
    ratios = np.array([each.force_ratio for each in c.references])
    least, most = curve.moduli
    moduli_Pa = np.geomspace(max(given.min() / REACH, least), min(given.max() * REACH, most), 200)
    own = curve.force_ratio(np.clip(moduli_Pa, least, most))
    left.plot(1e-3 * moduli_Pa, own, "--", color="0.5", lw=1, label="model")
    corrected = own * math.exp(-c.constant)
    left.plot(1e-3 * moduli_Pa, corrected, "k-", lw=1, label="corrected")
    if result.line.u is not None:
        reach = math.exp(result.line.u)
        left.fill_between(1e-3 * moduli_Pa, corrected / reach, corrected * reach, color="0.85", label="one object, u")
    u = [math.hypot(each.force_ratio_u, each.films_u, each.pickup_u) * each.force_ratio for each in c.references]
    left.errorbar(
        1e-3 * given, ratios, u, 1e-3 * given * [each.modulus_u for each in c.references], "o", capsize=2,
        label="references, u",
    )  # fmt: skip
    left.set(xlabel="modulus (kPa)", ylabel="force ratio")
    logarithmic(left, 1e-3 * moduli_Pa[0], 1e-3 * moduli_Pa[-1])
    name_all(left, 2)
    places, errors = range(len(c.references)), [100 * each.ln_error for each in c.references]
    right.errorbar(places, errors, [100 * each.ln_error_u for each in c.references], fmt="o", capsize=2)
    right.axhline(100 * c.constant, color="k", lw=1)
    if c.spread is not None:
        right.axhspan(100 * (c.constant - c.spread), 100 * (c.constant + c.spread), color="0.85")
    right.set(xticks=places, xticklabels=[each.name for each in c.references])
    right.set(xlabel="reference (line: constant, band: spread)", ylabel="ln of model over measured (%; bars: u)")
    return save(figure, folder)
