"""Shows and plots the result of a softness test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.softness.ranking import ranked_lines
from palpate.procedures.measurements.softness.result import Softness, SoftnessPoint, SoftnessResult
from palpate.procedures.records.columns import LAST, Column, columns_of
from palpate.procedures.showing import moduli
from palpate.procedures.showing.figure import logarithmic, name_all, new_figure, plot_over_loads, save
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import MARKS, legend, stamped

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Look:
    """Colour and width of an interval's bar."""

    color: str
    width: float


ABSOLUTE, SCALE = Look("0.75", 7.0), Look("C0", 1.5)


def show_softness(result: SoftnessResult, outcome: Outcome) -> list[object]:
    """Ratio and modulus of each object, on the model's scale and absolute, their order, and the model's error."""
    note = Column(head="note", cell=partial(_note, result.points), after=LAST)
    columns = columns_of(Softness) | moduli.COLUMNS | {"note": note}
    table = table_of(stamped(outcome["simulated"], f"Softness, by model {result.model!r}"), result.objects, columns)
    alike = ", ".join(f"{one} and {other}" for one, other in result.alike)
    return [
        table,
        *legend(table, marks={**MARKS, "any": "every modulus agrees with the ratio"}),
        f"softness order, hard to soft: {' > '.join(result.softness_order) or 'none, no point is valid'}",
        *([f"cannot be told apart at 95 %: {alike}"] if alike and result.ranked is None else []),
        *([] if result.ranked is None else [*ranked_lines(result.ranked), _seconds(outcome)]),
        moduli.absolute_line(result.validation),
        *moduli.bound_line(each.modulus_Pa is not None for each in result.objects if each.valid_points),
        f"price          {result.price}",
    ]


def _note(points: Sequence[SoftnessPoint], each: Softness) -> str:
    """What to know about what is found of an object."""
    flags = dict.fromkeys(f for p in points if p.object == each.object and not p.valid for f in p.flags)
    notes = [
        *([f"not used: {' '.join(flags)}"] if flags else []),
        *(["a film is saturated: take a smaller load"] if each.saturated else []),
        *([each.note] * bool(each.note)),
    ]
    return "; ".join(notes)


def _seconds(outcome: Outcome) -> str:
    """A line with the bench time that was predicted and taken."""
    predicted, achieved = outcome["predicted_seconds"], outcome["achieved_seconds"]
    times = [("predicted", predicted), ("taken", achieved)]
    return "bench time     " + ", ".join(f"{s:z.0f} s {name}" for name, s in times if s is not None)


def plot_softness(result: SoftnessResult, simulated: bool, folder: Path) -> Path:
    """Plot ratios over loads, and the moduli with their intervals. Returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"softness by model {result.model}")
    for place, each in enumerate(result.objects):
        points = [p for p in result.points if p.object == each.object]
        plot_over_loads(left, place, each.object, points)
    left.set(xlabel="load, peak to peak (N)", ylabel="force ratio (bars: standard uncertainty)")
    name_all(left, 6, title="object")
    known = [each for each in result.objects if each.scale_low_Pa or each.scale_high_Pa]
    for place, each in enumerate(known):
        if each.absolute_low_Pa or each.absolute_high_Pa:
            _bar(right, place, each.absolute_low_Pa, each.modulus_Pa, each.absolute_high_Pa, ABSOLUTE)
        _bar(right, place, each.scale_low_Pa, each.modulus_Pa, each.scale_high_Pa, SCALE)
    told = "thick absolute, thin scale" if result.validation.u is not None else "scale; absolute not known"
    right.set(xlabel=f"modulus (kPa; 95 %: {told}; arrows: bounds)", ylabel="object")
    right.set(yticks=range(len(known)), yticklabels=[e.object for e in known])
    right.set_xscale("log")
    logarithmic(right, *right.get_xlim())
    return save(figure, folder)


def _bar(axes: Axes, place: int, low: float | None, middle: float | None, high: float | None, look: Look) -> None:
    """Draw an interval of moduli [Pa] in kPa; an arrow at its end says that there is no bound on the other side."""
    ends = [1e-3 * end for end in (low, middle, high) if end]
    axes.plot(ends, [place] * len(ends), "-", color=look.color, lw=look.width, solid_capstyle="butt")
    for end, marker in ((low, "|" if high else ">"), (middle, "o"), (high, "|" if low else "<")):
        if end:
            axes.plot(1e-3 * end, place, marker, color=look.color)
