"""Our finite-element models beside the best that installs: error and time, and who is faster at equal error.

Case A, and the round sensor on a rigid support in space; the same numbers, two threads for all, everything from the
mesh to the force timed. NGSolve counts where it is importable, CalculiX where its program is found.
"""

from __future__ import annotations

import importlib.util
import math
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from instrument.models import axisymmetric, solid
from instrument.models.parameters import RoundParameters, SolidParameters
from tests.benchmarks import calculix_peer, ngsolve_peer
from tests.benchmarks.models import CASE_A, CASE_A_RATIO
from tests.benchmarks.row import Row

ROUNDS = 3
FLAT_ERRORS, SOLID_ERRORS = (1e-3, 1e-4, 1e-5), (1e-3,)
ROUND = RoundParameters(support="rigid")
# Error and seconds by what was run.
Curve = Mapping[str, tuple[float, float]]


def measure() -> Iterator[Row]:
    ngsolve, calculix = importlib.util.find_spec("ngsolve") is not None, shutil.which(calculix_peer.PROGRAM) is not None
    if ngsolve:
        import ngsolve as ng

        ng.SetNumThreads(ngsolve_peer.THREADS)
    ours = _curve(
        {f"degree {d}, {n} layers": lambda d=d, n=n: axisymmetric.solve_on(CASE_A, d, n).force_ratio
         for d, n in ((3, 0), (3, 1), (3, 2), (4, 3), (5, 4), (6, 5))},
        CASE_A_RATIO,
    )  # fmt: skip
    yield from _rows("case A, axisymmetric", ours)
    if ngsolve:
        runs = {
            f"degree {d}, {n} layers": lambda d=d, n=n: ngsolve_peer.axisymmetric_ratio(CASE_A, d, n)
            for d, n in ((2, 1), (2, 2), (3, 2), (4, 3), (5, 4), (6, 5))
        }
        yield from _beside("case A, NGSolve", ours, _curve(runs, CASE_A_RATIO), FLAT_ERRORS)
    else:
        yield Row("case A, NGSolve", "not installed")
    if calculix:
        runs = {
            f"{n} layers, halved {h} times": lambda n=n, h=h: calculix_peer.axisymmetric_ratio(CASE_A, n, h)
            for n, h in ((2, 0), (2, 1), (3, 2), (4, 3))
        }
        yield from _beside("case A, CalculiX", ours, _curve(runs, CASE_A_RATIO), FLAT_ERRORS)
    else:
        yield Row("case A, CalculiX", "not installed")
    yield from _in_space(ngsolve)


def _in_space(ngsolve: bool) -> Iterator[Row]:
    reference = axisymmetric.solve(ROUND, 4).force_ratio
    sensor = SolidParameters(outline="round", support="rigid")
    ours = _curve({f"refinement {k}": lambda k=k: solid.solve(sensor, k).force_ratio for k in (0, 1, 2)}, reference)
    yield from _rows("round sensor on a rigid support, solid", ours)
    if ngsolve:
        runs = {
            f"degree {d}, {n} levels, {size:g} mm": lambda d=d, n=n, size=size: ngsolve_peer.solid_ratio(
                ROUND, d, n, size
            )
            for d, n, size in ((2, 1, 2.0), (3, 1, 3.0), (3, 1, 2.0), (4, 1, 2.0))
        }
        yield from _beside("the same, NGSolve", ours, _curve(runs, reference), SOLID_ERRORS)
    else:
        yield Row("the same, NGSolve", "not installed")


def _curve(runs: Mapping[str, Callable[[], float]], reference: float) -> Curve:
    found = {}
    for name, run in runs.items():
        taken = []
        for _ in range(ROUNDS):
            start = time.perf_counter()
            ratio = run()
            taken.append(time.perf_counter() - start)
        found[name] = (abs(ratio - reference), min(taken))
    return found


def _rows(figure: str, curve: Curve) -> Iterator[Row]:
    for name, (error, seconds) in curve.items():
        yield Row(f"{figure}, {name}: error and time", f"{error:.1e} in {seconds:.2f} s")


def _beside(figure: str, ours: Curve, theirs: Curve, errors: Sequence[float]) -> Iterator[Row]:
    yield from _rows(figure, theirs)
    for error in errors:
        own, other = seconds_at(ours, error), seconds_at(theirs, error)
        yield Row(
            f"{figure}: time at error {error:g}, ours / theirs",
            f"{own:.2f} / {other:.2f} s = {own / other:.2f}" if other < math.inf else f"{own:.2f} s / not reached",
            "<= 1",
            own <= other,
        )


def seconds_at(curve: Curve, error: float) -> float:
    """On the line through the runs that none is both better and faster than, both axes logarithmic.

    The coarsest run's time where it is good enough already; inf where none is good enough.
    """
    front: list[tuple[float, float]] = []
    for found, seconds in sorted(curve.values(), key=lambda point: (point[1], point[0])):
        if not front or found < front[-1][0]:
            front.append((found, seconds))
    if error < front[-1][0]:
        return math.inf
    errors, times = np.log(np.array(front[::-1])).T
    return float(np.exp(np.interp(math.log(error), errors, times)))
