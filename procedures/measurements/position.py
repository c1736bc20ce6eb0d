"""Position sweep (thesis 4.3, Table A2.7): a point load along the base of two teeth, found by the films."""

from __future__ import annotations

import functools
import math
from collections.abc import Collection, Generator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget, falling
from palpate.instrument.allocation.repeated import Repeated, planned
from palpate.instrument.allocation.table import FIRST, Allocation, OutOfReach, RunOption, Table
from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import NOISE as BY_NOISE
from palpate.instrument.findings.film_forces import PRIOR_FREEDOM, SCATTER
from palpate.instrument.findings.position import Located, deviations, locate
from palpate.instrument.models.influence import ERROR, check_place, shares_along, tooth_shares
from palpate.instrument.quantity import as_typed, counted, show
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.instrument.signals.dwell import STEP
from palpate.instrument.thesis import read_table
from palpate.instrument.uncertainty.budget import Budget, coverage_factor
from palpate.procedures.engine.plan import APPROACH, Plan, Step, noise_of, point_seconds
from palpate.procedures.engine.procedure import (
    Expected,
    Measurement,
    Report,
    RequiredLoads,
    foreseen,
    predicted,
    until_full,
)
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.lab import MOUNTING, Lab, Target
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.measurements.prospects import binding, ended_by, options, too_long, wanted_of
from palpate.procedures.measurements.settings import DwellTime, Frequency, PeakLoad, SampleName, bench_time
from palpate.procedures.measurements.work import Laps, Sweep, SweepWork
from palpate.procedures.records.columns import Column, columns_of, gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.showing.figure import name_all, new_figure, save, with_u
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import legend, stamped, taken
from palpate.procedures.steps.checks import check_bench_time, check_force, check_frequency, check_increasing, check_time
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.probe import lower, mount, withdraw
from palpate.procedures.steps.servo import RELEASED

if TYPE_CHECKING:
    from rich.table import Table as RichTable


# --- What a position sweep measures and finds: shares of the force, and the place and size that the films tell

DOUBT = (
    "Table A2.7 prints neither the object nor the shape of its load, and its force hardly depends on the place of a"
    " load beside a tooth, which an elastic object's does: it is shown beside, not to be met"
)

MODEL = Column("the share by the table of the solid model", "", "model", "z.3f")
THESIS = Column("the share in Table A2.7; null: it does not have this place", "", "thesis", "z.3f")
FOUND = Column("place that the films alone find", "mm", "found\nmm", "z.2f", u="found_u")
LOW = Column("lower end of its 95 % interval", "mm", "95 %\nmm", "{0.found_low_mm:z.1f} to {0.found_high_mm:z.1f}")
HIGH = Column("upper end of its 95 % interval", "mm")
PLUS_MINUS = Column(head="u", cell="z.3f")


def name_of(x: float) -> str:
    """Name of the result for a place at x [m]."""
    return f"position at {1e3 * x:g} mm"


@dataclass(frozen=True, slots=True)
class PositionPoint:
    """A load at a place: forces peak to peak, shares of the whole force, place and size found by the films alone."""

    position_mm: Annotated[float, Column("place of the load", "mm", "x\nmm", "g")]
    load_measured_N: columns.PrintedLoad
    load_measured_u: float
    force_left_N: Annotated[float, Column("force on the left tooth", "N")]
    force_right_N: Annotated[float, Column("force on the right tooth", "N")]
    share_left: Annotated[float, Column("share of the left tooth", "", "left", "z.3f", u="share_left_u")]
    share_left_u: Annotated[float, PLUS_MINUS]
    share_right: Annotated[float, Column("share of the right tooth", "", "right", "z.3f", u="share_right_u")]
    share_right_u: Annotated[float, PLUS_MINUS]
    model_share_left: Annotated[float, replace(MODEL, after="share_left_u")]
    model_share_right: Annotated[float, MODEL]
    thesis_share_left: Annotated[float | None, replace(THESIS, after="model_share_left")]
    thesis_share_right: Annotated[float | None, THESIS]
    found_mm: Annotated[float, FOUND]
    found_u: Annotated[float, Column(head="u", cell="z.2f")]
    found_low_mm: Annotated[float, LOW]
    found_high_mm: Annotated[float, HIGH]
    found_force_N: Annotated[float, Column("force by the base film", "N", "found\nN", "z.2f", u="found_force_u")]
    found_force_u: Annotated[float, Column(head="u", cell="z.2f")]
    valid: columns.Valid
    settling_s: columns.Settling
    attempts: columns.Attempts
    flags: columns.Flags
    seconds: columns.LapSeconds = None


@dataclass(frozen=True, slots=True)
class FoundPlace:
    """The place that all valid load sets at a position tell, in a sweep that repeats them."""

    position_mm: Annotated[float, Column("where the load was set", "mm", "x\nmm", "g")]
    found_mm: Annotated[float, FOUND]
    found_u: Annotated[float, PLUS_MINUS]
    found_low_mm: Annotated[float, replace(LOW, cell="{0.found_low_mm:z.2f} to {0.found_high_mm:z.2f}")]
    found_high_mm: Annotated[float, HIGH]
    sets: Annotated[int, Column("number of valid load sets", head="load\nsets", after="position_mm")]
    half_mm: Annotated[float, Column("half-width of its 95 % interval where it is linear", "mm", "±\nmm", "z.3f")]


@dataclass(frozen=True, slots=True)
class PositionResult:
    """The result of a position sweep.

    Attributes:
        points: the points.
        rms_mm: root mean square of the distances between found and set places; None: no point is valid.
        inside: share of the places whose interval holds the set place; None: no point is valid.
        places: the place at each position with a valid point, where load sets are repeated.
        stopped: why a sweep that repeats load sets ended, for people; empty: it repeats none.
        budgets: none, because a place is found by its likelihood, which is no sum of contributions.
    """

    points: list[PositionPoint]
    rms_mm: float | None
    inside: float | None
    places: tuple[FoundPlace, ...] = ()
    stopped: str = ""
    budgets: tuple[Budget, ...] = ()

    @property
    def unbudgeted(self) -> dict[str, tuple[float, float]]:
        """Each found place and its standard uncertainty [mm]."""
        found: Sequence[FoundPlace | PositionPoint] = self.places or [point for point in self.points if point.valid]
        return {name_of(1e-3 * p.position_mm): (p.found_mm, p.found_u) for p in found}

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        repeated = {"places": [asdict(place) for place in self.places], "stopped": self.stopped}
        return {
            **(repeated if self.stopped else {}),
            "position_rms_mm": self.rms_mm,
            "inside_interval": self.inside,
            "thesis_doubt": DOUBT,
        }


def evaluate(points: Sequence[PositionPoint], places: Sequence[FoundPlace] = (), stopped: str = "") -> PositionResult:
    """How far the found places are from the set ones: `places`, or those of the valid points where there are none."""
    found: Sequence[FoundPlace | PositionPoint] = places or [point for point in points if point.valid]
    if not found:
        return PositionResult(list(points), None, None, stopped=stopped)
    squares = math.fsum((p.found_mm - p.position_mm) ** 2 for p in found)
    inside = sum(p.found_low_mm <= p.position_mm <= p.found_high_mm for p in found)
    rms = math.sqrt(squares / len(found))
    return PositionResult(list(points), rms, inside / len(found), tuple(places), stopped)


# --- What a position sweep is expected to give: the uncertainty of each place that the films find ------
#
# It is that of `locate` for the shares of the table of point loads. The gains scatter as the design says [M], noise
# is that of usual films [A]. Where two places give nearly the same shares, the uncertainty depends on how the gains
# fall: so it is the root mean square over shares that are off by gains, noise and the table's own error, by Gauss and
# Hermite's rule of three points.

QUADRATURE = ((-math.sqrt(3), 1 / 6), (0.0, 2 / 3), (math.sqrt(3), 1 / 6))  # of a normal distribution
TABLE = "table of point loads"
ONCE, END = 64.0, 6.7  # s, for the sample's mounting and the load cell's zero before and after, of which the end [M]
TOUCH, PER_NEWTON = 15.7, 2.9  # s, and s/N of the load: from home until the preload is reached at a place [M]

Place = tuple[float, float]


def share_noise(design: Design, shares: Sequence[float], load: float) -> list[float]:
    """Standard uncertainty of each tooth's share by the noise of its films, after one second [√s].

    Args:
        design: design of the sensor.
        shares: share of each tooth.
        load: load, peak to peak [N].
    """
    base = next(film for film in design.films if film.kind == FILM_KINDS[1])
    rigid = [film for film in design.films if film is not base]
    return [
        2 * noise_of(design) / load * math.hypot(1 / film.sensitivity, share / base.sensitivity)
        for film, share in zip(rigid, shares, strict=True)
    ]


@functools.lru_cache(maxsize=1024)
def lines_at(design: Design, sample: Sample, place: Place, load: float) -> tuple[BudgetLine, ...]:
    """Lines of the uncertainty [m] of a place that load sets find under a load, peak to peak [N].

    `locate` is no linear function of the shares. So a line is what it adds to ten load sets, the fewest that a
    tolerance has, beside the error of the table.
    """
    scatter, still, quiet = np.array(design.tooth_covariance), np.zeros((2, 2)), (0.0, 0.0)
    noise = share_noise(design, tooth_shares(design, sample, place), load)
    table = _place_u(design, sample, place, quiet, still)

    def added(noise: Sequence[float], scatter: Floats) -> float:
        u = _place_u(design, sample, place, [each / math.sqrt(FIRST) for each in noise], scatter / FIRST)
        return math.sqrt(FIRST * max(u**2 - table**2, 0.0))

    return (
        BudgetLine(SCATTER, added(quiet, scatter), RepeatUnit.SET, PRIOR_FREEDOM),
        BudgetLine(BY_NOISE, added(noise, still), RepeatUnit.SECOND),
        BudgetLine(TABLE, table, RepeatUnit.NOTHING),
    )


def _place_u(design: Design, sample: Sample, place: Place, noise: Sequence[float], scatter: Floats) -> float:
    """Standard uncertainty of a place [m] by shares of some noise and of some relative covariance."""
    shares = tooth_shares(design, sample, place)
    apart = scatter * np.outer(shares, shares) + np.diag(np.square(noise) + ERROR**2 / 3)
    together = np.linalg.cholesky(apart)
    square = 0.0
    for (one, own), (other, its) in product(QUADRATURE, repeat=2):
        off = (shares + together @ (one, other)).tolist()
        square += own * its * locate(design, sample, off, noise, scatter).u ** 2
    return math.sqrt(square)


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


# --- A tolerance of each found place, or a time for all: how often the load is set at each position ----
#
# The shares of the load sets are averaged, and the place is found from their mean. The first sets tell how much the
# shares scatter, and that tells how many sets there are in all, as `instrument.allocation.stopping` has it. The error
# of the table of point loads is the same in all of them.

RESERVE = 1.0  # s, for a set that takes longer than usual

NEAR = 5e-5  # m, within which the lines of a place are the same
QUIET, STILL = (0.0, 0.0), ((0.0, 0.0), (0.0, 0.0))

Shares = tuple[float, float]


@dataclass(frozen=True)
class PlaceSets(Repeated):
    """The load sets at one position, in metres along x, on a sample; the load is peak to peak [N]."""

    design: Design
    sample: Sample
    position: float
    load: float

    def are_enough(self, points: Sequence[PositionPoint]) -> bool:
        """Whether the valid ones of the points reach the tolerance, or by what was found no number of them does."""
        if self.tolerance is None or not (shares := _shares(points)):
            return False
        x = self._located(shares).position
        return self.is_enough(len(points), self._apart(x, shares), lines=self._found_lines(x, shares))

    def place(self, points: Sequence[PositionPoint]) -> FoundPlace | None:
        """The place that the points tell; None: none of them is valid."""
        if not (shares := _shares(points)):
            return None
        x = self._located(shares).position
        found = self.answer(self._apart(x, shares), self._found_lines(x, shares)).budget
        wide = self._located(shares, self._widened(x, found, len(shares)))
        ends = 1e3 * min(wide.low, x), 1e3 * max(wide.high, x)
        return FoundPlace(1e3 * self.position, 1e3 * x, 1e3 * found.u, *ends, len(shares), 1e3 * found.expanded())

    def _located(self, shares: Sequence[Shares], factor: float = 1.0) -> Located:
        """The place by the mean of shares, whose noise and scatter are `factor` times the expected ones."""
        less, mean = factor / math.sqrt(len(shares)), _mean(shares)
        noise = [less * u for u in self._noise(mean)]
        return locate(self.design, self.sample, mean, noise, less**2 * np.array(self.design.tooth_covariance))

    def _lines(self, x: float) -> tuple[BudgetLine, ...]:
        return lines_near(self.design, self.sample, x, self.load)

    def _found_lines(self, x: float, shares: Sequence[Shares]) -> tuple[BudgetLine, ...]:
        """Lines of the uncertainty of the place x [m] that was found; the table's by the shares that were measured."""
        *of_sets, table = self._lines(x)
        return (*of_sets, replace(table, u=locate(self.design, self.sample, _mean(shares), QUIET, STILL).u))

    def _apart(self, x: float, shares: Sequence[Shares]) -> list[float]:
        """Exponential of how far each set alone would move the place x [m].

        The rules of stopping take ratios, and look at their logarithms.
        """
        noise = self._noise(_mean(shares))
        off = deviations(self.design, self.sample, x, shares, noise, self.design.tooth_covariance)
        moved: list[float] = np.exp(self._of_set(x) * off).tolist()
        return moved

    def _widened(self, x: float, found: Budget, sets: int) -> float:
        """Found scatter of the mean over the expected one, times Student's factor over that of known scatter."""
        parts = [part for part in found.components if part.name != TABLE]
        expected = self._of_set(x) / math.sqrt(sets)
        apart = math.hypot(*(part.contribution for part in parts)) / expected if expected else 1.0
        freedom = min(part.degrees_of_freedom for part in parts)
        return apart * coverage_factor(freedom) / coverage_factor(math.inf)

    def _of_set(self, x: float) -> float:
        """What scatter and noise of one set are expected to add to the uncertainty of the place x [m]."""
        return budget(falling(self._lines(x)), 1, 1, self.plan.dwell).u

    def _noise(self, shares: Sequence[float]) -> list[float]:
        """Expected standard uncertainty of each share by the noise of one set."""
        return [u / math.sqrt(self.plan.dwell) for u in share_noise(self.design, shares, self.load)]


def lines_near(design: Design, sample: Sample, x: float, load: float) -> tuple[BudgetLine, ...]:
    """Lines of the uncertainty of the place x [m], of the nearest place that has lines of its own."""
    place = min(max(round(x / NEAR) * NEAR, 0.0), design.plate.length), design.cell[1] / 2
    return lines_at(design, sample, place, load)


def _shares(own: Sequence[PositionPoint]) -> tuple[Shares, ...]:
    """Shares of both teeth in the valid load sets."""
    return tuple((point.share_left, point.share_right) for point in own if point.valid)


def _seconds(plans: Mapping[float, Allocation]) -> float:
    """Bench time of a sweep with these plans [s]."""
    return ONCE + math.fsum(plan.seconds for plan in plans.values())


def _mean(shares: Sequence[Shares]) -> Shares:
    return math.fsum(left for left, _ in shares) / len(shares), math.fsum(right for _, right in shares) / len(shares)


def _for_time(ways: Mapping[float, Sequence[RunOption]], time: float) -> dict[float, Allocation]:
    each = (time - ONCE) / len(ways)
    where = f"at each of {counted(len(ways), 'position')}"
    first = next(iter(ways.values()))[0]
    least = first.costs.seconds(1, 1, first.dwell)
    if each < least:
        raise RangeError(
            f"--time {as_typed(time, 's')} is too short: one load set {where} takes {ONCE + len(ways) * least:.0f} s; "
            "give more time, or fewer --positions"
        )
    tables = {x: Table.of(some, fewest=1, by_time=True) for x, some in ways.items()}
    if each > min(table.seconds.max() for table in tables.values()):
        raise too_long(time, where)
    return {x: table.for_time(each) for x, table in tables.items()}


# --- the procedure -------------------------------------------------------------------------------------

SMALLEST = 1e-5  # m, of a tolerance
THESIS_TABLE = "A2.7"


@dataclass(frozen=True, slots=True)
class PositionStep(Step):
    """One position of the point load, along the base."""

    position_mm: float


Places = Mapping[float, PlaceSets]  # the load sets at each position [m], where these are repeated
PositionPlan = Plan[PositionStep, Places | None]


@dataclass(frozen=True)
class PositionSweep(Sweep[PositionStep, PositionPoint, PositionResult, Places | None]):
    """Move a point load along the base of two teeth; find its place and size by the films."""

    name = "sweep-position"
    point = PositionPoint
    manual_work = "sets the point probe"
    automated_by = "probe_stage"

    positions: Annotated[
        tuple[float, ...],
        Setting("m", "Positions along x: first:last:step or a list, increasing.", default="0 mm:24 mm:2 mm"),
    ] = tuple(round(2e-3 * number, 12) for number in range(13))
    sample: SampleName = "1"
    load: PeakLoad = 2.0
    dwell: DwellTime = 1.0
    frequency: Frequency = 10.0
    tolerance: Annotated[
        float | None,
        Setting(
            "m",
            "Half-width of the 95 % interval of each found place, in place of --dwell; load sets are repeated until it"
            " is reached.",
            example="0.2 mm",
            determines="dwell",
        ),
    ] = None
    time: Annotated[
        float | None,
        bench_time(
            "Instead of --dwell: bench time of the sweep, which is filled with load sets and not exceeded.",
            determines="dwell",
        ),
    ] = None

    def check(self, target: Target) -> None:
        check_nodes(target.design, target.nodes, target.channels)
        sample = get_sample(self.sample)
        if len(self.positions) < FEWEST:
            raise RangeError(f"{counted(len(self.positions), 'position')} cannot make a sweep; give {FEWEST} or more")
        check_increasing("positions", self.positions, "m")
        for position in self.positions:
            check_place(target.design, position)
            tooth_shares(target.design, sample, _at(target.design, position))
        check_force((self.load,), target.force_limit)
        check_frequency(self.frequency, target)
        if not self._repeated:
            check_time(self.dwell, self.frequency)
        if self.tolerance is not None:
            _check_tolerance(self.tolerance)
        check_bench_time(self.time, "30 min")

    def required_loads(self) -> RequiredLoads:
        return RequiredLoads((self.load,), self.extrapolate)

    def plan(self, target: Target) -> PositionPlan:
        """Every position, from left to right; with a tolerance or a time, the most load sets at each."""
        if self._repeated:
            return self._of_repeats(target)
        steps = [self._step(position, self.dwell, 1) for position in self.positions]
        return Plan(self.name, steps, predicted(steps, self._expected(target.design)))

    def _expected(self, design: Design) -> list[Expected]:
        """Standard uncertainty of each place by one load set [mm]."""
        sample, scatter, found = get_sample(self.sample), np.array(design.tooth_covariance), []
        for position in self.positions:
            place = _at(design, position)
            shares = share_noise(design, tooth_shares(design, sample, place), self.load)
            noise = [u / math.sqrt(self.dwell) for u in shares]
            found.append(Expected(name_of(position), 1e3 * _place_u(design, sample, place, noise, scatter), "mm"))
        return found

    @property
    def _repeated(self) -> bool:
        """Whether load sets are repeated, for a tolerance or to fill a time."""
        return self.tolerance is not None or self.time is not None

    def _of_repeats(self, target: Target) -> PositionPlan:
        design, sample = target.design, get_sample(self.sample)
        # Before each further set the drive goes off for a moment.
        later = point_seconds(self.frequency, STEP, first=False) + RELEASED / self.frequency
        costs = Costs(self._first_seconds(STEP) - later, 0.0, later - STEP)
        lines = {x: lines_near(design, sample, x, self.load) for x in self.positions}
        plans = self._plans({x: options(each, costs, self.frequency) for x, each in lines.items()})
        repeats = {
            x: PlaceSets(lines[x], costs, plan, self.tolerance, design, sample, x, self.load)
            for x, plan in plans.items()
        }
        steps = [
            self._step(x, plans[x].dwell, number) for x in self.positions for number in range(1, repeats[x].most + 1)
        ]
        seconds = _seconds(plans)
        worst, plan = max(plans.items(), key=lambda each: each[1].half)
        sets_text = ", ".join(f"{1e3 * x:g}: {one.sets}" for x, one in plans.items())
        longest = show(max(one.dwell for one in plans.values()), "s")
        shown = [
            wanted_of("each place", self._tolerance_text, self.time)
            + ("" if self._tolerance_text else ", shared alike among the positions"),
            f"plan           load sets at each position (mm): {sets_text}, of {longest} at most: "
            f"{duration(seconds)} (person {MOUNTING * (1 + len(plans)):g} s)",
            f"expected       ± {mm(plan.half)} at most, at {mm(worst)}",
            f"{binding(plan)} there",
        ]
        results = [Expected(name_of(x), 1e3 * one.u, "mm") for x, one in plans.items()]
        planned = [
            {"position_mm": 1e3 * x, "sets": one.sets, "dwell_s": one.dwell, "seconds": one.seconds,
             "u_mm": 1e3 * one.u, "half_mm": 1e3 * one.half, "binds": one.binds, "shares": one.shares}
            for x, one in plans.items()
        ]  # fmt: skip
        return Plan(self.name, steps, foreseen(seconds, None, results, shown, planned=planned), repeats)

    def _plans(self, ways: Mapping[float, Sequence[RunOption]]) -> dict[float, Allocation]:
        """The plan of each position.

        Raises:
            RangeError: no number of sets reaches the tolerance at some positions, or not one set at each fits into the
                time; the message says what would do.
        """
        if self.tolerance is not None:
            found, refused = planned(ways, self.tolerance)
            if refused:
                raise refusal(self.tolerance, refused, found)
            plans = {x: each.plan for x, each in found.items()}
            if self.time is None or _seconds(plans) <= self.time:
                return plans
        return _for_time(ways, self.time or 0.0)

    @property
    def _tolerance_text(self) -> str:
        """The tolerance for people; empty: there is none."""
        return "" if self.tolerance is None else f"± {mm(self.tolerance)}"

    def _first_seconds(self, dwell: float) -> float:
        """Expected time of the first load set at a place, with the probe set there by a person [s]."""
        return point_seconds(self.frequency, dwell, first=True) - APPROACH + TOUCH + PER_NEWTON * self.load

    def _step(self, position: float, dwell: float, number: int) -> PositionStep:
        seconds = point_seconds(self.frequency, dwell, first=False)
        if number == 1:
            seconds = self._first_seconds(dwell)
            seconds += ONCE if position == self.positions[0] else 0.0
        what = show(position, "m") + (f", set {number}" if number > 1 else "")
        group = f"mount sample {self.sample}"
        return PositionStep(dwell, seconds, None, 1e3 * position, what=what, group=group)

    def course(self, plan: PositionPlan, points: Sequence[PositionPoint], lab: Lab) -> Generator[int, None, str]:
        """Each position ends once it has the load sets that the tolerance needs, or that the time allows."""

        def full(step: PositionStep, own: Sequence[PositionPoint]) -> bool:
            sets = plan.basis[self.place(step)] if plan.basis and own else None
            return sets is not None and (sets.are_enough(own) or self._late(sets, points))

        return until_full(plan.steps, points, lambda step: step.position_mm, full)

    def _late(self, sets: PlaceSets, points: Sequence[PositionPoint]) -> bool:
        """Whether another set would take from the time of the positions that follow."""
        if self.time is None:
            return False
        taken = math.fsum(point.seconds or 0.0 for point in points)
        part = (self.positions.index(sets.position) + 1) / len(self.positions)
        following = sets.costs.set + sets.plan.dwell + RESERVE
        return taken + following > ONCE - END + part * (self.time - ONCE)

    def place(self, step: PositionStep) -> float:
        """Position of a step [m], to the last digit."""
        return next(place for place in self.positions if 1e3 * place == step.position_mm)

    def begin(self, plan: PositionPlan, lab: Lab, record: Recorder) -> PositionSweepWork:
        return PositionSweepWork(lab, record, self)

    def evaluate(self, points: Sequence[PositionPoint], plan: PositionPlan, lab: Lab) -> PositionResult:
        if plan.basis is None:
            return evaluate(points)
        missed, places = [], []
        for x, each in plan.basis.items():
            if place := each.place([point for point in points if point.position_mm == 1e3 * x]):
                places.append(place)
                missed += [] if each.reaches(1e-3 * place.half_mm) else [f"{place.position_mm:g}"]
        where = f" at {', '.join(missed)} mm" if missed else ""
        return evaluate(
            points, places, ended_by("load set", self._tolerance_text, self.time, where, " at each position")
        )

    def report(self, result: PositionResult, lab: Lab) -> Report:
        plot = partial(plot_sweep, result, lab.design, get_sample(self.sample), lab.bench.simulated)
        return Report(partial(show_sweep, result, lab.design), plot)


class PositionSweepWork(SweepWork):
    """A position sweep on the bench: the point probe presses at one place after the other."""

    def __init__(self, lab: Lab, record: Recorder, sweep: PositionSweep) -> None:
        self._laps = Laps(lab.bench.clock, sweep.time is not None)
        super().__init__(lab, record, sweep, (sweep.load,), sweep.frequency, (sweep.sample,))
        self._sweep, self._sample = sweep, get_sample(sweep.sample)
        self._pressed: float | None = None  # position on which the probe presses [mm]

    def arrange(self, step: PositionStep) -> None:
        mount(self.lab.bench, self._sample)

    def take(self, step: PositionStep) -> Measurement[PositionPoint]:
        design, position = self.lab.design, self._sweep.place(step)
        if self._pressed != step.position_mm:
            self._press(position, step.position_mm)
        measured = self.load_set(self._sweep.load, step.what, float(step.dwell_s or 0.0))
        point = replace(_point(design, self._sample, position, measured), seconds=self._laps.seconds())
        return self.measurement(point, measured)

    def _press(self, position: float, position_mm: float) -> None:
        bench = self.lab.bench
        withdraw(bench)
        bench.operator.place_probe(*_at(self.lab.design, position))
        onto = f"sample {self._sweep.sample} at {show(position, 'm')}"
        self.hold(lower(bench, self.lab.calibration, self.preload, onto))
        self._pressed = position_mm


def _check_tolerance(tolerance: float) -> None:
    """Check the half-width of a place's interval [m] that is asked for. Raises RangeError."""
    limits = f"is outside {mm(SMALLEST)} to {mm(LARGEST)}"
    if not tolerance >= SMALLEST:
        raise RangeError(f"--tolerance {mm(tolerance)} {limits}; give one inside, such as '0.2 mm'")
    if not tolerance <= LARGEST:
        raise RangeError(
            f"--tolerance {mm(tolerance)} {limits}; leave it out: more than one load set at a position would not help"
        )


def _at(design: Design, position: float) -> tuple[float, float]:
    return position, design.cell[1] / 2


def _point(design: Design, sample: Sample, position: float, measured: FilmPoint) -> PositionPoint:
    forces = measured.forces(design)
    left, right = forces.teeth
    shares = (left.force_ratio, right.force_ratio)
    found = locate(design, sample, shares, (left.noise_u, right.noise_u), design.tooth_covariance)
    model = tooth_shares(design, sample, _at(design, position))
    thesis = _thesis().get(round(1e3 * position, 6), (None, None))
    return gathered(
        PositionPoint, measured,
        position_mm=1e3 * position,
        force_left_N=left.force_N,
        force_right_N=right.force_N,
        share_left=left.force_ratio,
        share_left_u=left.force_ratio_u,
        share_right=right.force_ratio,
        share_right_u=right.force_ratio_u,
        model_share_left=model[0],
        model_share_right=model[1],
        thesis_share_left=thesis[0],
        thesis_share_right=thesis[1],
        found_mm=1e3 * found.position,
        found_u=1e3 * found.u,
        found_low_mm=1e3 * found.low,
        found_high_mm=1e3 * found.high,
        found_force_N=forces.force_total_N,
        found_force_u=forces.force_total_u,
    )  # fmt: skip


def _thesis() -> dict[float, tuple[float | None, float | None]]:
    """Shares of the left and the right tooth in Table A2.7, by the place in mm."""
    table = read_table(THESIS_TABLE)
    rows = zip(table.keys(), table.values("force_pvdf3_N"), table.values("force_pvdf1_N"), strict=True)
    return {round(float(x), 6): (float(left), float(right)) for x, left, right in rows}


# --- what it shows -------------------------------------------------------------------------------------

ALONG = 241  # places of the model's curve: 0.1 mm apart on the common base


def show_sweep(result: PositionResult, design: Design, outcome: Outcome) -> list[object]:
    """Shares beside model and thesis, then what the films alone say of place and size."""
    title = "A point load along the base (shares of the whole force)"
    points = table_of(stamped(outcome["simulated"], title), result.points, columns_of(PositionPoint))
    below = [
        f"model          solid, stored; error of a share {ERROR:g} at most, of its mesh alone",
        f"thesis         {DOUBT}",
    ]
    if result.rms_mm is not None and result.inside is not None:
        below.append(
            f"position       {result.rms_mm:z.2f} mm rms from the place set; {result.inside:.0%} in their 95 % interval"
        )
    if result.stopped:
        below.append(f"stopped        {result.stopped}; {counted(len(result.points), 'load set')}, {taken(outcome)}")
    tables = [points, *([_places(result, outcome)] if result.places else [])]
    return [*tables, *legend(points), *below]


def _places(result: PositionResult, outcome: Outcome) -> RichTable:
    """A table of the places that repeated load sets tell, with what was predicted."""
    foreseen = {row["name"]: row["u"] for row in outcome["predicted_results"]}

    def predicted(place: FoundPlace) -> str:
        return f"{foreseen[name_of(1e-3 * place.position_mm)]:z.3f}"

    columns = columns_of(FoundPlace) | {"predicted": Column(head="u\npredicted", cell=predicted, after="found_u")}
    return table_of(stamped(outcome["simulated"], "Places by the mean of all load sets"), result.places, columns)


def plot_sweep(result: PositionResult, design: Design, sample: Sample, simulated: bool, folder: Path) -> Path:
    """Shares along the base beside model and thesis, and how far found places are off; returns the PNG."""
    figure, (left, right) = new_figure(simulated, 2, f"a point load along the base, design {design.name}")
    x = [p.position_mm for p in result.points]
    along = np.linspace(0.0, design.plate.length, ALONG)
    models = shares_along(design, sample, along)
    for side, model, color in zip(("left", "right"), models, ("tab:blue", "tab:orange"), strict=True):
        thesis = with_u(result.points, f"thesis_share_{side}")[0]
        left.errorbar(
            x, *with_u(result.points, f"share_{side}"), fmt="o", ms=4, capsize=2, color=color, label=f"{side} tooth"
        )
        left.plot(1e3 * along, model, "-", lw=1, color=color, label=f"{side}, model")
        left.plot(x, thesis, "x", ms=5, color=color, label=f"{side}, thesis A2.7")
    left.set(xlabel="place of the load (mm)", ylabel="share of the force (bars: standard uncertainty)")
    name_all(left)
    places: Sequence[FoundPlace | PositionPoint] = result.places or result.points
    at, off = [p.position_mm for p in places], [p.found_mm - p.position_mm for p in places]
    spread = [[p.found_mm - p.found_low_mm for p in places], [p.found_high_mm - p.found_mm for p in places]]
    right.errorbar(at, off, spread, fmt="o", ms=4, capsize=2)
    right.axhline(0, color="k", lw=1)
    right.set(xlabel="place of the load (mm)", ylabel="found less set place (mm; bars: 95 %)")
    return save(figure, folder)
