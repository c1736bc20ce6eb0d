"""What a position sweep measures and finds: shares of the force, and the place and size that the films tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from palpate.instrument.uncertainty.budget import Budget
from palpate.procedures.measurements.position.expected import name_of

DOUBT = (
    "Table A2.7 prints neither the object nor the shape of its load, and its force hardly depends on the place of a"
    " load beside a tooth, which an elastic object's does: it is shown beside, not to be met"
)


@dataclass(frozen=True, slots=True)
class PositionPoint:
    """A load at a place: forces peak to peak, shares of the whole force, and place and size found by the films alone.

    Attributes:
        model_share_left, model_share_right: shares by the table of the solid model.
        thesis_share_left, thesis_share_right: shares in Table A2.7; None: the table does not have this place.
        found_mm, found_u: place that the films alone find, and its standard uncertainty.
        found_low_mm, found_high_mm: ends of its 95 % interval.
        found_force_N, found_force_u: force by the base film, and its standard uncertainty.
        seconds: bench time since the point before, or since the beginning [s]; None: the sweep has no time to keep.
    """

    position_mm: float
    load_measured_N: float
    load_measured_u: float
    force_left_N: float
    force_right_N: float
    share_left: float
    share_left_u: float
    share_right: float
    share_right_u: float
    model_share_left: float
    model_share_right: float
    thesis_share_left: float | None
    thesis_share_right: float | None
    found_mm: float
    found_u: float
    found_low_mm: float
    found_high_mm: float
    found_force_N: float
    found_force_u: float
    valid: bool
    settling_s: float
    attempts: int
    flags: tuple[str, ...]
    seconds: float | None = None


@dataclass(frozen=True, slots=True)
class FoundPlace:
    """The place that all valid load sets at a position tell, in a sweep that repeats them.

    Attributes:
        position_mm: where the load was set.
        found_mm, found_u: place that the films alone find, and its standard uncertainty.
        found_low_mm, found_high_mm: ends of its 95 % interval.
        sets: number of valid load sets.
    """

    position_mm: float
    found_mm: float
    found_u: float
    found_low_mm: float
    found_high_mm: float
    sets: int


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
