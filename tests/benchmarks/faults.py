"""The matrix of faults: what comes of every fault on everything that can have it, in every procedure."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Console
from rich.table import Table

from tests.benchmarks.row import Row
from tests.fault_matrix import ONCE, PROCEDURES, STAYS, Cell, Outcome, cells, play


def measure() -> Iterator[Row]:
    """Play all cells and print them; the row says how many are green."""
    outcomes = {cell: play(cell) for cell in cells()}
    table = Table(title="right, marked or stopped; (n): incidents in the record", box=None, padding=(0, 2, 0, 0))
    for column in ("fault", "on", *(f"{name}, {lasts}" for name in PROCEDURES for lasts in (ONCE, STAYS))):
        table.add_column(column)
    for kind, on, more in dict.fromkeys((cell.kind, cell.on, cell.more) for cell in outcomes):
        setting = f" {more[0][1]} = {more[1][1]:g}" if more else ""
        row = [outcomes[Cell(name, kind, on, lasts, more)] for name in PROCEDURES for lasts in (ONCE, STAYS)]
        table.add_row(kind + setting, on, *map(_shown, row))
    console = Console(width=150, highlight=False)
    console.print(table)
    wrong = {cell: outcome for cell, outcome in outcomes.items() if outcome.verdict == "WRONG"}
    for cell, outcome in wrong.items():
        console.print(f"WRONG: {cell.name}: {outcome.said}")
    yield Row(
        "fault matrix: cells right, marked or stopped with outputs at zero",
        f"{len(outcomes) - len(wrong)} of {len(outcomes)}",
        "all",
        not wrong,
    )


def _shown(outcome: Outcome) -> str:
    return f"{outcome.verdict} ({outcome.incidents})" if outcome.incidents else outcome.verdict
