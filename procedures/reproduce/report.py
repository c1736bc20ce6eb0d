"""Printing the results of `reproduce`."""

from __future__ import annotations

from palpate.instrument.models.evidence import Evidence
from palpate.procedures.reproduce.judging.rows import counts
from palpate.procedures.reproduce.outcome import Everything
from palpate.procedures.reproduce.page import AGAIN, absent_said, orders
from palpate.procedures.showing.text import new_table, print_all, stamped


def print_everything(done: Everything) -> None:
    """Print each class of each table, the verdict on each class, and the place of everything else."""
    overview = new_table(
        stamped(True, "The thesis beside ours: rows within twice their stated scatter"),
        "table", *(each.value for each in Evidence), "absent", "",
    )  # fmt: skip
    overview.columns[-1].justify = "left"
    for table in done.all_tables():
        mark = "*" if table.again else ""
        overview.add_row(
            f"{table.number}{mark}", *map(str, counts(table).values()), str(table.absent_cells or ""), table.title
        )
    verdicts = []
    for evidence, verdict in done.verdicts().items():
        verdicts += [f"{evidence.value.upper()}: {evidence.meaning}", *(f"  {line}" for line in verdict.brief())]
    blind = [
        f"blind run, {found.design}, {found.parameters} set: model less measured mean {found.mean:+.1f} % in the mean,"
        f" {found.worst:+.1f} % at worst"
        for found in done.blind
    ]
    print_all(
        overview, f"* {AGAIN}", absent_said(done.all_tables()), "", *verdicts, "", *orders(done), *blind,
        f"page      {done.page}   rows outside and why, what each table says, figures",
        f"tables    {done.models.folder}",
    )  # fmt: skip
