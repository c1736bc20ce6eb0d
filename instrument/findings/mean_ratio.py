"""Mean force ratio of an object over its load sets, with its uncertainty.

The gains scatter anew with each load set, and noise is new in each dwell: both average out. How much the gains scatter
is the design's statement, which comes from few sets itself. The films' calibration and their cables' pick-up are the
same in all points and do not average out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from palpate.instrument.uncertainty.budget import Budget, Component, coverage_factor

SCATTER, NOISE, CALIBRATION, PICKUP = "gain scatter", "noise", "films' calibration", "pick-up in step with the load"
PRIOR_FREEDOM = 7.0  # degrees of freedom of a design's `ratio_scatter`: the thesis' 30 are worth no more


class RatioPoint(Protocol):
    """One point of a run, as the procedures record it. `degrees_of_freedom` of its noise; None: infinitely many."""

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
    """Budget of the mean ratio of one point or more.

    Args:
        quantity: name of the result, for people.
        points: the points.
        film_freedom: degrees of freedom of the films' calibration; None: infinitely many.
    """
    n = len(points)
    shared = [(p.noise_u, p.calibration_u, p.pickup_u) for p in points]
    scatter = math.fsum(
        max(p.force_ratio_u**2 - math.hypot(*parts) ** 2, 0.0) for p, parts in zip(points, shared, strict=True)
    )
    noise = math.fsum(p.noise_u**2 for p in points)
    # Welch and Satterthwaite: each point estimated its noise by itself.
    spent = math.fsum(p.noise_u**4 / (p.degrees_of_freedom or math.inf) for p in points)
    freedom = noise**2 / spent if spent > 0 else math.inf
    components = [
        Component(SCATTER, math.sqrt(scatter) / n, degrees_of_freedom=PRIOR_FREEDOM),
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
    """Whether two means differ by more than their uncertainties explain, at 95 %.

    Calibration and pick-up are nearly the same in both means. They are counted as if they were independent, which makes
    a difference harder to prove.
    """
    least = min(one.degrees_of_freedom, other.degrees_of_freedom)
    return abs(one.value - other.value) >= coverage_factor(least) * math.hypot(one.u, other.u)
