"""Shows the result of a run: by the report of its procedure, or as a table of its points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

from palpate.procedures.records.columns import Column, columns_of
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import number, stamped

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from palpate.procedures.engine.procedure import Report, Result
    from palpate.procedures.lab.session import Outcome


def show_result(report: Report | None, result: Result, outcome: Outcome) -> list[object]:
    """Tables and lines of a result; `report` is that of its procedure, None: it has none."""
    if report is None:
        return show_points(result.points, result.summary(), outcome["simulated"])
    return [*report.show(outcome)]


def show_points(points: Sequence[DataclassInstance], found: Mapping[str, object], simulated: bool) -> list[object]:
    """A table of the points, then lines with the findings.

    Where no column of the points has a heading, each value that is no list has one: its name.
    """
    columns = columns_of(type(points[0])) if points else {}
    if points and not any(column.head or column.each for column in columns.values()):
        plain = [name for name, value in asdict(points[0]).items() if not isinstance(value, (list, tuple, dict))]
        columns = {name: Column(head=name.replace("_", "\n"), cell=partial(_value, name)) for name in plain}
    table = table_of(stamped(simulated, "Points"), points, columns)
    return [table, *(f"{name:<14} {number(value)}" for name, value in found.items())]


def _value(name: str, point: DataclassInstance) -> str:
    return number(getattr(point, name))
