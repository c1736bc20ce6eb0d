"""Shows and draws the modulus of an object, what was predicted and what was reached."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.quantity import counted, plus_minus, show
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.object_modulus.course import (
    ObjectModulusAnswer,
    ObjectModulusResult,
    mounting_scatter,
    ratios_of,
)
from palpate.procedures.measurements.object_modulus.planning import planned_lines, scatter_told
from palpate.procedures.measurements.prospects import share
from palpate.procedures.showing.figure import name_all, new_figure, save, with_u
from palpate.procedures.showing.moduli import between
from palpate.procedures.showing.text import stamped, taken

MOST_NAMED = 7  # mountings in the legend of the plot


def show_modulus(result: ObjectModulusResult, outcome: Outcome) -> list[object]:
    """What was wanted, planned, measured and reached."""
    shares, groups = result.shares, ratios_of(result.points)
    return [
        stamped(outcome["simulated"], "Young modulus of one object"),
        *planned_lines(result.wanted, result.prospect),
        *_measured(result),
        *([] if (found := mounting_scatter(groups)) is None else [f"mountings      {scatter_told(found)}"]),
        f"stopped        {result.stopped}; {counted(sum(map(len, groups)), 'set')} in "
        f"{counted(len(groups), 'mounting')}, {taken(outcome)}",
        *([] if not shares else [_binds(shares)]),
        *(f"note           {note}" for note in result.notes),
    ]


def _binds(shares: Mapping[str, float]) -> str:
    name = max(shares, key=lambda each: shares[each])
    return f"binds          {name}, {share(shares[name])} of the variance"


def _measured(result: ObjectModulusResult) -> list[str]:
    """The modulus with both intervals, and both relative uncertainties."""
    if result.answer is None:
        return ["measured       nothing: no set is valid"]
    row, line = result.answer.row, result.answer.validation
    scale, modulus = between(row["kind"], row["scale_low_Pa"], row["scale_high_Pa"]), ""
    if row["modulus_Pa"] is None:
        scale = f"{scale} (95 %, scale); {row['note']}"
    else:
        modulus = f"{show(row['modulus_Pa'], 'Pa', 3)} {_half(result.answer, absolute=False)}"
        scale = f"{scale} (95 %, scale)"
    told = [f"measured       {modulus}{scale}", _absolute(result.answer, row, line)]
    if row["modulus_Pa"] is not None and result.wanted.sample:
        known = get_sample(result.wanted.sample).modulus
        apart = f"{share(abs(known / row['modulus_Pa'] - 1))} {'above' if known > row['modulus_Pa'] else 'below'}"
        told.append(
            f"thesis         {show(known, 'Pa', 3)}, {apart} what is measured; the interval on the scale leaves out how"
            " far the model is off"
        )
    return told


def _half(answer: ObjectModulusAnswer, *, absolute: bool) -> str:
    """Half-width of the 95 % interval, with a comma; empty: it is not known."""
    budget = answer.budget(absolute=absolute)
    return "" if budget is None else f"{plus_minus(budget.expanded() / budget.value)}, "


def _absolute(answer: ObjectModulusAnswer, row: Mapping[str, object], line: ValidationLine) -> str:
    if row["absolute_kind"] is None:
        return f"absolute       {line.source}"
    low, high = (end if isinstance(end := row[f"absolute_{name}_Pa"], float) else None for name in ("low", "high"))
    told = between(str(row["absolute_kind"]), low, high)
    return f"absolute       {_half(answer, absolute=True)}{told} (95 %); {line.source}"


def plot_modulus(result: ObjectModulusResult, simulated: bool, folder: Path) -> Path:
    """Draw the ratio of each set, and the share of each line in the variance. Returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"modulus of one object by model {result.prospect.found.model}")
    mountings = dict.fromkeys(point.mounting for point in result.points)
    for number in mountings:
        own = [(place, p) for place, p in enumerate(result.points, 1) if p.mounting == number and p.valid]
        label = f"mounting {number}" if len(mountings) <= MOST_NAMED else None
        ratios = with_u([p for _, p in own], "force_ratio")
        left.errorbar([place for place, _ in own], *ratios, fmt="o", ms=4, lw=1, capsize=2, label=label)
    if result.answer is not None:
        ratio = result.answer.ratio
        left.axhspan(*ratio.interval(), alpha=0.2, label="mean, 95 %")
    left.set(xlabel="number of the set", ylabel="force ratio (bars: standard uncertainty)")
    name_all(left, 4)
    shares = sorted(result.shares.items(), key=lambda each: each[1])
    right.barh([name for name, _ in shares], [100 * value for _, value in shares])
    right.set(xlabel="share of the variance (%)")
    return save(figure, folder)
