"""The limits of a result, as a file says them, one table for each quantity:

    ["force ratio of sample 1"]                   # the quantity of an uncertainty budget
    low = 0.25
    high = "35 %"
    risk = "1 %"                                  # greatest specific risk of a false acceptance; 5 % without it
    prior = { mean = 0.3, sd = 0.02 }             # a normal distribution; without it there is no prior information

    [load_measured_N]                             # a column of the points: each valid point is judged
    high = "3.1 N"

The file is only data. It is read and checked before a bench is opened. Rows that a column holds have columns of their
own, such as `["films.gain_V_per_N"]`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self, get_args, get_type_hints

from pydantic import BeforeValidator, model_validator

from palpate.instrument.config import Config, check, read_data
from palpate.instrument.errors import ConfigError, QuantityError, UnknownName, UsageError, quoted
from palpate.instrument.quantity import parse, parse_tolerance, unit_of
from palpate.instrument.uncertainty.decision import Bounds, NormalPrior
from palpate.procedures.records.columns import Column, columns_of

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

LEAST_RISK = 1e-9


def _as_text(value: object) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{quoted(value)} is no finite number and no text; give for example '24 kPa', '5 %' or 0.3")
    return repr(value)


Amount = Annotated[str, BeforeValidator(_as_text)]


class PriorTable(Config):
    """`prior` of a limit: mean and standard deviation of a normal distribution."""

    mean: Amount
    sd: Amount


class LimitTable(Config):
    """The table of a quantity in a file of limits."""

    low: Amount | None = None
    high: Amount | None = None
    risk: Amount = "5 %"
    prior: PriorTable | None = None

    @model_validator(mode="after")
    def _can_be(self) -> Self:
        given = self.high if self.low is None else self.low
        if given is None:
            raise ValueError("it has neither low nor high; give one or both")
        self.in_unit(unit_of(given))
        return self

    def in_unit(self, unit: str) -> Bounds:
        """The limits in the unit of a quantity. Raises ValueError: they cannot be limits of it."""
        example = f"0.1 %{unit[1:]}" if unit.startswith("1/") else ""  # a number before 1/K would be no quantity

        def read(key: str, amount: str) -> float:
            try:
                unit_of(amount)
                return parse(amount, "" if unit == "1" else unit, example)
            except QuantityError as error:
                raise ValueError(f"{key}: {error}") from None

        low = None if self.low is None else read("low", self.low)
        high = None if self.high is None else read("high", self.high)
        if low is not None and high is not None and not low < high:
            raise ValueError(f"low = {self.low} is not below high = {self.high}; exchange them")
        prior = None
        if self.prior is not None:
            prior = NormalPrior(read("prior.mean", self.prior.mean), read("prior.sd", self.prior.sd))
            if not prior.sd > 0:
                raise ValueError(f"prior.sd = {self.prior.sd} is not above 0; give a standard deviation")
        try:
            risk = parse_tolerance(self.risk)
        except UsageError as error:
            raise ValueError(f"risk: {error}") from None
        if risk < LEAST_RISK:
            raise ValueError(f"risk = {self.risk} is below {LEAST_RISK:g}; no uncertainty is known so well")
        return Bounds(low, high, risk, prior)


@dataclass(frozen=True, slots=True)
class LimitsFile:
    """The limits of a file by quantity; `where`: what messages begin with."""

    where: str
    tables: Mapping[str, LimitTable]

    def of(self, name: str, unit: str) -> Bounds:
        """The limits of a quantity, in its unit. Raises ConfigError: they have another unit."""
        try:
            return self.tables[name].in_unit(unit)
        except ValueError as error:
            raise ConfigError(f"{self.where}: {name}: {error}") from None

    def without_u(self, point: type[DataclassInstance]) -> list[str]:
        """Names of columns without a standard uncertainty, whose verdict can only be undecided."""
        columns = number_columns(point)
        return [name for name in self.tables if name in columns and not columns[name].u]

    def open_names(self, point: type[DataclassInstance], predicted: Iterable[str]) -> list[str]:
        """Names of which only the result can tell whether it has them: no columns and no results of the plan.

        Raises ConfigError: a column has another unit; or there is no such column, by a name that only one can have.
        """
        columns, results = number_columns(point), set(predicted)
        for name in self.tables.keys() & columns.keys():
            self.of(name, columns[name].unit)
        left = [name for name in self.tables if name not in columns and name not in results]
        for name in left:
            if "_" in name or "." in name or name in columns_of(point):  # quantities of budgets are words
                raise ConfigError(f"{self.where}: {UnknownName('quantity', name, {*columns, *results})}")
        return left


def read_limits(given: str | Path | Mapping[str, Any]) -> LimitsFile:
    """Bounds of a file, or of a mapping with the same tables.

    Raises ConfigError: the file is missing or wrong, has no table, or a table cannot be that of a limit.
    """
    where, data = ("limits", dict(given)) if isinstance(given, Mapping) else (str(given), read_data(Path(given)))
    if not data:
        raise ConfigError(f"{where}: has no limits; give a table for each quantity, such as [force_ratio]")
    found = {}
    for name, table in data.items():
        if not name.isprintable() or not name.strip():
            raise ConfigError(f"{where}: {quoted(name)} is no name of a quantity; give printable characters")
        if not isinstance(table, Mapping):
            raise ConfigError(
                f"{where}: {name} is no table; write [{name}] on a line of its own, and low or high below"
            )
        found[name] = check(dict(table), LimitTable, f"{where}: {name}")
    return LimitsFile(where, found)


def number_columns(kind: type[DataclassInstance]) -> dict[str, Column]:
    """The columns of numbers of a class of points, with those of the rows that they hold."""
    hints, found = get_type_hints(kind), dict[str, Column]()
    for name, column in columns_of(kind).items():
        leaves = set(_leaves(hints[name]))
        for rows in (each for each in leaves if is_dataclass(each) and isinstance(each, type)):
            found |= {f"{name}.{inner}": each for inner, each in number_columns(rows).items()}
        if leaves & {int, float}:
            found[name] = column
    return found


def _leaves(hint: Any) -> Iterator[Any]:
    if not get_args(hint):
        yield hint
    for each in get_args(hint):
        yield from _leaves(each)
