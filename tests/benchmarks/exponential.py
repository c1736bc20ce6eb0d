"""How right exp(A t) is for chains whose poles nearly coincide: products of doublings beside mpmath's digits."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import NonInteractiveExampleWarning
from scipy.linalg import expm

from palpate.simulators.linear.exponential import Doublings
from palpate.simulators.linear.free_motion import FreeMotion
from palpate.simulators.linear.lti import Floats
from tests.benchmarks.row import Row
from tests.simulators import linear_matrices
from tests.simulators.linear_matrices import questions, worst

EXAMPLES, GOAL = 1000, 1e-13
DOUBLINGS, ROUNDS = 37, 5  # to two minutes


def measure() -> Iterator[Row]:
    warnings.simplefilter("ignore", NonInteractiveExampleWarning)
    found: list[tuple[float, float]] = []

    @settings(max_examples=EXAMPLES, deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck))
    @given(question=questions())
    def compare(question: tuple[Floats, int]) -> None:
        a, elapsed_ns = question
        exact = linear_matrices.exponential(a, elapsed_ns)
        bound = linear_matrices.exponential(np.abs(a), elapsed_ns)
        unit = np.array([elapsed_ns])
        ours = np.array([FreeMotion(a).decay(column, unit)[:, 0] for column in np.eye(len(a))]).T
        with np.errstate(all="ignore"):
            found.append((worst(ours, exact, bound), worst(expm(a * 1e-9 * elapsed_ns), exact, bound)))

    compare()
    ours, theirs = (max(errors) for errors in zip(*found, strict=True))
    what = f"exp(A t) of {len(found)} chains of 2 to 12 states: worst error over the same element of exp(|A| t)"
    yield Row(what, f"{ours:.0e}", f"<= {GOAL:.0e}", ours <= GOAL)
    yield Row("the same by scipy.linalg.expm", f"{theirs:.0e}")
    random = np.random.default_rng(1)
    a = np.tril(random.normal(size=(12, 12)), -1) - np.diag(np.logspace(-2, 6, 12))
    taken = []
    for _ in range(ROUNDS):
        start = time.process_time()
        Doublings(a, "1e-9")[DOUBLINGS]
        taken.append(time.process_time() - start)
    yield Row("all doublings of 12 states from 1 ns to two minutes, once", f"{1e3 * min(taken):.0f} ms")
