"""Choice of the dwell that gives a force ratio to a tolerance, the half-width of its 95 % interval.

    floor = (Floor("gain scatter", design.ratio_scatter, 7),)
    dwell_of(0.12, noise=2e-3, frequency=10.0, floor=floor).dwell

The part of the uncertainty that noise causes falls with the dwell T: u² = S (1/A₁² + 1/A₂² − 2 r/(A₁A₂))/T. S is
measured at the point itself. The rest, called the floor, does not fall with the dwell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import check_tolerance, plus_minus, show
from palpate.instrument.uncertainty.budget import Budget, Component

STEP = 0.1
"""Step of a dwell [s]. Over whole steps 50 and 60 Hz are orthogonal to a drive of 10 Hz."""
LONGEST = 3600.0  # s


@dataclass(frozen=True, slots=True)
class Floor:
    """A part of the ratio's relative standard uncertainty that no dwell lowers, such as the gains' scatter."""

    name: str
    u: float
    degrees_of_freedom: float = math.inf


@dataclass(frozen=True, slots=True)
class RequiredDwell:
    """The dwell that a tolerance needs.

    Attributes:
        dwell: dwell in whole steps of 0.1 s, at least one cycle [s].
        u: relative standard uncertainty of the ratio that the dwell should give, from floor and noise.
    """

    dwell: float
    u: float


def floor_u(floor: Sequence[Floor]) -> float:
    """Relative standard uncertainty below which no dwell comes."""
    return math.hypot(*(part.u for part in floor))


def half_width(floor: Sequence[Floor], noise: float = 0.0) -> float:
    """Half-width of the 95 % interval of a ratio, relative, by a floor and the noise that is left."""
    parts = (Component(part.name, part.u, degrees_of_freedom=part.degrees_of_freedom) for part in floor)
    return Budget("ratio", 0.0, "", (*parts, Component("noise in the dwell", noise))).expanded()


def dwell_of(
    tolerance: float, noise: float, frequency: float, floor: Sequence[Floor] = (), longest: float = LONGEST
) -> RequiredDwell:
    """The shortest dwell that gives a ratio to a tolerance.

    Args:
        tolerance: half-width of the ratio's 95 % interval, relative.
        noise: relative standard uncertainty by noise after one second [√s]. It is known to
            1/√(2 degrees of freedom) of itself, the dwell to twice that.
        frequency: of the drive [Hz].
        floor: parts of the uncertainty that do not fall with the dwell.
        longest: greatest dwell that is accepted [s].

    Raises:
        RangeError: the tolerance is not positive, is not above the floor, or takes longer than `longest`.
    """
    check_target(tolerance, floor)
    if (best := half_width(floor, noise / math.sqrt(longest))) > tolerance:
        raise RangeError(
            f"tolerance {plus_minus(tolerance, 3)} needs a dwell above the limit of {longest:g} s with the noise of"
            f" this point; no dwell gets below {plus_minus(half_width(floor), 3)}; ask for {100 * best:.3g} % or more,"
            " or raise the load"
        )
    short, enough = round(whole_steps(1 / frequency) / STEP), math.ceil(longest / STEP)
    while short < enough:  # numbers of steps
        middle = (short + enough) // 2
        good = half_width(floor, noise / math.sqrt(middle * STEP)) <= tolerance
        short, enough = (short, middle) if good else (middle + 1, enough)
    dwell = round(enough * STEP, 1)
    return RequiredDwell(dwell, math.hypot(floor_u(floor), noise / math.sqrt(dwell)))


def check_target(tolerance: float, floor: Sequence[Floor]) -> None:
    """Refuse a tolerance that no dwell reaches, before anything is measured. Raises RangeError."""
    check_tolerance(tolerance, f"tolerance {tolerance}")
    if not tolerance > (lowest := half_width(floor)):
        parts = ", ".join(f"{part.name} u = {part.u:.3g}" for part in floor)
        raise RangeError(
            f"tolerance {plus_minus(tolerance, 3)} is not above the {plus_minus(lowest, 3)} that no dwell beats"
            f" ({parts}); give a greater one, or average several load sets"
        )


def check_dwell(dwell: float, frequency: float, rate: float) -> None:
    """Refuse a dwell below one cycle and a frequency [Hz] of half the sample rate [Hz] or more. Raises RangeError."""
    if not 0 < frequency < rate / 2:
        raise RangeError(
            f"frequency {show(frequency, 'Hz')} is not above 0 and below half the sample rate, {show(rate / 2, 'Hz')};"
            " sample faster or drive slower"
        )
    if not dwell * frequency >= 1 - 1e-9:
        raise RangeError(
            f"dwell {show(dwell, 's')} is below one cycle of {show(frequency, 'Hz')}; dwell {show(1 / frequency, 's')}"
            " or longer"
        )


def whole_steps(dwell: float) -> float:
    """Round a dwell [s] up to whole steps of 0.1 s. A dwell that is whole except for round-off stays as it is."""
    return round(math.ceil(dwell / STEP * (1 - 1e-9)) * STEP, 1)
