"""Recorded runs, as tables and as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from procedures.report.text import STAMP, new_table, number, print_all, stamped
from procedures.run import Run
from procedures.run_list import RunSummary


def print_runs(found: list[RunSummary], folder: Path) -> None:
    """A line a run."""
    if not found:
        print_all(f"no runs in {folder}; make one with: palpate sweep loads")
        return
    table = new_table(None, "run", "status", "points", "")
    for run in found:
        table.add_row(run.folder.name, run.status, str(run.points), STAMP if run.simulated else "")
    print_all(f"Runs in {folder}", table, *(f"damaged: {run.fault}" for run in found if run.fault))


def run_row(run: RunSummary) -> dict[str, Any]:
    """A run in a JSON list."""
    return {
        "run": str(run.folder.absolute()),
        "started": run.started.isoformat(),
        "procedure": run.procedure,
        "simulated": run.simulated,
        "status": run.status,
        "points": run.points,
        "fault": run.fault or None,
    }


def run_object(run: Run, digest: str) -> dict[str, Any]:
    """A whole run as JSON."""
    return {
        "run": str(run.folder),
        "procedure": run.procedure,
        "simulated": run.simulated,
        "status": run.status,
        "digest": digest,
        "header": dict(run.header),
        "summary": dict(run.summary),
        "points": run.points(),
        "events": run.events(),
    }


def print_run(run: Run, digest: str) -> None:
    """Header, points and events of a run."""
    calibration: Any = run.header.get("calibration") or {}
    points = run.points()
    columns = [k for k, v in points[0].items() if k != "bench_ns" and not isinstance(v, list)] if points else []
    table = new_table(stamped(run.simulated, f"{run.procedure}: {len(points)} points"), *columns)
    for point in points:
        table.add_row(*(number(point[column]) for column in columns))
    print_all(
        stamped(run.simulated, str(run.folder)),
        f"status       {run.status}",
        f"started      {run.started:%Y-%m-%d %H:%M:%S} UTC",
        f"seed         {run.header.get('seed')}",
        f"calibration  {calibration.get('source', '-')}",
        f"digest       {digest}",
        table,
        *(f"event at {event['bench_ns'] / 1e9:.1f} s: {event['kind']}: {event['message']}" for event in run.events()),
    )
