"""Prints tables and lines in the terminal."""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from palpate.instrument.quantity import plus_minus
from palpate.procedures.console.terminal import console
from palpate.procedures.steps.beside import sentence
from palpate.procedures.steps.flags import FLAGS, Judged

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from palpate.procedures.lab.session import Outcome


T = TypeVar("T")
STAMP = "SIMULATED"
PIPE_WIDTH = 80  # columns if the output is no terminal
WIDEST = 100_000  # columns, more than any table has
LABEL = re.compile(r" *\S+(?: \S+)*  +")


def print_all(*things: object) -> None:
    """Print texts and tables. Texts are not read as markup.

    A terminal gets texts in lines of its width. A table that is too wide for that, or elsewhere for PIPE_WIDTH columns,
    is printed as several that share its first columns. Its title stands on one line, even if it is longer.
    """
    from rich.table import Table

    out = console()
    width = out.width if out.is_terminal else PIPE_WIDTH
    for thing in things:
        if isinstance(thing, Table) and thing.title is not None:
            out.print(thing.title, soft_wrap=True)
            thing.title = None
        if isinstance(thing, str) and out.is_terminal:
            thing = "\n".join(folded(line, width) for line in thing.splitlines())
        for part in blocks(thing, width) if isinstance(thing, Table) else [thing]:
            out.width = max(width, 1 + sum(_least_widths(part))) if isinstance(part, Table) else width
            out.print(part, soft_wrap=not isinstance(part, Table))


def folded(line: str, width: int) -> str:
    """A line folded between words where it is wider than some columns. A longer word, such as a path, stays whole.

    Further lines begin below the text after a label, `label          text`.
    """
    if len(line) <= width:
        return line
    label = LABEL.match(line)
    at = label.end() if label and label.end() < width // 2 else 0
    lines = textwrap.wrap(line[at:], width - at, break_long_words=False, break_on_hyphens=False)
    return line[:at] + ("\n" + " " * at).join(lines)


def new_table(title: Text | None, *columns: str) -> Table:
    """An empty table; its columns are aligned to the right and never wrapped."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", header_style="bold", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    return table


def ends(lines: Sequence[T], most: int) -> tuple[list[T], int]:
    """The first and last of some lines, `most` together, and how many are left out between them."""
    if len(lines) <= most:
        return [*lines], 0
    return [*lines[: most // 2], *lines[-(most // 2) :]], len(lines) - 2 * (most // 2)


def shortened(table: Table, most: int) -> tuple[Table, int]:
    """A table of the first and last lines of a table, `most` together, and how many are left out between them."""
    if table.row_count <= most:
        return table, 0
    part = _part(table, range(len(table.columns)), most)
    part.title, part.caption = table.title, table.caption
    return part, table.row_count - part.row_count


def blocks(table: Table, width: int) -> list[Table]:
    """The table; where it is wider than some columns, several tables that share its first columns.

    These are as many as tell its rows apart, or the first alone where they take more than two thirds of the width.
    """
    widths = _least_widths(table)
    if 1 + sum(widths) <= width:
        return [table]
    rows = list(zip(*(map(str, column.cells) for column in table.columns), strict=True))
    key = next((n for n in range(1, len(widths)) if len({row[:n] for row in rows}) == len(rows)), 1)
    if sum(widths[:key]) > 2 * width // 3:
        key = 1
    parts: list[list[int]] = []
    left = 0
    for number, own in enumerate(widths[key:], key):
        if not parts or own > left:
            parts.append([])
            left = width - 1 - sum(widths[:key])
        parts[-1].append(number)
        left -= own
    found = [_part(table, [*range(key), *part]) for part in parts]
    found[0].title = table.title
    return found


def _least_widths(table: Table) -> list[int]:
    """Columns that each column of a table takes, with the blank beside it; one more is left of all.

    It takes its longest line, or its longest word where lines may be folded.
    """
    out = console()
    wide = out.options.update(width=WIDEST)
    parts = ((_part(table, [number]), column.no_wrap) for number, column in enumerate(table.columns))
    found = [(out.measure(part, options=wide), whole) for part, whole in parts]
    return [(measure.maximum if whole else measure.minimum) - 1 for measure, whole in found]


def _part(table: Table, columns: Sequence[int], most: int = sys.maxsize) -> Table:
    """Some columns of a table, with the first and last of its lines, `most` together."""
    part = new_table(None, *(str(table.columns[i].header) for i in columns))
    cells = [ends([*table.columns[i].cells], most)[0] for i in columns]
    for own, i in zip(part.columns, columns, strict=True):
        own.justify, own.no_wrap = table.columns[i].justify, table.columns[i].no_wrap
    for row in zip(*cells, strict=True):
        part.add_row(*map(str, row))
    return part


def stamped(simulated: bool, text: str) -> Text:
    """A text, with SIMULATED in red before it if it is."""
    from rich.text import Text

    return Text.assemble((f"{STAMP} " if simulated else "", "bold red"), text)


MOUNTING: dict[str, str] = {  # how samples, weights and the like were mounted; not told of a simulated bench
    "sample changer": "by the sample changer",
    "confirmed": "confirmed by name",
    "assumed": "ASSUMED, nobody has confirmed it",
}


def about_itself(about: Mapping[str, str]) -> str:
    """What a run says about itself, in one line."""
    return ", ".join(f"{key} {value}" for key, value in about.items())


def where(outcome: Outcome, plot: Path | None = None) -> list[str]:
    """Lines about a run: the calibrations on which it rests, its time, its folder and its plot.

    A run that calibrates tells itself of what it has calibrated; one that calibrates a model, of its films, too.
    """
    own_films = outcome.keys() & {"film_calibration_file", "model_calibration_file"}
    named = {
        "about": about_itself(outcome.get("about", {})),
        "calibration": None if "calibration_file" in outcome else outcome["calibration"],
        "films": None if own_films else outcome.get("film_calibration"),
        "mounting": MOUNTING.get(outcome["mounting"]),
    }
    lines = [f"{name:<14} {source}" for name, source in named.items() if source]
    lines += [f"{'beside':<14} {each['name']} {sentence(each)}" for each in outcome.get("beside", ())]
    bench, wall = outcome["bench_seconds"], outcome["wall_seconds"]
    return [
        *lines,
        f"time           {bench:z.0f} s on the bench, {wall:z.1f} s here (x {bench / wall:z.0f})",
        f"run            {outcome['run']}",
        *([f"plot           {plot}"] if plot else []),
    ]


def taken(outcome: Outcome) -> str:
    """Bench time that a run took beside the predicted one; the latter alone where nobody knows the former."""
    achieved, predicted = outcome["achieved_seconds"], outcome["predicted_seconds"]
    return f"predicted {predicted:z.0f} s" if achieved is None else f"{achieved:z.0f} s (predicted {predicted:z.0f})"


def short(value: float | None) -> str:
    """A number with two digits in scientific notation; "-" for None."""
    return "-" if value is None else f"{value:.1e}"


def uncertainty_line(of: str, half: float, u: float, foreseen: float | None) -> str:
    """A line with the greatest half-width of the 95 % interval of some results, and their greatest uncertainty."""
    foreseen_text = "" if foreseen is None else f" (predicted {percent(foreseen)} %)"
    return f"uncertainty    {plus_minus(half)} of {of} at most; u {percent(u)} %{foreseen_text}"


def percent(value: float | None) -> str:
    """A fraction as a percentage with two decimals; "-" for None."""
    return "-" if value is None else f"{100 * value:z.2f}"


def number(value: object) -> str:
    """A float with four digits, any other value as it is; "-" for None."""
    return "-" if value is None else f"{value:z.4g}" if isinstance(value, float) else str(value)


# --- Legends of tables: a line for each mark that occurs in a table ------------------------------------

INVALID = "NO"
OUTSIDE = "*"
MARKS: dict[str, str] = {
    INVALID: "the point is not used: after 3 attempts it still has the flags that follow NO",
    **FLAGS,
    OUTSIDE: "outside the load cell's calibrated range",
    "-": "no value: not measured, no valid point, or nothing to compare with",
}
NO_VALUE: dict[str, str] = {"-": "no value: there is none, or the model does not give it"}


def verdict(point: Judged) -> str:
    """Whether a point is used, and its flags, for its row in a table."""
    return " ".join(("yes" if point.valid else INVALID, *point.flags))


def legend(*tables: Table, marks: Mapping[str, str] = MARKS) -> list[str]:
    """A line for each mark that occurs in one of the tables."""
    cells = {f" {cell} " for table in tables for column in table.columns for cell in column.cells}
    return [
        f"{mark:<14} {meaning}"
        for mark, meaning in marks.items()
        if any(f" {mark} " in cell or (mark == OUTSIDE and cell.endswith("* ")) for cell in cells)
    ]
