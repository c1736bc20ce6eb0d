"""Whether promises are kept: what runs of a store were predicted to take and to give, and what they took and gave.

kept = promises(Path("runs"))
kept.procedures()[0]["seconds_over_predicted"]["mean"]    # 0.99: bench time over the predicted one
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.instrument.errors import RecordError
from palpate.instrument.quantity import counted
from palpate.procedures.engine.procedure import ACHIEVED, RESULTS
from palpate.procedures.records.run import Run, list_runs
from palpate.procedures.showing.text import new_table, number, percent, print_all


@dataclass(frozen=True, slots=True)
class Promised:
    """What one run was predicted to take and to give, and what it took and gave, as JSON has it; None: not known.

    Attributes:
        run: name of its folder.
        procedure: name of its procedure.
        simulated: whether its bench was.
        bound_seconds: bench time within which 95 % of runs were predicted to end; None: the plan has no such bound.
        results: its predicted results, each with its standard uncertainty as predicted, as achieved, and their ratio.
        within_bound: whether it ended within the bound.
    """

    run: str
    procedure: str
    simulated: bool
    predicted_seconds: float | None
    achieved_seconds: float | None
    predicted_u: float | None
    achieved_u: float | None
    bound_seconds: float | None
    results: tuple[dict[str, Any], ...]
    within_bound: bool | None
    seconds_over_predicted: float | None
    u_over_predicted: float | None


Spread = Mapping[str, float]  # of achieved over predicted values: count, mean, least, greatest


@dataclass(frozen=True, slots=True)
class StoredPromises:
    """The promises of a store.

    Attributes:
        runs: the complete runs that have a promise, newest first.
        without: number of complete runs without one, because an older version recorded them.
        unreadable: names of runs that cannot be read.
    """

    runs: list[Promised]
    without: int
    unreadable: list[str]

    def procedures(self) -> list[dict[str, Any]]:
        """What was reached of the promises of each procedure, on simulated and on real benches, as JSON has it."""
        names = sorted({(run.procedure, run.simulated) for run in self.runs})
        return [_kept_by([run for run in self.runs if (run.procedure, run.simulated) == name]) for name in names]


def promises(store: Path) -> StoredPromises:
    """Compare what was predicted of the complete runs of a store with what they reached."""
    runs, without, unreadable = [], 0, []
    for each in list_runs(store):
        if each.fault:
            unreadable.append(each.folder.name)
        elif each.status == "complete":
            try:
                found = _promised(Run.open(each.folder))
            except RecordError:
                unreadable.append(each.folder.name)
                continue
            if found is None:
                without += 1
            else:
                runs.append(found)
    return StoredPromises(runs, without, unreadable)


def _kept_by(runs: Sequence[Promised]) -> dict[str, Any]:
    by_name: dict[str, list[float | None]] = {}
    for run in reversed(runs):  # results in the order of the oldest run
        for each in run.results:
            by_name.setdefault(each["name"], []).append(each["u_over_predicted"])
    within = [run.within_bound for run in runs if run.within_bound is not None]
    return {
        "procedure": runs[0].procedure,
        "simulated": runs[0].simulated,
        "runs": len(runs),
        "seconds_over_predicted": _spread([run.seconds_over_predicted for run in runs]),
        "within_bound": {"count": len(within), "share": sum(within) / len(within)} if within else None,
        "u_over_predicted": _spread([run.u_over_predicted for run in runs]),
        "results": [
            {"name": name, "u_over_predicted": spread}
            for name, values in by_name.items()
            if (spread := _spread(values)) is not None
        ],
    }


def _spread(values: Sequence[float | None]) -> Spread | None:
    """Of the values that are known; None: none is."""
    present = [value for value in values if value is not None]
    if not present:
        return None
    return {
        "count": len(present),
        "mean": math.fsum(present) / len(present),
        "least": min(present),
        "greatest": max(present),
    }


def _promised(run: Run) -> Promised | None:
    """The promise of a run; None: it has none."""
    names = ("predicted_seconds", "achieved_seconds", "predicted_u", "achieved_u")
    if not all(name in run.summary for name in names):
        return None
    seconds, taken, u, reached = (_number(run.summary[name]) for name in names)
    planned = run.summary.get("planned")
    bound = _number(planned.get("longest_s")) if isinstance(planned, dict) else None
    within = None if taken is None or bound is None else taken <= bound
    about = run.folder.name, run.procedure, run.simulated, seconds, taken, u, reached, bound
    return Promised(*about, _results(run), within, _over(taken, seconds), _over(reached, u))


def _results(run: Run) -> tuple[dict[str, Any], ...]:
    """The predicted results of a run, each with the achieved one of the same name and unit."""
    achieved, rows = _uncertainties(run, ACHIEVED), []
    for (name, unit), u in _uncertainties(run, RESULTS).items():
        reached = achieved.get((name, unit))
        row = {"name": name, "unit": unit, "predicted_u": u, "achieved_u": reached}
        rows.append({**row, "u_over_predicted": _over(reached, u)})
    return tuple(rows)


def _uncertainties(run: Run, key: str) -> dict[tuple[str, str], float | None]:
    """Standard uncertainties of a run's results, by name and unit; empty: an older version recorded none."""
    rows: list[dict[str, Any]] = run.summary.get(key, [])  # type: ignore[assignment]  # as the engine wrote them
    return {(row["name"], row["unit"]): _number(row["u"]) for row in rows}


def _number(value: object) -> float | None:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if is_number else None  # type: ignore[arg-type]


def _over(achieved: float | None, predicted: float | None) -> float | None:
    return None if achieved is None or not predicted else achieved / predicted


# --- Prints whether the promises of a store are kept ---------------------------------------------------

MOST = 20  # runs that are listed one by one


def print_promises(kept: StoredPromises, store: Path) -> None:
    """Print achieved over predicted time and uncertainty of each procedure and result, and of the newest runs."""
    table = new_table(
        None, "procedure", "bench", "runs", "time over\npredicted", "least to\ngreatest", "within the\nbound"
    )  # fmt: skip
    results = new_table(None, "procedure", "result", "runs", "u over\npredicted", "least to\ngreatest")
    for each in kept.procedures():
        bench, within = "simulated" if each["simulated"] else "real", each["within_bound"]
        kept_share = "-" if within is None else f"{within['share']:.0%} of {within['count']}"
        table.add_row(each["procedure"], bench, str(each["runs"]), *_cells(each["seconds_over_predicted"]), kept_share)
        first = f"{each['procedure']}{'' if each['simulated'] else ', real'}"
        for result in each["results"]:
            spread = result["u_over_predicted"]
            results.add_row(first, result["name"], str(spread["count"]), *_cells(spread))
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
    return f"{spread['mean']:.3f}", f"{spread['least']:.2f} to {spread['greatest']:.2f}"
