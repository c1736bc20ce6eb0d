"""What the marks in tables mean: a line below a table for each that stands in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from procedures.agreement import APART, FORCE, FREQUENCY
from procedures.film_point import CLIPPED, DRIFTED, FAULT, HUM, NOT_FINITE, SHORT, UNSETTLED
from procedures.policy import ATTEMPTS

if TYPE_CHECKING:
    from rich.table import Table

APARTNESS = f"more than {APART:g} standard uncertainties apart"
FLAGS: dict[str, str] = {
    CLIPPED: "a film's voltage passes the range of its converter; take a smaller load",
    NOT_FINITE: "a film gives samples that are no numbers; check its sensor node",
    UNSETTLED: "the films still drift when the time to settle is over; wait, or look for warming",
    FAULT: "a sensor node reported an emergency during the dwell; the events of the run say which",
    DRIFTED: "the load cell reads another load after the dwell than was set; check the mounting of the sample",
    FORCE: f"the films and the load cell measure two forces, {APARTNESS}; check their calibrations, and for a loose "
    "or swapped film",
    FREQUENCY: f"the films swing at another frequency than the generator is set to, {APARTNESS}; check the generator",
    HUM: "the record is too short to tell mains hum from the drive; used, hum may be in the amplitude",
    SHORT: "the record is too short to know its noise well; used, with a wide uncertainty",
}
"""By what a point is marked."""

INVALID = "NO"
OUTSIDE = "*"
MARKS: dict[str, str] = {
    INVALID: f"the point is not used: after {ATTEMPTS} attempts it is still flagged, for what stands behind NO",
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
