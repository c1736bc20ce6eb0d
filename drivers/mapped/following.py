"""How well readings follow a force that changes: what a filter and too few readings take off a peak-to-peak value."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from palpate.instrument.bench.role_maps.load_indicator import LowPass

LARGEST_LOSS = 0.05  # of a peak-to-peak value, beyond which a frequency is refused
POLLS = 64  # readings from which a peak-to-peak value is made up
GOLDEN = (math.sqrt(5) - 1) / 2  # fraction whose multiples are spread most evenly over a cycle


@dataclass(frozen=True, slots=True)
class Following:
    """What readings can follow.

    Attributes:
        filter: the low-pass through which they go.
        rate: readings in a second [1/s].
        polled: whether extremes are found among readings that are asked for, not among all that are made.
    """

    filter: LowPass
    rate: float
    polled: bool = False

    def loss(self, frequency: float) -> float:
        """The part of a peak-to-peak value that is lost at a frequency [Hz], at most.

        The readings next to the extremes are half a reading's interval away from them, at most.
        """
        seldom = 1 - math.cos(min(math.pi * frequency / self.rate, math.pi / 2))
        return 1 - self.filter.passes(frequency) * (1 - seldom)

    def relative_u(self, frequency: float) -> float:
        """Relative standard uncertainty of a peak-to-peak value that is not corrected for what is lost.

        The loss lies between nothing and its greatest value. Of polled readings, at phases spread over the cycle, those
        nearest to the extremes take off pi²/N² on the average, and scatter by as much.
        """
        lost = self.loss(frequency) / math.sqrt(3)
        return math.hypot(lost, math.pi**2 / POLLS**2) if self.polled else lost

    def highest(self) -> float:
        """The highest frequency that is not refused [Hz], rounded down to three digits."""
        low, high = 0.0, self.filter.corner + self.rate
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if self.loss(middle) <= LARGEST_LOSS else (low, middle)
        digits = 2 - math.floor(math.log10(low))
        return round(math.floor(low * 10.0**digits) / 10.0**digits, digits)


def pauses(window: float, readings: int = POLLS) -> Iterator[float]:
    """Pauses between so many polled readings over a window [s], in step with no frequency."""
    mean = window / (readings - 1)
    return (mean * (0.5 + number * GOLDEN % 1.0) for number in range(1, readings))
