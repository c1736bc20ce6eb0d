"""What the runs of a calibration so far tell: how well the sensitivity is known, and how many runs there shall be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.instrument.allocation.allocate import BelowFloor
from palpate.instrument.allocation.lines import Line, Unit, budget
from palpate.instrument.allocation.stopping import FIRST
from palpate.instrument.calibration.classification import Run
from palpate.instrument.calibration.load_cell_curve import CURVE, POSITIONS, REPEATABILITY, load_cell_curve
from palpate.instrument.errors import RangeError
from palpate.procedures.measurements.load_cell.expected import told
from palpate.procedures.measurements.load_cell.result import LoadCellPoint
from palpate.procedures.measurements.load_cell.series import RESERVE, Wanted, lines_of, planned, run_seconds
from palpate.procedures.showing.plan import duration

DEVIATION = "deviation from the curve"


@dataclass(frozen=True, slots=True)
class Learned:
    """What the runs so far tell.

    Attributes:
        u: relative standard uncertainty of the sensitivity that they give.
        runs: number of runs in each position that reach the tolerance, at least those that are done.
        why_not: why no further run reaches it; empty: the runs do.
    """

    u: float
    runs: int
    why_not: str


def learned(wanted: Wanted, loads: Sequence[float], runs: Sequence[Run], step: float) -> Learned:
    """What complete runs tell of the tolerance; `step`: step of the indicator's display [mV]."""
    load, done = np.asarray(loads, dtype=np.float64), math.ceil(len(runs) / wanted.positions)
    fitted = load_cell_curve(load, runs, step, wanted.degree, wanted.loads_u)
    found, curve = fitted.sensitivity, fitted.curve
    u = found.u / found.value
    degree, scatter = curve.coefficients.size - 1, fitted.scatter_mV or step / math.sqrt(12)
    parts = {part.name: part for part in found.components}
    fixed = [Line(POSITIONS, parts[POSITIONS].u / found.value, Unit.NOTHING)] if parts[POSITIONS].u else []

    def lines_by(number: int) -> list[Line]:
        return lines_of(loads, curve.reading(load), degree, scatter, step, number, wanted.loads_u) + fixed

    if curve.by_scatter:
        of_noise = budget(lines_of(loads, curve.reading(load), degree, scatter, step, len(runs), 0.0), 1, len(runs), 1)
        off = math.sqrt(max((parts[CURVE].u / found.value) ** 2 - of_noise.u**2, 0.0))
        fixed.append(Line(DEVIATION, off, Unit.NOTHING))
    least = done
    if differing := parts.get(REPEATABILITY):
        fixed.append(Line("runs", differing.u / found.value * math.sqrt(len(runs)), Unit.SET))
        least = max(done, FIRST)  # the scatter of the runs themselves decides: few of them tell little of it
    if wanted.tolerance is None or (u <= wanted.tolerance and len(runs) >= least * wanted.positions):
        return Learned(u, done, "")
    try:
        plan = planned(wanted, tuple(loads), lines_by)
    except BelowFloor as error:
        return Learned(u, done, f"{error.line} leaves {told(error.floor)}, which no further run lowers")
    except RangeError:  # by the scatter that was found no time is enough
        return Learned(u, done, "by the scatter that was found no number of runs is enough")
    return Learned(u, max(plan.runs, least), "")


def late(wanted: Wanted, points: Sequence[LoadCellPoint], loads: int, part: float) -> bool:
    """Whether another run would not end within the time, of which `part` is for the positions up to this one.

    Args:
        wanted: the tolerance or the time.
        points: points of all complete runs.
        loads: number of loads of a run.
        part: share of the time.
    """
    if wanted.time is None:
        return False
    taken = math.fsum(point.seconds or 0.0 for point in points)
    return taken + run_seconds(loads) + RESERVE > part * wanted.time


def stopped(wanted: Wanted, found: Learned, *, by_time: bool) -> str:
    """Why the series ended, for people; `by_time`: whether the time has no place for another run."""
    why = found.why_not
    if not why and (wanted.tolerance is None or found.u > wanted.tolerance):
        why = "the most runs that were planned are done"
        if by_time:
            why = f"another run would not have ended within {duration(wanted.time or 0.0)}"
    asked = "" if wanted.tolerance is None else f", {told(wanted.tolerance)} was asked for"
    return f"{told(found.u)} reached{asked}{f'; {why}' if why else ''}"
