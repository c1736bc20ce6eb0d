"""Matrices as chains have them, and hostile ones, with exp(A t) of them to 50 digits by another library."""

from __future__ import annotations

from random import Random
from typing import Any

import numpy as np

from palpate.instrument.arrays import Floats

APART = [0.0, 1e-16, 3e-16, 1e-15, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-5, 1e-4, 1e-3]  # of their size
DIGITS = 50


def question(draw: Random, most: int = 12) -> tuple[Floats, int]:
    """A matrix, and a time [ns] in which one of its poles is at work: long after it exp(|A| t) bounds nothing."""
    a = chain(draw, most)
    rate = abs(draw.choice(a.diagonal())) or 1.0
    return a, max(1, int(1e9 / rate * 10.0 ** draw.uniform(-2, 1)))


def chain(draw: Random, most: int = 12) -> Floats:
    """Stages in series, of which some have nearly the same pole, some feed back, and one or two may swing."""
    order = draw.randint(2, most)
    rates: list[float] = []
    while len(rates) < order:
        if rates and draw.random() < 0.5:
            rates.append(draw.choice(rates) * (1 + draw.choice(APART)))
        else:
            rates.append(10.0 ** draw.uniform(-3, 6))
    random = np.random.default_rng(draw.randrange(2**32))
    a = np.tril(random.normal(size=(order, order)) * 10.0 ** random.uniform(-3, 3, (order, order)), -1)
    a[random.random(a.shape) < draw.choice([0.0, 0.5])] = 0.0
    a -= np.diag(rates)
    for _ in range(draw.choice([0, 0, 1, 2])):  # an armature: x' = v, v' = -w^2 x - d v
        at, w = draw.randint(0, order - 2), 10.0 ** draw.uniform(0, 3)
        a[at : at + 2, at : at + 2] = [[0.0, 1.0], [-w * w, -w * draw.choice([0.1, 2.0])]]
    return a


def exponential(a: Floats, elapsed_ns: int) -> Any:
    """exp(a t) by mpmath."""
    import mpmath

    with mpmath.workdps(DIGITS + 30):
        return mpmath.expm(mpmath.matrix(a.tolist()) * mpmath.mpf(elapsed_ns) / 10**9, method="taylor")


def worst(found: Floats, exact: Any, bound: Any) -> float:
    """The greatest error of an element of `found` over the same element of `bound`."""
    import mpmath

    order, errors = len(found), [0.0]
    with mpmath.workdps(DIGITS):
        for i in range(order):
            for k in range(order):
                off = abs(mpmath.mpf(found[i, k]) - exact[i, k])
                if off > 1e-300:
                    errors.append(float(off / bound[i, k]) if bound[i, k] else float("inf"))
    return max(errors)
