"""The plan of a procedure: its points, and the expected time on hardware and uncertainty of each.

A run carries out the points of its plan; `--dry-run` prints the same plan and sends nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Generic

from typing_extensions import TypeVar  # typing has defaults of type variables from Python 3.13 on

from palpate.instrument.sensor.design import FILM_KINDS, USUAL_NOISE, Design
from palpate.procedures.lab.lab import BY_HAND, Mounts
from palpate.procedures.steps.films import settling_length
from palpate.procedures.steps.servo import FIRST_AMPLITUDE, LARGEST_GROWTH, READING_INTERVAL, READINGS, window

APPROACH = 30.0  # s to move home and down again until the preload is reached [M]
FIRST_STEPS, LATER_STEPS = 4, 1  # servo steps to the first load, and to each later load [M]
NEWTONS_PER_VOLT = 0.87  # N/V, load over the exciter's voltage, peak to peak [M]


@dataclass(frozen=True, slots=True)
class Step:
    """One planned point. What is expected of it has a name that no measured point has, so that none is taken for it.

    Attributes:
        dwell_s: dwell; None: it is chosen at the point, by its noise.
        seconds_expected: expected time on hardware, with the set-up before it [s].
        ratio_u_expected: expected relative standard uncertainty of the force ratio, `force_ratio_u` in JSON; None: it
            has none, or it is unknown.
        what: what is measured, for people.
        group: what is set up once for all successive steps of this group, for people.
    """

    dwell_s: float | None
    seconds_expected: float
    ratio_u_expected: float | None
    what: str = field(default="", kw_only=True)
    group: str = field(default="", kw_only=True)

    def summary(self) -> dict[str, Any]:
        """The step for JSON."""
        names = {"seconds_expected": "seconds", "ratio_u_expected": "force_ratio_u"}
        return {names.get(name, name): value for name, value in asdict(self).items() if name not in ("what", "group")}


S = TypeVar("S", bound=Step, default=Step)
B = TypeVar("B", default=Any)


@dataclass(frozen=True, slots=True)
class Predicted:
    """What a run is predicted to take and to give.

    Attributes:
        seconds: time on hardware, with a quick operator [s].
        u: relative standard uncertainty of the result; None: the procedure predicts none.
        details: further values for JSON, by their names.
        lines: the plan for people, in place of a table of its steps.
    """

    seconds: float
    u: float | None
    details: Mapping[str, Any] = field(default_factory=dict)
    lines: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class Plan(Generic[S, B]):
    """The plan of a run.

    It is made once for the closed bench, which refuses what cannot be, and once for the open one; the work, its course
    and the result take from it what it rests on.

    Attributes:
        procedure: name of its procedure.
        steps: its points in order; the most there can be, where the course of the procedure may leave steps out.
        forecast: what the run is predicted to take and to give, where that does not follow from its steps.
        basis: what the plan rests on, such as the load sets that a tolerance takes; None: only the settings.
    """

    procedure: str
    steps: Sequence[S]
    forecast: Predicted | None = None
    basis: B = None  # type: ignore[assignment]  # the default of a procedure without one

    @property
    def predicted(self) -> Predicted:
        """What the run is predicted to take and to give; by its steps, if the procedure does not say."""
        return self.forecast or Predicted(math.fsum(step.seconds_expected for step in self.steps), None)

    @property
    def seconds(self) -> float:
        """Expected time on hardware, with a quick operator [s]."""
        return self.predicted.seconds

    def summary(self) -> dict[str, Any]:
        """The plan for JSON."""
        predicted = self.predicted
        return {
            "procedure": self.procedure,
            "dry_run": True,
            "expected_seconds": predicted.seconds,
            "predicted_seconds": predicted.seconds,
            "predicted_u": predicted.u,
            **predicted.details,
            "points": [step.summary() for step in self.steps],
        }


def point_seconds(
    frequency: float, dwell: float, first: bool, steps: int | None = None, mounts: Mounts = BY_HAND
) -> float:
    """Expected time of a point, from the previous load to the end of its dwell [s].

    Args:
        frequency: frequency of the load [Hz].
        dwell: dwell [s].
        first: whether the point is the first with a new sample.
        steps: number of servo steps; None: the usual number.
        mounts: who mounts the sample, or stands a pin on a tooth, before the first point.
    """
    reading = (READINGS - 1) * READING_INTERVAL
    if steps is None:
        steps = FIRST_STEPS if first else LATER_STEPS
    servo = steps * (window(frequency) + READING_INTERVAL + reading)
    settling = 2 * settling_length(frequency, dwell)
    return (mounts.seconds + APPROACH if first else 0.0) + servo + settling + dwell + reading


def first_steps(load: float) -> int:
    """Servo steps from rest to a load [N, peak to peak]: the amplitude grows to it, threefold at most in each step."""
    growth = load / (2 * NEWTONS_PER_VOLT) / FIRST_AMPLITUDE
    return 1 + max(1, math.ceil(math.log(growth, LARGEST_GROWTH)))


def noise_of(design: Design) -> float:
    """Amplitude density of the noise of a design's films that is expected [V/√Hz].

    It is that of the scene or the bench file, or else the usual one.
    """
    return design.noise or USUAL_NOISE


def expected_noise(design: Design, load: float, ratio: float) -> float:
    """Expected relative noise of the force ratio after one second [√s].

    Args:
        design: the sensor design.
        load: load, peak to peak [N].
        ratio: the expected force ratio.
    """
    teeth, density = len(design.teeth), noise_of(design)
    square = 0.0
    for kind, force in zip(FILM_KINDS, (ratio * load, load), strict=True):
        films = [film for film in design.films if film.kind == kind]
        amplitudes = [film.sensitivity * force * len(film.teeth) / teeth / 2 for film in films]
        square += math.fsum((density / a) ** 2 for a in amplitudes) / len(films) ** 2
    return math.sqrt(square)
