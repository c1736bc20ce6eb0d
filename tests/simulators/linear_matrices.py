"""Matrices as chains have them, and hostile ones, with exp(A t) of them to 50 digits by another library."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
from hypothesis import strategies as st

from palpate.simulators.linear.lti import Floats

APART = [0.0, 1e-16, 3e-16, 1e-15, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-5, 1e-4, 1e-3]  # of their size
DIGITS = 50


@st.composite
def questions(draw: st.DrawFn, most: int = 12) -> tuple[Floats, int]:
    """A matrix, and a time [ns] in which one of its poles is at work: long after it exp(|A| t) bounds nothing."""
    a = draw(chains(most=most))
    rate = abs(a.diagonal()[draw(st.integers(0, len(a) - 1))]) or 1.0
    return a, max(1, int(1e9 / rate * 10.0 ** draw(st.floats(-2, 1))))


@st.composite
def chains(draw: st.DrawFn, least: int = 2, most: int = 12) -> Floats:
    """Stages in series, of which some have nearly the same pole, some feed back, and one or two may swing."""
    order = draw(st.integers(least, most))
    rates: list[float] = []
    while len(rates) < order:
        if rates and draw(st.booleans()):
            rates.append(draw(st.sampled_from(rates)) * (1 + draw(st.sampled_from(APART))))
        else:
            rates.append(10.0 ** draw(st.floats(-3, 6)))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    a = np.tril(random.normal(size=(order, order)) * 10.0 ** random.uniform(-3, 3, (order, order)), -1)
    a[random.random(a.shape) < draw(st.sampled_from([0.0, 0.5]))] = 0.0
    a -= np.diag(rates)
    for _ in range(draw(st.sampled_from([0, 0, 1, 2]))):  # an armature: x' = v, v' = -w^2 x - d v
        at, w = draw(st.integers(0, order - 2)), 10.0 ** draw(st.floats(0, 3))
        a[at : at + 2, at : at + 2] = [[0.0, 1.0], [-w * w, -w * draw(st.sampled_from([0.1, 2.0]))]]
    return a


def exponential(a: Floats, elapsed_ns: int) -> Any:
    """exp(a t) by mpmath."""
    with mpmath.workdps(DIGITS + 30):
        return mpmath.expm(mpmath.matrix(a.tolist()) * mpmath.mpf(elapsed_ns) / 10**9, method="taylor")


def worst(found: Floats, exact: Any, bound: Any) -> float:
    """The greatest error of an element of `found` over the same element of `bound`."""
    order, errors = len(found), [0.0]
    with mpmath.workdps(DIGITS):
        for i in range(order):
            for k in range(order):
                off = abs(mpmath.mpf(found[i, k]) - exact[i, k])
                if off > 1e-300:
                    errors.append(float(off / bound[i, k]) if bound[i, k] else float("inf"))
    return max(errors)
