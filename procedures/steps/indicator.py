"""Reading the load indicator: when a display counts, and the mean of several."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from palpate.drivers.bench import Bench
from palpate.drivers.roles import LoadIndicator, Reading, is_difference, made_u, why_invalid

READINGS = 4  # are averaged: the display's own noise dithers its steps
READING_INTERVAL = 0.1  # s; the display is renewed ten times a second
PATIENCE = 50  # readings to wait for a stable one: on a busy machine the bench is later than its filters say
TRACK_FILTER = 0.1  # s
TRACK_SETTLING = 0.8  # s, until a filtered reading counts as stable


@dataclass(frozen=True, slots=True)
class IndicatorMean:
    """A mean reading [mV]. It is valid if every one of its readings was.

    Attributes:
        wrong: why it is not valid; empty: it is.
        difference: whether it is the difference of two loads, so that it holds no zero.
        u_mV: standard uncertainty from how its readings were made, the same in all of them, beside that of the display.
    """

    reading_mV: float
    wrong: str = ""
    difference: bool = False
    u_mV: float = 0.0

    @property
    def valid(self) -> bool:
        return not self.wrong


def steady(bench: Bench, watch: Callable[[float], None] = lambda _: None) -> Reading:
    """Wait until the indicator's reading is stable and return it. A sick device's reading is returned at once.

    After `PATIENCE` readings the last one is returned, stable or not.

    Args:
        bench: the open bench.
        watch: is called with each reading [mV] that is not stable, and raises where the force is too great.
    """
    indicator = bench.role(LoadIndicator)
    reading = indicator.read()
    for _ in range(PATIENCE):
        if reading.stable or reading.sick:
            break
        watch(reading.reading_mV)
        bench.clock.wait(READING_INTERVAL)
        reading = indicator.read()
    return reading


def read_indicator(
    bench: Bench, count: int = READINGS, watch: Callable[[float], None] = lambda _: None
) -> IndicatorMean:
    """Mean of `count` successive displays. Each is waited for as in `steady`."""
    readings = []
    for number in range(count):
        if number:
            bench.clock.wait(READING_INTERVAL)
        readings.append(steady(bench, watch))
    mean = math.fsum(r.reading_mV for r in readings) / count
    u_mV = math.fsum(made_u(r) for r in readings) / count
    wrong = next(filter(None, map(why_invalid, readings)), "")
    return IndicatorMean(mean, wrong, is_difference(readings[0]), u_mV)
