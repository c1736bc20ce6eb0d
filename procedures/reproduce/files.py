"""Files of a reproduction: a CSV for each table, one summary, one JSON object."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.procedures.records.run import storing
from palpate.procedures.reproduce.figures import SavedPicture
from palpate.procedures.reproduce.rows import Comparison, counts_record, counts_said

REPAIRED = "*"
PREFACE = """# Against the thesis

H. Singh, "Design, Finite Element and Experimental Analysis of Piezoelectric Tactile Sensors for Endoscopic Graspers",
beside the sensor models. Forces and voltages are magnitudes, under 1 N in all. Cells marked * are repaired; the CSV
files have every cell with what is printed. The physical set is what the thesis says of the experiments; the
identified sets are fitted to Tables A2.1 and A2.3, the capped one to A2.7: effective values, not physical ones.
"""


def write_table(comparison: Comparison, folder: Path) -> Path:
    """Write every cell as CSV; returns the file.

    Raises:
        RecordError: it cannot be written.
    """
    path = folder / f"table_{comparison.table.number.replace('.', '_')}.csv"
    records = list(comparison.records())
    header = list(dict.fromkeys(name for record in records for name in record))
    with storing(path), path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, header, lineterminator="\n")
        writer.writeheader()
        writer.writerows(records)
    return path


def write_summary(tables: Sequence[tuple[Comparison, Path]], pictures: Sequence[SavedPicture], folder: Path) -> Path:
    """Write all tables' deviations and sentences, first columns, repaired cells and pictures as Markdown.

    Raises:
        RecordError: it cannot be written.
    """
    path = folder / "summary.md"
    parts = [PREFACE, *(_section(comparison, file) for comparison, file in tables)]
    parts += [f"## {p.number}: {p.shows}\n\n![{p.number}]({p.file.name})\n\n{p.caption}\n" for p in pictures]
    with storing(path):
        path.write_text("\n".join(parts), encoding="utf-8")
    return path


def table_object(comparison: Comparison, file: Path) -> dict[str, Any]:
    """A table as JSON has it."""
    table = comparison.table
    return {
        "table": table.number,
        "title": table.title,
        "doubt": table.doubt or None,
        "file": str(file),
        "evidence": counts_record(comparison.row_table()),
        "summary": [deviation.record() for deviation in comparison.deviations()],
        "said": list(comparison.sentences),
        "repaired": [
            {table.key: row, "column": column, "printed": cell.printed, "best": cell.value, "reason": cell.reason}
            for row, column, cell in table.repaired()
        ],
        "rows": list(comparison.records()),
    }


def _section(comparison: Comparison, file: Path) -> str:
    table = comparison.table
    lines = [f"## Table {table.number}: {table.title}", "", f"[{file.name}]({file.name})", ""]
    if table.doubt:
        lines += [f"Doubtful as a whole: {table.doubt}.", ""]
    lines += [f"- {sentence}." for sentence in (*counts_said(comparison.row_table()), *comparison.sentences)]
    lines += ["", *_markdown(_deviations(comparison)), "", *_markdown(_side_by_side(comparison))]
    if repaired := table.repaired():
        rows = [(row, column, c.printed, f"{c.value:g}", c.reason) for row, column, c in repaired]
        lines += ["", *_markdown([(table.key, "column", "printed", "best", "reason"), *rows])]
    return "\n".join([*lines, ""])


def _deviations(comparison: Comparison) -> list[tuple[str, ...]]:
    header = ("quantity", "set", "model", "worst", "at", "rms", "ours / thesis", "within goal", "evidence")
    rows = [
        (
            d.quantity, d.parameters, d.model, f"{d.worst:+.3g}", d.worst_at, f"{d.rms:.3g}", f"{d.factor:.3g}",
            "-" if d.within is None else f"{d.within} of {d.cells} within {d.goal:g}", d.evidence.value,
        )
        for d in comparison.deviations()
    ]  # fmt: skip
    return [header, *rows]


def _side_by_side(comparison: Comparison) -> list[tuple[str, ...]]:
    """All rows of the first column."""
    column = comparison.columns[0]
    header = [comparison.table.key, column.quantity]
    for series in column.ours:
        header += [f"{series.parameters} {series.model}", "difference", "relative"]
    rows = []
    for index, (row, cell) in enumerate(zip(comparison.table.rows, column.cells, strict=True)):
        thesis = abs(cell.value)
        line = [row, f"{thesis:g}{REPAIRED if cell.reason else ''}"]
        for series in column.ours:
            ours = float(series.values[index])
            line += [f"{ours:.4f}", f"{ours - thesis:+.4f}", f"{100 * (ours / thesis - 1):+.1f} %"]
        rows.append(tuple(line))
    return [tuple(header), *rows]


def _markdown(rows: Sequence[tuple[str, ...]]) -> list[str]:
    header, *rest = rows
    lines = [header, ("---",) * len(header), *rest]
    return ["| " + " | ".join(line) + " |" for line in lines]
