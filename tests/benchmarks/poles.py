"""Curves over the modulus of the object: what they take, and how far they are from solutions for one modulus at a time.

Processor time of one thread, nothing kept from before.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TypeVar

import numpy as np

from palpate.instrument.models.axisymmetric.curves import found_on
from palpate.instrument.models.axisymmetric.model import OPEN, REFINEMENTS, resolution_of
from palpate.instrument.models.finite_elements.ladder import estimates
from palpate.instrument.models.finite_elements.work import single
from palpate.instrument.models.parameters import PHYSICAL, RoundParameters, round_parameters
from palpate.instrument.sensor.designs import get_design
from tests.benchmarks import solid
from tests.benchmarks.row import Row
from tests.instrument import direct_round as direct

T = TypeVar("T")

CASE_A = RoundParameters()
RIGID = replace(CASE_A, support="rigid")
RATIOS = 10.0 ** np.array([-2, -1, 0, 0.6, 1.5, 3, 5, 8])  # moduli of the object over the ring's
WHOLE = np.logspace(-1, 7, 81)
AGREES, AGREES_INCOMPRESSIBLE = 1e-10, 1e-7
ROUND = {
    "case A": CASE_A,
    "frictionless": replace(CASE_A, interface="frictionless"),
    "capped": replace(CASE_A, interface="capped"),
    "rigid support": RIGID,
    "rigid support, frictionless": replace(RIGID, interface="frictionless"),
    "rigid support, capped": replace(RIGID, interface="capped"),
    "closed gap": replace(CASE_A, ring_inner_radius=CASE_A.tooth_radius),
    "ring of Poisson ratio 0.4999": replace(CASE_A, compliant_poisson=0.4999),
    "object and ring of Poisson ratio 0.5": replace(CASE_A, sensed_poisson=0.5, compliant_poisson=0.5),
    "the same, rigid support, frictionless": replace(
        RIGID, sensed_poisson=0.5, compliant_poisson=0.5, interface="frictionless"
    ),
}


def measure() -> Iterator[Row]:
    yield from _times()
    for name, sensor in ROUND.items():
        for refinement in (1, 3):
            yield _agreement(f"round, {name}, refinement {refinement}", sensor, refinement)
    yield from solid.agreement()


def _agreement(name: str, sensor: RoundParameters, refinement: int) -> Row:
    """Greatest differences of the force ratio, and of the films' stresses over the greatest of these."""
    moduli = RATIOS * sensor.compliant_modulus
    curve = found_on(sensor, *resolution_of(refinement))
    ratios, stresses = curve.force_ratios(moduli)[:, 0], curve.values(moduli)[:, :, 0]
    apart = stressed = 0.0
    for ratio, found, modulus in zip(ratios, stresses, moduli, strict=True):
        solution = direct.solve(replace(sensor, sensed_modulus=float(modulus)), refinement)
        apart = max(apart, abs(ratio - solution.force_ratio))
        known = np.array([(film.plane_stress, film.normal_stress) for film in solution.films.values()]).ravel()
        if len(known):
            stressed = max(stressed, float(np.abs(found - known).max() / np.abs(known).max()))
    incompressible = 0.5 in (sensor.sensed_poisson, sensor.compliant_poisson)
    goal = AGREES_INCOMPRESSIBLE if incompressible else AGREES
    told = f"{apart:.1e}, stresses of films {stressed:.1e}"
    return Row(f"{name}: curve and solutions", told, f"<= {goal:g}", apart <= goal)


def _times() -> Iterator[Row]:
    sensor = round_parameters(get_design("single_round"), PHYSICAL.load(1e5))
    found_on(sensor, *resolution_of(1))  # imports
    moduli, spent, curves = WHOLE * sensor.compliant_modulus, 0.0, []
    for refinement in REFINEMENTS:
        curve, seconds = _timed(lambda refinement=refinement: found_on(sensor, *resolution_of(refinement)))
        curves.append(curve)
        spent += seconds
        _, beside = _timed(lambda refinement=refinement: direct.solve(sensor, refinement))
        yield Row(
            f"single_round, refinement {refinement}: curve, beside one direct solution",
            f"{seconds:.2f} s, {beside:.2f} s",
            "<= 2 of these",
            seconds <= 2 * beside,
        )
        if len(curves) > 1:
            worst = float(estimates(curves, moduli, OPEN)[0].max())
            if worst <= 1e-6:
                break
    yield Row(
        f"single_round, whole curve, estimate {worst:.0e}: {len(curves)} meshes, cold",
        f"{spent:.2f} s",
        "<= 0.7 s to 1e-6",
        spent <= 0.7 and worst <= 1e-6,
    )
    many = np.geomspace(moduli[0], moduli[-1], 1000)
    _, seconds = _timed(lambda: (curves[-1].force_ratios(many), estimates(curves, many, OPEN)))
    each = 1e6 * seconds / len(many)
    yield Row("1,000 moduli with their estimates, one of these", f"{each:.1f} us", "<= 30 us", each <= 30)


def _timed(call: Callable[[], T]) -> tuple[T, float]:
    """The least processor time of three calls, as the machine may be busy [s]."""
    times = []
    with single():
        for _ in range(3):
            start = time.process_time()
            found = call()
            times.append(time.process_time() - start)
    return found, min(times)
