"""What a measurement of softness reads and finds: moduli by the mean force ratio, and the objects from hard to soft."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from palpate.instrument.findings.mean_ratio import apart, mean_ratio
from palpate.instrument.findings.object_modulus import COVERAGE, estimate
from palpate.instrument.models.prices.price_list import stored
from palpate.instrument.models.ratio import Question
from palpate.instrument.sensor.design import Design
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.steps.flags import CLIPPED


@dataclass(frozen=True, slots=True)
class SoftnessPoint:
    """One object under one load, peak to peak. Not `valid`: `flags` say why. Uncertainties as of `LoadPoint`."""

    object: str
    load_N: float
    load_measured_N: float
    load_measured_u: float
    force_ratio: float
    force_ratio_u: float
    noise_u: float
    valid: bool
    flags: tuple[str, ...]
    calibration_u: float = 0.0
    pickup_u: float = 0.0
    degrees_of_freedom: float | None = None


@dataclass(frozen=True, slots=True)
class Softness:
    """An object: mean force ratio over its valid loads, and the modulus by the model [Pa].

    `modulus_Pa` is None where only a bound is known, `low_Pa` and `high_Pa` where there is none; `kind` is "interval",
    "at least", "at most" or "any". `model_error`: what the interval allows for the model, as a ratio; None: not priced.
    `saturated`: of a film in some load. Without a valid load all but the name is None.
    """

    object: str
    valid_points: int
    saturated: bool
    force_ratio: float | None = None
    force_ratio_u: float | None = None
    modulus_Pa: float | None = None
    low_Pa: float | None = None
    high_Pa: float | None = None
    sensitivity: float | None = None
    kind: str | None = None
    note: str = ""
    model_error: float | None = None


@dataclass(frozen=True, slots=True)
class SoftnessResult:
    """`alike`: neighbours in the order, hard to soft, that the ratios do not tell apart by 95 %.

    `budgets`: of each mean ratio, and, linear, of each modulus that is known; its interval is not linear.
    """

    points: list[SoftnessPoint]
    objects: list[Softness]
    softness_order: list[str]
    alike: list[tuple[str, str]]
    model: str
    price: str
    budgets: list[Budget]

    def summary(self) -> dict[str, Any]:
        """Results under their public names."""
        return {
            "objects": [asdict(each) for each in self.objects],
            "softness_order": self.softness_order,
            "alike": [list(pair) for pair in self.alike],
            "coverage": COVERAGE,
            "answered_by": self.model,
            "price": self.price,
            "budgets": [budget.summary() for budget in self.budgets],
        }


def evaluate(points: Sequence[SoftnessPoint], design: Design, question: Question) -> SoftnessResult:
    """Moduli by the mean ratio over the valid loads, and the objects from hard to soft.

    `question` names the model that turns a ratio into a modulus, and the thickness of the objects.
    """
    means: dict[str, Budget] = {}
    found: dict[str, Softness] = {}
    for name in dict.fromkeys(point.object for point in points):
        own = [point for point in points if point.object == name]
        valid = [point for point in own if point.valid]
        found[name] = Softness(name, len(valid), any(CLIPPED in point.flags for point in own))
        if valid:
            means[name] = mean_ratio(f"force ratio of {name}", valid, design.film_freedom)
    model = question.model
    if means:
        ratios, uncertainties, freedom = zip(
            *((mean.value, mean.u, mean.degrees_of_freedom) for mean in means.values()), strict=True
        )
        rows = estimate(question, ratios, uncertainties, freedom)
        for name, row in zip(means, rows, strict=True):
            model = row.pop("model")
            found[name] = Softness(name, found[name].valid_points, found[name].saturated, **row)
    order = sorted(means, key=lambda name: means[name].value, reverse=True)
    alike = [pair for pair in itertools.pairwise(order) if not apart(means[pair[0]], means[pair[1]])]
    budgets = [budget for name, mean in means.items() for budget in _budgets(found[name], mean)]
    return SoftnessResult(list(points), list(found.values()), order, alike, model, price_of(design, model), budgets)


def _budgets(each: Softness, mean: Budget) -> Iterator[Budget]:
    """Of the mean ratio; and of the modulus where it is known, with what the model may be wrong by."""
    yield mean
    if each.modulus_Pa is None or each.sensitivity is None:
        return
    slope = each.sensitivity * each.modulus_Pa / mean.value
    # The model's error is a bound: a rectangle of that half width.
    model = Component("model", (each.model_error or 0.0) / math.sqrt(3), slope)
    parts = tuple(replace(part, sensitivity=slope) for part in mean.components)
    yield Budget(f"modulus of {each.object}", each.modulus_Pa, "Pa", (*parts, model))


def price_of(design: Design, model: str) -> str:
    """What the price list says of the model's error for this design, in a sentence."""
    known = [
        (promise, price)
        for price in stored().prices
        if price.design == design.name and price.model == model and (promise := price.promise(slice(None))) is not None
    ]
    if not known:
        return f"model {model!r} has no price for design {design.name!r}: its own error is not known"
    error, price = min(known, key=lambda each: each[0])
    return f"model {model!r} ({price.refinement}): error of the ratio at most {error:.1e} by the price list"
