"""The printed table of points or of result rows, from their columns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from palpate.instrument.errors import ConfigError
from palpate.procedures.records.columns import LAST, Column, columns_of
from palpate.procedures.showing.text import new_table

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

NOTHING = "-"


def table_of(title: Text | None, rows: Sequence[Any], columns: Mapping[str, Column]) -> Table:
    """A table with a line for each row, and what of `columns` has a heading.

    Args:
        title: its title.
        rows: the points or result rows.
        columns: by the fields of the rows, as `columns_of` has them; those whose `cell` is a function by any name.

    Raises:
        ConfigError: a value cannot be printed in the format of its column.
    """
    parts = [part for name in _in_order(columns) for part in _parts(name, columns[name], rows)]
    table = new_table(title, *(head for head, _ in parts))
    for row in rows:
        table.add_row(*(cell(row) for _, cell in parts))
    return table


def _in_order(columns: Mapping[str, Column]) -> list[str]:
    """The names of the columns as they are printed."""
    names = [name for name, column in columns.items() if not column.after]
    for name, column in columns.items():
        if column.after and column.after != LAST:
            names.insert(names.index(column.after) + 1 if column.after in names else len(names), name)
    return names + [name for name, column in columns.items() if column.after == LAST]


def _parts(name: str, column: Column, rows: Sequence[Any]) -> Iterator[tuple[str, Callable[[Any], str]]]:
    """Headings and cells of a field: one, or those of each row that it holds."""
    if column.each and rows:
        for number, inner in enumerate(getattr(rows[0], name)):
            for own, part in columns_of(type(inner)).items():
                if part.head:
                    yield f"{getattr(inner, column.each)}\n{part.head}", partial(_inner_cell, name, number, own, part)
    elif column.head:
        yield column.head, partial(cell_of, name, column)


def cell_of(name: str, column: Column, row: Any) -> str:
    """The cell of a row in the column of one of its fields. Raises ConfigError as `table_of` does."""
    if callable(column.cell):
        return column.cell(row)
    value = getattr(row, name)
    if value is None:
        return NOTHING
    try:
        if "{" in column.cell:
            return column.cell.format(row)
        return format(value if column.scale == 1.0 else column.scale * value, column.cell)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise ConfigError(
            f"{type(row).__name__}.{name}: {value!r} cannot be printed as {column.cell!r} ({error}); give its column"
            " another cell"
        ) from None


def _inner_cell(outer: str, number: int, name: str, column: Column, row: Any) -> str:
    return cell_of(name, column, getattr(row, outer)[number])
