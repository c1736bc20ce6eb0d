"""Prints whether the promises of a store are kept."""

from __future__ import annotations

from pathlib import Path

from palpate.instrument.quantity import counted
from palpate.procedures.accuracy.promises import Spread, StoredPromises
from palpate.procedures.showing.text import new_table, number, percent, print_all

MOST = 20  # runs that are listed one by one


def print_promises(kept: StoredPromises, store: Path) -> None:
    """Print achieved over predicted time and uncertainty of each procedure and result, and of the newest runs."""
    table = new_table(
        None, "procedure", "bench", "runs", "time over\npredicted", "least to\ngreatest", "within the\nbound"
    )  # fmt: skip
    results = new_table(None, "procedure", "result", "runs", "u over\npredicted", "least to\ngreatest")
    for each in kept.procedures:
        bench = "simulated" if each.simulated else "real"
        within = "-" if each.within is None else f"{each.within.share:.0%} of {each.within.count}"
        table.add_row(each.procedure, bench, str(each.runs), *_cells(each.time), within)
        first = f"{each.procedure}{'' if each.simulated else ', real'}"
        for name, spread in each.results.items():
            results.add_row(first, name, str(spread.count), *_cells(spread))
            first = ""
    runs = new_table(None, "run", "predicted\ns", "taken\ns", "predicted\nu %", "achieved\nu %")
    for run in kept.runs[:MOST]:
        runs.add_row(
            run.run, number(run.predicted_seconds), number(run.achieved_seconds), percent(run.predicted_u),
            percent(run.achieved_u),
        )  # fmt: skip
    print_all(
        *([table, results, runs] if kept.runs else [f"{store} has no complete run with a promise"]),
        *([f"{len(kept.runs) - MOST} older runs are in the mean values alone"] if len(kept.runs) > MOST else []),
        *([f"{counted(kept.without, 'run')} of an older version without a promise"] if kept.without else []),
        *([f"cannot be read: {', '.join(kept.unreadable)}"] if kept.unreadable else []),
    )


def _cells(spread: Spread | None) -> tuple[str, str]:
    if spread is None:
        return "-", "-"
    return f"{spread.mean:.3f}", f"{spread.least:.2f} to {spread.greatest:.2f}"
