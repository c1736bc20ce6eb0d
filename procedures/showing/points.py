"""Prints the points of a procedure that has no report of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

from palpate.procedures.lab.session import Outcome
from palpate.procedures.records.columns import Column, columns_of
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import number, print_all, stamped, where

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def print_points(points: Sequence[DataclassInstance], found: Mapping[str, object], outcome: Outcome) -> None:
    """Print a table of the points, then the findings and the run's folder.

    Where no column of the points has a heading, each value that is no list has one: its name.
    """
    columns = columns_of(type(points[0])) if points else {}
    if points and not any(column.head or column.each for column in columns.values()):
        plain = [name for name, value in asdict(points[0]).items() if not isinstance(value, (list, tuple, dict))]
        columns = {name: Column(head=name.replace("_", "\n"), cell=partial(_value, name)) for name in plain}
    table = table_of(stamped(outcome["simulated"], "Points"), points, columns)
    print_all(table, *(f"{name:<14} {number(value)}" for name, value in found.items()), *where(outcome))


def _value(name: str, point: DataclassInstance) -> str:
    return number(getattr(point, name))
