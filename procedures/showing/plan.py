"""Prints the plan of a procedure, for `--dry-run`."""

from __future__ import annotations

from palpate.instrument.quantity import counted
from palpate.procedures.console.terminal import Spoken, console
from palpate.procedures.engine.plan import Plan, S, Step
from palpate.procedures.engine.procedure import RELATIVE, expected_of
from palpate.procedures.showing.text import new_table, number, print_all

OWN = tuple(Step(None, 0.0, None).summary())


def print_plan(plan: Plan[S]) -> None:
    """Print every point with its dwell, time and expected uncertainty, or the plan's own lines.

    Then print what is expected of each result, and the total time.
    """
    if plan.predicted.lines:
        print_all(*plan.predicted.lines, _total(plan, ""))
        return
    rows = [step.summary() for step in plan.steps]
    asked = [name for name in rows[0] if name not in OWN]
    table = new_table(
        None, *(name.replace("_", "\n") for name in asked), "dwell\ns", "takes\ns", "expected u\nof ratio"
    )
    for row in rows:
        u = row["force_ratio_u"]
        table.add_row(
            *(number(row[name]) for name in asked),
            _dwell(row["dwell_s"], u),
            f"{row['seconds']:z.0f}",
            "-" if u is None else f"{100 * u:z.1f} %",
        )
    results = expected_of(plan)
    expected = new_table(None, "result", "expected u", "unit")
    for each in results:
        u = f"{100 * each.u:.2g} %" if each.unit == RELATIVE else f"{each.u:.2g}"
        expected.add_row(each.name, u, each.unit)
    print_all(table, *([expected] if results else []), _total(plan, f"{counted(len(rows), 'point')}, "))


def announce(plan: Plan[S]) -> None:
    """Tell who sits at the terminal, on stderr, what a run will do and how long it takes, before it begins."""
    shown = console(file=Spoken())
    if shown.is_terminal:
        for line in (*plan.predicted.lines, f"{plan.procedure}: about {duration(plan.seconds)}"):
            shown.print(line)


def _dwell(dwell: float | None, u: float | None) -> str:
    if dwell is not None:
        return f"{dwell:g}"
    return "-" if u is None else "by noise"


def _total(plan: Plan[S], points: str) -> str:
    return f"{plan.procedure}: {points}about {duration(plan.seconds)} on hardware; nothing was sent"


def duration(seconds: float) -> str:
    """A duration [s] in hours, minutes and seconds, for people."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
