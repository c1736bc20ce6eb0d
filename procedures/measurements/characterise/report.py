"""Shows and plots the result of a characterisation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.quantity import counted, plus_minus
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.characterise.definitions import ELSEWHERE
from palpate.procedures.measurements.characterise.result import (
    HOLDING,
    LOADING,
    UNLOADING,
    CharacteriseResult,
    Characteristic,
)
from palpate.procedures.records.columns import columns_of
from palpate.procedures.showing.figure import MARKERS, name_all, new_figure, save, with_u
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import new_table, percent, stamped, taken

if TYPE_CHECKING:
    from rich.table import Table

MOST_NAMED = 6  # films that a legend has room for


def show_characteristics(result: CharacteriseResult, outcome: Outcome) -> list[object]:
    """Each figure of merit with its uncertainty and how it was measured, then the definitions."""
    table = table_of(
        stamped(outcome["simulated"], f"Sensor {outcome['design']}"), result.rows, columns_of(Characteristic)
    )
    for column in (0, 1, 4, 5):
        table.columns[column].justify = "left"
    table.columns[5].no_wrap = False
    said = []
    if result.stopped:
        sets = counted(sum(point.direction == LOADING for point in result.points), "load set")
        predicted, achieved = outcome["predicted_u"], result.achieved_u
        half = max(half for _, half in result.sensitivities)
        said = [
            f"uncertainty    {plus_minus(half)} of a force sensitivity at most;"
            f" u {percent(achieved)} %{'' if predicted is None else f' (predicted {percent(predicted)} %)'}",
            f"stopped        {result.stopped}; {sets} up, {taken(outcome)}",
        ]
    return [table, _definitions(result), *said]


def _definitions(result: CharacteriseResult) -> Table:
    """A table with the equation of each quantity, or the command that measures it."""
    table = new_table(None, "quantity", "definition")
    table.caption = "V, F: voltage and load, peak to peak; a + b F: least-squares line; u(V): standard uncertainty"
    table.caption_justify = "left"
    for column in table.columns:
        column.justify = "left"
    for quantity, equation in {row.quantity: row.definition for row in result.rows}.items():
        table.add_row(quantity, equation)
    for each in ELSEWHERE:
        table.add_row(each.quantity, f"thesis {each.thesis}: {each.command}")
    return table


def plot_characteristics(result: CharacteriseResult, simulated: bool, folder: Path) -> Path:
    """Plot voltages over the load, both ways, and over time under one load. Returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, "films under load, and while it is held")
    for number, film in enumerate(result.films):
        color = f"C{number}"
        for direction, marker in ((LOADING, "^"), (UNLOADING, "v")):
            points = [p for p in result.points if p.direction == direction]
            (load, load_u), (volts, u) = with_u(points, "load_measured_N"), with_u(points, "voltages_V", 1e3, number)
            left.errorbar(
                load, volts, u, load_u, fmt=marker, color=color, ms=4, lw=1, capsize=2, label=f"{film}, {direction}",
            )  # fmt: skip
        held = [p for p in result.points if p.direction == HOLDING]
        first = held[0].voltages_V[number]
        volts, u = with_u(held, "voltages_V", 100 / first, number)
        right.errorbar(
            [p.time_s for p in held], [value - 100 for value in volts], u, fmt=f"{MARKERS[number % len(MARKERS)]}-",
            color=color, ms=4, lw=1, capsize=2, label=film,
        )  # fmt: skip
    left.set(xlabel="load, peak to peak (N)", ylabel="voltage, peak to peak (mV; bars: u)", yscale="log")
    right.set(xlabel="time (s)", ylabel="change of the amplitude (%; bars: u)")
    if len(result.films) <= MOST_NAMED:
        name_all(left, 2)
        name_all(right)
    return save(figure, folder)
