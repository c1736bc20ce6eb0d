"""Control charts of a series of results, each with an uncertainty of its own: what is out of control, and drift.

A value x is compared with the mean m of all before it, weighted by 1/u²: w = (x - m) / √(u² + u(m)²). While nothing
drifts, the w are independent and normal with standard deviation 1, whatever each u is, and so no run is needed that
is known to be good (recursive residuals: Brown, Durbin and Evans 1975; charts without a known mean: Hawkins 1987).

    Shewhart  alarm where |w| > 2.8
    CUSUM     high = max(0, high + w - 1), low = max(0, low - w - 1); alarm where one is above 2.52, then anew from 0

The formulas are those of Montgomery, Introduction to Statistical Quality Control, chapters 6 and 9, and of the
NIST/SEMATECH e-Handbook, 6.3.2. A slack of 1 finds a drift of 2 u within a run or two; with it, Hawkins' limit of 2.52
gives a false alarm in 370 values (Montgomery, table 9.4), and Shewhart's of 2.8 one in 196. `python -m tests.benchmarks
history` measures both together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.instrument.uncertainty.budget import Budget, Component

SHEWHART, SLACK, DECISION = 2.8, 1.0, 2.52  # in standard deviations of w


@dataclass(frozen=True, slots=True)
class Check:
    """What the charts say of a value: `residual` w and the sums of the CUSUM; of the first value all are 0."""

    residual: float = 0.0
    high: float = 0.0
    low: float = 0.0

    @property
    def alarms(self) -> tuple[str, ...]:
        """Which of the charts give an alarm."""
        found = {"Shewhart": abs(self.residual) > SHEWHART, "CUSUM": max(self.high, self.low) > DECISION}
        return tuple(name for name, alarm in found.items() if alarm)


def checked(values: Sequence[float], us: Sequence[float]) -> list[Check]:
    """A check for each value of a series, in its order; each `u` is above 0."""
    found = [Check()]
    high = low = 0.0
    weight = us[0] ** -2
    mean = values[0]
    for value, u in zip(values[1:], us[1:], strict=True):
        residual = (value - mean) / math.sqrt(u**2 + 1 / weight)
        check = Check(residual, max(0.0, high + residual - SLACK), max(0.0, low - residual - SLACK))
        high, low = (0.0, 0.0) if "CUSUM" in check.alarms else (check.high, check.low)
        weight += u**-2
        mean += (value - mean) * u**-2 / weight
        found.append(check)
    return found


def drift(times: Sequence[float], values: Sequence[float], us: Sequence[float], unit: str) -> Budget:
    """The slope of a line through a series, weighted by 1/u².

    Where the values scatter about the line by more than their `u`, the scatter is a second part of its uncertainty,
    with as many degrees of freedom as there are values beyond two.

    Args:
        times, values, us: the series; not all times are the same.
        unit: unit of the slope.
    """
    t, y, u = (np.asarray(each, dtype=float) for each in (times, values, us))
    weights = u**-2 / np.sum(u**-2)
    away = t - weights @ t
    spread = float(weights @ away**2)
    slope = float(weights @ (away * (y - weights @ y))) / spread
    own = 1 / math.sqrt(float(np.sum(u**-2)) * spread)
    left = (y - weights @ y - slope * away) / u
    freedom = t.size - 2
    more = max(0.0, float(left @ left) / freedom - 1) if freedom else 0.0  # of the variance, over that by the `u`
    parts = [Component("u of the runs", own)]
    if more:
        parts.append(Component("scatter beyond it", own * math.sqrt(more), 1.0, freedom, "A"))
    return Budget("drift", slope, unit, tuple(parts))
