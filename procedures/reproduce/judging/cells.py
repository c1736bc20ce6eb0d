"""Every cell of a table of the thesis beside the models, for the page."""

from __future__ import annotations

import math
from collections.abc import Iterator
from html import escape

from palpate.procedures.reproduce.judging.comparison import Comparison
from palpate.procedures.showing.text import number

SHORT = 30  # rows; the cells of longer tables are folded away


def every_cell(comparison: Comparison) -> str:
    """Rows in the thesis' order: printed and repaired value, then ours by each model and parameter set.

    A cell that differs by more than the goal of its column is marked as outside.
    """
    table = comparison.table
    names = list(dict.fromkeys((s.parameters, s.model) for column in comparison.columns for s in column.ours))
    header = (table.key, "quantity", "printed", "thesis", *(f"{model}, {parameters}" for parameters, model in names))
    return "\n".join(
        [
            f"<details{' open' if len(table.rows) <= SHORT else ''}><summary>every cell beside ours</summary>",
            f"<table><tr>{''.join(f'<th>{escape(name)}</th>' for name in header)}</tr>",
            *_rows(comparison, names),
            "</table></details>",
        ]
    )


def _rows(comparison: Comparison, names: list[tuple[str, str]]) -> Iterator[str]:
    for index, key in enumerate(comparison.table.rows):
        for column in comparison.columns:
            cell, thesis = column.cells[index], float(column.thesis[index])
            series = {(each.parameters, each.model): float(each.values[index]) for each in column.ours}
            cells = "".join(f"<td>{escape(text)}</td>" for text in (key, column.quantity, cell.printed, number(thesis)))
            for name in names:
                ours = series.get(name, math.nan)
                off = column.goal is not None and abs(ours - thesis) > column.goal
                cells += f"<td{' class=outside' if off else ''}>{number(ours) if math.isfinite(ours) else '-'}</td>"
            repaired = f' class=repaired title="{escape(cell.reason)}"' if cell.reason else ""
            yield f"<tr{repaired}>{cells}</tr>"
