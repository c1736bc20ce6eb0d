"""The result of a model's calibration by references: their mean ratios, and the calibration."""

from __future__ import annotations

import math
import re
import statistics
import tomllib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.model_calibration import MeasuredReference, ModelCalibration, fit_model
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
from palpate.instrument.findings.film_forces import CALIBRATION, NOISE, PICKUP, SCATTER, mean_ratio
from palpate.instrument.findings.object_modulus import MOST_SENSITIVE
from palpate.instrument.models.curve import RatioCurve
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.validation import ValidationLine, validate
from palpate.instrument.quantity import parse, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import SAMPLES, Sample, get_sample
from palpate.instrument.uncertainty.budget import NORMAL_FACTOR, Budget, Component, coverage_factor
from palpate.procedures.lab.store import store
from palpate.procedures.measurements.modulus.procedure import ModulusTest
from palpate.procedures.measurements.modulus.result import DisplaysPoint
from palpate.procedures.measurements.softness.procedure import object_of
from palpate.procedures.measurements.softness.result import SoftnessPoint
from palpate.procedures.records.columns import Column
from palpate.procedures.records.resumed import values_of
from palpate.procedures.records.run import Run
from palpate.procedures.records.run_list import find_run

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
    def told(self) -> str:
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
class Worth:
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
        worth: what the references are worth now, with another one, and with any number; empty: the spread is not known.
        budgets: budgets of the references' mean ratios, and of the constant.
    """

    points: Sequence[SoftnessPoint]
    calibration: ModelCalibration
    line: ValidationLine
    worth: tuple[Worth, ...]
    budgets: Sequence[Budget]

    @property
    def achieved_u(self) -> float | None:
        """Relative standard uncertainty of a modulus by the calibration alone; None: the spread is not known."""
        return self.worth[0].modulus_u if self.worth else None

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
            "worth": [asdict(each) for each in self.worth],
        }


def check_range(reference: Reference, curve: RatioCurve) -> float:
    """Sensitivity d ln E / d ln R of a model's curve at a reference.

    Raises:
        RangeError: the curve does not reach to it, or is so flat there that the reference says nothing.
    """
    low, high = curve.moduli
    told = f"reference {reference.name!r} of {show(reference.modulus, 'Pa')}"
    if not low <= reference.modulus <= high:
        raise RangeError(
            f"{told} is outside the {show(low, 'Pa')} to {show(high, 'Pa')} that model {curve.model!r} knows, where a"
            " ratio gives a bound alone; take a reference inside, or another model"
        )
    at = math.log(reference.modulus)
    slope = abs(float(curve.line(at, 1)))
    ratio = float(curve.line(at))
    if not ratio < MOST_SENSITIVE * slope:
        raise RangeError(
            f"{told} lies where 1 % of the ratio of model {curve.model!r} is more than {MOST_SENSITIVE:g} % of the"
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
                each.told,
                mean.value,
                math.hypot(part[SCATTER], part[NOISE]) / mean.value,
                part[CALIBRATION] / mean.value,
                part[PICKUP] / mean.value,
                float(curve.force_ratio(each.modulus)),
                check_range(each, curve),
            )
        )
    known = validate(question.design, question.parameters, curve.model)
    about = {
        "design": question.design,
        "model": curve.model,
        "parameters": question.parameters,
        "films_degrees_of_freedom": design.film_freedom,
        **origin,
    }
    found = fit_model(measured, known, about)
    line = found.line(same_films=True)
    return ReferencesResult(points, found, line, _worth(found, line), [*budgets, _budget(found)])


def _worth(found: ModelCalibration, line: ValidationLine) -> tuple[Worth, ...]:
    count = len(found.references)
    sensitivity = statistics.median(each.sensitivity for each in found.references)
    lines = ((count, line), (count + 1, found.with_more(count + 1)), (None, found.with_more(10**6)))
    return tuple(
        Worth(number, sensitivity * each.u, sensitivity * each.u * coverage_factor(each.degrees_of_freedom))
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
