"""Prints and plots the result of a softness test."""

from __future__ import annotations

from pathlib import Path

from palpate.instrument.findings.modulus_of_ratio import AT_LEAST, AT_MOST, INTERVAL
from palpate.instrument.quantity import show
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.softness.result import Softness, SoftnessResult
from palpate.procedures.showing.figure import new_figure, save
from palpate.procedures.showing.marks import MARKS, legend
from palpate.procedures.showing.text import new_table, number, print_all, stamped, where


def print_softness(result: SoftnessResult, outcome: Outcome, plot: Path) -> None:
    """Print ratio and modulus of each object, their order, and the model with its error."""
    table = new_table(
        stamped(outcome["simulated"], f"Softness, by model {result.model!r}"),
        "object", "force ratio", "u", "modulus", "95 % interval", "valid", "note",
    )  # fmt: skip
    for each in result.objects:
        flags = dict.fromkeys(f for p in result.points if p.object == each.object and not p.valid for f in p.flags)
        notes = [
            *([f"not used: {' '.join(flags)}"] if flags else []),
            *(["a film is saturated: take a smaller load"] if each.saturated else []),
            *([each.note] * bool(each.note)),
        ]
        table.add_row(
            each.object, number(each.force_ratio), number(each.force_ratio_u),
            "-" if each.modulus_Pa is None else show(each.modulus_Pa, "Pa", 3), _interval(each),
            str(each.valid_points), "; ".join(notes),
        )  # fmt: skip
    alike = ", ".join(f"{one} and {other}" for one, other in result.alike)
    print_all(
        table,
        *legend(table, marks={**MARKS, "any": "every modulus agrees with the ratio"}),
        f"softness order, hard to soft: {' > '.join(result.softness_order) or 'none, no point is valid'}",
        *([f"cannot be told apart at 95 %: {alike}"] if alike else []),
        f"price          {result.price}",
        *where(outcome, plot),
    )


def plot_softness(result: SoftnessResult, simulated: bool, folder: Path) -> Path:
    """Plot ratios over loads, and the moduli with their intervals. Returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"softness by model {result.model}")
    for each in result.objects:
        points = [p for p in result.points if p.object == each.object]
        left.errorbar(
            [p.load_N for p in points], [p.force_ratio for p in points], [p.force_ratio_u for p in points], fmt="o-",
            capsize=2, label=each.object,
        )  # fmt: skip
    left.set(xlabel="load, peak to peak (N)", ylabel="force ratio (bars: standard uncertainty)")
    left.legend(fontsize=8, title="object", ncols=6, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    known = [each for each in result.objects if each.low_Pa or each.high_Pa]
    for place, each in enumerate(known):
        low, high = each.low_Pa, each.high_Pa
        ends = [1e-3 * end for end in (low, each.modulus_Pa, high) if end]
        right.plot(ends, [place] * len(ends), "-", color="C0")
        for end, marker in ((low, "|" if high else ">"), (each.modulus_Pa, "o"), (high, "|" if low else "<")):
            if end:
                right.plot(1e-3 * end, place, marker, color="C0")
    right.set(xscale="log", xlabel="modulus (kPa; bars: 95 %, arrows: a bound)", ylabel="object")
    right.set(yticks=range(len(known)), yticklabels=[e.object for e in known])
    for axis in (right.xaxis.set_major_formatter, right.xaxis.set_minor_formatter):
        axis("{x:g}")
    return save(figure, folder)


def _interval(each: Softness) -> str:
    match each.kind:
        case kind if kind == INTERVAL and each.low_Pa and each.high_Pa:
            return f"{show(each.low_Pa, 'Pa', 3)} to {show(each.high_Pa, 'Pa', 3)}"
        case kind if kind == AT_LEAST and each.low_Pa:
            return f"at least {show(each.low_Pa, 'Pa', 3)}"
        case kind if kind == AT_MOST and each.high_Pa:
            return f"at most {show(each.high_Pa, 'Pa', 3)}"
    return "-" if each.kind is None else "any"
