"""What reproducing everything found."""

from __future__ import annotations

from instrument.evidence import Evidence
from procedures.report.text import new_table, number, print_all, stamped
from procedures.reproduce.everything import Everything
from procedures.reproduce.page import orders
from procedures.reproduce.rows import counts


def print_everything(done: Everything) -> None:
    """Each class of each table, the rows outside their scatter, what the tables say, and what each class comes to."""
    overview = new_table(
        stamped(True, "The thesis beside ours: rows within twice their stated scatter"),
        "table", *(each.value for each in Evidence), "title",
    )  # fmt: skip
    overview.columns[-1].justify = "left"
    for table in done.all_tables():
        overview.add_row(table.number, *map(str, counts(table).values()), table.title)
    outside = new_table(
        stamped(True, "Outside it, but for predicted rows: the page and the CSV files have them all"),
        "table", "row", "quantity", "evidence", "thesis", "ours", "scatter u", "repaired", "because",
    )  # fmt: skip
    for table_number, row in done.outside():
        if row.evidence is Evidence.PREDICTED:
            continue
        outside.add_row(
            table_number, row.row, row.quantity, row.evidence.value, number(row.cell.value), number(row.ours),
            number(row.u), "yes" if row.cell.reason else "", row.because.partition(":")[0] or "not known",
        )  # fmt: skip
    said = [f"- Table {table.number}: {sentence}" for table, _ in done.tables for sentence in table.said]
    verdicts = []
    for evidence, verdict in done.verdicts().items():
        verdicts += [f"{evidence.value.upper()}: {evidence.meaning}", *(f"  {line}" for line in verdict.said())]
    print_all(
        overview, outside, *said, "", *verdicts, *orders(done), f"page      {done.page}",
        f"tables    {done.models.folder}",
    )  # fmt: skip
