"""A tolerance of each film's force sensitivity, or a time: how often the loads are set on the way up.

The sensitivity is the slope of the line through all load sets. The first sets tell how much they scatter about it, and
that tells how many rounds of the loads there are in all, as `instrument.allocation.stopping` has it. The error of the
load cell is common to all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np

from palpate.instrument.allocation.allocate import Allocation, BelowFloor, allocate
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget, merged
from palpate.instrument.allocation.stopping import FIRST, answer, enough, first_sets
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.mean_ratio import NOISE, PRIOR_FREEDOM, SCATTER
from palpate.instrument.quantity import as_typed, counted, show
from palpate.instrument.sensor.design import Film
from palpate.instrument.uncertainty.budget import Component
from palpate.procedures.engine.plan import Predicted
from palpate.procedures.engine.promise import RESULTS
from palpate.procedures.lab.mounts import BY_HAND, Mounts
from palpate.procedures.measurements.characterise.definitions import RESOLUTION, SNR
from palpate.procedures.measurements.characterise.expected import Conditions, expected_figures
from palpate.procedures.measurements.characterise.point import LEAST_LOADS, LOADING, FilmsPoint
from palpate.procedures.measurements.characterise.uncertainty import cell_component
from palpate.procedures.measurements.prospects import reading_u
from palpate.procedures.measurements.repeated_sets import MOST_SETS, in_rounds, most_sets, reachable, share
from palpate.procedures.showing.plan import duration

READING = "reading of the loads"
LOAD_CELL = "load cell"
RESERVE = 1.0  # s, for a round that takes longer than usual
ROUNDING = 1e-9  # of a tolerance

Set = tuple[float, float]  # a load [N], and a film's voltage under it [V]


@dataclass(frozen=True)
class SlopeRepeats:
    """Rounds of loads that give the force sensitivities a tolerance, or that fill a time.

    Attributes:
        of: the conditions; the loads are those of one round.
        costs: bench times of a load set on the way up, and in `start` of all that is beside these sets.
        after: of that, the time after the last round [s].
        tolerance: relative standard uncertainty of each film's sensitivity; None: as good as the time allows.
        time: bench time of the run [s]; None: as long as the tolerance takes.
        mounts: who mounts the sample, and how long that takes.
    """

    of: Conditions
    costs: Costs
    after: float
    tolerance: float | None
    time: float | None
    mounts: Mounts = BY_HAND

    @cached_property
    def allocation(self) -> Allocation:
        """The plan in whole rounds, by the film that needs most of them.

        Raises:
            RangeError: the load cell alone is not below the tolerance, it takes too many sets, or not one round fits
                into the time; the message says what would do.
        """
        return _allocation(self)

    def lines(self, film: Film) -> tuple[BudgetLine, ...]:
        """Lines of a film's sensitivity."""
        loads, cell = np.array(self.of.loads), cell_component(self.of.cell)
        away = loads - loads.mean()
        weight = math.sqrt(loads.size) * away / float(away @ away)

        def slope_u(each: np.ndarray | float) -> float:
            """Relative uncertainty of the slope by one load set [1], of errors of the loads [N]."""
            return float(np.linalg.norm(weight * each))

        return (
            BudgetLine(SCATTER, slope_u(film.scatter * loads), RepeatUnit.SET, PRIOR_FREEDOM),
            BudgetLine(NOISE, slope_u(self.of.noise(film)) * math.sqrt(self.of.dwell), RepeatUnit.SECOND),
            BudgetLine(READING, slope_u(reading_u(self.of.cell, 1.0)), RepeatUnit.SET),
            BudgetLine(LOAD_CELL, cell.u, RepeatUnit.NOTHING, cell.degrees_of_freedom),
        )

    @cached_property
    def most(self) -> int:
        """The most rounds of a run."""
        loads = len(self.of.loads)
        return min(most_sets(self.allocation, loads), MOST_SETS) // loads

    def has_enough(self, points: Sequence[FilmsPoint]) -> bool:
        """Whether no further round is needed, by all points so far."""
        up = [point for point in points if point.direction == LOADING]
        if not up or len(up) % len(self.of.loads):
            return False
        sets = tuple(_sets(points, number) for number in range(len(self.of.design.films)))
        return self._known(sets) or self._late(points)

    def found(self, points: Sequence[FilmsPoint]) -> list[Component]:
        """Relative uncertainty of each film's slope, without that of the load cell; empty: too few sets are valid."""
        sets = [_sets(points, number) for number in range(len(self.of.design.films))]
        return [self._line(number, each) for number, each in enumerate(sets) if each]

    def stopped(self, sensitivities: Sequence[tuple[str, float]]) -> str:
        """Why the run ended, for people; `sensitivities`: each film with the relative uncertainty that it reached."""
        if self.tolerance is None:
            return f"another round of loads would not have ended within {show(self.time or 0.0, 's')}"
        within = "" if self.time is None else f" within {show(self.time, 's')}"
        missed = [f"{share(u, 3)} of film {film}" for film, u in sensitivities if u > self.tolerance * (1 + ROUNDING)]
        if not missed:
            return f"{share(self.tolerance, 3)} reached{within}"
        return f"{share(self.tolerance, 3)} NOT REACHED{within}: {', '.join(missed)}"

    def _known(self, sets: Sequence[Sequence[Set]]) -> bool:
        """Whether the valid sets of all films reach the tolerance, or no time would."""
        return self.tolerance is not None and all(
            len(each) >= FIRST and self._enough(number, each, self.tolerance) for number, each in enumerate(sets)
        )

    def _enough(self, number: int, sets: Sequence[Set], tolerance: float) -> bool:
        film, plan = self.of.design.films[number], self.allocation
        try:
            verdict = enough(self.lines(film), self.costs, tolerance, plan, 1.0, [self._apart(film, sets)])
        except RangeError:  # by the scatter that was found no time is enough
            return True
        cell = cell_component(self.of.cell).u
        return bool(verdict.why) and math.hypot(self._line(number, sets).u, cell) <= tolerance * (1 + ROUNDING)

    def _line(self, number: int, sets: Sequence[Set]) -> Component:
        film, plan = self.of.design.films[number], self.allocation
        lines = self.lines(film)
        by_time = self.tolerance is None or len(sets) < first_sets(plan)
        found = answer(lines, plan, 1.0, [self._apart(film, sets)], by_time=by_time).budget
        parts = [part for part in found.components if part.name != LOAD_CELL]
        least = budget([line for line in lines if line.name in (NOISE, READING)], 1, len(sets), plan.dwell).u
        u = max(math.hypot(*(part.u for part in parts)), least)  # a display may round a load alike in every round
        return Component("line", u, 1.0, min(part.degrees_of_freedom for part in parts), "A")

    def _apart(self, film: Film, sets: Sequence[Set]) -> list[float]:
        """How far each set alone would move the slope, as the exponential that the rules of ratios take.

        A residual counts in standard deviations that are expected of it.
        """
        loads, volts = (np.array(values) for values in zip(*sets, strict=True))
        expected = np.interp(loads, self.of.loads, self.of.apart(film))
        away = loads - loads.mean()
        square, size = float(away @ away), len(sets)
        slope = float(away @ volts) / square
        residuals = volts - volts.mean() - slope * away
        zeroth, first, second = (float(away**power @ expected**2) for power in range(3))
        of_line = zeroth / size**2 + 2 * away * first / size / square + (away / square) ** 2 * second
        own = (1 - 2 / size - 2 * away**2 / square) * expected**2
        of_set = budget(
            [line for line in self.lines(film) if line.per is not RepeatUnit.NOTHING], 1, 1, self.of.dwell
        ).u
        moved: list[float] = np.exp(of_set * residuals / slope / np.sqrt(own + of_line)).tolist()
        return moved

    def _late(self, points: Sequence[FilmsPoint]) -> bool:
        """Whether another round would take longer than the time."""
        if self.time is None:
            return False
        taken = math.fsum(point.seconds or 0.0 for point in points)
        return taken + self._round + self.after + RESERVE > self.time

    @property
    def _round(self) -> float:
        """Bench time of a round [s]."""
        return len(self.of.loads) * (self.costs.set + self.of.dwell)

    def predicted(self, times: Sequence[float], force_limit: float) -> Predicted:
        """What the run is predicted to take and to give; a plan for people. Arguments as for `expected_figures`."""
        plan, loads = self.allocation, len(self.of.loads)
        rounds = plan.sets // loads
        figures = expected_figures(self.of, rounds, times, force_limit, self._slope_u)

        def most(quantity: str) -> float:
            return max(each.u for each in figures if each.name.startswith(f"{quantity}, "))

        dwell, resolution = show(self.of.dwell, "s"), share(most(RESOLUTION), 3)
        lines = [
            f"wanted         {self._wanted()}",
            f"plan           {counted(rounds, 'round')} of {loads} loads up, of {dwell}; then down and held",
            f"time           {duration(plan.seconds)} ({self.mounts.described(1)})",
            f"expected       {share(plan.u, 3)} of each sensitivity at most, {resolution} of each resolution,",
            f"               {most(SNR):.2g} dB of each {SNR}",
            f"binds          {plan.binds}, {plan.shares[plan.binds]:.0%} of the variance",
        ]
        told = {
            RESULTS: [asdict(each) for each in figures],
            "planned": {"rounds": rounds, "sets": plan.sets, "seconds": plan.seconds, "u": plan.u,
                        "binds": plan.binds, "shares": plan.shares},
        }  # fmt: skip
        return Predicted(plan.seconds, plan.u, told, lines)

    def _slope_u(self, film: Film) -> float:
        """Expected relative uncertainty of a film's slope by all load sets of the plan."""
        plan = self.allocation
        return budget(
            [line for line in self.lines(film) if line.per is not RepeatUnit.NOTHING], 1, plan.sets, plan.dwell
        ).u

    def _wanted(self) -> str:
        time = "" if self.time is None else show(self.time, "s")
        if self.tolerance is None:
            return f"the force sensitivity of each film as good as {time} allow"
        return f"{share(self.tolerance, 3)} of the force sensitivity of each film{time and f', within {time}'}"

    def below_floor(self, error: BelowFloor) -> RangeError:
        """The refusal of a tolerance that the load cell alone exceeds."""
        asked, best = self.tolerance or 0.0, _worst(self, MOST_SETS - MOST_SETS % len(self.of.loads))
        lines = [
            f"--tolerance {share(asked, 3)} cannot be reached: the calibration of the {error.line} leaves "
            f"{share(error.floor, 3)} of each force sensitivity, which no round of loads lowers",
            f"best now  {share(1.01 * best.u, 3)}, by the most load sets of a run",
            "or        a better calibration of it:"
            f" palpate calibrate load-cell --tolerance '{share(asked / math.sqrt(2), 3)}'",
            "note      signal-to-noise ratios and force ratios do not feel the load cell",
        ]
        return RangeError("\n  ".join(lines))


def _sets(points: Sequence[FilmsPoint], number: int) -> tuple[Set, ...]:
    """The valid load sets of a film on the way up; empty: they are at too few different loads for a slope."""
    up = [p for p in points if p.direction == LOADING and p.valid]
    if len({p.load_N for p in up}) < LEAST_LOADS:
        return ()
    return tuple((p.load_measured_N, p.voltages_V[number]) for p in up)


def _allocation(asked: SlopeRepeats) -> Allocation:
    if asked.tolerance is not None:
        plan = _for_tolerance(asked, asked.tolerance)
        if asked.time is None or plan.seconds <= asked.time:
            return plan
    return _for_time(asked, asked.time or 0.0)


def _for_time(asked: SlopeRepeats, time: float) -> Allocation:
    loads, dwell = len(asked.of.loads), asked.of.dwell
    each = loads * (asked.costs.set + dwell)
    least = asked.costs.start + each
    if time < least:
        raise RangeError(
            f"--time {as_typed(time, 's')} is too short: one round of {counted(loads, 'load')} and what follows take "
            f"{least:.0f} s; give more time, a shorter --drift-time, or fewer --loads"
        )
    rounds = max(1, math.floor((time - RESERVE - asked.costs.start) / each))
    if rounds * loads > MOST_SETS:
        raise RangeError(
            f"--time {as_typed(time, 's')} holds {rounds * loads} load sets on the way up, above the limit of "
            f"{MOST_SETS}; give less time"
        )
    return _worst(asked, rounds * loads)


def _for_tolerance(asked: SlopeRepeats, tolerance: float) -> Allocation:
    dwell, sets = asked.of.dwell, 0
    for film in asked.of.design.films:
        try:
            found = allocate(merged(asked.lines(film), dwell), asked.costs, tolerance, dwell, FIRST)
        except BelowFloor as error:
            raise asked.below_floor(error) from None
        sets = max(sets, found.sets)
    if sets > MOST_SETS:
        raise RangeError(
            f"--tolerance {share(tolerance, 3)} takes {sets} load sets on the way up, above the limit of {MOST_SETS}; "
            f"give --tolerance '{reachable(_worst(asked, MOST_SETS).u)}' or more"
        )
    return _worst(asked, sets)


def _worst(asked: SlopeRepeats, sets: int) -> Allocation:
    """The plan with so many sets or a few more, as it is for the film that it tells least of."""
    each = (
        in_rounds(asked.lines(film), asked.costs, sets, asked.of.dwell, len(asked.of.loads))
        for film in asked.of.design.films
    )
    return max(each, key=lambda plan: plan.u)
