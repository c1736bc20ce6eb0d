"""Flags of points: why a point is not used, or what its record cannot tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from palpate.instrument.errors import EstimateError

CLIPPED, NOT_FINITE, UNSETTLED, FAULT, DRIFTED = "clipped", "not finite", "unsettled", "fault", "drifted"
FORCE, FREQUENCY = "force", "frequency"
HUM, SHORT = "hum", "short"
SURROUNDINGS = "surroundings"
USED = frozenset((HUM, SHORT))
"""Flags with which a point is valid all the same. Its record is too short to tell hum from the drive, or 1/f noise from
white noise; where the effect can be estimated, the point's uncertainty contains it."""

_APART = "further apart than noise explains (by noise alone only 6 points of 100,000 differ so much)"
FLAGS: dict[str, str] = {
    CLIPPED: "a film's voltage exceeds the range of its converter; take a smaller load",
    NOT_FINITE: "a film's samples are not finite numbers; check its sensor node",
    UNSETTLED: "the films still drift when the time to settle is over; wait longer, or check for warming",
    FAULT: "a sensor node reported an emergency during the dwell; the events of the run say which",
    DRIFTED: "after the dwell the load cell reads another load than was set; check the mounting of the sample",
    FORCE: f"films and load cell measure different forces, {_APART}; check their calibrations, and look for a "
    "loose or swapped film",
    FREQUENCY: f"films and exciter have different frequencies, {_APART}; check the exciter",
    SURROUNDINGS: "what was read beside the point is outside its limits, or could not be read; the events say which",
    HUM: "the dwell is too short to separate mains hum from the drive; the point is used, but hum may change it",
    SHORT: "the dwell is too short to know the noise well; the point is used, with a large uncertainty",
}
"""Meaning and remedy of each flag of a point."""


@runtime_checkable
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
    raise EstimateError(f"no point of {len(points)} is valid, so there is no result. {reasons(points)}")


def reasons(points: Sequence[Judged]) -> str:
    """Flags of points, the commonest first: how often each occurs, what it means, and its remedy."""
    counts = Counter(flag for point in points for flag in point.flags)
    return "; ".join(f"{flag} ({count}): {_meaning(flag)}" for flag, count in counts.most_common())


def causes(flags: Sequence[str]) -> str:
    """Flags of one point with what they mean, and their remedies."""
    return "; ".join(f"{flag}: {_meaning(flag)}" for flag in flags)


def _meaning(flag: str) -> str:
    return FLAGS.get(flag, "the events of the run say why")
