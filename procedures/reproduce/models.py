"""Chapter 4 of the thesis, its tables in Appendix II and the theories of Table 5.8, beside the models."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from palpate.instrument.errors import UnknownName
from palpate.procedures.console.terminal import Progress
from palpate.procedures.records.run import storing
from palpate.procedures.reproduce import chapter4, figures
from palpate.procedures.reproduce.curves import RINGS, CurveCase, Curves, Solutions
from palpate.procedures.reproduce.figures import SavedPicture
from palpate.procedures.reproduce.rows import Comparison, counts_record, counts_said

# --- Files of a reproduction: a CSV for each table, one summary, one JSON object -----------------------

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


# --- the models ----------------------------------------------------------------------------------------

PROCEDURE = "reproduce-models"
SETS = ("physical", "identified")
BOTH = "both"

Compare = Callable[[Sequence[str], Curves], Comparison]
# Tables in the order in which they are made.
TABLES: Mapping[str, Compare] = MappingProxyType(
    {
        **{number: partial(chapter4.compare_single, number) for number in ("A2.1", "4.1", "A2.2", "4.2")},
        **{
            number: partial(chapter4.compare_pair, number)
            for number in ("A2.3", "4.5", "A2.5", "4.3", "A2.4", "4.6", "A2.6", "4.4")
        },
        "A2.7": chapter4.compare_position,
        "5.8": chapter4.compare_theories,
    }
)


SECONDS, FRESH = 7.0, 12.0  # s of processor time that `run` takes for both sets, by known solutions and anew [M]


@dataclass(slots=True)
class Reproduction:
    """Tables and pictures that are done so far, with their files in `folder`; `summary` lists all."""

    folder: Path
    tables: list[tuple[Comparison, Path]] = field(default_factory=list)
    pictures: list[SavedPicture] = field(default_factory=list)
    summary: Path | None = None


def parameter_sets(name: str) -> tuple[str, ...]:
    """Names of the parameter sets that "physical", "identified" or "both" means.

    Raises:
        UnknownName: it is none of these.
    """
    if name not in (*SETS, BOTH):
        raise UnknownName("parameter set", name, (*SETS, BOTH))
    return SETS if name == BOTH else (name,)


def cases(parameters: Sequence[str]) -> list[CurveCase]:
    """Every curve that tables and figures need."""
    pairs = [
        chapter4.pair_cases(parameters, design, ring) for design in ("common_base", "different_base") for ring in RINGS
    ]
    singles = [chapter4.single_cases(parameters, ring) for ring in RINGS]
    wanted = [case for cases in (*singles, *pairs) for case in cases.values()]
    return [*wanted, *figures.model_cases(parameters), *figures.bench_cases(parameters)]


def run(parameters: Sequence[str], done: Reproduction, progress: Progress, fresh: bool = False) -> Curves:
    """Make all tables, then the figures, then the summary. Each is on disk and in `done` before the next begins.

    Returns the curves, which the figures of chapter 5 need as well.

    Args:
        parameters: names of the parameter sets.
        done: is filled.
        progress: is told of each solution.
        fresh: whether everything is solved anew and the solutions are written, instead of using known ones.

    Raises:
        EstimateError: a linear system cannot be solved accurately.
        RecordError: a file cannot be written.
    """
    solutions = Solutions() if fresh else Solutions.shipped()
    curves = Curves(
        cases(parameters), extra=len(chapter4.position_sets(parameters)), progress=progress, solutions=solutions
    )
    try:
        for compare in TABLES.values():
            comparison = compare(parameters, curves)
            done.tables.append((comparison, write_table(comparison, done.folder)))
            if comparison.table.number == "A2.7":
                done.pictures.append(figures.draw_position(comparison, done.folder))
        for picture in figures.model_pictures(parameters, curves, done.folder):
            done.pictures.append(picture)
    finally:
        if done.tables:  # also after an interruption
            done.summary = write_summary(done.tables, done.pictures, done.folder)
    if fresh:
        solutions.write(done.folder)
    return curves
