"""Legends of tables: a line for each mark that occurs in a table.

The flags of points are those of `steps/film_point.py`, which is not imported, so that commands that only read runs
start fast.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from palpate.instrument.errors import EstimateError

if TYPE_CHECKING:
    from rich.table import Table

APART = "further apart than noise explains (by noise alone only 6 points of 100,000 differ so much)"
FLAGS: dict[str, str] = {
    "clipped": "a film's voltage exceeds the range of its converter; take a smaller load",
    "not finite": "a film's samples are not finite numbers; check its sensor node",
    "unsettled": "the films still drift when the time to settle is over; wait longer, or check for warming",
    "fault": "a sensor node reported an emergency during the dwell; the events of the run say which",
    "drifted": "after the dwell the load cell reads another load than was set; check the mounting of the sample",
    "force": f"films and load cell measure different forces, {APART}; check their calibrations, and look for a "
    "loose or swapped film",
    "frequency": f"films and generator have different frequencies, {APART}; check the generator",
    "hum": "the dwell is too short to separate mains hum from the drive; the point is used, but hum may change it",
    "short": "the dwell is too short to know the noise well; the point is used, with a large uncertainty",
}
"""Meaning and remedy of each flag of a point."""

INVALID = "NO"
OUTSIDE = "*"
MARKS: dict[str, str] = {
    INVALID: "the point is not used: after 3 attempts it still has the flags that follow NO",
    **FLAGS,
    OUTSIDE: "outside the load cell's calibrated range",
    "-": "no value: not measured, no valid point, or nothing to compare with",
}
NO_VALUE: dict[str, str] = {"-": "no value: there is none, or the model does not give it"}


def verdict(valid: bool, flags: tuple[str, ...] | list[str]) -> str:
    """Whether a point is used, and its flags, for its row in a table."""
    return " ".join(("yes" if valid else INVALID, *flags))


def legend(*tables: Table, marks: Mapping[str, str] = MARKS) -> list[str]:
    """A line for each mark that occurs in one of the tables."""
    cells = {f" {cell} " for table in tables for column in table.columns for cell in column.cells}
    return [
        f"{mark:<14} {meaning}"
        for mark, meaning in marks.items()
        if any(f" {mark} " in cell or (mark == OUTSIDE and cell.endswith("* ")) for cell in cells)
    ]


class Judged(Protocol):
    """A point that is valid or not; `flags` say why."""

    @property
    def valid(self) -> bool: ...
    @property
    def flags(self) -> Sequence[str]: ...


def check_some_valid(points: Sequence[Judged]) -> None:
    """Check that a run has a valid point. Raises EstimateError: it has none; the message counts their flags."""
    if any(point.valid for point in points):
        return
    reasons = Counter(flag for point in points for flag in point.flags)
    said = "; ".join(
        f"{flag} ({count}): {FLAGS.get(flag, 'the events of the run say why')}" for flag, count in reasons.most_common()
    )
    raise EstimateError(f"none of the {len(points)} points is valid, so there is no result. {said}")
