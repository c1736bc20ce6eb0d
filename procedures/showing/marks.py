"""What the marks in tables mean: a line below a table for each that stands in it.

The flags of points are those of `steps/film_point.py`, which is not imported: commands that only read would start late.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from palpate.instrument.errors import EstimateError

if TYPE_CHECKING:
    from rich.table import Table

APART = "further apart than 6 points of 100,000 are by chance"
FLAGS: dict[str, str] = {
    "clipped": "a film's voltage passes the range of its converter; take a smaller load",
    "not finite": "a film gives samples that are no numbers; check its sensor node",
    "unsettled": "the films still drift when the time to settle is over; wait, or look for warming",
    "fault": "a sensor node reported an emergency during the dwell; the events of the run say which",
    "drifted": "the load cell reads another load after the dwell than was set; check the mounting of the sample",
    "force": f"the films and the load cell measure two forces, {APART}; check their calibrations, and for a loose "
    "or swapped film",
    "frequency": f"the films swing at another frequency than the generator is set to, {APART}; check the generator",
    "hum": "the record is too short to tell mains hum from the drive; used, hum may be in the amplitude",
    "short": "the record is too short to know its noise well; used, with a wide uncertainty",
}
"""By what a point is marked."""

INVALID = "NO"
OUTSIDE = "*"
MARKS: dict[str, str] = {
    INVALID: "the point is not used: after 3 attempts it is still flagged, for what stands behind NO",
    **FLAGS,
    OUTSIDE: "outside the load cell's calibrated range",
    "-": "no value: not measured, no valid point, or nothing to compare with",
}
NO_VALUE: dict[str, str] = {"-": "not known: there is none, or the model does not tell it"}


def verdict(valid: bool, flags: tuple[str, ...] | list[str]) -> str:
    """Of a point, for its table."""
    return " ".join(("yes" if valid else INVALID, *flags))


def legend(*tables: Table, marks: Mapping[str, str] = MARKS) -> list[str]:
    """A line for each mark that stands in one of the tables."""
    cells = {f" {cell} " for table in tables for column in table.columns for cell in column.cells}
    return [
        f"{mark:<14} {meaning}"
        for mark, meaning in marks.items()
        if any(f" {mark} " in cell or (mark == OUTSIDE and cell.endswith("* ")) for cell in cells)
    ]


class Judged(Protocol):
    """A point that may be used, or not: `flags` say why."""

    @property
    def valid(self) -> bool: ...
    @property
    def flags(self) -> Sequence[str]: ...


def check_some_valid(points: Sequence[Judged]) -> None:
    """Refuse to call a run done that has not one valid point. Raises EstimateError, which says why they are not."""
    if any(point.valid for point in points):
        return
    reasons = Counter(flag for point in points for flag in point.flags)
    said = "; ".join(
        f"{flag} ({count}): {FLAGS.get(flag, 'its events say why')}" for flag, count in reasons.most_common()
    )
    raise EstimateError(f"none of the {len(points)} points is valid, so there is no result. {said}")
