"""Prices of accuracy on one page: the modulus, models, integrators, dwell, arithmetic.

Each part has units of its own; its table and its panel show the same ways.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from palpate.instrument.models.price_list import PriceList
from palpate.instrument.quantity import show
from palpate.procedures.accuracy.arithmetic import ArithmeticPrice
from palpate.procedures.accuracy.dwell import TARGETS, DwellPrices
from palpate.procedures.accuracy.modulus.front import ModulusFront
from palpate.procedures.accuracy.modulus.report import plan_text
from palpate.procedures.accuracy.plot import INTERVAL

TOLERANCES = TARGETS
CPU, BENCH = "processor time (s)", "bench time after the mounting (s)"
MODULUS, MODELS, INTEGRATORS = "modulus", "sensor models", "time integration"
DWELL, ARITHMETIC = "dwell", "arithmetic"
SCALE, ABSOLUTE, MEAN = "on the model's scale", "absolute", "mean of load sets"


@dataclass(frozen=True, slots=True)
class MethodPoint:
    """One method at one setting: relative error (None where it fails) and seconds."""

    name: str
    setting: str
    error: float | None
    seconds: float


@dataclass(frozen=True, slots=True)
class RecommendedMethod:
    """The cheapest method that meets a tolerance, or the reason why there is none."""

    tolerance: float
    name: str | None = None
    setting: str | None = None
    error: float | None = None
    seconds: float | None = None
    why: str = ""


@dataclass(frozen=True, slots=True)
class PagePart:
    """One part of the page.

    Attributes:
        error_of: what has the relative error.
        time: what the seconds of its ways are.
        floor: relative error below which no way comes, as `floor_of` says; 0: there is none.
        note: what else to know, for people.
    """

    name: str
    error_of: str
    time: str
    ways: tuple[MethodPoint, ...]
    recommended: tuple[RecommendedMethod, ...]
    floor: float = 0.0
    floor_of: str = ""
    note: str = ""

    def summary(self) -> dict[str, Any]:
        """The part as JSON has it."""
        return asdict(self)


def of_modulus(front: ModulusFront) -> PagePart:
    """Part for the modulus of an object: the front of `palpate accuracy modulus`, and plans on the model's scale."""
    ways = [MethodPoint(SCALE, plan_text(point.plan), point.plan.scale_u, point.after) for point in front.points]
    ways += [MethodPoint(ABSOLUTE, plan_text(point.plan), point.plan.absolute_u, point.after) for point in front.points]
    recommended = [
        RecommendedMethod(each.tolerance, SCALE, plan_text(each.plan), each.plan.scale_u, each.after)
        if each.plan is not None
        else RecommendedMethod(each.tolerance, why=each.why)
        for each in front.targets
        if not each.absolute
    ]
    model = front.found.model
    note = (
        f"absolute: not known, since the validation error of model {model!r} is not"
        if front.model_u is None
        else f"absolute: no bench time gets below {front.model_u:.2g}, the validation error of model {model!r}"
    )
    return PagePart(
        name=MODULUS,
        error_of=f"Young modulus of an object of {show(front.modulus, 'Pa')}",
        time=BENCH,
        ways=tuple(ways),
        recommended=tuple(recommended),
        floor=front.model_u or 0.0,
        floor_of="absolute, the model's error",
        note=f"{note}: palpate accuracy modulus",
    )


def of_models(prices: PriceList, design: str) -> PagePart:
    """Part for the models, from the stored list: each answer that a caller gets, with promised error and whole time."""
    (reference,) = (r for r in prices.references if r.design == design)
    smallest = min(reference.force_ratios[INTERVAL : INTERVAL + 2])
    ways = []
    for price in prices.prices:
        promise = price.promise(slice(INTERVAL, INTERVAL + 1))
        if price.design == design and promise is not None and price.answer_s is not None:
            ways.append(MethodPoint(price.model, price.refinement, promise / smallest, price.answer_s))
    return _part(MODELS, f"force ratio of design {design}, one answer", CPU, ways)


def of_integrators(ways: Sequence[MethodPoint]) -> PagePart:
    """Part for the integrators of a stiff chain."""
    return _part(INTEGRATORS, "output of a stiff chain over 10 s", CPU, ways)


def of_dwells(prices: DwellPrices, scene: str) -> PagePart:
    """Part for the dwells: the whole uncertainty of one load set by each estimator, and means of sets for targets."""
    ways = [MethodPoint(p.estimator, f"{p.dwell_s:g} s", p.whole_u, p.seconds) for p in prices.points]
    recommended = []
    for r in prices.recommended:
        if r.u is None or r.seconds is None:
            recommended.append(RecommendedMethod(r.target, why=r.why))
            continue
        setting = f"{r.sets:,} x {r.dwell_s:g} s by {r.estimator}"
        recommended.append(RecommendedMethod(r.target, MEAN, setting, r.u, r.seconds))
        ways.append(MethodPoint(MEAN, setting, r.u, r.seconds))
    return PagePart(
        name=DWELL,
        error_of=f"force ratio of scene {scene}",
        time=BENCH,
        ways=tuple(ways),
        recommended=tuple(recommended),
        floor=prices.floor_u,
        floor_of="one load set, whatever its dwell",
    )


def of_arithmetic(measured: Sequence[ArithmeticPrice]) -> list[PagePart]:
    """Parts for the arithmetic, one for each task."""
    tasks = dict.fromkeys(m.task for m in measured)
    return [
        _part(
            f"{ARITHMETIC}: {task}",
            task,
            CPU,
            [MethodPoint(m.way, "", m.error, m.seconds) for m in measured if m.task == task],
        )
        for task in tasks
    ]


def _part(name: str, error_of: str, time: str, ways: Sequence[MethodPoint]) -> PagePart:
    return PagePart(name, error_of, time, tuple(ways), tuple(cheapest(ways, t) for t in TOLERANCES))


def cheapest(ways: Sequence[MethodPoint], tolerance: float) -> RecommendedMethod:
    """The fastest method whose error is within the tolerance; of equally fast ones the most accurate."""
    known = [way for way in ways if way.error is not None]
    good = [way for way in known if way.error is not None and way.error <= tolerance]
    if not good:
        best = min((way.error for way in known if way.error is not None), default=None)
        why = "none answers" if best is None else f"the best is off by {best:.2g}"
        return RecommendedMethod(tolerance, why=why)
    found = min(good, key=lambda way: (way.seconds, way.error))
    return RecommendedMethod(tolerance, found.name, found.setting, found.error, found.seconds)
