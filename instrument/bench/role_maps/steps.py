"""Speeds and accelerations of drives, in the units that their makers use."""

from __future__ import annotations

import math

SPEEDS = ("step/s", "r/min")
RAMPS = ("step/s2", "r/min/s", "ms", "ms/1000 r/min")  # the last two are times that a change of the speed takes
MINUTE = 60.0  # s
RAMP = 1000.0  # r/min that the last unit of a ramp is about


def speed_of(unit: str, steps_per_turn: float, value: float) -> float:
    """Speed of a value of a field [step/s]."""
    return value if unit == "step/s" else value * steps_per_turn / MINUTE


def speed_value(unit: str, steps_per_turn: float, speed: float) -> float:
    """Value of a field for a speed [step/s]."""
    return speed if unit == "step/s" else speed * MINUTE / steps_per_turn


def ramp_of(unit: str, steps_per_turn: float, speed: float, value: float) -> float:
    """Acceleration of a value of a field [step/s²], in a move at a speed [step/s]; infinite for a time of 0."""
    match unit:
        case "step/s2":
            return value
        case "r/min/s":
            return value * steps_per_turn / MINUTE
        case "ms":
            return 1e3 * speed / value if value else math.inf
        case _:
            return 1e3 * RAMP * steps_per_turn / MINUTE / value if value else math.inf


def ramp_value(unit: str, steps_per_turn: float, speed: float, acceleration: float) -> float:
    """Value of a field for an acceleration [step/s²], in a move at a speed [step/s]."""
    match unit:
        case "step/s2":
            return acceleration
        case "r/min/s":
            return acceleration * MINUTE / steps_per_turn
        case "ms":
            return 1e3 * speed / acceleration
        case _:
            return 1e3 * RAMP * steps_per_turn / MINUTE / acceleration
