"""What accuracy of a modulus costs in time: all plans that no other beats, and what a tolerance asks of each cause.

Every number comes from the planner of `palpate measure modulus`: the rows of its one table of plans."""

from __future__ import annotations

import bisect
import math
import shlex
import textwrap
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from palpate.instrument.allocation.lines import budget
from palpate.instrument.allocation.table import ROUNDING, OutOfReach
from palpate.instrument.contracts.own import FULL_SCALE_COUNTS, HEADROOM, RANGES
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import NOISE, SCATTER
from palpate.instrument.models.price_list import stored
from palpate.instrument.quantity import LARGEST_TOLERANCE, as_asked, counted, parse, plus_minus, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.estimate import amplitudes
from palpate.instrument.uncertainty.budget import coverage_factor
from palpate.procedures.accuracy.numerics import NEAR, late_sine
from palpate.procedures.engine.plan import noise_of
from palpate.procedures.measurements.object_modulus.planning import (
    CURVE,
    MOUNTED,
    Alternative,
    ModulusPlans,
    Prospect,
    Wanted,
    costs_of,
    lines_of,
    mounting_lines,
    worth_lines,
)
from palpate.procedures.measurements.prospects import load_on, share
from palpate.procedures.showing.figure import write
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.text import STAMP, folded, new_table, print_all, stamped
from palpate.procedures.steps.films import SAMPLES_PER_CYCLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes


TARGETS = (0.2, 0.1, 0.05, 0.02, 0.01)  # half-widths of the 95 % interval, relative
POINTS = 24  # of the front, at most
SYSTEMATIC = 0.05  # share of the variance that all together may have that is not random
MINUTE = 60.0  # s: what one minute less and one more would give
FIT, CONVERTER, INTEGRATION = "fit", "converter", "integration"
QUIET = "converter, without noise"
SETUP, FURTHER = "start and end", "more, if needed"
ROUNDS = 15  # of timing


@dataclass(frozen=True, slots=True)
class CauseCost:
    """One cause of uncertainty: what it leaves, what the tolerance asks of it, what there is, and who pays.

    Attributes:
        cause: name of the cause.
        u: relative standard uncertainty of the modulus by it alone; None: it is no cause but a part of the time.
        share: its share of the variance; None: as for `u`.
        needs, has: what the tolerance asks and what there is, in words; empty: nothing of its own.
        needs_value, has_value: the same as numbers: mountings, sets, seconds of dwell, or relative errors of the ratio.
        bench_s, person_s: bench time that pays for it, and the part of it that a person takes [s]; None: none.
        processor_s, processor_u: processor time, with its standard uncertainty [s]; None: none that counts.
    """

    cause: str
    u: float | None
    share: float | None
    needs: str = ""
    has: str = ""
    needs_value: float | None = None
    has_value: float | None = None
    bench_s: float | None = None
    person_s: float | None = None
    processor_s: float | None = None
    processor_u: float | None = None


@dataclass(frozen=True, slots=True)
class FrontPoint:
    """A plan that no other beats.

    Attributes:
        plan: the plan.
        command: the command that makes it.
    """

    plan: Prospect
    command: str

    def summary(self, person: float) -> dict[str, Any]:
        """The point as JSON has it; `person`: time of a person for one mounting [s]."""
        plan = self.plan.allocation
        return {
            "seconds": self.plan.times.mean,
            "longest_s": self.plan.times.longest,
            "person_s": person * self.plan.times.mountings,
            "reached_by": self.plan.times.enough,
            "U95": plan.half,
            "load_N": plan.load,
            "mountings": plan.mountings,
            "sets": plan.sets,
            "dwell_s": plan.dwell,
            "command": self.command,
        }


@dataclass(frozen=True, slots=True)
class ModulusFront:
    """What accuracy of the modulus of one object costs on one bench.

    Attributes:
        modulus: Young modulus of the object [Pa].
        plans: all plans for the tolerance that was asked for.
        points: the front, the quickest plan first.
        targets: for each of TARGETS the quickest plan; None: none reaches it.
        asked: the quickest plan for the tolerance; None: none reaches it.
        why: why there is none, with other ways there; empty: there is one.
        costs: what the tolerance asks of each cause.
        less, more: half-widths of plans that take a minute less and more; None: there is none so quick.
        by_references: what references would leave in place of the model's validation error; None: not known.
        offered: what would make the run for the tolerance quicker or surer.
    """

    modulus: float
    plans: ModulusPlans
    points: tuple[FrontPoint, ...]
    targets: tuple[tuple[float, FrontPoint | None], ...]
    asked: FrontPoint | None
    why: str
    costs: tuple[CauseCost, ...]
    less: float | None
    more: float | None
    by_references: Alternative | None
    offered: tuple[Alternative, ...]

    @classmethod
    def of(cls, plans: ModulusPlans, modulus: float, command: Sequence[str]) -> Self:
        """All plans for an object of a Young modulus [Pa]; `command` measures it, without its tolerance.

        Raises:
            RangeError: the model tells no more than a bound of the object.
        """
        found = plans.found
        if found.sensitivity is None:
            raise RangeError(
                f"of an object of {show(modulus, 'Pa')} model {found.model!r} tells no more than a bound, whatever"
                " the time: its ratio hardly depends on the modulus; take a sensor with a ring more like it, or"
                " palpate test modulus"
            )
        if found.validation.u is None and not plans.wanted.relative:
            plans = plans.asking(relative=True)
        rows = [row for row in plans.table.front_rows() if plans.table.half[row] <= LARGEST_TOLERANCE]
        asked, why, less, more = None, "", None, None
        offered: Sequence[Alternative]
        try:
            asked = _point(plans, command, plans.wanted.tolerance or 0.0)
        except OutOfReach as error:
            why, quickest = str(plans.refused(error)), plans.quickest()
            offered = [] if quickest is None else [quickest]
        else:
            offered, mean = plans.alternatives(asked.plan), asked.plan.times.mean
            less, more = (_in_time(plans, rows, mean + change) for change in (-MINUTE, MINUTE))
        return cls(
            modulus=modulus,
            plans=plans,
            points=tuple(_points(plans, rows, command)),
            targets=tuple((each, _reached(plans, command, each)) for each in TARGETS),
            asked=asked,
            why=why,
            costs=() if asked is None else tuple(costs_for(plans, asked.plan)),
            less=less,
            more=more,
            by_references=plans.references_that_pay(),
            offered=tuple(offered),
        )

    @property
    def wanted(self) -> Wanted:
        """What was asked for; relative, also where the validation error is not known."""
        return self.plans.wanted

    @property
    def remedy(self) -> str:
        """What would lower the cause that binds, beside sets and mountings; empty: nothing, or none is planned."""
        return "" if self.asked is None else self.plans.remedy(self.asked.plan.allocation.binds)

    @property
    def absolute(self) -> float | None:
        """What the model's validation error leaves, half-width; None: it is not known."""
        found = self.plans.found
        if found.validation.u is None or found.sensitivity is None:
            return None
        return found.sensitivity * found.validation.u * coverage_factor(found.validation.degrees_of_freedom)

    def summary(self) -> dict[str, Any]:
        """The front as JSON has it."""
        found, wanted, person = self.plans.found, self.wanted, self.wanted.mounts.person
        offered = {each.what: each.summary() for each in self.offered}
        references = self.by_references
        freedom = None if math.isinf(wanted.mounted_freedom) else wanted.mounted_freedom
        return {
            "modulus_Pa": self.modulus,
            "tolerance": wanted.tolerance,
            "tolerance_of": "U95",
            "relative_to_model": wanted.relative,
            "model": found.model,
            "force_ratio": found.ratio,
            "sensitivity": found.sensitivity,
            "validation": found.validation.summary(),
            "front": [point.summary(person) for point in self.points],
            "targets": [
                {"tolerance": tolerance, "plan": None if point is None else point.summary(person)}
                for tolerance, point in self.targets
            ],
            "asked": None if self.asked is None else self.asked.summary(person),
            "why": self.why,
            "costs": [asdict(cost) for cost in self.costs],
            "minute_less_U95": self.less,
            "minute_more_U95": self.more,
            "absolute_U95": self.absolute,
            "references_U95": None if references is None else references.U95,
            "references_s": None if references is None else references.once_s,
            "quickest": offered.get("quickest"),
            "alternatives": list(offered.values()),
            "priors": [{"name": MOUNTED, "u": wanted.mounted, "freedom": freedom, "evidence": wanted.mounted_by}],
        }


def _points(plans: ModulusPlans, rows: Sequence[int], command: Sequence[str]) -> list[FrontPoint]:
    """The front, thinned out to points about as far apart in time; none that takes longer and gives less is kept."""
    if not rows:
        return []
    times = np.log(plans.table.mean[list(rows)])
    numbers = np.unique([int(np.abs(times - each).argmin()) for each in np.linspace(times[0], times[-1], POINTS)])
    points: list[FrontPoint] = []
    for number in numbers:
        point = _point(plans, command, _typed(float(plans.table.half[rows[number]])))
        if not points or point.plan.times.mean > points[-1].plan.times.mean:
            points.append(point)
    return points


def _typed(half: float) -> float:
    """A half-width, rounded up to six digits, as it is typed."""
    digits = 10.0 ** (5 - math.floor(math.log10(half)))
    return math.ceil(half * digits * (1 - ROUNDING)) / digits


def _point(plans: ModulusPlans, command: Sequence[str], tolerance: float) -> FrontPoint:
    """The quickest plan for a tolerance, and the command that makes it. Raises OutOfReach: there is none."""
    words = [*command, "--tolerance", f"{100 * tolerance:.10g} %", *["--relative-to-model"] * plans.wanted.relative]
    return FrontPoint(plans.by(plans.table.for_tolerance(tolerance), tolerance), shlex.join(words))


def _reached(plans: ModulusPlans, command: Sequence[str], tolerance: float) -> FrontPoint | None:
    try:
        return _point(plans, command, tolerance)
    except OutOfReach:
        return None


def _in_time(plans: ModulusPlans, rows: Sequence[int], seconds: float) -> float | None:
    """The least tolerance that runs reach in so much time on average [s], further mountings included; None: none."""
    table = plans.table

    def lasts(row: int) -> float:
        return plans.by(table.row(row), float(table.half[row])).times.mean

    quick = bisect.bisect_right(rows, seconds, key=lasts)
    return float(table.half[rows[quick - 1]]) if quick else None


# --- What a tolerance asks of each cause ---------------------------------------------------------------
#
# What is random is paid with mountings, sets and dwell. What is not (model, fit, converter) may have a twentieth of the
# variance together, in equal parts; each is told the error of the ratio that this leaves it.


def costs_for(plans: ModulusPlans, prospect: Prospect) -> list[CauseCost]:
    """One row for each cause; shares add up to 1, and bench times to the mean time of the plan."""
    plan, design, found, wanted = prospect.allocation, plans.design, plans.found, plans.wanted
    costs = costs_of(plan.load, wanted.frequency, wanted.mounts)
    cycles = round(plan.dwell * wanted.frequency)
    lines = lines_of(design, found, plan.load, wanted, not wanted.relative, cycles)
    reached = budget(lines, plan.mountings, plan.sets, plan.dwell)
    shares = {row["name"]: (abs(row["contribution"]), row["share"]) for row in reached.rows()}
    slope = found.sensitivity or 1.0
    systematic = {CURVE, FIT, CONVERTER}
    allowed = math.sqrt(3 * SYSTEMATIC / len(systematic)) * reached.u / slope  # a bound counts as a rectangle
    mountings, sets, dwell = plan.mountings, plan.sets, plan.sets * plan.dwell
    times, person = counted(mountings, "time"), costs.person * mountings
    fit, of_sets, noise = _fit_of(plan.dwell, wanted.frequency), f"{sets} sets", shares[NOISE][1]
    fit_s, fit_u = _timed(fit)
    needs = dwell * noise * (1 - SYSTEMATIC) / SYSTEMATIC / (1 - noise) if noise < 1 else dwell
    paid = [
        CauseCost(MOUNTED, None, None, times, times, mountings, mountings, costs.mounting * mountings, person),
        CauseCost(SCATTER, None, None, of_sets, of_sets, sets, sets, (costs.set + plan.dwell) * sets, None,
                  fit_s * sets, fit_u * sets),
        CauseCost(NOISE, None, None, show(needs, "s", 2), show(dwell, "s", 2), needs, dwell),
        replace(_bound(CURVE, found.curve_u * math.sqrt(3) / found.ratio, allowed), processor_s=_answer_s(plans)),
    ]  # fmt: skip
    rows = {row.cause: row for row in paid}
    for name, (u, part) in sorted(shares.items(), key=lambda each: -each[1][1]):
        rows[name] = replace(rows.pop(name, CauseCost(name, None, None)), u=u, share=part)
    quiet, dithered = converter_error(design, plan.load, found.ratio, wanted.frequency, plan.dwell)
    for name, error in ((FIT, abs(fit() - 1)), (CONVERTER, dithered)):
        rows[name] = replace(_bound(name, error, allowed), u=slope * error / math.sqrt(3), share=0.0)
    further, persons = prospect.times.mean - plan.seconds, costs.person * (prospect.times.mountings - mountings)
    return [
        *rows.values(),
        CauseCost(QUIET, None, None, "", _error(quiet), None, quiet),
        CauseCost(INTEGRATION, None, None, "", "not in the path: the bench steps nothing"),
        CauseCost(SETUP, None, None, bench_s=costs.start),
        CauseCost(FURTHER, None, None, bench_s=further, person_s=persons),
    ]


def _bound(cause: str, error: float, allowed: float) -> CauseCost:
    """A cause that is not random: the bound of its relative error, and the one that is allowed."""
    return CauseCost(cause, None, None, _error(allowed), _error(error), allowed, error)


def _answer_s(plans: ModulusPlans) -> float | None:
    """Processor time of an answer of the model [s]; None: not priced."""
    own = [price for price in stored().prices if (price.design, price.model) == (plans.design.name, plans.found.model)]
    return min((price.answer_s for price in own if price.answer_s is not None), default=None)


def _error(error: float) -> str:
    """A relative error of the ratio, as text."""
    return f"{100 * error:.2g} %" if error >= 1e-8 else "< 1e-6 %"


def _fit_of(dwell: float, frequency: float) -> Callable[[], float]:
    """A fit of a set's record, a day after the start and on a large offset: the amplitude that is found of 1."""
    at, signal = late_sine(dwell, SAMPLES_PER_CYCLE * frequency, frequency)
    return lambda: float(amplitudes(at, signal[np.newaxis], frequency)[0])


def _timed(call: Callable[[], object]) -> tuple[float, float]:
    """Processor time of a call, median of some rounds, and its standard uncertainty [s]."""
    call()
    taken = []
    for _ in range(ROUNDS):
        began = time.process_time_ns()
        call()
        taken.append(1e-9 * (time.process_time_ns() - began))
    return float(np.median(taken)), float(np.std(taken)) * 1.25 / math.sqrt(ROUNDS)


def converter_error(design: Design, load: float, ratio: float, frequency: float, dwell: float) -> tuple[float, float]:
    """Greatest relative error of the ratio by rounding to the steps of the converter: without noise, and in it.

    The range is the one that a run chooses. Noise moves samples across steps and so averages the rounding: a normal
    one leaves 2 step/π · exp(−2 π² σ²/step²) of it at most.
    """
    rate = SAMPLES_PER_CYCLE * frequency
    at = np.arange(round(dwell * rate)) / rate
    ranges = sorted(parse(name, "V") for name in RANGES)
    sigma, quiet, dithered = noise_of(design) * math.sqrt(rate / 2), 0.0, 0.0
    for film in design.films:
        volts = film.sensitivity * load_on(design, film, ratio, load)
        step = next((each for each in ranges if HEADROOM * volts <= each), ranges[-1]) / FULL_SCALE_COUNTS
        amplitude = volts / 2
        clean = amplitude * NEAR[:, np.newaxis] * np.cos(2 * np.pi * frequency * at + 0.3)
        rounded = np.rint(clean / step) * step
        error = float(np.abs(amplitudes(at, rounded, frequency) / (amplitude * NEAR) - 1).max())
        left = 2 * step / math.pi * math.exp(-2 * (math.pi * sigma / step) ** 2) / amplitude
        quiet, dithered = quiet + error, dithered + min(error, left)
    return quiet, dithered


# --- What accuracy costs: printed as tables, and drawn as one page -------------------------------------

LEAST, SMALL = 0.0005, 0.02  # of the variance: a smaller share is no number, and no bar of its own
COLUMNS, TITLE, WIDTH = 80, 75, 105  # letters in a line of text, of the picture's title, and of its own text
NAME = 18  # letters in a line of a cause
NOTHING = "-"
LEGEND = (
    "±              half of the 95 % interval; above 20 % a factor, as it is not symmetric: 50 % is × 1.6",
    "u, share       standard uncertainty, part of the variance; -: next to nothing",
    "needs, has     what the tolerance asks of a cause, and what the plan has",
)
APART = 0.2  # distance of the logarithms of times whose names do not cover each other


def title_of(front: ModulusFront) -> str:
    scale = "on its scale" if front.wanted.relative else "absolute"
    return f"modulus of {show(front.modulus, 'Pa')} by model {front.plans.found.model!r}, {scale}"


def print_front(front: ModulusFront, simulated: bool, plot: str) -> None:
    """Print the quickest plan for some tolerances, what the asked one costs, and what else to know.

    `plot`: where the picture is, or why there is none; empty: none was asked for.
    """
    title = stamped(simulated, f"Time for a {title_of(front)}")
    targets = new_table(title, "", "quickest plan", "mean time", "of it a\nperson's", "at most")
    targets.columns[1].justify = "left"
    for tolerance, point in front.targets:
        cells = ("none", "", "", "") if point is None else _plan_cells(front, point)
        targets.add_row(plus_minus(tolerance), *cells)
    print_all(targets, *_costs(front), *_notes(front), *([f"plot           {plot}"] if plot else []))


def _plan_cells(front: ModulusFront, point: FrontPoint) -> tuple[str, str, str, str]:
    times = point.plan.times
    longest = duration(times.longest)
    if not times.kept:
        longest += f", {share(times.enough)} of runs"
    return plan_text(point), duration(times.mean), duration(front.wanted.mounts.person * times.mountings), longest


def plan_text(point: FrontPoint) -> str:
    """A plan in a few words."""
    plan = point.plan.allocation
    each = counted(plan.sets // plan.mountings, "set")
    return f"{plan.mountings} x {each}, {show(plan.load, 'N')}, {show(plan.dwell, 's')}"


def _costs(front: ModulusFront) -> list[object]:
    if front.asked is None:
        return [front.why]
    processor = sum(cost.processor_s or 0.0 for cost in front.costs)
    table = new_table(
        None, "cause", "u\n%", "share\n%", "needs", "has", "bench\ns", "of it\nperson", "processor"
    )  # fmt: skip
    for number in (0, 3, 4):
        table.columns[number].justify = "left"
    has = {cost.cause: cost.has for cost in front.costs}
    for cost in front.costs:
        if cost.cause not in (INTEGRATION, QUIET):
            table.add_row(*_cost_cells(cost))
    return [
        f"{_answer(front, front.asked)}; processor {show(processor, 's', 2)}",
        table,
        f"converter      {has[QUIET]} in a silent record; the films' noise averages its steps",
        f"integration    {has[INTEGRATION]}",
        front.asked.command,
    ]


def _answer(front: ModulusFront, asked: FrontPoint) -> str:
    """How long the asked tolerance takes."""
    times, tolerance = asked.plan.times, as_asked(front.wanted.tolerance or 0.0)
    person = duration(front.wanted.mounts.person * times.mountings)
    average = f"{tolerance}: {duration(times.mean)} on average, {person} of it a person's"
    return average if times.kept else f"{average} ({share(times.enough)} of runs reach it)"


def _cost_cells(cost: CauseCost) -> tuple[str, ...]:
    def seconds(value: float | None) -> str:
        return "" if value is None else f"{value:.0f}"

    u = "" if cost.u is None else f"{100 * cost.u:.2g}" if cost.u >= 1e-6 else NOTHING
    part = "" if cost.share is None else f"{100 * cost.share:.2g}" if cost.share >= LEAST else NOTHING
    processor = ""
    if cost.processor_s is not None:
        exact = cost.processor_u is None or cost.processor_s >= 2 * cost.processor_u
        processor = show(cost.processor_s, "s", 2) if exact else f"< {show(2 * (cost.processor_u or 0.0), 's', 1)}"
    cause = textwrap.fill(cost.cause, NAME)
    return cause, u, part, cost.needs, cost.has, seconds(cost.bench_s), seconds(cost.person_s), processor


def _notes(front: ModulusFront) -> list[str]:
    lines = []
    if front.absolute is not None and front.wanted.relative:
        lines.append(f"absolute       {plus_minus(front.absolute)}, by the model")
        if front.by_references is not None:
            lines += [f"references     {front.by_references.told}", f"               {front.by_references.how}"]
    if front.less is not None or front.more is not None:
        mean = front.asked.plan.times.mean if front.asked is not None else math.nan
        halves = {mean - MINUTE: front.less, mean + MINUTE: front.more}
        given = (
            f"{duration(t)} give {'no answer' if h is None else plus_minus(h)}" for t, h in halves.items() if t > 0
        )
        lines.append(f"a minute       {'; '.join(given)}")
    if front.remedy and front.asked is not None:
        lines.append(f"binds          {front.asked.plan.allocation.binds}: {front.remedy}")
    lines += mounting_lines(front.wanted)
    lines += [*worth_lines(front.offered), *(LEGEND if front.costs else LEGEND[:1])]
    return [folded(line, COLUMNS) for line in lines]


def plot_front(front: ModulusFront, simulated: bool, file: Path) -> bool:
    """Draw into a file: the front, and below it what binds, who pays and what would help.

    Returns: False: there is nothing to draw, as no plan reaches the largest tolerance.

    Raises:
        RecordError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    if not front.points:
        return False
    asked = front.asked
    if asked is None:
        title, *helps = front.why.splitlines()
        rows, below = 1, [line.removeprefix("  or").strip() for line in helps]
    else:
        title, rows = _answer(front, asked), 2
        below = [f"{each.what}: {each.told}" for each in front.offered]
        if front.remedy:
            below.insert(0, f"{asked.plan.allocation.binds}: {front.remedy}")
        if front.absolute is not None and front.by_references is not None and front.wanted.relative:
            below.append(f"absolute: {plus_minus(front.absolute)} by the model; {front.by_references.told}")
    helps = [wrapped for line in below for wrapped in textwrap.wrap(line, WIDTH, subsequent_indent="    ")]
    heights = [*(4.0, 2.1)[:rows], 0.14 * len(helps)]
    figure = Figure(figsize=(7.2, 1.2 + sum(heights) + 0.3 * rows), layout="constrained")
    figure.suptitle("\n".join(textwrap.wrap(title, TITLE)), fontsize=11, weight="bold")
    grid = figure.add_gridspec(rows + 1, 2, height_ratios=heights)
    ax = figure.add_subplot(grid[0, :])
    ax.set_title(f"{STAMP}: {title_of(front)}" if simulated else title_of(front), fontsize=9)
    _draw_front(front, ax)
    if asked is not None:
        _draw_shares(front, figure.add_subplot(grid[1, 0]))
        _draw_payers(front, asked, figure.add_subplot(grid[1, 1]))
    text = figure.add_subplot(grid[rows, :])
    text.axis("off")
    text.set_title("What would help", loc="left", fontsize=9, weight="bold")
    text.text(0, 1, "\n".join(helps), va="top", fontsize=8, transform=text.transAxes)
    write(figure, file)
    return True


def _draw_shares(front: ModulusFront, ax: Axes) -> None:
    """Share of each cause in the variance; the small ones together."""
    causes = {cost.cause: cost.share for cost in front.costs if cost.share is not None and cost.share >= SMALL}
    shares = [*causes.values(), 1 - math.fsum(causes.values())]
    _bars(ax, [*causes, "all others"], shares, [share(each) for each in shares])
    ax.set_title(f"What binds: {max(causes, key=lambda name: causes[name])}", loc="left", fontsize=9, weight="bold")
    ax.set(xlim=(0, 1.2), xticks=[])
    ax.set_xlabel("share of the variance", fontsize=8, loc="left")


def _draw_payers(front: ModulusFront, asked: FrontPoint, ax: Axes) -> None:
    """Bench time of each part of the mean time, with the part of it that a person takes."""
    plan = asked.plan.allocation
    names = {MOUNTED: counted(plan.mountings, "mounting"), SCATTER: f"{plan.sets} load sets"}
    payers = [cost for cost in front.costs if cost.bench_s]
    bench, person = [cost.bench_s or 0.0 for cost in payers], [cost.person_s or 0.0 for cost in payers]
    labels = [names.get(cost.cause, cost.cause) for cost in payers]
    _bars(ax, labels, bench, [duration(each) for each in bench], "bench")
    ax.barh(range(len(payers)), person, color="0.3", hatch="//", edgecolor="0.6", height=0.6, label="of it a person")
    ax.set_title("Who pays, on average", loc="left", fontsize=9, weight="bold")
    ax.set(xlim=(0, 1.4 * max(bench)), xticks=[])
    ax.legend(fontsize=8, loc="upper left", bbox_to_anchor=(0.0, 0.0), ncols=2, frameon=False)


def _bars(ax: Axes, names: Sequence[str], values: Sequence[float], labels: Sequence[str], label: str = "") -> None:
    bars = ax.barh(range(len(names)), values, color="0.75", label=label, height=0.6)
    ax.bar_label(bars, labels, padding=3, fontsize=8)
    ax.set_yticks(range(len(names)), [textwrap.fill(name, NAME) for name in names], fontsize=8)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.spines[["top", "right"]].set_visible(False)


def _draw_front(front: ModulusFront, ax: Axes) -> None:
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    times = [point.plan.times.mean for point in front.points]
    halves = [100 * point.plan.allocation.half for point in front.points]
    ends = np.maximum.accumulate([point.plan.times.longest for point in front.points])
    sure = [point.plan.times.kept for point in front.points].count(True)  # those come first
    ax.fill_betweenx(halves, times, ends, color="0.9", lw=0, label="95 % of runs end before its right edge")
    ax.plot(times[: sure + 1], halves[: sure + 1], "k-", lw=1.5, label="mean time of the quickest plan")
    if sure < len(times):
        ax.plot(times[sure:], halves[sure:], "k:", lw=1.5, label="fewer than 95 % of runs get there")
    marked: set[float] = set()
    for point in [front.asked, *(each for _, each in front.targets)]:
        if point is not None and all(abs(math.log(point.plan.times.mean / other)) > APART for other in marked):
            marked.add(point.plan.times.mean)
            _mark(ax, point, asked=point is front.asked)
    ticks = (10, 20, 60, 120, 300, 600, 1800, 3600, 2 * 3600, 5 * 3600, 10 * 3600, 24 * 3600)
    ax.set(xscale="log", yscale="log", xlabel="time from the command to the answer, a person's included")
    ax.xaxis.label.set_fontsize(9)
    room = max(4.0, (ends[-1] / times[0]) ** 0.3)  # on the left, for a text
    ax.set(xlim=(times[0] / room, 1.1 * ends[-1]), ylim=(halves[-1] / 1.6, 1.3 * halves[0]))
    ax.set_ylabel("± (%), half of the 95 % interval", fontsize=9)
    ax.xaxis.set_major_locator(FixedLocator(ticks))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _round(value)))
    ax.yaxis.set_major_locator(FixedLocator((0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50)))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter("{x:g}")
    ax.tick_params(labelsize=8)
    ax.legend(fontsize=8, loc="upper right", frameon=False)


def _round(seconds: float) -> str:
    """A round duration for an axis."""
    for unit, length in (("h", 3600), ("min", 60)):
        if seconds >= length:
            return f"{seconds / length:g} {unit}"
    return f"{seconds:g} s"


def _mark(ax: Axes, point: FrontPoint, *, asked: bool) -> None:
    """A point with its half-width and time; lines to both axes from the one that was asked for."""
    x, y = point.plan.times.mean, 100 * point.plan.allocation.half
    ax.plot(x, y, "D" if asked else "o", color="k", ms=6)
    half = point.plan.allocation.half
    digits = 2 if float(f"{half:.2g}") >= half else 3  # 10.4 % is not told as 10 %, which another plan reaches
    text = f"{plus_minus(half, digits)}: {duration(x)}"
    ax.annotate(
        text, (x, y), xytext=(-8, -6), textcoords="offset points", fontsize=9 if asked else 8, ha="right", va="top",
        weight="bold" if asked else "normal",
    )  # fmt: skip
    if asked:
        ax.plot([0, x, x], [y, y, 0], "k--", lw=0.8)
