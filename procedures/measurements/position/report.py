"""What a position sweep found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.instrument.models.influence import ERROR, shares_along
from palpate.instrument.quantity import counted
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.position.expected import name_of
from palpate.procedures.measurements.position.result import DOUBT, FoundPlace, PositionPoint, PositionResult
from palpate.procedures.records.columns import Column, columns_of
from palpate.procedures.showing.figure import name_all, new_figure, save, with_u
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import legend, stamped, taken

if TYPE_CHECKING:
    from rich.table import Table

ALONG = 241  # places of the model's curve: 0.1 mm apart on the common base


def show_sweep(result: PositionResult, design: Design, outcome: Outcome) -> list[object]:
    """Shares beside model and thesis, then what the films alone say of place and size."""
    title = "A point load along the base (shares of the whole force)"
    points = table_of(stamped(outcome["simulated"], title), result.points, columns_of(PositionPoint))
    said = [
        f"model          solid, stored; error of a share {ERROR:g} at most, of its mesh alone",
        f"thesis         {DOUBT}",
    ]
    if result.rms_mm is not None and result.inside is not None:
        said.append(
            f"position       {result.rms_mm:z.2f} mm rms from the place set; {result.inside:.0%} in their 95 % interval"
        )
    if result.stopped:
        said.append(f"stopped        {result.stopped}; {counted(len(result.points), 'load set')}, {taken(outcome)}")
    tables = [points, *([_places(result, outcome)] if result.places else [])]
    return [*tables, *legend(points), *said]


def _places(result: PositionResult, outcome: Outcome) -> Table:
    """A table of the places that repeated load sets tell, with what was predicted."""
    foreseen = {row["name"]: row["u"] for row in outcome["predicted_results"]}

    def predicted(place: FoundPlace) -> str:
        return f"{foreseen[name_of(1e-3 * place.position_mm)]:z.3f}"

    columns = columns_of(FoundPlace) | {"predicted": Column(head="u\npredicted", cell=predicted, after="found_u")}
    return table_of(stamped(outcome["simulated"], "Places by the mean of all load sets"), result.places, columns)


def plot_sweep(result: PositionResult, design: Design, sample: Sample, simulated: bool, folder: Path) -> Path:
    """Shares along the base beside model and thesis, and how far found places are off; returns the PNG."""
    figure, (left, right) = new_figure(simulated, 2, f"a point load along the base, design {design.name}")
    x = [p.position_mm for p in result.points]
    along = np.linspace(0.0, design.plate.length, ALONG)
    models = shares_along(design, sample, along)
    for side, model, color in zip(("left", "right"), models, ("tab:blue", "tab:orange"), strict=True):
        thesis = with_u(result.points, f"thesis_share_{side}")[0]
        left.errorbar(
            x, *with_u(result.points, f"share_{side}"), fmt="o", ms=4, capsize=2, color=color, label=f"{side} tooth"
        )
        left.plot(1e3 * along, model, "-", lw=1, color=color, label=f"{side}, model")
        left.plot(x, thesis, "x", ms=5, color=color, label=f"{side}, thesis A2.7")
    left.set(xlabel="place of the load (mm)", ylabel="share of the force (bars: standard uncertainty)")
    name_all(left)
    places: Sequence[FoundPlace | PositionPoint] = result.places or result.points
    at, off = [p.position_mm for p in places], [p.found_mm - p.position_mm for p in places]
    spread = [[p.found_mm - p.found_low_mm for p in places], [p.found_high_mm - p.found_mm for p in places]]
    right.errorbar(at, off, spread, fmt="o", ms=4, capsize=2)
    right.axhline(0, color="k", lw=1)
    right.set(xlabel="place of the load (mm)", ylabel="found less set place (mm; bars: 95 %)")
    return save(figure, folder)
