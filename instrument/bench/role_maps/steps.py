"""Speeds and accelerations of drives, in the units that their makers use."""

from __future__ import annotations

import math

SPEEDS = ("step/s", "r/min")
RATES = {
    "step/s2": "step/s",
    "r/min/s": "r/min",
}  # units of an acceleration, each with that of the speed which is gained in a second
TIMES = ("ms", "ms/1000 r/min")  # what it takes to gain the speed of a move, or to gain `CHANGE`
RAMPS = (*RATES, *TIMES)
MINUTE = 60.0  # s
CHANGE = 1000.0  # r/min


def speed_of(unit: str, steps_per_turn: float, value: float) -> float:
    """Speed of a value of a field [step/s]."""
    return value if unit == "step/s" else value * steps_per_turn / MINUTE


def speed_value(unit: str, steps_per_turn: float, speed: float) -> float:
    """Value of a field for a speed [step/s]."""
    return speed if unit == "step/s" else speed * MINUTE / steps_per_turn


def ramp_of(unit: str, steps_per_turn: float, speed: float, value: float) -> float:
    """Acceleration of a value of a field [step/s²], in a move at a speed [step/s]; infinite for a time of 0."""
    if unit in RATES:
        return speed_of(RATES[unit], steps_per_turn, value)
    return _gained(unit, steps_per_turn, speed) / value if value else math.inf


def ramp_value(unit: str, steps_per_turn: float, speed: float, acceleration: float) -> float:
    """Value of a field for an acceleration [step/s²], in a move at a speed [step/s]."""
    if unit in RATES:
        return speed_value(RATES[unit], steps_per_turn, acceleration)
    return _gained(unit, steps_per_turn, speed) / acceleration


def _gained(unit: str, steps_per_turn: float, speed: float) -> float:
    """Product of an acceleration [step/s²] and its value in a unit of `TIMES`: the speed that is gained, × 1000."""
    return 1e3 * speed if unit == "ms" else speed_of("r/min", steps_per_turn, 1e3 * CHANGE)
