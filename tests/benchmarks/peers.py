"""Our finite-element models beside the best that installs: error and time, and who is faster at equal error.

Case A under a soft, a middling and a hard object, and the round sensor on a rigid support in space; the same numbers,
everything from the mesh to the force timed. Ours finds the whole curve over the object's modulus, the others one point
of it. Of one thread the processor time counts, of two the time that passes; ours always takes one. Each tries several
meshes, and all take turns, as a machine has its moods. In the plane an error is the greatest under the three objects:
under one alone it can pass through zero between two coarse meshes. NGSolve counts where it is importable, CalculiX
where its program is found.
"""

from __future__ import annotations

import importlib.util
import math
import resource
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.axisymmetric.curves import found_on
from palpate.instrument.models.finite_elements.work import single
from palpate.instrument.models.parameters import PHYSICAL, RoundParameters, SolidParameters, solid_parameters
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.solid.ladders import OF_MANY_TEETH, Resolution
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.material import FilmMaterial
from tests.benchmarks import calculix_peer, ngsolve_peer
from tests.benchmarks.row import Row
from tests.instrument.direct import direct

TURNS, TURNS_IN_SPACE = 9, 3
THREADS = (1, 2)
SUPERLU_MESHES = (("common_base", 1), ("array", 0))
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
# By what was run: error, processor time of one thread, and time that passed [s].
Found = Mapping[str, tuple[float, float, float]]
# Error and seconds by what was run.
Curve = Mapping[str, tuple[float, float]]


def _ratio(parameters: RoundParameters, degree: int, layers: int) -> float:
    """Read off the whole curve, found anew."""
    return float(found_on(parameters, degree, layers).force_ratios(np.array([parameters.sensed_modulus]))[0, 0])


def _solid_ratio(parameters: SolidParameters, resolution: Resolution) -> float:
    """Read off the whole curve, found anew."""
    unit = replace(parameters, sensed_modulus=1.0, force=1.0)
    (found,) = solid.read(solid.found_on(unit, resolution), unit, np.array([parameters.sensed_modulus]))
    return found.force_ratio


def measure() -> Iterator[Row]:
    ngsolve, calculix = importlib.util.find_spec("ngsolve") is not None, shutil.which(calculix_peer.PROGRAM) is not None
    runs = {f"degree {d}, {n} layers": lambda p, d=d, n=n: _ratio(p, d, n) for d, n in MESHES if d > 2}
    own = list(runs)
    others: dict[str, dict[int, list[str]]] = {"NGSolve": {}, "CalculiX": {}}
    for threads in THREADS if ngsolve else ():
        these = {
            f"NGSolve, degree {d}, {n} layers, threads: {threads}": lambda p, d=d, n=n, t=threads: (
                ngsolve_peer.axisymmetric_ratio(p, d, n, t)
            )
            for d, n in MESHES
        }
        others["NGSolve"][threads] = list(these)
        runs |= these
    if calculix:
        these = {
            f"CalculiX, {n} layers, halved {h} times": lambda p, n=n, h=h: calculix_peer.axisymmetric_ratio(p, n, h)
            for n, h in ((2, 0), (2, 1), (3, 2))
        }
        others["CalculiX"][1] = list(these)
        runs |= these
    found = _found(runs, FLAT, TURNS)
    yield from _rows("case A, axisymmetric", found)
    for peer, by_threads in others.items():
        if not by_threads:
            yield Row(f"case A, {peer}", "not installed")
        for threads, names in by_threads.items():
            yield from _beside(f"case A, {peer}", threads, found, own, names, FLAT_ERRORS)
    yield from _in_space(ngsolve)
    yield from _beside_superlu()


def _in_space(ngsolve: bool) -> Iterator[Row]:
    references = {ROUND: _ratio(ROUND, *axisymmetric.resolution_of(4))}
    sensor = SolidParameters(outline="round", support="rigid")
    runs = {
        f"degree {d}, {n} layers of ratio {q:g}": lambda _, d=d, n=n, q=q: _solid_ratio(
            sensor, Resolution(layers=n, ratio=q, sectors=1, degree=d)
        )
        for n, q, d in SOLID_MESHES
    }
    own, others = list(runs), {}
    for threads in THREADS if ngsolve else ():
        these = {
            f"NGSolve, degree {d}, {n} levels, {size:g} mm, threads: {threads}": (
                lambda p, d=d, n=n, s=size, t=threads: ngsolve_peer.solid_ratio(p, d, n, s, t)
            )
            for d, n, size in SOLID_PEER_MESHES
        }
        others[threads] = list(these)
        runs |= these
    found = _found(runs, references, TURNS_IN_SPACE)
    yield from _rows("round sensor on a rigid support, solid", found)
    if not others:
        yield Row("the same, NGSolve", "not installed")
    for threads, names in others.items():
        yield from _beside("the same, NGSolve", threads, found, own, names, SOLID_ERRORS)


def _beside_superlu() -> Iterator[Row]:
    """The whole curve by fronts, and one modulus by SuperLU's factors of the assembled matrix."""
    for design, refinement in SUPERLU_MESHES:
        sensor = solid_parameters(get_design(design), PHYSICAL.load(1e5))
        resolution = OF_MANY_TEETH.resolutions[refinement]
        began = _processor_seconds()
        solid.found_on(replace(sensor, sensed_modulus=1.0), resolution)
        between = _processor_seconds()
        with single():
            direct(sensor, resolution)
        fronts, superlu = between - began, _processor_seconds() - between
        yield Row(
            f"{design}, mesh {refinement}: processor time of fronts, whole curve / SuperLU, one modulus",
            f"{fronts:.1f} / {superlu:.1f} s = {fronts / superlu:.2f}",
            "<= 1",
            fronts <= superlu,
        )


def _found(
    runs: Mapping[str, Callable[[RoundParameters], float]], references: Mapping[RoundParameters, float], times: int
) -> Found:
    """Greatest error over all sensors, and the shortest times of one solution, of so many."""
    errors: dict[str, list[float]] = {name: [] for name in runs}
    worked: dict[str, list[float]] = {name: [] for name in runs}
    passed: dict[str, list[float]] = {name: [] for name in runs}
    for parameters, reference in (times * list(references.items()))[: max(times, len(references))]:
        for name, run in runs.items():
            start, began = time.perf_counter(), _processor_seconds()
            ratio = run(parameters)
            passed[name].append(time.perf_counter() - start)
            worked[name].append(_processor_seconds() - began)
            errors[name].append(abs(ratio - reference))
    return {name: (max(errors[name]), min(worked[name]), min(passed[name])) for name in runs}


def _processor_seconds() -> float:
    """Processor time of this process and of the programs that it ran [s]."""
    used = [resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _rows(figure: str, found: Found) -> Iterator[Row]:
    for name, (error, worked, passed) in found.items():
        yield Row(f"{figure}, {name}: error, processor time, time", f"{error:.1e} in {worked:.3f} s, {passed:.3f} s")


def _beside(
    figure: str, threads: int, found: Found, ours: Sequence[str], theirs: Sequence[str], errors: Sequence[float]
) -> Iterator[Row]:
    own_curve, other_curve = (
        {name: (found[name][0], found[name][1 if threads == 1 else 2]) for name in names} for names in (ours, theirs)
    )
    clock = "processor time, one thread" if threads == 1 else f"time, {threads} threads"
    for error in errors:
        own, other = seconds_at(own_curve, error), seconds_at(other_curve, error)
        yield Row(
            f"{figure}: {clock}, at error {error:g}, ours / theirs",
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
