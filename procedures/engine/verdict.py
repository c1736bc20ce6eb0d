"""Whether a result lies within its limits: a verdict for each of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self, get_args, get_type_hints

from pydantic import BeforeValidator, model_validator

from palpate.instrument.config import Config, check, read_data
from palpate.instrument.errors import ConfigError, QuantityError, RecordError, UnknownName, UsageError, quoted
from palpate.instrument.quantity import counted, parse, parse_tolerance, show, unit_of
from palpate.instrument.uncertainty.decision import (
    FAIL,
    PASS,
    UNDECIDED,
    Bounds,
    Decision,
    Estimate,
    NormalPrior,
    Outcome,
    decide,
    deciding_u,
    guard_band,
)
from palpate.procedures.engine.catalogue import procedure_class
from palpate.procedures.engine.procedure import Finished, Result
from palpate.procedures.records.columns import Column, columns_of
from palpate.procedures.records.run import Run

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


# --- The limits of a result, as a file says them, one table for each quantity: -------------------------
#
#     ["force ratio of sample 1"]                   # the quantity of an uncertainty budget
#     low = 0.25
#     high = "35 %"
#     risk = "1 %"                                  # greatest specific risk of a false acceptance; 5 % without it
#     prior = { mean = 0.3, sd = 0.02 }             # a normal distribution; without it there is no prior information
#
#     [load_measured_N]                             # a column of the points: each valid point is judged
#     high = "3.1 N"
#
# The file is only data. It is read and checked before a bench is opened. Rows that a column holds have columns of their
# own, such as `["films.gain_V_per_N"]`.

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


# --- the quantities of a result ------------------------------------------------------------------------

WORST = (FAIL, UNDECIDED, PASS)
STATUS: dict[Outcome, int] = {PASS: 0, FAIL: 3, UNDECIDED: 4}  # exit status


@dataclass(frozen=True, slots=True)
class FoundValue:
    """A value of a quantity; `estimate`: None: it is not known, or without its uncertainty; `point`: None: a result."""

    value: float | None
    estimate: Estimate | None
    point: int | None = None


@dataclass(frozen=True, slots=True)
class FoundQuantity:
    """The values of a quantity; `left_out`: number of points that are not valid."""

    unit: str
    values: Sequence[FoundValue]
    left_out: int = 0


def _of_budgets(budgets: Iterable[Mapping[str, Any]]) -> dict[str, FoundQuantity]:
    found: dict[str, FoundQuantity] = {}
    for entry in budgets:
        budget = entry.get("budget", entry)
        freedom = math.inf if budget["degrees_of_freedom"] is None else budget["degrees_of_freedom"]
        ends = None if budget is entry else (entry["low"], entry["high"])
        value = FoundValue(entry["value"], Estimate(entry["value"], entry["u"], freedom, ends))
        same = found.get(budget["quantity"], FoundQuantity(budget["unit"], ()))
        found[budget["quantity"]] = FoundQuantity(same.unit, (*same.values, value))
    return found


def of_points(columns: Mapping[str, Column], points: Sequence[Mapping[str, Any]]) -> dict[str, FoundQuantity]:
    """The quantities of points by the names of columns; those of points that are not valid are left out."""
    valid = [(number, point) for number, point in enumerate(points, 1) if point.get("valid", True)]
    return {
        name: FoundQuantity(
            column.unit,
            [_measured(*cell, number) for number, point in valid for cell in _cells(point, name, column.u)],
            len(points) - len(valid),
        )
        for name, column in columns.items()
    }


def _of_run(run: Run) -> dict[str, FoundQuantity]:
    """The quantities of a run's points; none if its procedure is that of a script or of a package that is not here."""
    try:
        kind = procedure_class(run.procedure)
    except UnknownName:
        return {}
    return of_points(number_columns(kind.point), run.points())


def _cells(point: Mapping[str, Any], name: str, u: str) -> Iterator[tuple[Any, Any]]:
    """The values of a column in a point, each with its standard uncertainty or None."""
    outer, dot, inner = name.partition(".")
    if dot:
        for row in point[outer]:
            yield from _cells(row, inner, u)
    elif isinstance(point[name], (list, tuple)):
        yield from zip(point[name], point[u] if u else [None] * len(point[name]), strict=True)
    else:
        yield point[name], point[u] if u else None


def _measured(value: float | None, u: float | None, point: int) -> FoundValue:
    finite = [None if each is None or not math.isfinite(each) else float(each) for each in (value, u)]
    return FoundValue(finite[0], None if None in finite else Estimate(*finite), point)  # type: ignore[arg-type]


def quantities_of(of: Finished[Any] | Result | Run) -> dict[str, FoundQuantity]:
    """The quantities of a result by the names of its columns and budgets.

    Raises UsageError: the run has not ended; RecordError: another version recorded it, or it is damaged.
    """
    if isinstance(of, Run):
        if of.status != "complete":
            raise UsageError(f"{of.folder} is {of.status}, so it has no result; end it with palpate runs resume")
        budgets: Any = of.summary.get("budgets", ())
        try:
            return _of_run(of) | _of_budgets(budgets)
        except (KeyError, TypeError) as error:
            raise RecordError(f"{of.folder}: another version of palpate recorded it ({error}); run it anew") from None
    result = of.result if isinstance(of, Finished) else of
    points = [asdict(point) for point in result.points]
    columns = of_points(number_columns(type(result.points[0])), points) if points else {}
    return columns | _of_budgets(each.summary() for each in result.budgets)


# --- verdicts ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LimitVerdict:
    """What a limit says; of several values, as of a column, it tells that of the worst.

    Attributes:
        quantity: its name in the file of limits.
        outcome: "pass", "fail" or "undecided".
        value, u, unit: the value and its standard uncertainty; None: not known.
        low, high, risk: the limits, in that unit; None: there is none.
        prior: what was known beforehand; None: there is no prior information.
        outside: probability to lie outside the limits; None: not known.
        deciding_u: greatest standard uncertainty that would decide the same value; None: it is decided, or none would.
        values: how many values were judged.
        point: number of the point whose value it is, from 1; None: it is one of the result.
        reason: why, for people.
    """

    quantity: str
    outcome: Outcome
    value: float | None
    u: float | None
    unit: str
    low: float | None
    high: float | None
    risk: float
    prior: NormalPrior | None
    outside: float | None
    deciding_u: float | None
    values: int
    point: int | None
    reason: str


@dataclass(frozen=True, slots=True)
class Judgement:
    """The verdicts of all limits of a file, in its order."""

    verdicts: tuple[LimitVerdict, ...]

    @property
    def outcome(self) -> Outcome:
        """That of all limits together: "fail" if one fails, else "undecided" if one is."""
        return min((each.outcome for each in self.verdicts), key=WORST.index)

    @property
    def status(self) -> int:
        """Exit status: 0 all pass, 3 one fails, 4 one is undecided and none fails."""
        return STATUS[self.outcome]

    def summary(self) -> dict[str, Any]:
        """The judgement as JSON has it."""
        return {"verdict": self.outcome, "verdicts": [asdict(each) for each in self.verdicts]}

    def __str__(self) -> str:
        return "\n".join(f"{each.quantity}: {each.outcome}: {each.reason}" for each in self.verdicts)


def judge(of: Finished[Any] | Result | Run, limits: str | Path | Mapping[str, Any] | LimitsFile) -> Judgement:
    """Judge a result by limits.

    Args:
        of: a finished run, its result, or a run on disk.
        limits: the file of limits, or a mapping with the same tables.

    Raises:
        ConfigError: the limits are wrong, or the result has no such quantity, or one of another unit.
        UsageError: the run has not ended.
    """
    asked = limits if isinstance(limits, LimitsFile) else read_limits(limits)
    found = quantities_of(of)
    for name in asked.tables:
        if name not in found:
            raise ConfigError(f"{asked.where}: {UnknownName('quantity of this result', name, found)}")
    return Judgement(tuple(_verdict(name, found[name], asked.of(name, found[name].unit)) for name in asked.tables))


def _verdict(name: str, quantity: FoundQuantity, bounds: Bounds) -> LimitVerdict:
    judged = [_of_value(name, each, quantity, bounds) for each in quantity.values]
    if not judged:
        judged = [_of_value(name, FoundValue(None, None), quantity, bounds)]
    return min(judged, key=lambda each: (WORST.index(each.outcome), -(each.outside or 0.0)))


def _of_value(name: str, value: FoundValue, quantity: FoundQuantity, bounds: Bounds) -> LimitVerdict:
    unit, estimate, outcome = quantity.unit, value.estimate, UNDECIDED
    outside = least = None
    if estimate is not None:
        decision = decide(estimate, bounds)
        outcome, outside = decision.outcome, None if math.isnan(decision.outside) else decision.outside
        least = deciding_u(estimate, bounds) if outcome == UNDECIDED else None
        why = _reason(estimate, bounds, unit, decision, least)
    elif value.value is not None:
        why = f"{show(value.value, unit)} has no standard uncertainty, so the risk is not known"
    else:
        why = "there is no valid value"
    if quantity.left_out:
        why += f"; without {counted(quantity.left_out, 'point')} that are not valid"
    return LimitVerdict(
        quantity=name,
        outcome=outcome,
        value=value.value,
        u=None if estimate is None else estimate.u,
        unit=unit,
        low=bounds.low,
        high=bounds.high,
        risk=bounds.risk,
        prior=bounds.prior,
        outside=outside,
        deciding_u=least,
        values=len(quantity.values),
        point=value.point,
        reason=why if value.point is None else f"point {value.point}: {why}",
    )


def _reason(estimate: Estimate, bounds: Bounds, unit: str, decision: Decision, least: float | None) -> str:
    value, nearest = show(estimate.value, unit), bounds.nearest(estimate.value)
    if math.isnan(decision.outside):
        return f"{value} is so far from its prior that they contradict each other; state another prior"
    why = f"outside with a probability of {percent(decision.outside)}"
    if decision.outcome == PASS:
        return f"{value} is {why}"
    if decision.outcome == FAIL:
        side = "below" if decision.below > decision.above else "above"
        return f"{value} is {side} {show(nearest, unit)} with a probability of {percent(decision.outside)}"
    band = guard_band(estimate, bounds)
    if bounds.prior is None and abs(estimate.value - nearest) <= band:
        why = f"within the guard band of {show(band, unit, 2)} on each side of {show(nearest, unit)}, {why}"
    why = f"{value} is {why}, and the risk is {percent(bounds.risk)}"
    if least is None:
        return f"{why}; no uncertainty would decide it"
    would = "pass" if bounds.hold(estimate.value) else "fail"
    now = show(estimate.u, unit, 2)
    return f"{why}; with a u of {show(least, unit, 2)} or less in the place of {now} it would {would}"


def percent(probability: float) -> str:
    """A probability for people."""
    return "below 0.001 %" if 0 < probability < 1e-5 else f"{100 * probability:.3g} %"
