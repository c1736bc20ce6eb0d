"""Report of a study: a line for each group of cells that differ in their seeds alone, and plots over each axis."""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any

from palpate.procedures.showing.figure import new_figure, save
from palpate.procedures.showing.text import MARKS, legend, new_table, number, print_all, stamped
from palpate.procedures.study.block import FEW_CELLS
from palpate.procedures.study.description import Value
from palpate.procedures.study.results import Results, coordinate

MOST_LINES, MOST_PANELS, MOST_REASONS = 40, 3, 5
DECADE_AND_MORE = 30.0  # ratio of an axis' ends from which on it is drawn logarithmic


def print_study(results: Results, outcome: dict[str, Any]) -> None:
    """Print groups, failures and files."""
    groups = results.groups()
    names = [name for name in results.study.axes if name != "seed"]
    table = new_table(
        stamped(True, f"{results.study.file.name}: mean force ratio, {results.study.file.how}"),
        *(name.removeprefix("effects.") for name in names), "cells", "failed", "ratio", "spread", "u", "model",
    )  # fmt: skip
    for group in groups[:MOST_LINES]:
        table.add_row(
            *(str(group.axes[name]) for name in names), str(group.cells), str(group.failed or ""),
            *map(number, (group.force_ratio, group.spread, group.force_ratio_u, group.model_force_ratio)),
        )  # fmt: skip
    lines = legend(table, marks=MARKS)
    if len(groups) > MOST_LINES:
        lines.append(f"and {len(groups) - MOST_LINES} lines more in {outcome['points'] or 'the results with --json'}")
    failed = outcome["failed"]
    lines += [f"cell {each['cell']} failed: {each['reason']}" for each in failed[:MOST_REASONS]]
    if len(failed) > MOST_REASONS:
        lines.append(f"and {len(failed) - MOST_REASONS} cells more failed: see --json")
    lines += [
        f"{count} cells were computed one by one, because of "
        + ("how few of them share a scene" if cause == FEW_CELLS else f"the effect {cause}")
        for cause, count in outcome["one_by_one"].items()
    ]
    lines += [
        f"study          {outcome['study']}, {outcome['done']} of {outcome['cells']} cells",
        f"points         {outcome['points'] or 'in study.record; as a table with --to csv or --to parquet'}",
        f"plot           {outcome['plot']}",
    ]
    print_all(table, *lines)


def plot_study(results: Results, folder: Path) -> Path:
    """Draws the mean force ratio of each cell over each axis that varies; returns the PNG."""
    ratios = array("d")
    axes: dict[str, list[Value]] = {name: [] for name in results.study.axes}
    for mean in results.means():
        if mean.force_ratio is not None:
            ratios.append(mean.force_ratio)
            for name, value in mean.axes.items():
                axes[name].append(value)
    varied = [name for name, values in axes.items() if any(str(value) != str(values[0]) for value in values)]
    shown = [name for name in varied if name != "seed"][:MOST_PANELS] or [*results.study.axes][:1]
    figure, panels = new_figure(True, len(shown), f"{results.study.file.name}, {len(ratios)} cells")
    for ax, name in zip(panels, shown, strict=True):
        values, unit = coordinate(axes[name])
        if any(isinstance(value, str) for value in values):
            places = {value: place for place, value in enumerate(dict.fromkeys(values))}
            ax.plot([places[value] for value in values], ratios, "o", ms=3, alpha=0.5)
            ax.set_xticks([*places.values()], [str(value) for value in places], fontsize=7)
        else:
            ax.plot(values, ratios, "o", ms=3, alpha=0.5)
            if values and min(values) > 0 and max(values) > DECADE_AND_MORE * min(values):  # type: ignore[operator]
                ax.set_xscale("log")
        ax.set(xlabel=f"{name} ({unit})" if unit else name, ylabel="mean force ratio")
    return save(figure, folder)
