"""Prices of accuracy on one page: the modulus, models, integrators, dwell, arithmetic.

Each part has units of its own; its table and its panel show the same ways.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.instrument.models.price_list import PriceList
from palpate.instrument.quantity import show
from palpate.procedures.accuracy.arithmetic import ArithmeticPrice
from palpate.procedures.accuracy.dwell import TARGETS, DwellPrices
from palpate.procedures.accuracy.modulus.front import ModulusFront
from palpate.procedures.accuracy.modulus.report import plan_text
from palpate.procedures.showing.figure import MARKERS, save_in_new, write
from palpate.procedures.showing.text import new_table, print_all, stamped

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes


# --- Work-precision diagrams: error against the time of one answer, a panel for each design ------------

# The range of moduli of the rubber samples, in which every model answers.
INTERVAL = 1
MODELS_PLOT = "models.png"
REFERENCE = "uncertainty of the reference"


def plot_prices(prices: PriceList, designs: list[str], path: Path) -> None:
    """Draw a PNG file in an existing folder. A design without a reference has no panel.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    from matplotlib.figure import Figure

    references = {reference.design: reference for reference in prices.references if reference.design in designs}
    columns = min(2, len(references)) or 1
    rows = -(-len(references) // columns) or 1
    figure = Figure(figsize=(5.6 * columns + 2, 4.4 * rows), layout="constrained")
    low, high = prices.moduli_Pa[INTERVAL : INTERVAL + 2]
    figure.suptitle(
        f"Greatest error of the force ratio for objects of {show(low, 'Pa', 3)} to {show(high, 'Pa', 3)}"
        f"\n{prices.machine.cpu}, {prices.machine.date}"
    )
    models = list(dict.fromkeys(price.model for price in prices.prices))
    drawn: dict[str, Artist] = {}
    for place, (design, reference) in enumerate(references.items()):
        ax = figure.add_subplot(rows, columns, place + 1)
        for number, model in enumerate(models):
            style = f"C{number}{MARKERS[number % len(MARKERS)]}"
            own = [
                p for p in prices.prices if (p.design, p.model) == (design, model) and p.errors[INTERVAL] is not None
            ]
            answers = [(p.answer_s, p.errors[INTERVAL]) for p in own if p.answer_s is not None]
            meshes = [(p.seconds, p.errors[INTERVAL]) for p in own if p.answer_s is None and p.seconds is not None]
            for points, kind in ((answers, {"ls": "-", "lw": 1}), (meshes, {"ls": "", "mfc": "none"})):
                if points:
                    (line,) = ax.plot(*zip(*points, strict=True), style, ms=6, **kind)
                    drawn.setdefault(model, line)
        known = max(reference.uncertainties[INTERVAL : INTERVAL + 2])
        drawn[REFERENCE] = ax.axhline(known, color="0.5", ls=":")
        ax.set(xscale="log", yscale="log", title=design, xlabel="processor time of one answer (s)", ylabel="error")
        ax.grid(alpha=0.3)
    # One legend for all panels. Of a hollow point the time is that of one mesh, which callers do not get alone.
    names = [name for name in (*models, REFERENCE) if name in drawn]
    figure.legend(
        [drawn[name] for name in names], names, loc="outside right upper", fontsize=8, title="hollow: one mesh alone"
    )
    write(figure, path)


# --- The page of prices: a table and a panel for each part, from the same ways -------------------------

PLOT = "accuracy.png"
LEAST = 1e-16  # an exact result is drawn at this error


def print_page(parts: Sequence[PagePart], plot: Path | None) -> None:
    """Print a table for each part: the quickest way within each tolerance, or the reason why there is none."""
    for part in parts:
        named = part.name if part.error_of in part.name else f"{part.name}: {part.error_of}"
        table = new_table(stamped(part.time == BENCH, named), "tolerance", "take", "error", part.time)
        table.columns[1].justify = "left"
        reasons = []
        for each in part.recommended:
            take = " ".join(text for text in (each.name, each.setting) if text)
            if each.error is None or each.seconds is None:
                take = "nothing"
                reasons.append(f"{100 * each.tolerance:g} %: {each.why}")
            error = "" if each.error is None else f"{each.error:.1e}"
            seconds = "" if each.seconds is None else f"{each.seconds:.2g}"
            table.add_row(f"{100 * each.tolerance:g} %", take, error, seconds)
        print_all(table, *reasons, *([part.note] if part.note else []), "")
    if plot is not None:
        print_all(f"plot           {plot}")


def plot_page(parts: Sequence[PagePart], folder: Path) -> Path:
    """Draw `accuracy.png` in a folder: a panel for each part, and one for all of arithmetic.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    from matplotlib.figure import Figure

    drawn = [part for part in parts if not part.name.startswith(ARITHMETIC)]
    tasks = [part for part in parts if part.name.startswith(ARITHMETIC)]
    rows = -(-len(drawn) // 2)
    figure = Figure(figsize=(14, 4.6 * rows + 4.2), layout="constrained")
    # The long names of the lower panel do not push the upper ones aside.
    upper, lower = figure.subfigures(2, 1, height_ratios=(4.6 * rows, 4.2), squeeze=False)[:, 0]
    for place, part in enumerate(drawn):
        _draw(part, upper.add_subplot(rows, 2, place + 1))
    _draw_tasks(tasks, lower.add_subplot())
    return save_in_new(figure, folder, PLOT)


def _draw(part: PagePart, ax: Axes) -> None:
    """Error against time of the ways of one part; rings: the ways that the table recommends."""
    for place, name in enumerate(dict.fromkeys(way.name for way in part.ways)):
        own = [(w.seconds, max(w.error, LEAST)) for w in part.ways if w.name == name and w.error is not None]
        if own:
            style = f"C{place % 10}{MARKERS[place % len(MARKERS)]}-"
            ax.plot(*zip(*own, strict=True), style, ms=4, lw=0.9, label=name)
    told = [(r.seconds, max(r.error, LEAST)) for r in part.recommended if r.seconds is not None and r.error is not None]
    if told:
        ax.plot(*zip(*told, strict=True), "o", ms=11, mfc="none", mec="k", mew=1, label="recommended")
    if part.floor > 0:
        ax.axhline(part.floor, color="0.4", ls=":", lw=1, label=f"floor: {part.floor_of}")
    title = f"{part.name}: {part.error_of}"
    ax.set_title(f"SIMULATED, {title}" if part.time == BENCH else title, fontsize=10)
    ax.set(xscale="log", yscale="log", xlabel=part.time, ylabel="relative error")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=7.5)


def _draw_tasks(tasks: Sequence[PagePart], ax: Axes) -> None:
    """A row for each way of each task of arithmetic, with its error and its time."""
    rows = [(number, part, way) for number, part in enumerate(tasks) for way in part.ways if way.error is not None]
    for row, (number, _, way) in enumerate(rows):
        error = max(way.error or 0.0, LEAST)
        ax.plot([LEAST, error], [row, row], color=f"C{number}", lw=0.8, alpha=0.5)
        ax.plot(error, row, "o", color=f"C{number}", ms=5)
        ax.annotate(
            f"{way.seconds:.1e} s", (error, row), xytext=(6, 0), textcoords="offset points", fontsize=7, va="center"
        )
    ax.set_yticks(range(len(rows)), [f"{part.error_of}: {way.name}" for _, part, way in rows], fontsize=7)
    ax.set(xscale="log", xlim=(LEAST / 2, 100), xlabel="relative error, with processor time beside it")
    ax.set_title("arithmetic", fontsize=10)
    ax.invert_yaxis()
    ax.grid(alpha=0.3, axis="x")


# --- the whole page ------------------------------------------------------------------------------------

TOLERANCES = TARGETS
CPU, BENCH = "processor time (s)", "bench time after the mounting (s)"
MODULUS, MODELS, INTEGRATORS = "modulus", "sensor models", "time integration"
DWELL, ARITHMETIC = "dwell", "arithmetic"
SCALE, ABSOLUTE, MEAN = "on the model's scale", "absolute", "mean of load sets"


@dataclass(frozen=True, slots=True)
class MethodPoint:
    """One method at one setting: relative error (None where it fails) and seconds."""

    name: str
    setting: str
    error: float | None
    seconds: float


@dataclass(frozen=True, slots=True)
class RecommendedMethod:
    """The cheapest method that meets a tolerance, or the reason why there is none."""

    tolerance: float
    name: str | None = None
    setting: str | None = None
    error: float | None = None
    seconds: float | None = None
    why: str = ""


@dataclass(frozen=True, slots=True)
class PagePart:
    """One part of the page.

    Attributes:
        error_of: what has the relative error.
        time: what the seconds of its ways are.
        floor: relative error below which no way comes, as `floor_of` says; 0: there is none.
        note: what else to know, for people.
    """

    name: str
    error_of: str
    time: str
    ways: tuple[MethodPoint, ...]
    recommended: tuple[RecommendedMethod, ...]
    floor: float = 0.0
    floor_of: str = ""
    note: str = ""

    def summary(self) -> dict[str, Any]:
        """The part as JSON has it."""
        return asdict(self)


def of_modulus(front: ModulusFront) -> PagePart:
    """Part for the modulus of an object: the front of `palpate accuracy modulus`, and plans on the model's scale."""
    ways = [MethodPoint(SCALE, plan_text(point.plan), point.plan.scale_u, point.after) for point in front.points]
    ways += [MethodPoint(ABSOLUTE, plan_text(point.plan), point.plan.absolute_u, point.after) for point in front.points]
    recommended = [
        RecommendedMethod(each.tolerance, SCALE, plan_text(each.plan), each.plan.scale_u, each.after)
        if each.plan is not None
        else RecommendedMethod(each.tolerance, why=each.why)
        for each in front.targets
        if not each.absolute
    ]
    model = front.found.model
    note = (
        f"absolute: not known, since the validation error of model {model!r} is not"
        if front.model_u is None
        else f"absolute: no bench time gets below {front.model_u:.2g}, the validation error of model {model!r}"
    )
    return PagePart(
        name=MODULUS,
        error_of=f"Young modulus of an object of {show(front.modulus, 'Pa')}",
        time=BENCH,
        ways=tuple(ways),
        recommended=tuple(recommended),
        floor=front.model_u or 0.0,
        floor_of="absolute, the model's error",
        note=f"{note}: palpate accuracy modulus",
    )


def of_models(prices: PriceList, design: str) -> PagePart:
    """Part for the models, from the stored list: each answer that a caller gets, with promised error and whole time."""
    (reference,) = (r for r in prices.references if r.design == design)
    smallest = min(reference.force_ratios[INTERVAL : INTERVAL + 2])
    ways = []
    for price in prices.prices:
        promise = price.promise(slice(INTERVAL, INTERVAL + 1))
        if price.design == design and promise is not None and price.answer_s is not None:
            ways.append(MethodPoint(price.model, price.refinement, promise / smallest, price.answer_s))
    return _part(MODELS, f"force ratio of design {design}, one answer", CPU, ways)


def of_integrators(ways: Sequence[MethodPoint]) -> PagePart:
    """Part for the integrators of a stiff chain."""
    return _part(INTEGRATORS, "output of a stiff chain over 10 s", CPU, ways)


def of_dwells(prices: DwellPrices, scene: str) -> PagePart:
    """Part for the dwells: the whole uncertainty of one load set by each estimator, and means of sets for targets."""
    ways = [MethodPoint(p.estimator, f"{p.dwell_s:g} s", p.whole_u, p.seconds) for p in prices.points]
    recommended = []
    for r in prices.recommended:
        if r.u is None or r.seconds is None:
            recommended.append(RecommendedMethod(r.target, why=r.why))
            continue
        setting = f"{r.sets:,} x {r.dwell_s:g} s by {r.estimator}"
        recommended.append(RecommendedMethod(r.target, MEAN, setting, r.u, r.seconds))
        ways.append(MethodPoint(MEAN, setting, r.u, r.seconds))
    return PagePart(
        name=DWELL,
        error_of=f"force ratio of scene {scene}",
        time=BENCH,
        ways=tuple(ways),
        recommended=tuple(recommended),
        floor=prices.floor_u,
        floor_of="one load set, whatever its dwell",
    )


def of_arithmetic(measured: Sequence[ArithmeticPrice]) -> list[PagePart]:
    """Parts for the arithmetic, one for each task."""
    tasks = dict.fromkeys(m.task for m in measured)
    return [
        _part(
            f"{ARITHMETIC}: {task}",
            task,
            CPU,
            [MethodPoint(m.way, "", m.error, m.seconds) for m in measured if m.task == task],
        )
        for task in tasks
    ]


def _part(name: str, error_of: str, time: str, ways: Sequence[MethodPoint]) -> PagePart:
    return PagePart(name, error_of, time, tuple(ways), tuple(cheapest(ways, t) for t in TOLERANCES))


def cheapest(ways: Sequence[MethodPoint], tolerance: float) -> RecommendedMethod:
    """The fastest method whose error is within the tolerance; of equally fast ones the most accurate."""
    known = [way for way in ways if way.error is not None]
    good = [way for way in known if way.error is not None and way.error <= tolerance]
    if not good:
        best = min((way.error for way in known if way.error is not None), default=None)
        why = "none answers" if best is None else f"the best is off by {best:.2g}"
        return RecommendedMethod(tolerance, why=why)
    found = min(good, key=lambda way: (way.seconds, way.error))
    return RecommendedMethod(tolerance, found.name, found.setting, found.error, found.seconds)
