"""Prints the points of a procedure that has no report of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from palpate.procedures.lab.session import Outcome
from palpate.procedures.showing.text import new_table, number, print_all, stamped, where


def print_points(rows: Sequence[Mapping[str, object]], found: Mapping[str, object], outcome: Outcome) -> None:
    """Print the points with a column for each value, then the findings and the run's folder."""
    names = [name for name, value in rows[0].items() if not isinstance(value, (list, tuple, dict))] if rows else []
    table = new_table(stamped(outcome["simulated"], "Points"), *(name.replace("_", "\n") for name in names))
    for row in rows:
        table.add_row(*(number(row[name]) for name in names))
    print_all(table, *(f"{name:<14} {number(value)}" for name, value in found.items()), *where(outcome))
