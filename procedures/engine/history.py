"""A quantity over the complete runs of a store: control charts, drift, and when a calibration is needed again."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from palpate.instrument.errors import EstimateError, RecordError, UnknownName, UsageError, quoted
from palpate.instrument.quantity import counted, parse, parse_tolerance
from palpate.instrument.uncertainty.budget import Budget
from palpate.instrument.uncertainty.control_chart import Check, checked, drift
from palpate.procedures.engine.catalogue import procedure_class
from palpate.procedures.engine.verdict import FoundQuantity, quantities_of
from palpate.procedures.lab.run_table import bench_of
from palpate.procedures.records.run import Run, RunSummary

MONTH = timedelta(days=365.25 / 12)
LONGEST = 1200  # months; no date is told that is farther away


@dataclass(frozen=True, slots=True)
class Series:
    """Runs under like conditions in the order of their beginnings, two at least.

    Attributes:
        conditions: what is the same in all of them, with the unit of the values.
        runs, values, us, checks: the runs, with value, standard uncertainty and what the charts say of each.
        drift: change of the value in a month.
        tolerance: the change that is allowed.
        since: when a drift began to count: the last run of a calibration, which begins anew; else the first run.
    """

    conditions: Mapping[str, Any]
    runs: Sequence[Run]
    values: Sequence[float]
    us: Sequence[float]
    checks: Sequence[Check]
    drift: Budget
    tolerance: float
    since: datetime

    @property
    def mean(self) -> float:
        """Mean of the values."""
        return math.fsum(self.values) / len(self.values)

    @property
    def span(self) -> timedelta:
        """Time from the first run to the last."""
        return self.runs[-1].started - self.runs[0].started

    @property
    def too_short(self) -> bool:
        """Whether the runs span too short a time for a drift in a month.

        Then its 95 % interval is wider than ± the mean itself and ± the tolerance: it rules out no change at all.
        """
        return self.drift.expanded() > max(abs(self.mean), self.tolerance)

    @property
    def due(self) -> str | None:
        """Date at which the drift has used up the tolerance; None: the drift's interval has 0 in it, or `LONGEST`."""
        low, high = self.drift.interval()
        return None if low <= 0 <= high else self._used_up(self.drift.value)

    @property
    def earliest(self) -> str | None:
        """As `due`, by that end of the drift's interval that is farther from 0."""
        return self._used_up(max(self.drift.interval(), key=abs))

    def _used_up(self, slope: float) -> str | None:
        months = self.tolerance / abs(slope) if slope else math.inf
        return None if months > LONGEST else str((self.since + months * MONTH).date())

    def summary(self) -> dict[str, Any]:
        """The series for JSON."""
        low, high = self.drift.interval()
        runs = [
            {"run": str(run.folder), "started": run.started.isoformat(), "value": value, "u": u}
            | {**asdict(check), "alarms": list(check.alarms)}
            for run, value, u, check in zip(self.runs, self.values, self.us, self.checks, strict=True)
        ]
        slope = {"drift_per_month": self.drift.value, "drift_u": self.drift.u, "drift_low": low, "drift_high": high}
        of_drift = {**slope, "recalibrate": self.due, "recalibrate_earliest": self.earliest}
        if self.too_short:
            of_drift = dict.fromkeys(of_drift)
        return {
            **self.conditions,
            "runs": runs,
            "alarms": sum(bool(check.alarms) for check in self.checks),
            "span_s": self.span.total_seconds(),
            "tolerance": self.tolerance,
            "since": self.since.isoformat(),
            **of_drift,
        }


@dataclass(frozen=True, slots=True)
class QuantityHistory:
    """The series of a quantity; `left_out`: why runs that have it are in none, by their names."""

    quantity: str
    series: Sequence[Series]
    left_out: Mapping[str, str]

    def summary(self) -> dict[str, Any]:
        """The history for JSON."""
        left = [{"run": run, "why": why} for run, why in self.left_out.items()]
        return {"quantity": self.quantity, "series": [each.summary() for each in self.series], "left_out": left}


def history(found: Iterable[RunSummary], quantity: str, tolerance: str | None, now: datetime) -> QuantityHistory:
    """The history of a quantity of runs: a series for each sensor, bench and kind of run.

    The value of a run is the mean of all that it has of the quantity, with the mean of their uncertainties: those share
    the errors of a calibration, so that more points do not make the value surer.

    Args:
        found: runs of a store; only those that are complete count.
        quantity: name of a column or of a budget.
        tolerance: the change that is allowed, such as "1 %" of the mean or "0.1 mV/N"; None: the `u` of the last run.
        now: the time of this computer's clock.

    Raises:
        UnknownName: no run has the quantity. UsageError: no run is complete, no two under like conditions have it with
            its uncertainty, a run is of a time to come, or the tolerance cannot be one.
    """
    names, left_out, present = set[str](), dict[str, str](), False
    alike: dict[str, list[tuple[Run, float, float, dict[str, Any]]]] = {}
    complete = [each for each in found if each.status == "complete"]
    if not complete:
        raise UsageError("no complete run is chosen; measure first, ask for less with --where, or name another store")
    for summary in complete:
        try:
            run = Run.open(summary.folder)
            quantities = quantities_of(run)
            names |= {name for name, each in quantities.items() if any(value.estimate for value in each.values)}
            if quantity not in quantities:
                continue
            present = True
            _check_time(run, now)
            _check_order(run)
            conditions = _conditions(run, quantities[quantity])
            alike.setdefault(json.dumps(conditions), []).append((run, *_value(quantities[quantity]), conditions))
        except (RecordError, EstimateError) as error:
            left_out[summary.folder.name] = str(error)
    if not present:
        raise UnknownName("quantity with an uncertainty in these complete runs", quantity, names)
    series = []
    for runs in alike.values():
        if len({run.started for run, *_ in runs}) > 1:
            series.append(_series(sorted(runs, key=lambda each: each[0].started), tolerance))
        else:
            left_out |= {run.folder.name: "no other run under these conditions at another time" for run, *_ in runs}
    if not series:
        name, why = next(iter(left_out.items()))
        raise UsageError(
            f"{quoted(quantity)} has no history: it takes two complete runs under like conditions, with uncertainties;"
            f" {counted(len(left_out), 'run')} left out, such as {name}: {why}"
        )
    return QuantityHistory(quantity, series, left_out)


def _check_time(run: Run, now: datetime) -> None:
    if run.started > now:
        raise UsageError(
            f"{run.folder} began on {run.started:%Y-%m-%d %H:%M}, which is later than this computer's clock: it was"
            f" set back, or that run's clock was ahead; set it, or leave such runs out with --where 'started <="
            f" {now:%Y-%m-%d}'"
        )


def _check_order(run: Run) -> None:
    """Raises EstimateError: the run began before a calibration was made that it used, so its time is wrong.

    Nothing else in a record tells the order of runs but the time.
    """
    for key, used in run.header.items():
        made, when = str(used.get("created")) if isinstance(used, dict) else "", run.started
        with suppress(ValueError):  # it is no calibration, or does not tell when it was made
            when = datetime.fromisoformat(made).astimezone(UTC)
        if when > run.started:
            raise EstimateError(
                f"it began on {run.started:%Y-%m-%d %H:%M}, before the {key.replace('_', ' ')} that it used was made,"
                f" {made}: a clock was set back"
            )


def _value(found: FoundQuantity) -> tuple[float, float]:
    """The value of a run and its standard uncertainty. Raises EstimateError: it has none that can be compared."""
    estimates = [each.estimate for each in found.values if each.estimate is not None and each.estimate.u > 0]
    if found.left_out:
        raise EstimateError(f"{counted(found.left_out, 'point')} not valid")
    if not estimates or len(estimates) < len(found.values):
        raise EstimateError("it has no standard uncertainty there, so drift and scatter cannot be told apart")
    return math.fsum(each.value for each in estimates) / len(estimates), math.fsum(each.u for each in estimates) / len(
        estimates
    )


def _conditions(run: Run, found: FoundQuantity) -> dict[str, Any]:
    """What must be the same in the runs of a series."""
    devices: Any = run.header.get("devices") or {}
    return {
        "procedure": run.procedure,
        "simulated": run.simulated,
        "bench": bench_of(run.header),
        "devices": sorted(map(str, devices.values())),
        "object": run.about.get("object"),
        "settings": run.header.get("settings"),
        "unit": found.unit,
        "values": len(found.values),
    }


def _series(found: Sequence[tuple[Run, float, float, dict[str, Any]]], tolerance: str | None) -> Series:
    runs, values, us, (conditions, *_) = zip(*found, strict=True)
    first, last, unit = runs[0], runs[-1], conditions["unit"]
    try:
        calibrates = procedure_class(first.procedure).calibrates
    except UnknownName:  # of a script, or of a package that is not here
        calibrates = False
    allowed = us[-1] if tolerance is None else _amount(tolerance, unit, math.fsum(values) / len(values))
    slope = drift([(run.started - first.started) / MONTH for run in runs], values, us, f"{unit}/month")
    since = (last if calibrates else first).started
    return Series(conditions, runs, values, us, checked(values, us), slope, allowed, since)


def _amount(tolerance: str, unit: str, mean: float) -> float:
    """A tolerance in the unit of a quantity. Raises UsageError: it cannot be one."""
    if tolerance.rstrip().endswith("%") and unit != "%":
        return parse_tolerance(tolerance) * abs(mean)
    found = parse(tolerance, "" if unit == "1" else unit)
    if not found > 0:
        raise UsageError(f"tolerance {quoted(tolerance)} is not above 0; give for example '1 %'")
    return found
