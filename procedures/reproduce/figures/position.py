"""The picture of Table A2.7: forces of both teeth, and their ratio, under a load that moves along the common base."""

from __future__ import annotations

from pathlib import Path

from palpate.procedures.reproduce.figures.picture import COLORS, THESIS, Picture, canvas, legend, save
from palpate.procedures.reproduce.judging.comparison import Comparison

NUMBER = "Table A2.7"
TEETH = {"force_pvdf3_N": ("left tooth", "o", "-"), "force_pvdf1_N": ("right tooth", "s", "--")}
RATIO = {"force_ratio": ("both teeth", "D", "-")}


def draw(comparison: Comparison, folder: Path) -> Picture:
    """Draw the teeth on the left and their sum on the right. Raises RecordError."""
    drawing, (left, right) = canvas(NUMBER, 2)
    x = comparison.table.keys()
    for axes, shown in ((left, TEETH), (right, RATIO)):
        for column in comparison.columns:
            if column.quantity not in shown:
                continue
            words, marker, style = shown[column.quantity]
            axes.plot(x, column.thesis, marker, color=THESIS, ms=4, mfc="none", label=f"thesis, {words}")
            for series in column.ours:
                worth = column.evidence(series, comparison.table).value
                label = f"ours, {words}: {series.parameters} set, {worth}"
                axes.plot(x, series.values, style, color=COLORS[series.parameters], lw=1.3, label=label)
        axes.axhline(0, color=THESIS, lw=0.6)
        axes.grid(alpha=0.3)
        axes.set(xlabel="place of the load (mm, inferred)")
    left.set(ylabel="force on a tooth (N)")
    right.set(ylabel="force on both teeth over total force")
    legend(drawing, columns=3)
    caption = (
        "Marks: the thesis' table. Curves: ours by model solid under a force of 1 N in one point; the legend says which"
        " set was fitted to this table and which predicts it."
    )
    return save(drawing, NUMBER, caption, folder)
