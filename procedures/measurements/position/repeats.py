"""A tolerance of each found place, or a time for all: how often the load is set at each position.

The shares of the load sets are averaged, and the place is found from their mean. The first sets tell how much the
shares scatter, and that tells how many sets there are in all, as `instrument.allocation.stopping` has it. The error of
the table of point loads is the same in all of them.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.allocation.stopping import answer, enough, first_sets
from palpate.instrument.allocation.table import ROUNDING, Allocation, OutOfReach, RunOption, Table, dwells
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.position import Located, deviations, locate
from palpate.instrument.quantity import as_typed, counted, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample
from palpate.instrument.signals.dwell import STEP, whole_steps
from palpate.instrument.uncertainty.budget import Budget, coverage_factor
from palpate.procedures.engine.plan import Predicted, point_seconds
from palpate.procedures.engine.promise import RESULTS, Expected
from palpate.procedures.lab.lab import MOUNTING
from palpate.procedures.measurements.position.expected import (
    END,
    ONCE,
    TABLE,
    lines_at,
    name_of,
    place_seconds,
    share_noise,
)
from palpate.procedures.measurements.position.result import FoundPlace, PositionPoint
from palpate.procedures.measurements.prospects import binding, most_sets, planned_for, too_long
from palpate.procedures.showing.plan import duration
from palpate.procedures.steps.servo import RELEASED

# -------------------------------------------------------------------------------------------------------
# A tolerance of a place that no load set reaches: where, why, the best there is, and which positions reach it

FEWEST = 2  # positions of a sweep
LARGEST = 0.6e-3  # m; single load sets find most places so well, and near a tooth's middle none do


def refusal(tolerance: float, refused: Mapping[float, OutOfReach], reached: Collection[float]) -> RangeError:
    """The refusal of a tolerance [m] that some positions [m] cannot have, and others can."""
    each = ", ".join(f"{mm(error.best)} at {mm(x)}" for x, error in refused.items())
    best = math.ceil(1e6 * max(error.best for error in refused.values())) / 1e6
    ambiguous = best > LARGEST
    lines = [
        f"--tolerance {mm(tolerance)} cannot be reached at {counted(len(refused), 'position')}: the error of the "
        f"{TABLE} and the most load sets of a run leave ± {each}",
        "best now  " + ("with --tolerance left out" if ambiguous else f"--tolerance '{mm(best)}'"),
    ]
    if len(reached) >= FEWEST:
        lines.append(f"or        --positions '{', '.join(map(mm, reached))}', which reach it")
    if ambiguous:
        lines.append("note      two places on both sides of a tooth's middle give nearly the same shares")
    return RangeError("\n  ".join(lines))


def mm(length: float) -> str:
    """A length [m] in millimetres, for people."""
    return f"{1e3 * length:.3g} mm"


# --- the repeated load sets ----------------------------------------------------------------------------

RESERVE = 1.0  # s, for a set that takes longer than usual

NEAR = 5e-5  # m, within which the lines of a place are the same
QUIET, STILL = (0.0, 0.0), ((0.0, 0.0), (0.0, 0.0))

Shares = tuple[float, float]


@dataclass(frozen=True)
class PlaceRepeats:
    """The load sets of a position sweep whose places shall have a tolerance, or that has a time.

    Attributes:
        design: the sensor.
        sample: the sample on it.
        positions: positions of the load along x [m].
        load: load, peak to peak [N].
        frequency: frequency of the load [Hz].
        tolerance: half-width of the 95 % interval of each place [m]; None: as good as the time allows.
        time: bench time of the sweep [s]; None: as long as the tolerance takes.
    """

    design: Design
    sample: Sample
    positions: tuple[float, ...]
    load: float
    frequency: float
    tolerance: float | None
    time: float | None

    @cached_property
    def allocations(self) -> Mapping[float, Allocation]:
        """The plan of each position, by the position.

        Raises:
            RangeError: no number of sets reaches the tolerance at some positions, or not one set at each fits into the
                time; the message says what would do.
        """
        ways = {}
        for x in self.positions:
            lines = self.lines(x)
            shortest = whole_steps(max(STEP, 1 / self.frequency))
            ways[x] = [RunOption(lines, self.costs, dwell) for dwell in dwells(lines, shortest, whole_steps)]
        if self.tolerance is not None:
            plans, refused = planned_for(ways, self.tolerance)
            if refused:
                raise refusal(self.tolerance, refused, plans)
            if self.time is None or ONCE + math.fsum(plan.seconds for plan in plans.values()) <= self.time:
                return plans
        return _for_time(self, ways, self.time or 0.0)

    def lines(self, x: float) -> tuple[BudgetLine, ...]:
        """Lines of the uncertainty of the place x [m]."""
        place = min(max(round(x / NEAR) * NEAR, 0.0), self.design.plate.length), self.design.cell[1] / 2
        return lines_at(self.design, self.sample, place, self.load)

    @property
    def costs(self) -> Costs:
        """Bench times at a position; before each further set the drive goes off for a moment."""
        later = point_seconds(self.frequency, STEP, first=False) + RELEASED / self.frequency
        return Costs(place_seconds(self.frequency, STEP, self.load) - later, 0.0, later - STEP)

    @property
    def seconds(self) -> float:
        """Bench time of the plan [s]."""
        return ONCE + math.fsum(plan.seconds for plan in self.allocations.values())

    def most(self, position: float) -> int:
        """The most load sets at a position."""
        return most_sets(self.allocations[position])

    def has_enough(self, position: float, own: Sequence[PositionPoint], points: Sequence[PositionPoint]) -> bool:
        """Whether a position needs no further load set, by its own points and all so far."""
        if not own:
            return False
        shares = _shares(own)
        return (bool(shares) and self._known(self.allocations[position], shares)) or self._late(position, points)

    def place(self, position: float, points: Sequence[PositionPoint]) -> FoundPlace | None:
        """The place that the load sets at a position tell; None: none of them is valid."""
        own = _at(position, points)
        shares = _shares(own)
        if not shares:
            return None
        plan = self.allocations[position]
        x = self._located(shares, plan).position
        by_time = self.tolerance is None or len(shares) < first_sets(plan)
        found = answer(self._found_lines(x, shares), plan, 1.0, [self._apart(x, shares, plan)], by_time=by_time).budget
        wide = self._located(shares, plan, self._widened(x, found, len(shares), plan))
        ends = 1e3 * min(wide.low, x), 1e3 * max(wide.high, x)
        return FoundPlace(1e3 * position, 1e3 * x, 1e3 * found.u, *ends, len(shares), 1e3 * found.expanded())

    def stopped(self, places: Sequence[FoundPlace]) -> str:
        """Why the sweep ended, for people."""
        if self.tolerance is None:
            return f"another load set would not have ended within {show(self.time or 0.0, 's')}"
        within = "" if self.time is None else f" within {show(self.time, 's')}"
        missed = [place for place in places if 1e-3 * place.half_mm > self.tolerance * (1 + ROUNDING)]
        if not missed:
            return f"± {mm(self.tolerance)} reached at each position{within}"
        where = ", ".join(f"{place.position_mm:g}" for place in missed)
        return f"± {mm(self.tolerance)} NOT REACHED{within} at {where} mm"

    def _known(self, plan: Allocation, shares: Sequence[Shares]) -> bool:
        """Whether the shares of all valid sets at a position reach the tolerance, or no time would."""
        if self.tolerance is None:
            return False
        x = self._located(shares, plan).position
        lines, apart = self._found_lines(x, shares), [self._apart(x, shares, plan)]
        try:
            return bool(enough(lines, self.costs, self.tolerance, plan, 1.0, apart).why)
        except RangeError:  # by the scatter, or at the place, that was found no time is enough
            return True

    def _late(self, position: float, points: Sequence[PositionPoint]) -> bool:
        """Whether another set would take from the time of the positions that follow."""
        if self.time is None:
            return False
        taken = math.fsum(point.seconds or 0.0 for point in points)
        part = (self.positions.index(position) + 1) / len(self.positions)
        following = self.costs.set + self.allocations[position].dwell + RESERVE
        return taken + following > ONCE - END + part * (self.time - ONCE)

    def _located(self, shares: Sequence[Shares], plan: Allocation, factor: float = 1.0) -> Located:
        """The place by the mean of shares, whose noise and scatter are `factor` times the expected ones."""
        less, mean = factor / math.sqrt(len(shares)), _mean(shares)
        noise = [less * u for u in self._noise(mean, plan)]
        return locate(self.design, self.sample, mean, noise, less**2 * np.array(self.design.tooth_covariance))

    def _found_lines(self, x: float, shares: Sequence[Shares]) -> tuple[BudgetLine, ...]:
        """Lines of the uncertainty of the place x [m] that was found; the table's by the shares that were measured."""
        *of_sets, table = self.lines(x)
        return (*of_sets, replace(table, u=locate(self.design, self.sample, _mean(shares), QUIET, STILL).u))

    def _apart(self, x: float, shares: Sequence[Shares], plan: Allocation) -> list[float]:
        """Exponential of how far each set alone would move the place x [m].

        The rules of stopping take ratios, and look at their logarithms.
        """
        noise = self._noise(_mean(shares), plan)
        off = deviations(self.design, self.sample, x, shares, noise, self.design.tooth_covariance)
        moved: list[float] = np.exp(self._of_set(x, plan) * off).tolist()
        return moved

    def _widened(self, x: float, found: Budget, sets: int, plan: Allocation) -> float:
        """Found scatter of the mean over the expected one, times Student's factor over that of known scatter."""
        parts = [part for part in found.components if part.name != TABLE]
        expected = self._of_set(x, plan) / math.sqrt(sets)
        apart = math.hypot(*(part.contribution for part in parts)) / expected if expected else 1.0
        freedom = min(part.degrees_of_freedom for part in parts)
        return apart * coverage_factor(freedom) / coverage_factor(math.inf)

    def _of_set(self, x: float, plan: Allocation) -> float:
        """What scatter and noise of one set are expected to add to the uncertainty of the place x [m]."""
        return budget([line for line in self.lines(x) if line.per is not RepeatUnit.NOTHING], 1, 1, plan.dwell).u

    def _noise(self, shares: Sequence[float], plan: Allocation) -> list[float]:
        """Expected standard uncertainty of each share by the noise of one set."""
        return [u / math.sqrt(plan.dwell) for u in share_noise(self.design, shares, self.load)]

    def predicted(self) -> Predicted:
        """What the sweep is predicted to take and to give; a plan for people."""
        plans = self.allocations
        worst, plan = max(plans.items(), key=lambda each: each[1].half)
        each = ", ".join(f"{1e3 * x:g}: {one.sets}" for x, one in plans.items())
        dwell = max(one.dwell for one in plans.values())
        person = MOUNTING * (1 + len(plans))
        lines = [
            f"wanted         {self._wanted()}",
            f"plan           load sets at each position (mm): {each}, of {show(dwell, 's')} at most: "
            f"{duration(self.seconds)} (person {person:g} s)",
            f"expected       ± {mm(plan.half)} at most, at {mm(worst)}",
            f"{binding(plan)} there",
        ]
        told = {
            RESULTS: [asdict(Expected(name_of(x), 1e3 * one.u, "mm")) for x, one in plans.items()],
            "planned": [
                {"position_mm": 1e3 * x, "sets": one.sets, "dwell_s": one.dwell, "seconds": one.seconds,
                 "u_mm": 1e3 * one.u, "half_mm": 1e3 * one.half, "binds": one.binds, "shares": one.shares}
                for x, one in plans.items()
            ],
        }  # fmt: skip
        return Predicted(self.seconds, None, told, lines)

    def _wanted(self) -> str:
        time = "" if self.time is None else show(self.time, "s")
        if self.tolerance is None:
            return f"each place as good as {time} allow, shared alike among the positions"
        return f"± {mm(self.tolerance)} of each place{time and f', within {time}'}"


def _at(position: float, points: Sequence[PositionPoint]) -> list[PositionPoint]:
    return [point for point in points if point.position_mm == 1e3 * position]


def _shares(own: Sequence[PositionPoint]) -> tuple[Shares, ...]:
    """Shares of both teeth in the valid load sets."""
    return tuple((point.share_left, point.share_right) for point in own if point.valid)


def _mean(shares: Sequence[Shares]) -> Shares:
    return math.fsum(left for left, _ in shares) / len(shares), math.fsum(right for _, right in shares) / len(shares)


def _for_time(asked: PlaceRepeats, ways: Mapping[float, Sequence[RunOption]], time: float) -> dict[float, Allocation]:
    each = (time - ONCE) / len(ways)
    where = f"at each of {counted(len(ways), 'position')}"
    least = asked.costs.seconds(1, 1, ways[asked.positions[0]][0].dwell)
    if each < least:
        raise RangeError(
            f"--time {as_typed(time, 's')} is too short: one load set {where} takes {ONCE + len(ways) * least:.0f} s; "
            "give more time, or fewer --positions"
        )
    tables = {x: Table.of(some, fewest=1, by_time=True) for x, some in ways.items()}
    if each > min(table.seconds.max() for table in tables.values()):
        raise too_long(time, where)
    return {x: table.for_time(each) for x, table in tables.items()}
