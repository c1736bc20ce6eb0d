"""A sine as a list of set-points that a bus sends over and over."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from palpate.instrument.contracts.pdo import MOST_CYCLIC
from palpate.instrument.errors import RangeError

FEWEST = 20  # set-points of a period
CLOSEST = 2e-5  # greatest error of the frequency, relative
LONGEST_US = 1_000_000  # between two set-points


@dataclass(frozen=True)
class SetPointGrid:
    """Times of the set-points of some whole periods: `count` of them, `step_us` apart, which are `periods`."""

    count: int
    step_us: int
    periods: int

    @property
    def length_ns(self) -> int:
        """Time that the list takes."""
        return 1000 * self.count * self.step_us

    @property
    def frequency(self) -> float:
        """Frequency of the sine [Hz]."""
        return 1e9 * self.periods / self.length_ns

    def sine(self, peak: float) -> list[float]:
        """The set-points of a sine."""
        return [peak * math.sin(2 * math.pi * self.periods * number / self.count) for number in range(self.count)]


def grid(frequency: float, fastest: float, who: str) -> SetPointGrid:
    """The times of set-points whose sine is closest to a frequency.

    Args:
        frequency: frequency of the sine [Hz].
        fastest: shortest time between two set-points [s].
        who: name of the device, for the message.

    Raises RangeError: the frequency is too high or too low, or no list has it.
    """
    highest, lowest = 1 / (FEWEST * fastest), 1e6 / (MOST_CYCLIC * LONGEST_US)
    if not lowest <= frequency <= highest:
        raise RangeError(
            f"{who}: frequency = {frequency:g} Hz is outside {lowest:.3g} to {highest:g} Hz, which {FEWEST} to "
            f"{MOST_CYCLIC} set-points of a period reach, {1e3 * fastest:g} ms or more apart; give one inside"
        )
    best = min(_lists(frequency, fastest), key=lambda each: abs(each.frequency - frequency))
    if abs(best.frequency - frequency) > CLOSEST * frequency:
        raise RangeError(
            f"{who}: frequency = {frequency:.10g} Hz: no list of set-points, which come every whole microsecond, has "
            f"it; the nearest has {best.frequency:.10g} Hz"
        )
    return best


def _lists(frequency: float, fastest: float) -> Iterator[SetPointGrid]:
    """All lists near a frequency, those of few periods first, and of these the finest first."""
    for periods in range(1, MOST_CYCLIC // FEWEST + 1):
        for count in range(MOST_CYCLIC, FEWEST * periods - 1, -1):
            step_us = round(1e6 * periods / (frequency * count))
            if fastest * (1 - 1e-9) <= 1e-6 * step_us <= 1e-6 * LONGEST_US:
                yield SetPointGrid(count, step_us, periods)
