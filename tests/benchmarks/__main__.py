"""Prints every figure that palpate promises, measured now on this machine: `python -m tests.benchmarks`.

Nothing here fails on a slow machine: times are printed beside their goals, never asserted.
"""

from __future__ import annotations

import platform
import sys

from rich.console import Console
from rich.table import Table

from tests.benchmarks import (
    agreement,
    array,
    bounds,
    calibrations,
    campaigns,
    characterise,
    coverage,
    damages,
    disk,
    driver_call,
    dwell,
    eds,
    entries,
    estimates,
    estimates_solid,
    faults,
    first_result,
    fixture,
    front,
    growth,
    hard_cases,
    history,
    hostile_scenes,
    kills,
    listeners,
    live,
    load,
    masters,
    models,
    modulus_budget,
    modulus_wire,
    moods,
    order,
    peers,
    poles,
    prices,
    real_bench,
    records,
    references,
    repeats,
    report,
    reproduce,
    run_table,
    scatter,
    scenes,
    serve,
    served_kills,
    soak,
    solid,
    stale,
    start_up,
    study,
    sweep,
    uncertainty,
    verdicts,
    walk_through,
)
from tests.benchmarks.row import Row

PARTS = {
    "driver_call": driver_call.measure,
    "eds": eds.measure,
    "sweep": sweep.measure,
    "array": array.measure,
    "dwell": dwell.measure,
    "order": order.measure,
    "repeats": repeats.measure,
    "characterise": characterise.measure,
    "uncertainty": uncertainty.measure,
    "coverage": coverage.measure,
    "verdicts": verdicts.measure,
    "models": models.measure,
    "modulus_wire": modulus_wire.measure,
    "solid": solid.measure,
    "peers": peers.measure,
    "poles": poles.measure,
    "real_bench": real_bench.measure,
    "prices": prices.measure,
    "records": records.measure,
    "references": references.measure,
    "report": report.measure,
    "reproduce": reproduce.measure,
    "entries": entries.measure,
    "first_result": first_result.measure,
    "fixture": fixture.measure,
    "front": front.measure,
    "growth": growth.measure,
    "hard_cases": hard_cases.measure,
    "history": history.measure,
    "scenes": scenes.measure,
    "serve": serve.measure,
    "masters": masters.measure,
    "study": study.measure,
    "start_up": start_up.measure,
    "walk_through": walk_through.measure,
}
# A quarter of an hour and more (bounds, estimates, estimates_solid: hours, resumable): only by name.
LONG = {
    "agreement": agreement.measure,
    "bounds": bounds.measure,
    "estimates": estimates.measure,
    "estimates_solid": estimates_solid.measure,
    "faults": faults.measure,
    "calibrations": calibrations.measure,
    "hostile_scenes": hostile_scenes.measure,
    "kills": kills.measure,
    "campaigns": campaigns.measure,
    "listeners": listeners.measure,
    "live": live.measure,
    "load": load.measure,
    "served_kills": served_kills.measure,
    "soak": soak.measure,
    "damages": damages.measure,
    "disk": disk.measure,
    "modulus_budget": modulus_budget.measure,
    "moods": moods.measure,
    "run_table": run_table.measure,
    "scatter": scatter.measure,
    "stale": stale.measure,
}


def main(names: list[str]) -> int:
    """Run the named parts, or all but the long ones."""
    if unknown := [name for name in names if name not in PARTS | LONG]:
        print(f"unknown benchmark {unknown[0]!r}; valid: {', '.join(PARTS | LONG)}", file=sys.stderr)  # noqa: T201
        return 2
    console = Console(width=120, highlight=False)
    console.print(f"{platform.machine()}, Python {platform.python_version()}")
    table = Table(box=None, padding=(0, 2, 0, 0))
    for column in ("figure", "measured", "goal", ""):
        table.add_column(column)
    for name in names or PARTS:
        row: Row
        for row in (PARTS | LONG)[name]():
            verdict = "" if row.met is None else "met" if row.met else "NOT MET"
            table.add_row(row.figure, row.measured, row.goal, verdict)
    console.print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
