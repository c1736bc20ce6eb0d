"""Shows recorded runs, as tables and as JSON."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.instrument.quantity import counted
from palpate.procedures.showing.text import (
    MOUNTING,
    about_itself,
    legend,
    new_table,
    number,
    print_all,
    stamped,
)
from palpate.procedures.steps.flags import FLAGS

if TYPE_CHECKING:  # the list of runs needs no record to be read
    from rich.table import Table

    from palpate.procedures.records.damage import DamageReport, Repaired
    from palpate.procedures.records.run import Run, RunSummary

TIME = "%Y-%m-%d %H:%M:%S"


def print_runs(found: list[RunSummary], folder: Path, some: bool = False) -> None:
    """Print a row for each run; `some`: whether only runs are shown for which a condition holds."""
    if not found and some:
        print_all(f"no run in {folder} fits")
        return
    if not found:
        print_all(f"no runs in {folder}; make one with: palpate sweep loads")
        return
    for simulated in (False, True):
        own = [run for run in found if bool(run.simulated) is simulated]
        table = new_table(stamped(simulated, f"Runs in {folder}"), "run", "procedure", "status", "points")
        for run in own:
            table.add_row(run.folder.name, run.procedure, run.status, str(run.points))
        print_all(*([table] if own else []), *(f"damaged: {run.fault}" for run in own if run.fault))


def run_row(run: RunSummary) -> dict[str, Any]:
    """A run as an element of a JSON list."""
    return {
        "run": str(run.folder.absolute()),
        "started": run.started.isoformat(),
        "procedure": run.procedure,
        "simulated": run.simulated,
        "status": run.status,
        "points": run.points,
        "fault": run.fault or None,
        "about": dict(run.header.get("about", {})),
    }


def run_object(run: Run, digest: str, signal_digest: str, unfinished: str) -> dict[str, Any]:
    """A whole run as JSON."""
    return {
        "run": str(run.folder),
        "procedure": run.procedure,
        "simulated": run.simulated,
        "status": run.status,
        "digest": digest,
        "signal_digest": signal_digest,
        "header": dict(run.header),
        "summary": dict(run.summary),
        "points": run.points(),
        "events": run.events(),
        **_unfinished(unfinished),
    }


def _unfinished(what: str) -> dict[str, str]:
    return {"unfinished": what} if what else {}


def print_run(run: Run, digest: str, signal_digest: str, unfinished: str) -> None:
    """Print header, points and events of a run."""
    line, table = shown_points(run, run.points())
    print_all(
        stamped(run.simulated, str(run.folder)),
        *(f"{name:<12} {text}" for name, text in facts(run, digest, signal_digest).items()),
        line,
        table,
        *legend(table, marks=FLAGS),
        *(f"event at {event['bench_ns'] / 1e9:z.1f} s: {event['kind']}: {event['message']}" for event in run.events()),
        *(f"unfinished: {what}" for what in _unfinished(unfinished).values()),
    )


def facts(run: Run, digest: str, signal_digest: str) -> dict[str, str]:
    """What a run says of itself, for people, by names."""
    calibration = run.header.get("calibration")
    source = calibration.get("source") if isinstance(calibration, dict) else None
    mounting = run.header.get("mounting")
    arithmetic = run.header.get("arithmetic")
    kernels = arithmetic.get("blas") if isinstance(arithmetic, dict) else None
    return {
        "status": run.status,
        **({"procedure": f"{run.procedure}, from {_origin(run)}"} if "procedure_from" in run.header else {}),
        "started": f"{run.started:{TIME}} UTC",
        **({"about": about_itself(run.about)} if run.about else {}),
        "seed": number(run.header.get("seed")),
        "calibration": source or "-",
        "mounting": MOUNTING.get(str(mounting), str(mounting or "-")),
        "digest": digest,
        "of signals": signal_digest,
        "arithmetic": kernels or "-",
    }


def shown_points(run: Run, stored: Iterable[dict[str, Any]]) -> tuple[str, Table]:
    """A line with what is the same at all points of a run, and a table of their other values."""
    points = list(map(_flagged, stored))
    columns = [k for k, v in points[0].items() if k != "bench_ns" and not isinstance(v, list)] if points else []
    cells = {k: [number(point[k]) for point in points] for k in columns}
    same = [k for k, texts in cells.items() if len(points) > 1 and texts.count(texts[0]) == len(texts)]
    same = [k for k in same if k != "flags" or points[0][k] is None]
    columns = [k for k in columns if k not in same]
    table = new_table(stamped(run.simulated, f"{run.procedure}: {counted(len(points), 'point')}"), *columns)
    for row in zip(*(cells[column] for column in columns), strict=True):
        table.add_row(*row)
    texts = ", ".join(f"{k} {cells[k][0]}" for k in same) or "-"
    return f"each point   {texts}", table


def _origin(run: Run) -> str:
    """The package of an outside procedure with its version, or the file of a script."""
    package, versions = str(run.header["procedure_from"]), run.header.get("versions")
    return f"{package} {versions.get(package, '') if isinstance(versions, dict) else ''}".rstrip()


def _flagged(point: dict[str, Any]) -> dict[str, Any]:
    """A point whose flags are joined into one text."""
    flags = point.get("flags")
    return {**point, "flags": " ".join(map(str, flags)) or None} if isinstance(flags, list) else point


def check_object(found: DamageReport) -> dict[str, Any]:
    """The findings of a check as JSON."""
    counts = {key: value for key, value in asdict(found).items() if key not in ("folder", "unfinished")}
    return {"run": str(found.folder), "damaged": bool(found.faults), **counts, **_unfinished(found.unfinished)}


def print_check(found: DamageReport) -> None:
    """Print the findings of a check."""
    table = new_table(None, "status", "points", "waveforms", "verdict")
    table.add_row(found.status, str(found.points), str(found.waveforms), "DAMAGED" if found.faults else "whole")
    lines = [f"damaged: {fault}" for fault in found.faults]
    lines += [f"unfinished: {found.unfinished}"] if found.unfinished else []
    if found.faults and not found.points:
        lines.append("no point of it is whole; restore it from a copy")
    elif found.faults:
        lines.append(f"salvage it with: palpate runs repair {found.folder} --out DIR")
    elif found.status != "complete":
        lines.append(f"not complete; go on with: palpate runs resume {found.folder}")
    print_all(str(found.folder), table, *lines)


def repaired_object(done: Repaired) -> dict[str, Any]:
    """A salvaged run as JSON."""
    return {
        "run": str(done.folder),
        "points": done.points,
        "waveforms": done.waveforms,
        "gone": done.gone,
    }


def print_repaired(done: Repaired) -> None:
    """Print how much was salvaged, and what is lost."""
    print_all(
        f"{done.folder}: {counted(done.points, 'point')}, {counted(done.waveforms, 'waveform')}",
        *(f"gone: {what}" for what in done.gone or ["nothing"]),
    )
