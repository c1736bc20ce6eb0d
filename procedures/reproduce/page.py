"""Everything on one HTML page that needs no other file: counts, tables, pictures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from procedures.report.text import STAMP, number
from procedures.reproduce.figure_page import figure_sections, heading, listed, pictures_of
from procedures.reproduce.rows import LEAST_SHARE, Row, RowTable
from procedures.reproduce.slips import COLUMNS, slips
from procedures.run import storing

if TYPE_CHECKING:
    from procedures.reproduce.comparison import Comparison
    from procedures.reproduce.everything import Everything

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 75em; padding: 0 1em; }
table { border-collapse: collapse; margin: 1em 0; font-variant-numeric: tabular-nums; }
th, td { border-bottom: 1px solid #ddd; padding: .15em .7em; text-align: right; }
th { border-bottom-color: #555; }
.outside { background: #fdd; } .repaired { background: #ffc; } .stamp { color: #c00; }
img { max-width: 100%; } .words td, .words th { text-align: left; vertical-align: top; }
"""
HEADER = (
    "row", "quantity", "printed", "thesis", "ours", "difference", "% of theory", "% of experiment", "scatter u",
    "within 2 u", "outside, because",
)  # fmt: skip


def write_page(done: Everything, folder: Path) -> Path:
    """The page, with pictures in it; returns the file. Raises RecordError."""
    path = folder / "index.html"
    tables = [table for table, _ in done.tables]
    drawn = done.models.pictures
    parts = [
        "<!doctype html><html lang=en><meta charset=utf-8><title>Against the thesis</title>",
        f"<style>{STYLE}</style><h1>Against the thesis</h1>",
        "<p>H. Singh, Design, Finite Element and Experimental Analysis of Piezoelectric Tactile Sensors for Endoscopic"
        f" Graspers. What is measured is <b class=stamp>{STAMP}</b>. Yellow: a slip of the thesis, repaired, with the"
        " reason; red: outside its stated scatter.</p>",
        _list(summary_lines(done)),
        *(_section(table) for table in tables),
        "<h1>Models</h1>",
        *(
            _comparison(comparison) + pictures_of(f"Table {comparison.table.number}", drawn)
            for comparison, _ in done.models.tables
        ),
        "<h1>Figures</h1>",
        *figure_sections(drawn),
        f"<h1>Slips of the thesis</h1><p>{len(slips())} cells, repaired everywhere above.</p>",
        f"<table><tr>{_cells('th', COLUMNS)}</tr>",
        *(f"<tr>{_cells('td', slip)}</tr>" for slip in slips()),
        "</table>",
    ]
    parts += listed(set(re.findall(r'<h2 id="([^"]*)"', "\n".join(parts))))
    with storing(path):
        path.write_text("\n".join(parts) + "\n", encoding="utf-8")
    return path


def summary_lines(done: Everything) -> list[str]:
    """What the page and the terminal say first."""
    found = done.summary()
    share = found["experimental_share"]
    lines = [
        f"{found['within']} of {found['judged']} rows lie within their stated scatter",
        f"experiments: {found['experimental_within']} of {found['experimental_cells']} cells within two standard"
        f" uncertainties of their scatter{'' if share is None else f', {share:.1%}'}; {LEAST_SHARE:.0%} are asked for",
    ]
    lines.append(f"experiments: {found['experimental_by_chance']}")
    lines += [
        f"BIASED: Table {table.number}: forces and voltages are off by {table.bias:+.2f} standard uncertainties in the"
        f" mean, {table.inside} of {len(table.judged)} rows within"
        for table, _ in done.tables
        if table.biased
    ]
    lines += [
        f"softness order, design {design}: {'right' if right else 'WRONG'}" for design, right in done.orders.items()
    ]
    return lines


def _section(table: RowTable) -> str:
    judged = f"{table.inside} of {len(table.judged)} rows within" if table.judged else "nothing is judged"
    doubt = f"<p>Doubtful as a whole: {escape(table.doubt)}.</p>" if table.doubt else ""
    return "\n".join(
        [
            f"{heading(f'Table {table.number}', table.title)}<p>{judged}.</p>{doubt}",
            _list(table.said),
            f"<table><tr>{_cells('th', HEADER)}</tr>",
            *(_row(row) for row in table.rows),
            "</table>",
        ]
    )


def _row(row: Row) -> str:
    kind = "outside" if row.within is False else "repaired" if row.cell.reason else ""
    of_theory, of_experiment = (number(error) for error in row.errors())
    verdict = "-" if row.within is None else "yes" if row.within else "NO"
    cells = (
        row.row, row.quantity, row.cell.printed, number(row.cell.value), number(row.ours), number(row.difference),
        of_theory, of_experiment, number(row.u), verdict, row.because or ("not known" if row.within is False else ""),
    )  # fmt: skip
    return f'<tr class="{kind}" title="{escape(row.cell.reason)}">{_cells("td", cells)}</tr>'


def _comparison(comparison: Comparison) -> str:
    table = comparison.table
    header = (
        "quantity",
        "set",
        "model",
        "worst",
        "at",
        "rms",
        "ours / thesis",
        "cells",
        "goal",
        "within goal",
        "evidence",
    )
    rows = [[number(value) for value in deviation.record().values()] for deviation in comparison.deviations()]
    repaired = [
        f"{row}, {column}: printed {c.printed}, is {c.value:g}: {c.reason}" for row, column, c in table.repaired()
    ]
    return "\n".join(
        [
            heading(f"Table {table.number}", table.title),
            _list([*comparison.said, *([f"doubtful as a whole: {table.doubt}"] if table.doubt else [])]),
            f"<table><tr>{_cells('th', header)}</tr>",
            *(f"<tr>{_cells('td', row)}</tr>" for row in rows),
            "</table>",
            f"<details><summary>{len(repaired)} repaired cells</summary>{_list(repaired)}</details>"
            if repaired
            else "",
        ]
    )


def _list(lines: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(line)}' for line in lines)}</ul>" if lines else ""


def _cells(tag: str, values: Sequence[str]) -> str:
    return "".join(f"<{tag}>{escape(value)}</{tag}>" for value in values)
