"""What accuracy costs: printed as tables, and drawn as one page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.instrument.quantity import counted, plus_minus, show
from palpate.procedures.accuracy.front import INTEGRATION, MINUTE, QUIET, CauseCost, FrontPoint, ModulusFront
from palpate.procedures.measurements.prospects import share
from palpate.procedures.showing.figure import save_in_new
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.text import STAMP, new_table, print_all, stamped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLOT = "accuracy.png"
LEAST = 0.0005  # of the variance: a smaller share is told as such
BAND = 0.15  # opacity
APART = 0.2  # distance of the logarithms of times whose names do not cover each other


def title_of(front: ModulusFront) -> str:
    scale = "on its scale" if front.relative else "absolute"
    return f"modulus of {show(front.modulus, 'Pa')} by model {front.found.model!r}, {scale}"


def print_front(front: ModulusFront, simulated: bool, plot: Path | None) -> None:
    """Print the quickest plan for some tolerances, what the asked one costs, and what else to know."""
    targets = new_table(
        stamped(simulated, f"Time for a {title_of(front)}"), "", "quickest plan", "mean time", "at most", "person"
    )
    targets.columns[1].justify = "left"
    for tolerance, point in front.targets:
        cells = ("none", "", "", "") if point is None else _plan_cells(front, point)
        targets.add_row(plus_minus(tolerance), *cells)
    print_all(targets, *_costs(front), *_notes(front), *([] if plot is None else [f"plot           {plot}"]))


def _plan_cells(front: ModulusFront, point: FrontPoint) -> tuple[str, str, str, str]:
    times, plan = point.plan.times, point.plan.allocation
    return plan_text(point), duration(times.mean), duration(times.longest), duration(front.person * plan.mountings)


def plan_text(point: FrontPoint) -> str:
    """A plan in a few words."""
    plan = point.plan.allocation
    each = counted(plan.sets // plan.mountings, "set")
    return f"{plan.mountings} x {each}, {show(point.plan.load, 'N')}, {show(plan.dwell, 's')}"


def _costs(front: ModulusFront) -> list[object]:
    if front.asked is None:
        return [front.why]
    times, person = front.asked.plan.times, front.person * front.asked.plan.allocation.mountings
    processor = sum(cost.processor_s or 0.0 for cost in front.costs)
    head = (
        f"{plus_minus(front.tolerance)}: {duration(times.mean)} on average, {duration(person)} of them a person's;"
        f" processor {show(processor, 's', 2)}"
    )
    table = new_table(None, "cause", "u", "share", "needs", "has", "bench", "person", "CPU")
    for number in (0, 3, 4):
        table.columns[number].justify = "left"
    has = {cost.cause: cost.has for cost in front.costs}
    for cost in front.costs:
        if cost.cause not in (INTEGRATION, QUIET):
            table.add_row(*_cost_cells(cost))
    return [
        head,
        table,
        f"converter      {has[QUIET]} in a silent record; the films' noise averages its steps",
        f"integration    {has[INTEGRATION]}",
        front.asked.command,
    ]


def _cost_cells(cost: CauseCost) -> tuple[str, ...]:
    def seconds(value: float | None) -> str:
        return "" if value is None else f"{value:.0f} s"

    def u(value: float | None) -> str:
        return "" if value is None else share(value) if value >= 1e-6 else "< 1e-4 %"

    part = "" if cost.share is None else share(cost.share) if cost.share >= LEAST else "< 0.1 %"
    processor = ""
    if cost.processor_s is not None:
        exact = cost.processor_u is None or cost.processor_s >= 2 * cost.processor_u
        processor = show(cost.processor_s, "s", 2) if exact else f"< {show(2 * (cost.processor_u or 0.0), 's', 1)}"
    return (
        cost.cause.removesuffix(" scatter"),
        u(cost.u),
        part,
        cost.needs,
        cost.has,
        seconds(cost.bench_s),
        seconds(cost.person_s),
        processor,
    )


def _notes(front: ModulusFront) -> list[str]:
    lines = []
    if front.absolute is not None and front.relative:
        references = ""
        if front.by_references is not None and front.references_s is not None:
            left, once = plus_minus(front.by_references), duration(front.references_s)
            references = f"; references leave {left} ({once})"
        lines.append(f"absolute       {plus_minus(front.absolute)} by the model{references}")
    if front.less is not None or front.more is not None:
        mean = front.asked.plan.times.mean if front.asked is not None else math.nan
        halves = {mean - MINUTE: front.less, mean + MINUTE: front.more}
        told = (f"{duration(t)} give {'no answer' if h is None else plus_minus(h)}" for t, h in halves.items() if t > 0)
        lines.append(f"a minute       {'; '.join(told)}")
    if front.quicker is not None:
        lines += [f"quicker        {front.quicker.told}", f"               {front.quicker.how}"]
    for prior in front.priors:
        freedom = "exact" if prior.freedom is None else f"{counted(round(prior.freedom), 'degree')} of freedom"
        lines += [f"mountings      {prior.evidence}", f"               counted {share(prior.u)}, {freedom}"]
    lines.append("±, ×           half-width of the 95 % interval; u: standard uncertainty")
    return lines


def plot_front(front: ModulusFront, simulated: bool, folder: Path) -> Path:
    """Draw `accuracy.png` in a folder: the front, and below it who pays for the asked tolerance.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 7.6 if front.costs else 4.6), layout="constrained")
    figure.suptitle(f"{STAMP}: {title_of(front)}" if simulated else title_of(front), fontsize=10)
    grid = figure.add_gridspec(2 if front.costs else 1, 2, height_ratios=(1.5, 1) if front.costs else (1,))
    _draw_front(front, figure.add_subplot(grid[0, :]))
    if front.costs:
        causes = [cost for cost in front.costs if cost.share is not None]
        shares = figure.add_subplot(grid[1, 0])
        _bars(shares, [_named(cost) for cost in causes], [100 * (cost.share or 0.0) for cost in causes])
        shares.set(xlabel="share of the variance (%)", xlim=(0, 100))
        payers = [cost for cost in front.costs if cost.bench_s]
        bench = figure.add_subplot(grid[1, 1])
        _bars(bench, [cost.cause for cost in payers], [cost.bench_s or 0.0 for cost in payers], "0.75", "bench")
        _bars(bench, [cost.cause for cost in payers], [cost.person_s or 0.0 for cost in payers], "0.35", "a person")
        bench.set(xlabel=f"time for {plus_minus(front.tolerance)} (s)")
        bench.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderpad=0.2)
    return save_in_new(figure, folder, PLOT)


def _named(cost: CauseCost) -> str:
    """A cause with what there is of it, as far as it is short."""
    return f"{cost.cause}\n{cost.has}" if cost.has else cost.cause


def _bars(ax: Axes, names: Sequence[str], values: Sequence[float], colour: str = "0.55", label: str = "") -> None:
    ax.barh(range(len(names)), values, color=colour, label=label, height=0.7)
    ax.set_yticks(range(len(names)), names, fontsize=8)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.tick_params(labelsize=8)
    ax.grid(alpha=0.3, axis="x")


def _draw_front(front: ModulusFront, ax: Axes) -> None:
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    times = [point.plan.times.mean for point in front.points]
    halves = [100 * point.plan.allocation.half for point in front.points]
    ends = np.maximum.accumulate([point.plan.times.longest for point in front.points])
    ax.fill_betweenx(
        halves, times, ends, color="0.5", alpha=BAND, lw=0, label="until the run ends at the latest (95 %)"
    )
    ax.plot(times, halves, "k-", lw=1.5, label="mean time of the quickest plan")
    slope = [halves[-1] * (times[-1] / each) ** 0.5 for each in times]
    ax.plot(times, slope, "k:", lw=0.8, label="four times the time, half the width")
    told = {front.asked.plan.times.mean} if front.asked is not None else set()
    for tolerance, point in front.targets:
        if point is not None and all(abs(math.log(point.plan.times.mean / other)) > APART for other in told):
            told.add(point.plan.times.mean)
            _mark(ax, point, "o", plus_minus(tolerance))
    if front.asked is not None:
        text = f"{plus_minus(front.tolerance)}: {duration(front.asked.plan.times.mean)}\n{plan_text(front.asked)}"
        _mark(ax, front.asked, "D", text)
    ticks = (10, 20, 60, 120, 300, 600, 1800, 3600, 2 * 3600, 5 * 3600, 10 * 3600, 24 * 3600)
    ax.set(xscale="log", yscale="log", xlabel="time from the command to the answer, a person's included")
    ax.set_ylabel("half-width of the 95 % interval (%)", fontsize=9)
    ax.xaxis.set_major_locator(FixedLocator(ticks))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: duration(value)))
    ax.yaxis.set_major_locator(FixedLocator((0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50)))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter("{x:g}")
    ax.tick_params(labelsize=8)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8, loc="lower left")


def _mark(ax: Axes, point: FrontPoint, marker: str, text: str) -> None:
    at = point.plan.times.mean, 100 * point.plan.allocation.half
    ax.plot(*at, marker, color="k", ms=6)
    ax.annotate(text, at, xytext=(7, 5), textcoords="offset points", fontsize=8)
