"""What a procedure will do, point by point, and how long it takes on hardware.

A run goes through the points of its plan; `--dry-run` prints the same plan and sends nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Generic, TypeVar

from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.procedures.steps.films import settling_length
from palpate.procedures.steps.indicator import READING_INTERVAL, READINGS
from palpate.procedures.steps.servo import window

MOUNTING = 60.0  # s, for a person to change the sample [A]
APPROACH = 30.0  # s, home and down again until the preload stands [M]
FIRST_STEPS, LATER_STEPS = 4, 1  # of the servo, to the first load and to each after it [M]
NOISE = 2e-6  # V/√Hz of a film's channel [A]


@dataclass(frozen=True, slots=True)
class Step:
    """One point to come.

    Attributes:
        dwell_s: s; None: chosen at the point, by its noise.
        seconds: on hardware, with what goes before it.
        force_ratio_u: expected standard uncertainty, relative; None: not of a ratio, or not known before.
        what: is measured, for people.
        group: what is set up before it, for people: once for all steps of one group, which follow each other.
    """

    dwell_s: float | None
    seconds: float
    force_ratio_u: float | None
    what: str = field(default="", kw_only=True)
    group: str = field(default="", kw_only=True)

    def summary(self) -> dict[str, Any]:
        """Under public names."""
        return {name: value for name, value in asdict(self).items() if name not in ("what", "group")}


S = TypeVar("S", bound=Step)


@dataclass(frozen=True, slots=True)
class Plan(Generic[S]):
    """Every point of a run, in order."""

    procedure: str
    steps: Sequence[S]

    @property
    def seconds(self) -> float:
        """On hardware, a person being quick."""
        return math.fsum(step.seconds for step in self.steps)

    def summary(self) -> dict[str, Any]:
        """Under public names."""
        return {
            "procedure": self.procedure,
            "dry_run": True,
            "expected_seconds": self.seconds,
            "points": [step.summary() for step in self.steps],
        }


def point_seconds(frequency: float, dwell: float, first: bool, steps: int | None = None) -> float:
    """From the load before to the end of a point, with a steady load [s]; the first goes with a new sample.

    `steps`: of the servo; None: as many as loads take that follow each other.
    """
    reading = (READINGS - 1) * READING_INTERVAL
    if steps is None:
        steps = FIRST_STEPS if first else LATER_STEPS
    servo = steps * (window(frequency) + READING_INTERVAL + reading)
    settling = 2 * settling_length(frequency, dwell)
    return (MOUNTING + APPROACH if first else 0.0) + servo + settling + dwell + reading


def expected_noise(design: Design, load: float, ratio: float) -> float:
    """Relative standard uncertainty of the ratio after one second [√s], of films as noisy as is usual.

    Args:
        load: N, peak to peak.
        ratio: the force ratio to be expected.
    """
    teeth = len(design.teeth)
    square = 0.0
    for kind, force in zip(FILM_KINDS, (ratio * load, load), strict=True):
        films = [film for film in design.films if film.kind == kind]
        amplitudes = [film.sensitivity * force * len(film.teeth) / teeth / 2 for film in films]
        square += math.fsum((NOISE / a) ** 2 for a in amplitudes) / len(films) ** 2
    return math.sqrt(square)
