"""Prints every figure that palpate promises, measured now on this machine: `python -m tests.benchmarks`.

    python -m tests.benchmarks                  all but the long ones
    python -m tests.benchmarks sweep kills      these
    python -m tests.benchmarks sweep rounds=1   with another size of it, where it has some
    python -m tests.benchmarks --list           what there is, and its sizes

Nothing here fails on a slow machine: times are printed beside their goals, never asserted.
"""

from __future__ import annotations

import inspect
import json
import platform
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

from rich.console import Console
from rich.table import Table

from tests.benchmarks.common import Row

# Benchmarks by the module that has a function of their name.
USUAL = {
    "wire": ("driver_call", "array", "fixture", "serve"),
    "sweep": ("sweep", "dwell", "scenes"),
    "repeats": ("order", "repeats", "characterise", "verdicts", "history"),
    "coverage": ("uncertainty", "coverage", "references"),
    "models": ("models", "solid", "poles"),
    "peers": ("peers",),
    "modulus": ("modulus_wire",),
    "front": ("front", "hard_cases", "prices"),
    "devices": ("eds", "real_bench", "masters"),
    "records": ("records",),
    "commands": ("report", "reproduce", "entries", "first_result", "growth", "study", "start_up", "walk_through"),
}
# A quarter of an hour and more (bounds, estimates, estimates_solid: hours, resumable): only by name.
LONG = {
    "bounds": ("bounds",),
    "estimates": ("estimates",),
    "estimates_solid": ("estimates_solid",),
    "faults": ("faults", "hostile_scenes", "moods"),
    "records": ("calibrations", "kills", "campaigns", "served_kills", "damages", "disk"),
    "live": ("listeners", "live"),
    "wire": ("load", "stale"),
    "sweep": ("soak",),
    "modulus": ("modulus_budget",),
    "commands": ("run_table",),
    "coverage": ("scatter",),
}
MODULES = {name: module for some in (USUAL, LONG) for module, names in some.items() for name in names}


def measuring(name: str) -> Callable[..., Iterator[Row]]:
    """The function that yields the rows of a benchmark."""
    found: Callable[..., Iterator[Row]] = getattr(import_module(f"tests.benchmarks.{MODULES[name]}"), name)
    return found


def main(words: list[str]) -> int:
    """Run the named benchmarks, or all but the long ones; `size=number` belongs to the one before it."""
    asked: dict[str, dict[str, Any]] = {}
    for word in words:
        size, is_size, number = word.partition("=")
        if is_size and asked:
            asked[list(asked)[-1]][size] = json.loads(number)
        elif word in MODULES:
            asked[word] = {}
        elif word != "--list":
            print(f"unknown benchmark {word!r}; valid: {', '.join(MODULES)}", file=sys.stderr)  # noqa: T201
            return 2
    console = Console(width=120, highlight=False)
    if "--list" in words:
        for name in MODULES:
            told = str(measuring(name).__doc__).split("\n\n")[0]
            sizes, *_ = str(inspect.signature(measuring(name), eval_str=True)).partition(" ->")
            console.print(f"{name}{sizes}", told, sep="\n    ")
        return 0
    console.print(f"{platform.machine()}, Python {platform.python_version()}")
    table = Table(box=None, padding=(0, 2, 0, 0))
    for column in ("figure", "measured", "goal", ""):
        table.add_column(column)
    for name in asked or [name for names in USUAL.values() for name in names]:
        for row in measuring(name)(**asked.get(name, {})):
            verdict = "" if row.met is None else "met" if row.met else "NOT MET"
            table.add_row(row.figure, row.measured, row.goal, verdict)
    console.print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
