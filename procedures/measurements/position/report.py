"""What a position sweep measures and finds: shares of the force, place and size, and how they are shown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from palpate.instrument.models.influence import ERROR, shares_along
from palpate.instrument.quantity import counted
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample
from palpate.instrument.uncertainty.budget import Budget
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import Column, columns_of
from palpate.procedures.showing.figure import name_all, new_figure, save, with_u
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import legend, stamped, taken

if TYPE_CHECKING:
    from rich.table import Table


# --- What a position sweep measures and finds: shares of the force, and the place and size that the films tell

DOUBT = (
    "Table A2.7 prints neither the object nor the shape of its load, and its force hardly depends on the place of a"
    " load beside a tooth, which an elastic object's does: it is shown beside, not to be met"
)

MODEL = Column("the share by the table of the solid model", "", "model", "z.3f")
THESIS = Column("the share in Table A2.7; null: it does not have this place", "", "thesis", "z.3f")
FOUND = Column("place that the films alone find", "mm", "found\nmm", "z.2f", u="found_u")
LOW = Column("lower end of its 95 % interval", "mm", "95 %\nmm", "{0.found_low_mm:z.1f} to {0.found_high_mm:z.1f}")
HIGH = Column("upper end of its 95 % interval", "mm")
PLUS_MINUS = Column(head="u", cell="z.3f")


def name_of(x: float) -> str:
    """Name of the result for a place at x [m]."""
    return f"position at {1e3 * x:g} mm"


@dataclass(frozen=True, slots=True)
class PositionPoint:
    """A load at a place: forces peak to peak, shares of the whole force, place and size found by the films alone."""

    position_mm: Annotated[float, Column("place of the load", "mm", "x\nmm", "g")]
    load_measured_N: columns.PrintedLoad
    load_measured_u: float
    force_left_N: Annotated[float, Column("force on the left tooth", "N")]
    force_right_N: Annotated[float, Column("force on the right tooth", "N")]
    share_left: Annotated[float, Column("share of the left tooth", "", "left", "z.3f", u="share_left_u")]
    share_left_u: Annotated[float, PLUS_MINUS]
    share_right: Annotated[float, Column("share of the right tooth", "", "right", "z.3f", u="share_right_u")]
    share_right_u: Annotated[float, PLUS_MINUS]
    model_share_left: Annotated[float, replace(MODEL, after="share_left_u")]
    model_share_right: Annotated[float, MODEL]
    thesis_share_left: Annotated[float | None, replace(THESIS, after="model_share_left")]
    thesis_share_right: Annotated[float | None, THESIS]
    found_mm: Annotated[float, FOUND]
    found_u: Annotated[float, Column(head="u", cell="z.2f")]
    found_low_mm: Annotated[float, LOW]
    found_high_mm: Annotated[float, HIGH]
    found_force_N: Annotated[float, Column("force by the base film", "N", "found\nN", "z.2f", u="found_force_u")]
    found_force_u: Annotated[float, Column(head="u", cell="z.2f")]
    valid: columns.Valid
    settling_s: columns.Settling
    attempts: columns.Attempts
    flags: columns.Flags
    seconds: columns.LapSeconds = None


@dataclass(frozen=True, slots=True)
class FoundPlace:
    """The place that all valid load sets at a position tell, in a sweep that repeats them."""

    position_mm: Annotated[float, Column("where the load was set", "mm", "x\nmm", "g")]
    found_mm: Annotated[float, FOUND]
    found_u: Annotated[float, PLUS_MINUS]
    found_low_mm: Annotated[float, replace(LOW, cell="{0.found_low_mm:z.2f} to {0.found_high_mm:z.2f}")]
    found_high_mm: Annotated[float, HIGH]
    sets: Annotated[int, Column("number of valid load sets", head="load\nsets", after="position_mm")]
    half_mm: Annotated[float, Column("half-width of its 95 % interval where it is linear", "mm", "±\nmm", "z.3f")]


@dataclass(frozen=True, slots=True)
class PositionResult:
    """The result of a position sweep.

    Attributes:
        points: the points.
        rms_mm: root mean square of the distances between found and set places; None: no point is valid.
        inside: share of the places whose interval holds the set place; None: no point is valid.
        places: the place at each position with a valid point, where load sets are repeated.
        stopped: why a sweep that repeats load sets ended, for people; empty: it repeats none.
        budgets: none, because a place is found by its likelihood, which is no sum of contributions.
    """

    points: list[PositionPoint]
    rms_mm: float | None
    inside: float | None
    places: tuple[FoundPlace, ...] = ()
    stopped: str = ""
    budgets: tuple[Budget, ...] = ()

    @property
    def unbudgeted(self) -> dict[str, tuple[float, float]]:
        """Each found place and its standard uncertainty [mm]."""
        found: Sequence[FoundPlace | PositionPoint] = self.places or [point for point in self.points if point.valid]
        return {name_of(1e-3 * p.position_mm): (p.found_mm, p.found_u) for p in found}

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        repeated = {"places": [asdict(place) for place in self.places], "stopped": self.stopped}
        return {
            **(repeated if self.stopped else {}),
            "position_rms_mm": self.rms_mm,
            "inside_interval": self.inside,
            "thesis_doubt": DOUBT,
        }


def evaluate(points: Sequence[PositionPoint], places: Sequence[FoundPlace] = (), stopped: str = "") -> PositionResult:
    """How far the found places are from the set ones: `places`, or those of the valid points where there are none."""
    found: Sequence[FoundPlace | PositionPoint] = places or [point for point in points if point.valid]
    if not found:
        return PositionResult(list(points), None, None, stopped=stopped)
    squares = math.fsum((p.found_mm - p.position_mm) ** 2 for p in found)
    inside = sum(p.found_low_mm <= p.position_mm <= p.found_high_mm for p in found)
    rms = math.sqrt(squares / len(found))
    return PositionResult(list(points), rms, inside / len(found), tuple(places), stopped)


# --- what it shows -------------------------------------------------------------------------------------

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
