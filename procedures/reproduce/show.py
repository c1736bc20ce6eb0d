"""What a reproduction says to people."""

from __future__ import annotations

from palpate.procedures.reproduce.chapter4.models import Reproduction
from palpate.procedures.reproduce.judging.rows import counts_said
from palpate.procedures.showing.text import new_table, print_all, stamped


def print_reproduction(done: Reproduction) -> None:
    """A table of deviations a thesis table, each with its sentences, and where everything lies."""
    for comparison, _ in done.tables:
        table = comparison.table
        shown = new_table(
            stamped(False, f"Table {table.number}: {table.title}"),
            "quantity", "set", "model", "worst", "at", "rms", "ours / thesis", "within goal", "evidence",
        )  # fmt: skip
        deviations = comparison.deviations()
        # Where there is a goal, the columns without one say the same again, or are the voltages of the sentences.
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
        sentences = (*counts_said(comparison.row_table()), *comparison.said, *doubt, repaired)
        print_all(shown, *(f"- {sentence}" for sentence in sentences), "")
    print_all(*(f"{p.number}: {p.shows}   {p.file}" for p in done.pictures))
    print_all(f"summary   {done.summary}", f"tables    {done.folder}")
