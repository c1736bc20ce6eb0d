"""What accuracy costs: printed as tables, and drawn as one page."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.instrument.findings.film_forces import SCATTER
from palpate.instrument.quantity import as_asked, counted, plus_minus, show
from palpate.procedures.accuracy.front import INTEGRATION, MINUTE, QUIET, CauseCost, FrontPoint, ModulusFront
from palpate.procedures.measurements.object_modulus.planning import MOUNTED, mounting_lines, worth_lines
from palpate.procedures.measurements.prospects import share
from palpate.procedures.showing.figure import write
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.text import STAMP, folded, new_table, print_all, stamped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
    told = f"{tolerance}: {duration(times.mean)} on average, {person} of it a person's"
    return told if times.kept else f"{told} ({share(times.enough)} of runs reach it)"


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
        told = (f"{duration(t)} give {'no answer' if h is None else plus_minus(h)}" for t, h in halves.items() if t > 0)
        lines.append(f"a minute       {'; '.join(told)}")
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
    told = [names.get(cost.cause, cost.cause) for cost in payers]
    _bars(ax, told, bench, [duration(each) for each in bench], "bench")
    ax.barh(range(len(payers)), person, color="0.3", hatch="//", edgecolor="0.6", height=0.6, label="of it a person")
    ax.set_title("Who pays, on average", loc="left", fontsize=9, weight="bold")
    ax.set(xlim=(0, 1.4 * max(bench)), xticks=[])
    ax.legend(fontsize=8, loc="upper left", bbox_to_anchor=(0.0, 0.0), ncols=2, frameon=False)


def _bars(ax: Axes, names: Sequence[str], values: Sequence[float], told: Sequence[str], label: str = "") -> None:
    bars = ax.barh(range(len(names)), values, color="0.75", label=label, height=0.6)
    ax.bar_label(bars, told, padding=3, fontsize=8)
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
    told: set[float] = set()
    for point in [front.asked, *(each for _, each in front.targets)]:
        if point is not None and all(abs(math.log(point.plan.times.mean / other)) > APART for other in told):
            told.add(point.plan.times.mean)
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
