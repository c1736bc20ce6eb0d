"""The mean force ratio of an object over its load sets, with what its points share and what each has alone.

The gains scatter anew with each load set, and noise is new in each dwell. The films' calibration and their cables'
pick-up are the same in all: they do not average out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from palpate.instrument.uncertainty.budget import Budget, Component, coverage_factor

SCATTER, NOISE, CALIBRATION, PICKUP = "gain scatter", "noise", "films' calibration", "pick-up in step with the load"


class RatioPoint(Protocol):
    """A load set, as the procedures record it; no degrees of freedom: a record of before they were known."""

    @property
    def force_ratio(self) -> float: ...
    @property
    def force_ratio_u(self) -> float: ...
    @property
    def noise_u(self) -> float: ...
    @property
    def calibration_u(self) -> float: ...
    @property
    def pickup_u(self) -> float: ...
    @property
    def degrees_of_freedom(self) -> float | None: ...


def mean_ratio(quantity: str, points: Sequence[RatioPoint], film_freedom: float | None) -> Budget:
    """Of the points, which must be one at least; `film_freedom`: of the films' calibration, None where it is known."""
    n = len(points)
    shared = [(p.noise_u, p.calibration_u, p.pickup_u) for p in points]
    scatter = math.fsum(
        max(p.force_ratio_u**2 - math.hypot(*parts) ** 2, 0.0) for p, parts in zip(points, shared, strict=True)
    )
    noise = math.fsum(p.noise_u**2 for p in points)
    # Welch and Satterthwaite, of noise that was estimated in each point alone.
    spent = math.fsum(p.noise_u**4 / (p.degrees_of_freedom or math.inf) for p in points)
    freedom = noise**2 / spent if spent > 0 else math.inf
    components = [
        Component(SCATTER, math.sqrt(scatter) / n),
        Component(NOISE, math.sqrt(noise) / n, degrees_of_freedom=freedom, kind="A"),
        Component(
            CALIBRATION,
            math.fsum(p.calibration_u for p in points) / n,
            degrees_of_freedom=film_freedom or math.inf,
        ),
        Component(PICKUP, math.fsum(p.pickup_u for p in points) / n),
    ]
    ratio = math.fsum(p.force_ratio for p in points) / n
    return Budget(quantity, ratio, "", tuple(c for c in components if c.u > 0 or c.name != PICKUP))


def apart(one: Budget, other: Budget) -> bool:
    """Whether two means differ by more than their uncertainties explain, by 95 %.

    Calibration and pick-up are nearly the same in both; they are counted as if they were not, which errs to the safe
    side.
    """
    least = min(one.degrees_of_freedom, other.degrees_of_freedom)
    return abs(one.value - other.value) >= coverage_factor(least) * math.hypot(one.u, other.u)
