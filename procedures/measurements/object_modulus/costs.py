"""Bench times of the measurement of a modulus: a mounting, a set, the beginning and the end."""

from __future__ import annotations

import math

from palpate.instrument.allocation.lines import Costs
from palpate.procedures.lab.mounts import BY_HAND, Mounts
from palpate.procedures.steps.checks import preload_for
from palpate.procedures.steps.films import settling_length
from palpate.procedures.steps.indicator import READING_INTERVAL, READINGS
from palpate.procedures.steps.servo import RELEASED, window

ZERO = 1.2  # s, the load cell's zero at the start [M]
END, END_PER_NEWTON = 4.7, 0.6  # s, and s/N of the load: the probe home and the zero again at the end [M]
FIRST_TOUCH, PER_NEWTON = 3.7, 2.2  # s, and s/N of the preload: the quick approach [M]
WITHDRAWAL = 2.1  # s, before each mounting but the first [M]
SERVO_STEPS = 4  # to the load, after each mounting [M]


def costs_of(load: float, frequency: float, mounts: Mounts = BY_HAND) -> Costs:
    """Bench times of the measurement under a load [N, peak to peak] of a frequency [Hz].

    Each mounting is one of an object that lies there already; the first one, where none does, may be quicker.
    """
    reading = (READINGS - 1) * READING_INTERVAL
    servo = SERVO_STEPS * (window(frequency) + READING_INTERVAL + reading) + reading
    approach = FIRST_TOUCH + PER_NEWTON * preload_for((load,))
    again = RELEASED / frequency + 2 * settling_length(frequency, shortest(frequency))
    mounting = mounts.again + approach + servo + WITHDRAWAL
    start = ZERO + end_seconds(load) - WITHDRAWAL - (mounts.again - mounts.seconds)
    return Costs(max(start, 0.0), mounting, again, mounts.person)


def end_seconds(load: float) -> float:
    """Bench time of the end of the measurement under a load [N, peak to peak] [s]."""
    return END + END_PER_NEWTON * load


def shortest(frequency: float) -> float:
    """Least dwell of a set [s]: whole periods of a frequency [Hz], and not below 0.1 s."""
    return max(1.0, math.ceil(0.1 * frequency - 1e-9)) / frequency
