"""The front of a modulus: a table of plans, and a plot of uncertainty and its parts against bench time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.allocation.stopping import FIRST
from palpate.instrument.quantity import counted, show
from palpate.procedures.measurements.object_modulus.prospect import Prospect
from palpate.procedures.measurements.prospects import share
from palpate.procedures.showing.figure import save_in_new
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.text import STAMP, new_table, print_all, stamped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from palpate.procedures.accuracy.modulus.front import ModulusFront, QuickestPlan

PLOT = "modulus.png"
ROWS = 8  # of the front, in the table
SCALE, ABSOLUTE = "C0", "C3"
NAMED = 10.0  # percent of the variance from which on a line's name stands in its area
AREA = 0.75  # opacity


def title_of(front: ModulusFront) -> str:
    return f"Young modulus of an object of {show(front.modulus, 'Pa')}, by model {front.found.model!r}"


def plan_text(plan: Prospect) -> str:
    """A plan in a few words; one mounting is not told."""
    return f"{_sets_text(plan)}, {show(plan.load, 'N')}, {show(plan.allocation.dwell, 's')}"


def _sets_text(plan: Prospect) -> str:
    mountings, sets = plan.allocation.mountings, plan.allocation.sets
    return counted(sets, "set") if mountings == 1 else f"{mountings} x {counted(sets // mountings, 'set')}"


def percent(u: float | None) -> str:
    return "not known" if u is None else share(u)


def print_modulus_front(front: ModulusFront, simulated: bool, plot: Path | None) -> None:
    """Print the plan for each tolerance, some plans of the front, and what no time on the bench lowers."""
    asked = new_table(
        stamped(simulated, title_of(front)), "tolerance", "on the model's scale", "mean time", "gives", "absolute"
    )
    asked.columns[1].justify = "left"
    half = len(front.targets) // 2
    for scale, absolute in zip(front.targets[:half], front.targets[half:], strict=True):
        asked.add_row(f"{100 * scale.tolerance:g} %", *_cells(scale), _absolute(absolute))
    table = new_table(None, "bench time", "best plan", "scale", "absolute", "largest part\nof the variance")
    table.columns[1].justify = table.columns[4].justify = "left"
    for point in front.points[:: -(-len(front.points) // ROWS)]:
        plan, shares = point.plan, point.scale_shares if point.absolute_shares is None else point.absolute_shares
        binds = max(shares, key=lambda name: shares[name])
        table.add_row(
            duration(plan.allocation.seconds), plan_text(plan), percent(plan.scale_u), percent(plan.absolute_u),
            f"{binds} {share(shares[binds])}",
        )  # fmt: skip
    refused = [[each for each in some if each.plan is None] for some in (front.targets[:half], front.targets[half:])]
    plans = [each.plan for each in front.targets if each.plan is not None] + [each.plan for each in front.points]
    several = any(plan.allocation.mountings > 1 for plan in plans)
    mounted = (
        "the scatter of mountings was never measured and counts as none: --mounting-scatter"
        if front.mounting_u is None
        else f"one mounting leaves {percent(front.mounting_u)}"
    )
    print_all(
        asked,
        table,
        f"{duration(front.mounting)} of each time are for mounting and end, {front.person:g} s of them a person's;"
        f" {mounted}",
        f"u: relative standard uncertainty. With fewer than {FIRST} sets it leans upon what is known of the sensor;"
        " noise of the films is that of the scene or bench file (noise), or else the usual one",
        *(["2 x 10 sets: two mountings of ten load sets each"] if several else []),
        *(some[-1].why for some in refused if some),
        *([] if plot is None else [f"plot           {plot}"]),
    )


def _cells(target: QuickestPlan) -> tuple[str, str, str]:
    if target.plan is None:
        return "none, as told below", "", ""
    return plan_text(target.plan), duration(target.plan.times.mean), percent(target.plan.scale_u)


def _absolute(target: QuickestPlan) -> str:
    return "not reached" if target.plan is None else duration(target.plan.times.mean)


def plot_modulus_front(front: ModulusFront, simulated: bool, folder: Path) -> Path:
    """Draw `modulus.png` in a folder: the front with its limits on the left, the shares of variance on the right.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    figure = Figure(figsize=(13, 6.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1))
    left = figure.add_subplot(grid[:, 0])
    figure.suptitle(f"{STAMP}: {title_of(front)}" if simulated else title_of(front))
    times = [point.after for point in front.points]
    _draw_front(front, left, times)
    known = front.model_u is not None
    for place, (name, drawn) in enumerate((("on the model's scale", True), ("absolute", known))):
        ax = figure.add_subplot(grid[place, 1])
        ax.set_title(f"variance {name}", fontsize=10)
        if drawn:
            shares = [p.absolute_shares if place and p.absolute_shares else p.scale_shares for p in front.points]
            _draw_shares(front, ax, times, shares)
        else:
            ax.set_axis_off()
            ax.text(0.5, 0.5, "not known", transform=ax.transAxes, ha="center", fontsize=14, color="0.4")
        ax.set_xlabel("bench time after the mounting (s)")
    names = [line.name for line in front.lines]
    handles = [Patch(color=_colour(front, name), alpha=AREA, label=name) for name in names]
    figure.legend(handles=handles, loc="outside lower right", ncols=3, fontsize=9)
    return save_in_new(figure, folder, PLOT)


def _draw_front(front: ModulusFront, ax: Axes, times: Sequence[float]) -> None:
    plans = [point.plan for point in front.points]
    ax.plot(
        times, [100 * (plan.scale_u or math.nan) for plan in plans], color=SCALE, lw=1.2, label="on the model's scale"
    )
    if front.model_u is not None:
        ax.plot(
            times, [100 * (plan.absolute_u or math.nan) for plan in plans], color=ABSOLUTE, lw=3.5, label="absolute"
        )
        _limit(ax, front.model_u, "model: no time lowers it; references do (palpate calibrate model)", times)
    ax.plot(times, [100 * point.noise_u for point in front.points], color="0.5", ls="--", lw=1, label="noise alone")
    if front.mounting_u:
        _limit(ax, front.mounting_u, "one mounting; further mountings lower it", times)
    told: dict[tuple[float, bool], list[QuickestPlan]] = {}
    for target in front.targets:
        if target.after is not None:
            told.setdefault((target.after, target.absolute), []).append(target)
    for number, ((after, absolute), targets) in enumerate(told.items()):
        plan = targets[0].plan
        assert plan is not None
        at = after, 100 * ((plan.absolute_u if absolute else plan.scale_u) or math.nan)
        ax.plot(*at, "o", color=ABSOLUTE if absolute else SCALE, ms=7)
        text = f"{', '.join(f'{100 * target.tolerance:g}' for target in targets)} %: {_short(plan)}"
        late = after > times[0] ** 0.4 * times[-1] ** 0.6  # no room for words on the right
        _annotate(ax, text, at, below=late or number % 2 == 1)
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="bench time after the mounting (s)",
        ylabel="relative standard uncertainty of the modulus (%)",
    )
    ax.xaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.grid(alpha=0.3, which="both")
    ax.legend(
        loc="lower left", fontsize=9, title=f"mounting and end take {duration(front.mounting)} more", title_fontsize=9
    )


def _short(plan: Prospect) -> str:
    return f"{_sets_text(plan)}, {duration(plan.times.mean)} in all"


def _annotate(ax: Axes, text: str, at: tuple[float, float], below: bool) -> None:
    """Write beside a dot where the front is not: to the right and above it, or to the left and below."""
    where, side = ((-6, -14), "right") if below else ((7, 6), "left")
    note = ax.annotate(text, at, xytext=where, textcoords="offset points", fontsize=9, ha=side)
    note.set_in_layout(False)


def _limit(ax: Axes, u: float, name: str, times: Sequence[float]) -> None:
    ax.axhline(100 * u, color="0.3", ls=":", lw=1)
    ax.annotate(
        name, (times[-1], 100 * u), xytext=(0, 4), textcoords="offset points", ha="right", fontsize=8.5, color="0.3"
    )


def _colour(front: ModulusFront, name: str) -> str:
    """Colour of a line's area, the same in both panels."""
    return f"C{[line.name for line in front.lines].index(name)}"


def _draw_shares(front: ModulusFront, ax: Axes, times: Sequence[float], shares: Sequence[dict[str, float]]) -> None:
    """Areas stacked by line; the larger ones are named where they are largest."""
    heights = {name: [100 * each[name] for each in shares] for name in shares[0]}
    ax.stackplot(times, list(heights.values()), colors=[_colour(front, name) for name in heights], alpha=AREA)
    below = [0.0] * len(times)
    for name, height in heights.items():
        # Not at the edges, where there is no room for a name.
        place = max(range(len(times) // 4, 3 * len(times) // 4), key=lambda at: height[at])
        if height[place] > NAMED:
            at = times[place], below[place] + height[place] / 2
            ax.text(*at, f"{name}, {height[place]:.0f} %", ha="center", va="center", fontsize=9)
        below = [low + more for low, more in zip(below, height, strict=True)]
    ax.set(xscale="log", xlim=(times[0], times[-1]), ylim=(0, 100), ylabel="share (%)")
    ax.xaxis.set_major_formatter("{x:g}")
