"""Our finite-element models beside the best that installs: error and time, and who is faster at equal error.

Case A under a soft, a middling and a hard object, and the round sensor on a rigid support in space; the same numbers,
everything from the mesh to the force timed, two threads for all, in the plane one for NGSolve where that is faster.
Each tries several meshes, and both take turns, as a machine has its moods. In the plane an error is the greatest under
the three objects: under one alone it can pass through zero between two coarse meshes. NGSolve counts where it is
importable, CalculiX where its program is found.
"""

from __future__ import annotations

import importlib.util
import math
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.axisymmetric.curves import found_on
from palpate.instrument.models.parameters import RoundParameters, SolidParameters
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.solid.curve import Resolution
from palpate.instrument.sensor.film_material import FilmMaterial
from tests.benchmarks import calculix_peer, ngsolve_peer
from tests.benchmarks.row import Row

ROUNDS, TURNS, TURNS_IN_SPACE = 3, 27, 9
# Degree and layers; of degree 2 for the peer alone.
MESHES = ((2, 0), (2, 1), (3, 0), (3, 1), (3, 2), (4, 1), (4, 2), (4, 3), (5, 2), (5, 3), (5, 4), (6, 4))
# Ours: layers, ratio, degree, those of ratio 0.2 being refinements 0 to 2. The peer's: degree, levels, size [mm].
SOLID_MESHES = ((2, 0.2, 2), (3, 0.3, 2), (2, 0.2, 3), (2, 0.15, 3), (3, 0.2, 3))
SOLID_PEER_MESHES = ((2, 1, 2.0), (3, 1, 3.0), (3, 1, 2.0), (4, 1, 2.0))
FLAT_ERRORS, SOLID_ERRORS = (1e-3, 1e-4, 1e-5), (1e-3,)
# With films that the peers know, too.
CASE_A = RoundParameters(film=FilmMaterial.isotropic(2.2e9, 0.34))
# Force ratios of degree 9 with 8 layers.
FLAT = {
    replace(CASE_A, sensed_modulus=14.9e3): 0.18357342,
    CASE_A: 0.424527777,
    replace(CASE_A, sensed_modulus=1e6): 0.82465873,
}
ROUND = RoundParameters(support="rigid")
# Error and seconds by what was run.
Curve = Mapping[str, tuple[float, float]]


def _ratio(parameters: RoundParameters, degree: int, layers: int) -> float:
    """Read off the whole curve, found anew."""
    return float(found_on(parameters, degree, layers).force_ratios(np.array([parameters.sensed_modulus]))[0, 0])


def measure() -> Iterator[Row]:
    ngsolve, calculix = importlib.util.find_spec("ngsolve") is not None, shutil.which(calculix_peer.PROGRAM) is not None
    own = {f"degree {d}, {n} layers": lambda p, d=d, n=n: _ratio(p, d, n) for d, n in MESHES if d > 2}
    others = {
        f"degree {d}, {n} layers, {t} threads": lambda p, d=d, n=n, t=t: ngsolve_peer.axisymmetric_ratio(p, d, n, t)
        for d, n in MESHES
        for t in (1, ngsolve_peer.THREADS)
    }
    found = _curve(own | others if ngsolve else own, FLAT, TURNS)
    ours = {name: found[name] for name in own}
    yield from _rows("case A, axisymmetric", ours)
    if ngsolve:
        yield from _beside("case A, NGSolve", ours, {name: found[name] for name in others}, FLAT_ERRORS)
    else:
        yield Row("case A, NGSolve", "not installed")
    if calculix:
        runs = {
            f"{n} layers, halved {h} times": lambda p, n=n, h=h: calculix_peer.axisymmetric_ratio(p, n, h)
            for n, h in ((2, 0), (2, 1), (3, 2), (4, 3))
        }
        yield from _beside("case A, CalculiX", ours, _curve(runs, FLAT), FLAT_ERRORS)
    else:
        yield Row("case A, CalculiX", "not installed")
    yield from _in_space(ngsolve)


def _in_space(ngsolve: bool) -> Iterator[Row]:
    references = {ROUND: _ratio(ROUND, *axisymmetric.resolution_of(4))}
    sensor = SolidParameters(outline="round", support="rigid")
    own = {
        f"degree {d}, {n} layers of ratio {q:g}": lambda _, d=d, n=n, q=q: (
            solid.solve_on(sensor, Resolution(layers=n, ratio=q, sectors=1, degree=d)).force_ratio
        )
        for n, q, d in SOLID_MESHES
    }
    others = {
        f"degree {d}, {n} levels, {size:g} mm": lambda p, d=d, n=n, size=size: ngsolve_peer.solid_ratio(p, d, n, size)
        for d, n, size in SOLID_PEER_MESHES
    }
    found = _curve(own | others if ngsolve else own, references, TURNS_IN_SPACE)
    ours = {name: found[name] for name in own}
    yield from _rows("round sensor on a rigid support, solid", ours)
    if ngsolve:
        yield from _beside("the same, NGSolve", ours, {name: found[name] for name in others}, SOLID_ERRORS)
    else:
        yield Row("the same, NGSolve", "not installed")


def _curve(
    runs: Mapping[str, Callable[[RoundParameters], float]],
    references: Mapping[RoundParameters, float],
    times: int = ROUNDS,
) -> Curve:
    """Greatest error over all sensors, and the shortest time of one solution, of so many or one for each sensor."""
    errors: dict[str, list[float]] = {name: [] for name in runs}
    taken: dict[str, list[float]] = {name: [] for name in runs}
    for parameters, reference in (times * list(references.items()))[: max(times, len(references))]:
        for name, run in runs.items():
            start = time.perf_counter()
            ratio = run(parameters)
            taken[name].append(time.perf_counter() - start)
            errors[name].append(abs(ratio - reference))
    return {name: (max(errors[name]), min(taken[name])) for name in runs}


def _rows(figure: str, curve: Curve) -> Iterator[Row]:
    for name, (error, seconds) in curve.items():
        yield Row(f"{figure}, {name}: error and time", f"{error:.1e} in {seconds:.3f} s")


def _beside(figure: str, ours: Curve, theirs: Curve, errors: Sequence[float]) -> Iterator[Row]:
    yield from _rows(figure, theirs)
    for error in errors:
        own, other = seconds_at(ours, error), seconds_at(theirs, error)
        yield Row(
            f"{figure}: time at error {error:g}, ours / theirs",
            f"{own:.3f} / {other:.3f} s = {own / other:.2f}" if other < math.inf else f"{own:.2f} s / not reached",
            "<= 1",
            own <= other,
        )


def seconds_at(curve: Curve, error: float) -> float:
    """On the line through the runs that none is both better and faster than, both axes logarithmic.

    The coarsest run's time where it is good enough already; inf where none is good enough.
    """
    front: list[tuple[float, float]] = []
    for found, seconds in sorted(curve.values(), key=lambda point: (point[1], point[0])):
        # The same mesh on more threads differs by rounding: that is no gain.
        if not front or found < 0.99 * front[-1][0]:
            front.append((found, seconds))
    if error < front[-1][0]:
        return math.inf
    errors, times = np.log(np.array(front[::-1])).T
    return float(np.exp(np.interp(math.log(error), errors, times)))
