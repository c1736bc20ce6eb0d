"""The points and the result of a softness test: Young moduli, and the objects from hard to soft."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.findings.film_forces import CALIBRATION, apart, mean_ratio
from palpate.instrument.findings.object_modulus import COVERAGE, ByReferences, answering, estimate, validation_of
from palpate.instrument.models.price_list import stored
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.sensor.design import Design
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import LAST, Column
from palpate.procedures.steps.flags import CLIPPED

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
    budgets = [budget for name, mean in means.items() for budget in _budgets(found[name], mean, line, cancelled)]
    price = price_of(design, model)
    return SoftnessResult(list(points), list(found.values()), order, alike, model, price, line, budgets)


def _films(mean: Budget) -> float:
    """Part of a mean ratio's uncertainty by the films' calibration."""
    return math.fsum(part.u for part in mean.components if part.name == CALIBRATION)


def _budgets(each: Softness, mean: Budget, line: ValidationLine, cancelled: str = "") -> Iterator[Budget]:
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
    known = [
        (max(bounds), price)
        for price in stored().prices
        if price.design == design.name and price.model == model and (bounds := price.bounds(slice(None)))
    ]
    if not known:
        return f"model {model!r} has no price for design {design.name!r}: its own error is not known"
    error, price = min(known, key=lambda each: each[0])
    return f"model {model!r} ({price.refinement}): error of the ratio at most {error:.1e} by the price list"
