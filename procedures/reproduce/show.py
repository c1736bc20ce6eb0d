"""Printing the results of `reproduce models`."""

from __future__ import annotations

from palpate.procedures.reproduce.judging.rows import counts_said
from palpate.procedures.reproduce.models import Reproduction
from palpate.procedures.showing.text import new_table, print_all, stamped


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
