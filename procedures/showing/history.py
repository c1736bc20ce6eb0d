"""Prints and draws the history of a quantity."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.instrument.quantity import show_with_u
from palpate.instrument.uncertainty.control_chart import DECISION, SHEWHART
from palpate.procedures.engine.history import QuantityHistory, Series
from palpate.procedures.showing.figure import MARKERS, name_all, new_figure, write
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.text import new_table, print_all, stamped

if TYPE_CHECKING:
    from rich.table import Table


def print_history(found: QuantityHistory, picture: str | None) -> None:
    """Print a table for each series, with its drift and when a calibration is needed again."""
    for series in found.series:
        print_all(_table(found.quantity, series), *_lines(series))
    print_all(*(f"left out       {run}: {why}" for run, why in found.left_out.items()))
    print_all(*([] if picture is None else [f"plot           {picture}"]))


def _named(series: Series) -> str:
    """What is measured on which bench."""
    of = series.conditions
    return f"{of['procedure']} on {of['bench']}" + (f", object {of['object']}" if of["object"] else "")


def _table(quantity: str, series: Series) -> Table:
    of = series.conditions
    title = stamped(of["simulated"], f"{quantity}: {_named(series)}")
    table = new_table(title, "run", "value", "u", "w", "CUSUM\nhigh", "CUSUM\nlow", "alarm")
    for run, value, u, check in zip(series.runs, series.values, series.us, series.checks, strict=True):
        charts = f"{check.residual:+z.2f}", f"{check.high:z.2f}", f"{check.low:z.2f}", " ".join(check.alarms) or "-"
        table.add_row(run.folder.name, *show_with_u(value, u, of["unit"]), *charts)
    return table


def _lines(series: Series) -> list[str]:
    low, high = series.drift.interval()
    share = f"{100 * series.drift.value / abs(series.mean):+.2g} % a month, " if series.mean else ""
    unit = f" {series.conditions['unit']}".rstrip()
    if series.too_short:
        span = duration(series.span.total_seconds())
        return [f"drift          not known: too short a span, {span}", "recalibrate    not known, for the same reason"]
    used = f"{series.tolerance:.2g}{unit} used up"
    due = "no drift is shown" if low <= 0 <= high else f"{series.due or 'not within a century'}, with {used}"
    return [
        f"drift          {share}{series.drift.value:+.3g}{unit} a month (95 %: {low:+.3g} to {high:+.3g})",
        f"recalibrate    {due}; by the interval not before {series.earliest or 'a century'}",
    ]


def plot_history(found: QuantityHistory, file: Path) -> None:
    """Draw the values with their uncertainties, and the charts with their limits, into a file."""
    from matplotlib.dates import ConciseDateFormatter  # tells the day, too

    simulated = any(series.conditions["simulated"] for series in found.series)
    figure, (left, right) = new_figure(simulated, 2, f"history of {found.quantity}")
    for number, series in enumerate(found.series):
        look: dict[str, Any] = {"color": f"C{number % 10}", "ms": 4, "lw": 1}
        marker = MARKERS[number % len(MARKERS)]
        dates: Any = [run.started for run in series.runs]
        left.errorbar(dates, series.values, series.us, fmt=marker, capsize=2, label=_named(series), **look)
        hidden = "_" if number else ""  # from the legend, which names each kind of line once
        right.plot(dates, [each.residual for each in series.checks], marker, label=f"{hidden}w", **look)
        right.plot(dates, [each.high for each in series.checks], "-", label=f"{hidden}CUSUM, high", **look)
        right.plot(dates, [-each.low for each in series.checks], "--", label=f"{hidden}CUSUM, low", **look)
        alarms = [(date, each.residual) for date, each in zip(dates, series.checks, strict=True) if each.alarms]
        right.plot([date for date, _ in alarms], [value for _, value in alarms], "rx", ms=10, label=f"{hidden}alarm")
    for limit, line, name in ((SHEWHART, ":", "limits of w"), (DECISION, "-.", "limits of CUSUM")):
        right.axhline(limit, color="k", lw=1, ls=line, label=name)
        right.axhline(-limit, color="k", lw=1, ls=line)
    units = dict.fromkeys(series.conditions["unit"] or "1" for series in found.series)
    left.set(ylabel=f"{found.quantity} ({', '.join(units)}; bars: u)")
    right.set(ylabel="w and CUSUM (standard deviations of w)")
    for axes in (left, right):
        axes.set_xlabel("begin of the run (UTC)")
        axes.tick_params(axis="x", rotation=30)
        dated = ConciseDateFormatter(axes.xaxis.get_major_locator())  # type: ignore[no-untyped-call]
        axes.xaxis.set_major_formatter(dated)
    name_all(left, 1)
    name_all(right)
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + 0.17 * len(found.series))  # inches that a line of the legend takes
    write(figure, file)
