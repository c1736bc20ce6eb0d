"""All runs of a store as one table, and the runs for which something holds, such as "batch = B7"."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import eq, ge, gt, le, lt, ne
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.instrument.errors import UnknownName, UsageError, quoted
from palpate.procedures.lab.store import store
from palpate.procedures.records.run import RunSummary, list_runs

if TYPE_CHECKING:
    import pandas as pd

SIGNS: Mapping[str, Callable[[Any, Any], bool]] = {"<=": le, ">=": ge, "!=": ne, "=": eq, "<": lt, ">": gt}
CONDITION = re.compile(r"\s*([A-Za-z][A-Za-z0-9_.]*)\s*(<=|>=|!=|=|<|>)\s*(.*?)\s*")
OWN = ("run", "procedure", "started", "status", "simulated", "scene", "seed", "points")


def runs(folder: str | Path | None = None, where: Sequence[str] = ()) -> pd.DataFrame:
    """The runs of a store, the newest first, one a row.

    Columns: `run` (name of its folder), `procedure`, `started`, `status` ("damaged": it cannot be read), `simulated`,
    `scene`, `seed`, `points`; then what the runs say about themselves, by its keys; then their settings, as
    `settings.loads`. None stands where a run has no such value.

    Args:
        folder: the store; None: $PALPATE_STORE, or runs/.
        where: conditions that all hold, such as "batch = B7", "points >= 10", "started > 2026-01". Lists are compared
            as they are shown, as in "settings.loads = [2.0, 3.0]".

    Raises UsageError, UnknownName: a condition is none, or no run has a value of its name.
    """
    import pandas as pd

    found = list_runs(store() if folder is None else Path(folder))
    rows = [row_of(run) for run, _ in chosen(found, where)]
    return pd.DataFrame(rows, columns=list(dict.fromkeys([*OWN, *(key for row in rows for key in row)])))


def chosen(found: Iterable[RunSummary], where: Sequence[str]) -> list[tuple[RunSummary, dict[str, Any]]]:
    """The runs for which all conditions hold, each with its row. Raises as `runs` does."""
    rows = [(run, row_of(run)) for run in found]
    keys = {key for _, row in rows for key in row}
    for text in where:
        key, holds = _condition(text)
        if rows and key not in keys:
            raise UnknownName("value of these runs", key, sorted(keys))
        rows = [(run, row) for run, row in rows if holds(row.get(key))]
    return rows


def row_of(run: RunSummary) -> dict[str, Any]:
    """A run as a row of the table."""
    header = run.header
    scene, about, settings = (header.get(name) for name in ("scene", "about", "settings"))
    return {
        "run": run.folder.name,
        "procedure": run.procedure or None,
        "started": run.started.isoformat(),
        "status": run.status,
        "simulated": run.simulated,
        "scene": scene.get("name") if isinstance(scene, Mapping) else None,
        "seed": header.get("seed"),
        "points": run.points,
        **(about if isinstance(about, Mapping) else {}),
        **({f"settings.{key}": value for key, value in settings.items()} if isinstance(settings, Mapping) else {}),
    }


def bench_of(header: Mapping[str, Any]) -> str:
    """Name of the scene or bench of a run."""
    scene = header.get("scene")
    if isinstance(scene, Mapping):
        return str(scene.get("name"))
    try:
        return str(tomllib.loads(str(header.get("bench"))).get("name"))
    except tomllib.TOMLDecodeError:
        return ""


def _condition(text: str) -> tuple[str, Callable[[Any], bool]]:
    """The name in a condition, and whether it holds for a value of that name."""
    found = CONDITION.fullmatch(text)
    if found is None:
        raise UsageError(
            f"{quoted(text)} is no condition; give a name, one of {' '.join(SIGNS)}, and a value: 'batch = B7'"
        )
    key, sign, wanted = found.groups()

    def holds(value: Any) -> bool:
        if value is None:
            return False
        if isinstance(value, bool):
            return SIGNS[sign](str(value).lower(), wanted.lower())
        if isinstance(value, int | float):
            try:
                return SIGNS[sign](float(value), float(wanted))
            except ValueError:
                raise UsageError(f"{quoted(text)}: {key} is a number in these runs, and {wanted!r} is none") from None
        try:
            return SIGNS[sign](float(value), float(wanted))
        except (TypeError, ValueError):
            return SIGNS[sign](str(value), wanted)

    return key, holds
