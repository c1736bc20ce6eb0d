"""A reproduction as one HTML page that needs no other file, and as printed tables."""

from __future__ import annotations

import base64
import re
from collections.abc import Container, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from palpate.instrument.models.evidence import Evidence
from palpate.instrument.models.validation import SIGN, Validation
from palpate.instrument.thesis import Content, contents
from palpate.procedures.records.run import storing
from palpate.procedures.reproduce.chapter5 import distance_sentence
from palpate.procedures.reproduce.criterion import Verdict, judge
from palpate.procedures.reproduce.figures import SavedPicture
from palpate.procedures.reproduce.models import Reproduction
from palpate.procedures.reproduce.rows import (
    COLUMNS,
    Comparison,
    Row,
    RowTable,
    counts,
    counts_said,
    every_cell,
    slips,
)
from palpate.procedures.showing.text import STAMP, new_table, number, print_all, stamped

# --- Figures on the page: those of chapters 4 and 5 and the bridge, and a list of all numbered tables and figures

ALL = "All tables and figures of the thesis"
WITH_SECTION = ("Figure 4.", "Figure 5.", "Figure A3.5")
LIST_HEADER = ("number", "section", "shows", "here", "what it is of palpate", "doubt")
KINDS = {"compared": "compared", "drawn": "drawn", "part": "a part of palpate", "none": "nothing"}


def figure_sections(pictures: Sequence[SavedPicture]) -> list[str]:
    """A section for each of these figures: what it shows, what palpate has for it, and a picture of data."""
    return [_figure_section(each, pictures) for each in contents().values() if each.number.startswith(WITH_SECTION)]


def pictures_of(number: str, pictures: Sequence[SavedPicture]) -> str:
    """The pictures of a figure or table with their captions."""
    return "\n".join(_figure(picture) for picture in pictures if picture.number == number)


def heading(number: str, shows: str) -> str:
    """Heading of a table or figure, to which the list links."""
    return f'<h2 id="{escape(anchor(number))}">{escape(f"{number}: {shows}")}</h2>'


def anchor(number: str) -> str:
    """Anchor of a table or figure, from its number such as "Figure 4.8"."""
    return number.lower().replace(" ", "-")


def listed(anchors: Container[str]) -> list[str]:
    """All tables and figures of the thesis, with a link to each that has an anchor on the page."""
    rows = []
    for each in contents().values():
        place = anchor(each.number)
        number = f'<a href="#{place}">{each.number}</a>' if place in anchors else each.number
        cells = (each.section, each.shows, KINDS[each.ours], each.part, each.doubt)
        rows.append(f"<tr><td>{number}</td>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>")
    return [
        f"<table class=words><tr>{''.join(f'<th>{name}</th>' for name in LIST_HEADER)}</tr>",
        *rows,
        "</table>",
    ]


def _figure_section(content: Content, pictures: Sequence[SavedPicture]) -> str:
    beside = (
        f"Nothing of palpate stands beside it: {content.part}" if content.ours == "none" else f"Palpate: {content.part}"
    )
    doubt = f" In doubt: {content.doubt}." if content.doubt else ""
    return "\n".join(
        [
            heading(content.number, content.shows),
            f"<p>{escape(f'Section {content.section}. {beside}.{doubt}')}</p>",
            pictures_of(content.number, pictures),
        ]
    )


def _figure(picture: SavedPicture) -> str:
    with storing(picture.file):
        data = base64.b64encode(picture.file.read_bytes()).decode()
    words = escape(f"{picture.number}: {picture.shows}")
    return (
        f'<figure><img alt="{words}" src="data:image/png;base64,{data}">'
        f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
    )


# --- What reproducing the whole thesis has come to so far: models, tables, verdicts, and the page ------


@dataclass(slots=True)
class Everything:
    """Everything that is done so far: the models' part, tables of rows with their files, and the page."""

    models: Reproduction
    tables: list[tuple[RowTable, Path]] = field(default_factory=list)
    orders: dict[str, bool] = field(default_factory=dict)
    order_evidence: dict[str, Evidence] = field(default_factory=dict)
    blind: list[Validation] = field(default_factory=list)
    page: Path | None = None

    def all_tables(self) -> list[RowTable]:
        """Tables of the experiments and tables of the models."""
        return [table for table, _ in self.tables] + [found.row_table() for found, _ in self.models.tables]

    def verdicts(self) -> dict[Evidence, Verdict]:
        """Verdict on each class of rows."""
        return judge(self.all_tables())

    def outside(self) -> list[tuple[str, Row]]:
        """Rows outside their stated scatter, with their table."""
        return [(table.number, row) for table in self.all_tables() for row in table.judged if not row.within]

    def met(self) -> bool:
        """Whether every class meets its requirement and the orders are right."""
        return all(verdict.met for verdict in self.verdicts().values()) and all(self.orders.values())

    def summary(self) -> dict[str, Any]:
        """The summary with the names that JSON has."""
        return {
            "evidence": {evidence.value: verdict.record() for evidence, verdict in self.verdicts().items()},
            "softness_order_right": self.orders,
            "softness_order_evidence": {design: each.value for design, each in self.order_evidence.items()},
            "blind": {"sign": SIGN, "runs": [found.record() for found in self.blind]},
            "met": self.met(),
            "outside": [{"table": number, **row.record()} for number, row in self.outside()],
        }


# --- Printing the results of `reproduce models` --------------------------------------------------------


def print_reproduction(done: Reproduction) -> None:
    """Print a table of deviations for each table of the thesis, its sentences, and the place of the files."""
    for comparison, _ in done.tables:
        table = comparison.table
        shown = new_table(
            stamped(False, f"Table {table.number}: {table.title}"),
            "quantity", "set", "model", "worst", "at", "rms", "ours / thesis", "within goal", "evidence",
        )  # fmt: skip
        deviations = comparison.deviations()
        # Where a column has a goal, the others repeat it, or are voltages, on which there is a sentence.
        goals = any(d.goal is not None for d in deviations)
        for d in deviations:
            if goals and d.goal is None:
                continue
            within = "-" if d.within is None else f"{d.within} of {d.cells} ({d.goal:g})"
            shown.add_row(
                d.quantity, d.parameters, d.model, f"{d.worst:+.3g}", d.worst_at, f"{d.rms:.3g}", f"{d.factor:.3g}",
                within, d.evidence.value,
            )  # fmt: skip
        doubt = [f"doubtful as a whole: {table.doubt}"] if table.doubt else []
        repaired = f"repaired cells: {len(table.repaired())}; the CSV has them as printed, with the reason"
        sentences = (*counts_said(comparison.row_table()), *comparison.sentences, *doubt, repaired)
        print_all(shown, *(f"- {sentence}" for sentence in sentences), "")
    print_all(*(f"{p.number}: {p.shows}   {p.file}" for p in done.pictures))
    print_all(f"summary   {done.summary}", f"tables    {done.folder}")


# --- the page ------------------------------------------------------------------------------------------

PARTS = (
    "Table by table", "Models beside the experiments", "Experiments", "Models", "Figures", "Slips of the thesis", ALL,
)  # fmt: skip
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 75em; padding: 0 1em; }
table { border-collapse: collapse; margin: 1em 0; font-variant-numeric: tabular-nums; }
th, td { border-bottom: 1px solid #ddd; padding: .15em .7em; text-align: right; }
th { border-bottom-color: #555; }
.outside { background: #fdd; } .repaired { background: #ffc; } .stamp { color: #c00; }
.input > td:first-child { border-left: 8px solid #999; } .fitted > td:first-child { border-left: 8px double #06c; }
.predicted > td:first-child { border-left: 8px dotted #090; }
.verdict { padding-left: 1em; } .input.verdict { border-left: 8px solid #999; }
.fitted.verdict { border-left: 8px double #06c; } .predicted.verdict { border-left: 8px dotted #090; }
img { max-width: 100%; } .words td, .words th { text-align: left; vertical-align: top; }
"""
AGAIN = "these numbers stand in another table as well, and each class counts them there"
CAUSES = (
    "The blind runs and the thesis' own finite elements lie above the experiments of one sensor, and much lower beside"
    " those of two: there the identified set and the thesis' own lie below. By our models this change of sign cannot"
    " come from plates or films that yield, the load cell's calibration, friction or tilt, nor from a thickness or a"
    " modulus alone. It could come from how the load is spread, from the moduli of ring and objects together with it,"
    " from the films' gains, or from the readings: most of those printed for the common base are the single sensor's"
    " times a constant. docs/validation.md goes through every cause."
)
HEADER = (
    "row", "quantity", "by", "evidence", "printed", "thesis", "ours", "difference", "thesis less ours, % of ours",
    "% of thesis",
    "scatter u", "within 2 u", "outside, because",
)  # fmt: skip


def write_page(done: Everything, folder: Path) -> Path:
    """Write the page with its pictures; returns the file. Raises RecordError."""
    path = folder / "index.html"
    tables = [table for table, _ in done.tables]
    drawn = done.models.pictures
    parts = [
        "<!doctype html><html lang=en><meta charset=utf-8><title>Against the thesis</title>",
        f"<style>{STYLE}</style><h1>Against the thesis</h1>",
        "<p>H. Singh, Design, Finite Element and Experimental Analysis of Piezoelectric Tactile Sensors for Endoscopic"
        f" Graspers. What is measured is <b class=stamp>{STAMP}</b>. Yellow: a slip of the thesis, repaired, with the"
        " reason; red: outside its stated scatter.</p>",
        "<p>Each row is of one of three classes, by what of the thesis went into our number, and each class is counted"
        " alone. Signs: a difference is ours less the thesis', and of a model beside measured means the model less the"
        " measured one. Percent errors, as in Table 5.8, have the thesis' sign, which is the other way round: the"
        " experiment less the theory.</p>",
        _links(),
        legend(),
        *(_verdict(verdict) for verdict in done.verdicts().values()),
        _list(orders(done)),
        *_overview(done.all_tables()),
        _title("Models beside the experiments"),
        _list([f"blind run, {distance_sentence(found)}" for found in done.blind]),
        f"<p>{escape(CAUSES)}</p>",
        _title("Experiments"),
        *(_section(table) for table in tables),
        _title("Models"),
        *(
            _comparison(comparison, [table.number for table in tables])
            + pictures_of(f"Table {comparison.table.number}", drawn)
            for comparison, _ in done.models.tables
        ),
        _title("Figures"),
        *figure_sections(drawn),
        _title("Slips of the thesis"),
        f"<p>{len(slips())} cells, repaired everywhere above.</p>",
        f"<table><tr>{_cells('th', COLUMNS)}</tr>",
        *(f"<tr>{_cells('td', slip)}</tr>" for slip in slips()),
        "</table>",
    ]
    parts += [_title(ALL), *listed(set(re.findall(r'<h2 id="([^"]*)"', "\n".join(parts))))]
    with storing(path):
        path.write_text("\n".join(parts) + "\n", encoding="utf-8")
    return path


def orders(done: Everything) -> list[str]:
    """Sentences that tell whether samples are in the order of the thesis' figures."""
    return [
        f"softness order by force ratio, design {design}: {'right' if right else 'WRONG'}"
        f" ({done.order_evidence[design].value})"
        for design, right in done.orders.items()
    ]


def legend() -> str:
    """Meaning of each class, with the mark at the left edge of its rows."""
    rows = "".join(f'<tr class="{each.value}"><td><b>{each.value}</b><td>{escape(each.meaning)}' for each in Evidence)
    return f"<table class=words>{rows}</table>"


def _title(name: str) -> str:
    """Heading of a part of the page, to which the links at its top lead."""
    return f'<h1 id="{anchor(name)}">{name}</h1>'


def _links() -> str:
    links = (f'<a href="#{anchor(name)}">{name}</a>' for name in PARTS)
    return f"<p>{' · '.join(links)}</p>"


def _overview(tables: Sequence[RowTable]) -> list[str]:
    """Rows of the overview: each class of each table.

    The theories of a table that the bench has, too, are under the same number.

    """
    seen: set[str] = set()
    rows = []
    for table in tables:
        number = f"{table.number} (theories)" if table.number in seen else table.number
        seen.add(table.number)
        place, mark = escape(anchor(f"Table {number}")), " *" if table.again else ""
        link = f'<a href="#{place}">{escape(number)}</a>{mark}'
        counted = "".join(f"<td>{count}</td>" for count in counts(table).values())
        rows.append(f"<tr><td>{link}</td>{counted}<td>{escape(table.title)}</td></tr>")
    header = ("table", *(each.value for each in Evidence), "what it is")
    return [
        _title("Table by table"),
        f"<p>Rows within twice their stated scatter. * {AGAIN}.</p>",
        f"<table class=words><tr>{_cells('th', header)}</tr>",
        *rows,
        "</table>",
    ]


def _verdict(verdict: Verdict) -> str:
    name = verdict.evidence.value
    return f'<div class="verdict {name}"><h3>{name.capitalize()}</h3>{_list(verdict.sentences())}</div>'


def _section(table: RowTable) -> str:
    doubt = f"<p>Doubtful as a whole: {escape(table.doubt)}.</p>" if table.doubt else ""
    return "\n".join(
        [
            f"{heading(f'Table {table.number}', table.title)}{doubt}",
            _list([*counts_said(table), *table.sentences]),
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
        row.row, row.quantity, row.by or "bench", row.evidence.value, row.cell.printed, number(row.cell.value),
        number(row.ours), number(row.difference), of_theory, of_experiment, number(row.u), verdict,
        _because(row),
    )  # fmt: skip
    return f'<tr class="{row.evidence.value} {kind}" title="{escape(row.cell.reason)}">{_cells("td", cells)}</tr>'


def _because(row: Row) -> str:
    """Reason why a row is outside, if it is; a model that is off needs none."""
    if row.within is not False:
        return ""
    return row.because or ("the model" if row.by else "not known")


def _comparison(comparison: Comparison, taken: Container[str]) -> str:
    """Section for a table; where the bench has a table of that number, this one is for the theories behind it."""
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
    rows = [
        (deviation.evidence.value, [number(value) for value in deviation.record().values()])
        for deviation in comparison.deviations()
    ]
    repaired = [
        f"{row}, {column}: printed {c.printed}, is {c.value:g}: {c.reason}" for row, column, c in table.repaired()
    ]
    doubt = [f"doubtful as a whole: {table.doubt}"] if table.doubt else []
    return "\n".join(
        [
            heading(f"Table {table.number}{' (theories)' if table.number in taken else ''}", table.title),
            _list([*counts_said(comparison.row_table()), *comparison.sentences, *doubt]),
            f"<table><tr>{_cells('th', header)}</tr>",
            *(f'<tr class="{evidence}">{_cells("td", row)}</tr>' for evidence, row in rows),
            "</table>",
            every_cell(comparison),
            f"<details><summary>{len(repaired)} repaired cells</summary>{_list(repaired)}</details>"
            if repaired
            else "",
        ]
    )


def _list(lines: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(line)}' for line in lines)}</ul>" if lines else ""


def _cells(tag: str, values: Sequence[str]) -> str:
    return "".join(f"<{tag}>{escape(value)}</{tag}>" for value in values)


# --- Printing the results of `reproduce` ---------------------------------------------------------------


def print_everything(done: Everything) -> None:
    """Print each class of each table, the verdict on each class, and the place of everything else."""
    overview = new_table(
        stamped(True, "The thesis beside ours: rows within twice their stated scatter"),
        "table", *(each.value for each in Evidence),
    )  # fmt: skip
    for table in done.all_tables():
        mark = "*" if table.again else ""
        overview.add_row(f"{table.number}{mark}", *map(str, counts(table).values()))
    verdicts = []
    for evidence, verdict in done.verdicts().items():
        verdicts += [f"{evidence.value.upper()}: {evidence.meaning}", *(f"  {line}" for line in verdict.brief())]
    blind = [
        f"blind run, {found.design}, {found.parameters} set: model less measured mean {found.mean:+.1f} % in the mean,"
        f" {found.worst:+.1f} % at worst"
        for found in done.blind
    ]
    print_all(
        overview, f"* {AGAIN}", "", *verdicts, "", *orders(done), *blind,
        f"page      {done.page}   what each table is, rows outside and why, figures",
        f"tables    {done.models.folder}",
    )  # fmt: skip
