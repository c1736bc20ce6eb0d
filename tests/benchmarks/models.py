"""Time and accuracy of the sensor models: stored curves, curves found anew, and single solutions beside them."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from unittest import mock

import numpy as np

from palpate.instrument.arithmetic import KERNELS
from palpate.instrument.models import surface
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.axisymmetric.curves import found_on
from palpate.instrument.models.axisymmetric.model import OPEN, REFINEMENTS, resolution_of
from palpate.instrument.models.finite_elements.ladder import estimates
from palpate.instrument.models.finite_elements.work import single
from palpate.instrument.models.parameters import (
    IDENTIFIED_ROUND,
    IDENTIFIED_SOLID,
    PHYSICAL,
    RoundParameters,
    SolidParameters,
    round_parameters,
    solid_parameters,
)
from palpate.instrument.models.response import responses
from palpate.instrument.models.solid import ladders
from palpate.instrument.models.solid import model as solid_model
from palpate.instrument.models.solid.ladders import Resolution, SolidCurve
from palpate.instrument.models.solid.system import System
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.thesis import read_table
from tests.benchmarks.common import Row, at_most, least, palpate, spent
from tests.instrument import direct_round
from tests.instrument.direct import direct

CASE_A = RoundParameters()
CASE_A_RATIO = 0.424527365  # degree 9 with 8 layers: 0.4245273654; degree 8 with 7 layers: 0.4245273658
TOLERANCES = (0.5, 0.2, 0.1, 0.05, 0.01, 1e-3)
RATIOS = np.logspace(-1, 5, 61)  # moduli of the object over the ring's


def models() -> Iterator[Row]:
    """Model "auto" against its tolerances, stored curves, case A of the round model, tables of the thesis."""
    for design in ("single_round", "single", "common_base"):
        yield _automatic(design)
    for design in ("single_round", "single", "common_base", "different_base", "array"):
        yield from _stored(design)
    axisymmetric.solve(CASE_A, 1)  # imports
    for refinement, error_goal, seconds_goal in ((2, 1e-4, 0.5), (3, 5e-6, 2.0)):
        ratios: list[float] = []
        seconds = spent(lambda r=refinement, to=ratios: to.append(axisymmetric.solve(CASE_A, r).force_ratio)).wall
        error = abs(ratios[0] - CASE_A_RATIO)
        yield Row(
            f"axisymmetric, case A, refinement {refinement}: error and time", f"{error:.1e} in {seconds:.2f} s",
            f"<= {error_goal:g} in < {seconds_goal} s", error <= error_goal and seconds < seconds_goal,
        )  # fmt: skip
    yield from _tables()


def _automatic(design: str) -> Row:
    """Model "auto" against the finest mesh: one finer than any that it answers with, or the finest there is."""
    sensor, moduli = get_design(design), np.geomspace(1.49e4, 140e9, 500)
    loads = [PHYSICAL.load(float(modulus)) for modulus in moduli]
    if design == "single_round":
        finer = found_on(round_parameters(sensor, loads[0]), 8, 7, mixed=True)  # refinement 6
        finest = finer.force_ratios(moduli)[:, 0]
    else:
        finest = surface.find(sensor, loads[0]).force_ratios(moduli)
    worst = 0.0
    for tolerance in TOLERANCES:
        found = np.array([each.force_ratio for each in responses(sensor, loads, "auto", tolerance)])
        worst = max(worst, float(np.abs(found / finest - 1).max()) / tolerance)
    return at_most(
        f"{design}, 500 moduli x {len(TOLERANCES)} tolerances: greatest error of auto over its tolerance",
        worst,
        1,
        "{:.2f}",
    )


def _stored(design: str, many: int = 1000) -> Iterator[Row]:
    """What is asked of stored curves: by a function, and by commands in processes of their own."""
    moduli = np.geomspace(1e4, 1e8, many)
    shipped = surface.find(get_design(design), PHYSICAL.load(1e5))
    shipped.solve_at(moduli)
    each = 1e6 * least(lambda: shipped.solve_at(moduli), 3) / many
    yield at_most(f"{design}: ratio, signals and estimate of {many} moduli, each", each, 30, "{:.1f} us")
    listed = ", ".join(f"{modulus:.6g} Pa" for modulus in moduli)
    for words in (("ratio", "--sensed-modulus", listed), ("modulus", "--force-ratio", "0.3")):
        command = ("model", *words, "--design", design, "--model", "surface", "--json")
        seconds = least(lambda command=command: palpate(*command), 3)
        yield at_most(f"{design}: palpate model {words[0]}, curve stored", seconds, 0.5, "{:.2f} s")


def _tables() -> Iterator[Row]:
    """Each third row by the solid model, spread over two processes, and each row by the round one."""
    disc = round_parameters(IDENTIFIED_ROUND.design(get_design("single")), IDENTIFIED_ROUND.load(1e5))
    with ProcessPoolExecutor(2) as pool:
        for number, design, column, limit in (
            ("A2.1", "single", "force_rigid_N", 0.012),
            ("A2.3", "common_base", "force_ratio", 0.015),
            ("A2.1", "", "force_rigid_N", 0.008),
        ):
            table, stride = read_table(number), 3 if design else 1
            solve, sensor = axisymmetric.solve, disc
            if design:
                sensor = solid_parameters(IDENTIFIED_SOLID.design(get_design(design)), IDENTIFIED_SOLID.load(1e5))
                solve = solid_model.solve
            asked = [replace(sensor, sensed_modulus=float(modulus)) for modulus in table.keys()[::stride]]
            ratios = np.array([each.force_ratio for each in pool.map(solve, asked, [1] * len(asked))])
            worst = float(np.abs(ratios - np.abs(table.values(column))[::stride]).max())
            model = "solid, one set for both" if design else "axisymmetric, a set of its own"
            yield at_most(f"Table {number}, {len(asked)} rows, {model}: force ratio off by", worst, limit, "{:.4f}")


# --- curves in space -----------------------------------------------------------------------------------

# Design, the last of its meshes, and goals: what its estimate certifies, processor time of all meshes [s].
CERTIFIED = (
    ("single", 2, 1e-4, 3.0),
    ("common_base", 1, 1e-3, 3.0),
    ("common_base", 2, 1e-4, 15.0),
    ("array_16", 1, 1e-3, 30.0),
)
MOST_MEMORY = 4.0  # GB


def solid(first: int = len(CERTIFIED)) -> Iterator[Row]:
    """The solid model: what whole curves cost cold.

    Curves are of all moduli of the object at once, from a tenth of the ring's modulus to 1e5 times. Times are of
    processor, of all meshes up to the one that is named, none of which was kept. A script that loads numpy first has
    the processor's own kernels of linear algebra, a command those that every processor has
    (`palpate.instrument.arithmetic`). An array's one mesh is compared with a finer one.
    """
    for kernels, of in (({}, "a script"), (KERNELS, "a command")):
        for name, last, error, seconds in CERTIFIED[:first]:
            sensor = solid_parameters(get_design(name), PHYSICAL.load(1e5))
            own = ladders.meshes(sensor).resolutions[: last + 1]
            meshes = [*((sensor, each) for each in own), *solid_model.beside(sensor, len(own))]
            found, held = _alone(meshes, kernels)
            curves, moduli = [each.poles for each in found], RATIOS * sensor.compliant_modulus
            bounds, _ = solid_model.estimates(curves[: len(own)], sensor, moduli, curves[len(own) :])
            what = f"certified, by {of}, {len(found)} meshes to {found[last].unknowns} unknowns"
            yield _cold(
                name, what, found, held, f"estimate {bounds.max():.1e}", bounds.max() <= error, (error, seconds)
            )
    sensor = solid_parameters(get_design("array"), PHYSICAL.load(1e5))
    (found, held), (finer, _) = (_alone([(sensor, ladders.resolution(sensor, each))], {}) for each in (1, 2))
    one, better = (each[0].poles.force_ratios(RATIOS * sensor.compliant_modulus) for each in (found, finer))
    off = float(np.abs(one - better).max())
    yield _cold(
        "array", f"one mesh of {found[0].unknowns} unknowns", found, held, f"error {off:.1e}", off <= 1e-3, (1e-3, 30.0)
    )


def _cold(
    name: str, what: str, found: Sequence[SolidCurve], held: float, told: str, exact: bool, goals: tuple[float, float]
) -> Row:
    seconds = sum(sum(each.seconds) for each in found)
    return Row(
        f"solid: {name}, whole curve, cold, {what}", f"{seconds:.1f} s, {held:.1f} GB, {told}",
        f"<= {goals[1]:g} s, <= {MOST_MEMORY:g} GB, to {goals[0]:g}",
        bool(seconds <= goals[1] and held <= MOST_MEMORY and exact),
    )  # fmt: skip


def _alone(
    meshes: Sequence[tuple[SolidParameters, Resolution]], kernels: Mapping[str, str]
) -> tuple[list[SolidCurve], float]:
    """Curves that are found in a process of their own, with these kernels, and the memory of that [GB]."""
    # A copy of this process would pay for each page of memory that it shares.
    with mock.patch.dict(os.environ, kernels), ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(_found, meshes).result()


def _found(meshes: Sequence[tuple[SolidParameters, Resolution]]) -> tuple[list[SolidCurve], float]:
    systems = (System(sensor, mesh) for sensor, mesh in meshes)
    found = [system.curve([system.load(None)]) for system in systems]
    return found, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


# --- curves and single solutions -----------------------------------------------------------------------

HALF = {"sensed_poisson": 0.5, "compliant_poisson": 0.5}
ROUND = {
    "case A": {},
    "frictionless": {"interface": "frictionless"},
    "capped": {"interface": "capped"},
    "rigid support": {"support": "rigid"},
    "rigid support, frictionless": {"support": "rigid", "interface": "frictionless"},
    "rigid support, capped": {"support": "rigid", "interface": "capped"},
    "closed gap": {"ring_inner_radius": CASE_A.tooth_radius},
    "ring of Poisson ratio 0.4999": {"compliant_poisson": 0.4999},
    "object and ring of Poisson ratio 0.5": HALF,
    "the same, rigid support, frictionless": {"support": "rigid", "interface": "frictionless", **HALF},
}
SOLID = {
    "bonded": {},
    "frictionless": {"interface": "frictionless"},
    "rigid support": {"support": "rigid"},
    "closed gap": {"ring_inner_radius": 1.4e-3},
    "point load": {"load_at": (6e-3, 5e-3)},
    "Poisson ratios 0.5": HALF,
}


def poles() -> Iterator[Row]:
    """Curves over the modulus of the object: what they take, and how far they are from single solutions.

    Processor time of one thread, nothing kept from before.
    """
    with single():
        yield from _times()
    for name, changed in ROUND.items():
        for refinement in (1, 3):
            apart, stressed = _apart_round(replace(CASE_A, **changed), refinement)
            yield _agreement(
                f"round, {name}, refinement {refinement}",
                apart,
                changed,
                f"{apart:.1e}, stresses of films {stressed:.1e}",
            )
    for name, changed in SOLID.items():
        sensor = replace(solid_parameters(get_design("single"), PHYSICAL.load(1e5)), **changed)
        moduli, mesh = np.array((1e-2, 1.0, 1e3, 1e8)) * sensor.compliant_modulus, ladders.resolution(sensor, 0)
        known = [direct(replace(sensor, sensed_modulus=float(each)), mesh).force_ratio for each in moduli]
        found = solid_model.curve(sensor, 0).poles.force_ratios(moduli)[:, 0]
        yield _agreement(f"solid: single, {name}", float(np.abs(found - known).max()), changed)


def _agreement(name: str, apart: float, changed: Mapping[str, object], told: str = "") -> Row:
    return at_most(
        f"{name}: curve and direct solutions apart, E1/E2 = 1e-2 to 1e8",
        apart,
        1e-7 if 0.5 in changed.values() else 1e-10,
        "{:.1e}",
        told,
    )


def _apart_round(sensor: RoundParameters, refinement: int) -> tuple[float, float]:
    """Greatest differences of the force ratio, and of the films' stresses over the greatest of these."""
    moduli = 10.0 ** np.array([-2, -1, 0, 0.6, 1.5, 3, 5, 8]) * sensor.compliant_modulus
    curve = found_on(sensor, *resolution_of(refinement))
    alone = [direct_round.solve(replace(sensor, sensed_modulus=float(modulus)), refinement) for modulus in moduli]
    films = [[(film.plane_stress, film.normal_stress) for film in each.films.values()] for each in alone]
    known = np.array(films).reshape(len(moduli), -1)
    stressed = np.abs(curve.values(moduli)[:, :, 0] - known).max(axis=1, initial=0.0)
    apart = np.abs(curve.force_ratios(moduli)[:, 0] - [each.force_ratio for each in alone])
    return float(apart.max()), float((stressed / np.abs(known).max(axis=1, initial=1e-300)).max())


def _times() -> Iterator[Row]:
    sensor = round_parameters(get_design("single_round"), PHYSICAL.load(1e5))
    found_on(sensor, *resolution_of(1))  # imports
    moduli, seconds, curves, worst = np.logspace(-1, 7, 81) * sensor.compliant_modulus, 0.0, [], np.inf
    for refinement in REFINEMENTS:
        curves.append(found_on(sensor, *resolution_of(refinement)))
        took = least(lambda refinement=refinement: found_on(sensor, *resolution_of(refinement)), 3)
        beside = least(lambda refinement=refinement: direct_round.solve(sensor, refinement), 3)
        yield at_most(
            f"single_round, refinement {refinement}: curve, beside one direct solution",
            took / beside,
            2,
            "{:g} of these",
            f"{took:.2f} s, {beside:.2f} s",
        )
        seconds += took
        if len(curves) > 1 and (worst := float(estimates(curves, moduli, OPEN)[0].max())) <= 1e-6:
            break
    yield Row(
        f"single_round, whole curve, estimate {worst:.0e}: {len(curves)} meshes, cold", f"{seconds:.2f} s",
        "<= 0.7 s to 1e-6", seconds <= 0.7 and worst <= 1e-6,
    )  # fmt: skip
    many = np.geomspace(moduli[0], moduli[-1], 1000)
    each = 1e3 * least(lambda: (curves[-1].force_ratios(many), estimates(curves, many, OPEN)), 3)
    yield at_most("1,000 moduli with their estimates, one of these", each, 30, "{:.1f} us")
