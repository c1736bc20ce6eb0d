"""Prices of accuracy on one page: models, integrators, dwell, arithmetic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from palpate.instrument.models.prices.price_list import PriceList
from palpate.procedures.accuracy.arithmetic import ArithmeticPrice
from palpate.procedures.accuracy.dwell import TARGETS, DwellPrices
from palpate.procedures.accuracy.plot import INTERVAL

TOLERANCES = TARGETS
CPU, BENCH = "CPU time", "dwell on the bench"
MODELS, INTEGRATORS, DWELL, ARITHMETIC = "sensor models", "time integration", "dwell", "arithmetic"


@dataclass(frozen=True, slots=True)
class Way:
    """One method at one setting: relative error (None where it fails) and seconds."""

    name: str
    setting: str
    error: float | None
    seconds: float


@dataclass(frozen=True, slots=True)
class Recommended:
    """The cheapest method that meets a tolerance, or the reason why there is none."""

    tolerance: float
    name: str | None
    setting: str | None
    error: float | None
    seconds: float | None
    why: str


@dataclass(frozen=True, slots=True)
class Part:
    """One part of the page. `floor` is a relative error below which no method comes."""

    name: str
    error_of: str
    time: str
    ways: tuple[Way, ...]
    recommended: tuple[Recommended, ...]
    floor: float = 0.0

    def summary(self) -> dict[str, Any]:
        """The part as JSON has it."""
        return asdict(self)


def of_models(prices: PriceList, design: str) -> Part:
    """Part for the models, from the stored list: each model that answers for the rubber samples, at each refinement.

    A recommendation counts what a caller gets: the promised error, and the whole time of such an answer.
    """
    (reference,) = (r for r in prices.references if r.design == design)
    smallest = min(reference.force_ratios[INTERVAL : INTERVAL + 2])
    ways, offers = [], []
    for price in prices.prices:
        error, seconds = price.errors[INTERVAL], price.seconds
        if price.design == design and seconds is not None:
            way = Way(price.model, price.refinement, None if error is None else error / smallest, seconds)
            ways.append(way)
            promise = price.promise(slice(INTERVAL, INTERVAL + 1))
            if promise is not None and price.answer_s is not None:
                offers.append(replace(way, error=promise / smallest, seconds=price.answer_s))
    recommended = tuple(cheapest(offers, t) for t in TOLERANCES)
    return Part(MODELS, f"force ratio of design {design}", CPU, tuple(ways), recommended)


def of_integrators(ways: Sequence[Way]) -> Part:
    """Part for the integrators of a stiff chain."""
    return _part(INTEGRATORS, "output of a stiff chain over 10 s", CPU, ways)


def of_dwells(prices: DwellPrices, scene: str) -> Part:
    """Part for the dwells: noise and bias of each estimator; recommended dwells by least squares, with the floor."""
    ways = [Way(p.estimator, f"{p.dwell_s:g} s", (p.u**2 + p.bias**2) ** 0.5, p.dwell_s) for p in prices.points]
    recommended = tuple(
        Recommended(r.target, r.why, f"{r.dwell_s:g} s", r.u, r.dwell_s, "")
        if r.dwell_s is not None
        else Recommended(r.target, None, None, None, None, r.why)
        for r in prices.recommended
    )
    error_of = f"force ratio of scene {scene}, noise and bias"
    return Part(DWELL, error_of, BENCH, tuple(ways), recommended, prices.floor_u)


def of_arithmetic(measured: Sequence[ArithmeticPrice]) -> list[Part]:
    """Parts for the arithmetic, one for each task."""
    tasks = dict.fromkeys(m.task for m in measured)
    return [
        _part(
            f"{ARITHMETIC}: {task}", task, CPU, [Way(m.way, "", m.error, m.seconds) for m in measured if m.task == task]
        )
        for task in tasks
    ]


def _part(name: str, error_of: str, time: str, ways: Sequence[Way]) -> Part:
    return Part(name, error_of, time, tuple(ways), tuple(cheapest(ways, t) for t in TOLERANCES))


def cheapest(ways: Sequence[Way], tolerance: float) -> Recommended:
    """The fastest method whose error is within the tolerance; of equally fast ones the most accurate."""
    known = [way for way in ways if way.error is not None]
    good = [way for way in known if way.error is not None and way.error <= tolerance]
    if not good:
        best = min((way.error for way in known if way.error is not None), default=None)
        why = "none answers" if best is None else f"the best is off by {best:.2g}"
        return Recommended(tolerance, None, None, None, None, why)
    found = min(good, key=lambda way: (way.seconds, way.error))
    return Recommended(tolerance, found.name, found.setting, found.error, found.seconds, "")
