"""Words for what is wanted of a measurement of a modulus, what is planned, and what is expected of it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from palpate.instrument.findings.mean_ratio import CALIBRATION
from palpate.instrument.quantity import as_typed, counted, show
from palpate.instrument.uncertainty.budget import COVERAGE, Between
from palpate.procedures.measurements.object_modulus.course import LEAST_MOUNTINGS
from palpate.procedures.measurements.object_modulus.prospect import Prospect, Wanted, has_most_sets
from palpate.procedures.measurements.prospects import MOST_SETS, share

ROUNDING = 1e-9
LEAST_SHARE = 0.005  # a smaller one is not told


def wanted_line(wanted: Wanted, model: str) -> str:
    """What was asked for, in words."""
    scale = f"on the scale of {model!r}" if wanted.relative else "absolute"
    if wanted.tolerance is None:
        return f"as good as {as_typed(wanted.time or 0.0, 's')} allow, {scale}"
    within = "" if wanted.time is None else f", within {as_typed(wanted.time, 's')}"
    return f"{share(wanted.tolerance)} {scale}{within}"


def missed_by(wanted: Wanted, reached: float | None) -> str:
    """What was reached instead of the tolerance, to end a sentence; empty: it was reached, or none was asked for."""
    if wanted.tolerance is None or reached is None or reached <= wanted.tolerance * (1 + ROUNDING):
        return ""
    return f": {share(reached)} reached, {share(wanted.tolerance)} was asked for"


def _end(wanted: Wanted, prospect: Prospect) -> str:
    """When a run ends at the latest."""
    plan, bound = prospect.allocation, f"{prospect.times.longest:.0f} s"
    if wanted.tolerance is None and has_most_sets(plan):
        return f"with the {plan.sets:,} load sets that a run has at most; more time buys nothing"
    if wanted.tolerance is None or prospect.times.longest == wanted.time:
        return f"ends at {bound}"
    runs = f"{share(prospect.times.enough)} of runs"
    most = "" if prospect.times.enough == COVERAGE else f", as it has {MOST_SETS:,} load sets at most"
    if wanted.time is not None:
        return f"{runs} need no more than {bound}{most}"
    return f"ends at {bound}, which are enough for {runs}{most}"


def _unknown_mountings(mountings: int, sensitivity: float) -> str:
    """What an unknown scatter of mountings means for a plan."""
    if mountings >= LEAST_MOUNTINGS:
        return "are to tell their scatter; the plan counts no further ones"
    added = share(0.01 * sensitivity / math.sqrt(mountings))
    return f"their scatter is not known and counts as 0: each 1 % adds {added}"


def scatter_told(found: Between) -> str:
    """What is known of the scatter of mountings beyond that of sets, to follow the word mountings."""
    if found.significant:
        return f"scatter by {share(found.u)} of the ratio, at most {share(found.bound_u)} (95 %)"
    return f"scatter no more than their sets let expect, at most {share(found.bound_u)} of the ratio (95 %)"


def planned_lines(wanted: Wanted, prospect: Prospect) -> list[str]:
    """What is planned and what is expected of it."""
    plan, found = prospect.allocation, prospect.found
    expected = prospect.scale_u if wanted.relative else prospect.absolute_u
    person = wanted.mounts.described(plan.mountings, again=True)
    counts = f"{counted(plan.mountings, 'mounting')}, {counted(plan.sets, 'set')}"
    each = f"{show(prospect.load, 'N')}, {show(wanted.frequency, 'Hz')}, {show(plan.dwell, 's')}"
    lines = [
        f"wanted         {wanted_line(wanted, found.model)}",
        f"plan           {counts}, {each} ({person})",
        f"lasts          {prospect.times.mean:.0f} s on average; {_end(wanted, prospect)}",
    ]
    if wanted.mounted_by:
        counted_as = f"{share(wanted.mounted or 0.0)}, {wanted.mounted_freedom:g} degrees of freedom"
        lines += [f"mountings      {wanted.mounted_by}", f"               the plan counts {counted_as}"]
    if wanted.mounted is None and found.sensitivity is not None:
        lines.append(f"mountings      {_unknown_mountings(plan.mountings, found.sensitivity)}")
    if found.sensitivity is None:
        return [*lines, f"expected       only a bound: model {found.model!r} cannot tell such an object from its ratio"]
    told = "not known" if expected is None else share(expected)
    if not wanted.relative and prospect.scale_u is not None:
        told += f" ({share(prospect.scale_u)} on the scale)"
    cancel = found.films_cancel and not wanted.relative
    uncalibrated = "" if cancel or CALIBRATION in plan.shares else ", films not calibrated"
    return [*lines, f"expected       {told}: {parts_of(plan.shares, plan.u)}{uncalibrated}"]


def parts_of(shares: Mapping[str, float], u: float) -> str:
    """The lines of a budget, with what each adds to the uncertainty, the largest first."""
    order = sorted(shares, key=lambda name: -shares[name])
    told = [name for name in order if shares[name] >= LEAST_SHARE] or order[:1]
    return ", ".join(f"{name} {share(u * max(shares[name], 0.0) ** 0.5)}" for name in told)
