"""What reproducing everything found."""

from __future__ import annotations

from procedures.report.text import new_table, number, print_all, stamped
from procedures.reproduce.everything import Everything
from procedures.reproduce.page import summary_lines


def print_everything(done: Everything) -> None:
    """A line a table, the rows outside their scatter, what the tables say, and where everything lies."""
    overview = new_table(
        stamped(True, "Experiments of the thesis beside ours"), "table", "rows", "judged", "within", "title"
    )
    for table, _ in done.tables:
        overview.add_row(table.number, str(len(table.rows)), str(len(table.judged)), str(table.inside), table.title)
    outside = new_table(
        stamped(True, "Outside twice the stated scatter"),
        "table", "row", "quantity", "thesis", "ours", "scatter u", "repaired",
        "because",
    )  # fmt: skip
    for table_number, row in done.outside():
        outside.add_row(
            table_number, row.row, row.quantity, number(row.cell.value), number(row.ours), number(row.u),
            "yes" if row.cell.reason else "", row.because.partition(":")[0] or "not known",
        )  # fmt: skip
    said = [f"- Table {table.number}: {sentence}" for table, _ in done.tables for sentence in table.said]
    print_all(
        overview, outside, *said, "", *summary_lines(done), f"page      {done.page}", f"tables    {done.models.folder}"
    )
