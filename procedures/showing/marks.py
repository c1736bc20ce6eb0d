"""Legends of tables: a line for each mark that occurs in a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from palpate.procedures.steps.flags import FLAGS, Judged

if TYPE_CHECKING:
    from rich.table import Table

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
