"""A target that cannot be reached: which line binds, the best there is, and other ways there."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import replace

from palpate.instrument.allocation.allocate import BelowFloor
from palpate.instrument.errors import RangeError, UsageError
from palpate.instrument.findings.mean_ratio import CALIBRATION, PICKUP
from palpate.instrument.findings.object_modulus import answering
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.quantity import LARGEST_TOLERANCE
from palpate.instrument.sensor.design import Design
from palpate.procedures.measurements.object_modulus.alternatives import command_of, quickest
from palpate.procedures.measurements.object_modulus.lines import CURVE, MOUNTED, VALIDATION, ExpectedRatio, Wanted
from palpate.procedures.measurements.object_modulus.preparing import COMPRESSION, prepared, references_of
from palpate.procedures.measurements.object_modulus.prospect import Prospect, best_of, sets_of
from palpate.procedures.measurements.repeated_sets import MOST_SETS, reachable
from palpate.procedures.measurements.repeated_sets import share as percent
from palpate.procedures.showing.plan import duration

NEEDS_MOUNTINGS = 0.05  # tolerance below which the scatter of mountings must be known
REFERENCES = 6  # as many as pay
LEAST_BY_COMPRESSION = 0.02
LEAST_TOLERANCE = 1e-6
CLOSE_TO = 1.002  # the ratio of two tolerances that are told alike
REMEDIES = {
    CALIBRATION: "calibrate the films at more points: palpate calibrate films",
    PICKUP: "tie the films' cables down, and give the smaller pick-up in the bench file",
    CURVE: "ask a finer model, such as --model auto",
    MOUNTED: "leave the number of mountings to the plan, without --mountings",
}


def below_floor(
    wanted: Wanted,
    question: RatioQuestion,
    found: ExpectedRatio,
    design: Design,
    loads: Sequence[float],
    error: BelowFloor,
) -> RangeError:
    """The refusal of a tolerance below the floor."""
    best = f"best now  {reachable(_least_tolerance(design, found, _free(wanted), tuple(loads), error.floor))}"
    share = f"{100 * (wanted.tolerance or 0.0):.3g} %"
    if error.line != VALIDATION:
        ways = _prepared(wanted, question, found, design, loads)
        if not ways and not (error.line == CURVE and found.model == answering(replace(question, model="auto"))):
            ways = [f"or        {REMEDIES[error.line]}"]
        if (wanted.tolerance or 0.0) >= LEAST_BY_COMPRESSION:
            ways = [*ways, _by_compression(wanted)]
        told_floor = f"{error.line} leaves {percent(error.floor)}, which no time on the bench lowers"
        return RangeError("\n  ".join([f"--tolerance {share} cannot be reached: {told_floor}", best, *ways]))
    factor = math.exp((found.sensitivity or 1.0) * (found.validation.u or 0.0))
    lines = [
        f"--tolerance {share} absolute cannot be reached: the model binds: {error.line} of {found.model!r} leaves"
        f" {percent(error.floor)}, a factor of {factor:.2g} ({found.validation.source})",
        best,
        *(_prepared(wanted, question, found, design, loads) or _with_references(question, found, design)),
        _by_compression(wanted),
        *_on_scale(wanted, found, design, loads),
    ]
    return RangeError("\n  ".join(lines))


def too_many_sets(
    wanted: Wanted, found: ExpectedRatio, design: Design, loads: Sequence[float], prospect: Prospect
) -> RangeError:
    """The refusal of a tolerance above the floor that takes more load sets than a run has."""
    plan = prospect.allocation
    least = _least_tolerance(design, found, _free(wanted), tuple(loads), 0.0)
    return RangeError(
        f"--tolerance {100 * (wanted.tolerance or 0.0):.3g} % cannot be reached: {plan.binds} binds: it takes"
        f" {plan.sets:,} load sets, above the {MOST_SETS:,} of a run\n  best now  {reachable(least)}"
    )


def _free(wanted: Wanted) -> Wanted:
    """What is wanted, whatever the tolerance and the time."""
    return replace(wanted, tolerance=None, time=None)


@functools.lru_cache(maxsize=64)
def _least_tolerance(
    design: Design, found: ExpectedRatio, wanted: Wanted, loads: tuple[float, ...], floor: float
) -> float:
    """The least tolerance whose plan has no more load sets than a run; it is above `floor`, which no time lowers."""
    low, high = max(floor, LEAST_TOLERANCE), max(LARGEST_TOLERANCE, 2 * floor)
    while high > CLOSE_TO * low:
        middle = math.sqrt(low * high)
        try:
            sets = sets_of(design, found, replace(wanted, tolerance=middle), loads)
        except RangeError:  # so little above the floor that it takes centuries
            sets = MOST_SETS + 1
        low, high = (low, middle) if sets <= MOST_SETS else (middle, high)
    return high


def not_known(wanted: Wanted, found: ExpectedRatio, design: Design, loads: Sequence[float]) -> RangeError:
    """The refusal of an absolute tolerance where the model's validation error is not known."""
    share = f"{100 * (wanted.tolerance or 0.0):.3g} %"
    lines = [
        f"--tolerance {share} absolute cannot be promised: the validation error of {found.model!r} is"
        f" {found.validation.source}",
        _by_compression(wanted),
        *_on_scale(wanted, found, design, loads),
    ]
    return RangeError("\n  ".join(lines))


def check_mountings(wanted: Wanted, found: ExpectedRatio, tolerance: float) -> None:
    """Refuse a tolerance that needs the scatter of mountings where that was never measured. Raises UsageError."""
    if tolerance >= NEEDS_MOUNTINGS or wanted.mounted is not None or (wanted.mountings or 1) >= 3:
        return
    percent = (found.sensitivity or 1.0) * 0.01
    raise UsageError(
        f"--tolerance {100 * tolerance:.3g} % needs the scatter of the ratio from mounting to mounting, which was never"
        f" measured: 1 % of it alone makes {100 * percent:.2g} % of the modulus with one mounting\n"
        "  either  --mountings 3, which measures it, and stores it for this sensor; its two degrees of freedom make"
        " the interval twice as wide\n"
        "  or      --mounting-scatter '1 %', if an earlier measurement told it; '0 %' takes none for granted"
    )


def _by_compression(wanted: Wanted) -> str:
    """The compression test of this bench [M]; of an object that is no rubber sample, by the name of one of its size."""
    sample = f"--sample {wanted.sample}" if wanted.sample else "with --sample for one of its size"
    return f"or        2 to 4 % in {COMPRESSION:.0f} s, where it can be taken off: palpate test modulus {sample}"


def _with_references(question: RatioQuestion, found: ExpectedRatio, design: Design) -> list[str]:
    """What as many references as pay would leave; empty: not known."""
    made = references_of(question, found, design)
    if made is None:
        return []
    count = max(REFERENCES, made.least)
    left, seconds = math.hypot(made.rest, made.u / math.sqrt(count)), duration(made.seconds(count))
    how = command_of(VALIDATION, count)
    return [f"or        {100 * left:.2g} % with {count} references ({seconds}, once): {how}"]


def _prepared(
    wanted: Wanted, question: RatioQuestion, found: ExpectedRatio, design: Design, loads: Sequence[float]
) -> list[str]:
    """What other sessions make the tolerance reachable, as quickly as can be; empty: none do."""
    best = quickest(prepared(question, found, wanted, design, loads), len(design.teeth))
    if best is None or (wanted.time is not None and best.run_s > wanted.time):
        return []
    return [f"or        as asked with {best.told}: {best.how}"]


def _on_scale(wanted: Wanted, found: ExpectedRatio, design: Design, loads: Sequence[float]) -> list[str]:
    """What the tolerance costs on the model's scale; empty: it is not reached there either."""
    try:
        plan = best_of(design, found, replace(wanted, time=None, relative=True), loads)
    except RangeError:
        return []
    share = f"{100 * (wanted.tolerance or 0.0):.3g} %"
    seconds = duration(plan.times.mean)
    return [f"or        {share} on the scale of {found.model!r}, about {seconds}: --relative-to-model"]
