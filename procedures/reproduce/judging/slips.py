"""Every doubtful cell of the thesis' tables: as printed, its best value, and the reason."""

from __future__ import annotations

import csv
from pathlib import Path

from palpate.instrument.thesis import TABLES, read_table
from palpate.procedures.records.run import storing

COLUMNS = ("table", "row", "column", "printed", "best", "reason")


def slips() -> list[tuple[str, ...]]:
    """One row for each cell, in the order of the tables, with the columns COLUMNS."""
    return [
        (number, row, column, cell.printed, f"{cell.value:g}", cell.reason)
        for number in TABLES
        for row, column, cell in read_table(number).repaired()
    ]


def write_slips(folder: Path) -> Path:
    """Write the slips as CSV; returns the file. Raises RecordError."""
    path = folder / "slips.csv"
    with storing(path), path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([COLUMNS, *slips()])
    return path
