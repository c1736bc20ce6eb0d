"""The solid model: what whole curves cost cold, and whether estimates hold.

Curves are of all moduli of the object at once, from a tenth of the ring's modulus to 1e5 times. Times are of processor,
of all meshes up to the one that is named, none of which was kept. A script that loads numpy first has the processor's
own kernels of linear algebra, a command those that every processor has (`palpate.instrument.arithmetic`). Errors are
against a finer mesh.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from unittest import mock

import numpy as np

from palpate.instrument.arithmetic import KERNELS
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import PHYSICAL, SolidParameters, solid_parameters
from palpate.instrument.models.solid import ladders
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.solid.ladders import Resolution, SolidCurve
from palpate.instrument.models.solid.system import System
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.material import PVDF
from tests.benchmarks.row import Row
from tests.instrument.direct import direct
from tests.settings import disc, solid_sensors

SEED = 3
DISCS, SQUARES, PAIRS = 16, 3, 1
CORES = 2
GAIN = 1.3  # by the processor's own kernels
RATIOS = np.logspace(-1, 5, 61)  # moduli of the object over the ring's
NEGLIGIBLE = 1e-7
# Design, the last of its meshes, and goals: what its estimate certifies, processor time of all meshes [s], memory [GB].
CERTIFIED = (
    ("single", 2, 1e-4, 3.0, 4.0),
    ("common_base", 1, 1e-3, 3.0, 4.0),
    ("common_base", 2, 1e-4, 15.0, 4.0),
    ("array_16", 1, 1e-3, 30.0, 4.0),
)
# The same for what one mesh is off by, beside the mesh that knows better.
ALONE = ("array", 1, 1e-3, 30.0, 4.0, 2)
# Moduli of the object over the ring's at which poles are compared with direct solutions.
COMPARED = (1e-2, 1.0, 1e3, 1e8)
WITH_DIRECT = {
    "single, bonded": ({}, 1e-10),
    "single, frictionless": ({"interface": "frictionless"}, 1e-10),
    "single, rigid support": ({"support": "rigid"}, 1e-10),
    "single, closed gap": ({"ring_inner_radius": 1.4e-3}, 1e-10),
    "single, point load": ({"load_at": (6e-3, 5e-3)}, 1e-10),
    "single, Poisson ratios 0.5": ({"sensed_poisson": 0.5, "compliant_poisson": 0.5}, 1e-7),
}


def measure() -> Iterator[Row]:
    for kernels, of in (({}, "a script"), (KERNELS, "a command")):
        for goal in CERTIFIED:
            yield _certified(*goal, kernels, of)
    yield _cost(*ALONE)
    yield _own_kernels()
    with ProcessPoolExecutor(CORES) as pool:
        shares = [
            share
            for own in pool.map(_errors_over_estimates, solid_sensors(DISCS, SQUARES, PAIRS, SEED))
            for share in own
        ]
    yield Row(
        f"solid: error over its estimate, {len(shares)} meshes of random sensors, 61 moduli each",
        f"{np.median(shares):.2f} in the middle, {max(shares):.2f} at worst",
        "<= 1",
        max(shares) <= 1,
    )


def agreement() -> Iterator[Row]:
    """Poles beside direct solutions; a part of the benchmark `poles`."""
    for name, (changed, goal) in WITH_DIRECT.items():
        apart = _apart(replace(solid_parameters(get_design("single"), PHYSICAL.load(1e5)), **changed))  # type: ignore[arg-type]
        yield Row(
            f"solid: {name}, poles and direct solutions apart, E1/E2 = 1e-2 to 1e8",
            f"{apart:.0e}",
            f"{goal:.0e}",
            apart <= goal,
        )


def _certified(
    name: str, last: int, error: float, seconds: float, memory: float, kernels: Mapping[str, str], of: str
) -> Row:
    sensor = solid_parameters(get_design(name), PHYSICAL.load(1e5))
    own = [(sensor, each) for each in ladders.meshes(sensor).resolutions[: last + 1]]
    found, held = _alone([*own, *solid.beside(sensor, len(own))], kernels)
    curves = [each.poles for each in found]
    bounds, _ = solid.estimates(curves[: len(own)], sensor, RATIOS * sensor.compliant_modulus, curves[len(own) :])
    spent = sum(sum(each.seconds) for each in found)
    return Row(
        f"solid: {name}, whole curve, certified, cold, by {of}, {len(found)} meshes to {found[last].unknowns} unknowns",
        f"{spent:.1f} s, {held:.1f} GB, estimate {bounds.max():.1e} at most, {np.median(bounds):.1e} in the middle",
        f"<= {seconds:g} s, <= {memory:g} GB, to {error:g}",
        bool(spent <= seconds and held <= memory and bounds.max() <= error),
    )


def _cost(name: str, refinement: int, error: float, seconds: float, memory: float, better: int) -> Row:
    sensor = solid_parameters(get_design(name), PHYSICAL.load(1e5))
    ((own,), held), ((finer,), _) = (
        _alone([(sensor, ladders.resolution(sensor, each))], {}) for each in (refinement, better)
    )
    moduli = RATIOS * sensor.compliant_modulus
    off = float(np.abs(own.poles.force_ratios(moduli) - finer.poles.force_ratios(moduli)).max())
    spent = sum(own.seconds)
    return Row(
        f"solid: {name}, whole curve on one mesh, cold, {own.unknowns} unknowns",
        f"{spent:.1f} s, {held:.1f} GB, error {off:.1e}",
        f"<= {seconds:g} s, <= {memory:g} GB, error <= {error:g}",
        spent <= seconds and held <= memory and off <= error,
    )


def _own_kernels() -> Row:
    """The command, which takes the processor's own kernels, beside the same question of a script, which does not."""
    imported = "from palpate.instrument.models.response import *"
    ask = f"{imported}; print(ask(RatioQuestion('array', 'solid'), [1e6])[0].response)"
    main = "from palpate.procedures.commands import main; main()"
    command = (main, "model", "ratio", "--design", "array", "--model", "solid", "--sensed-modulus", "1 MPa", "--json")
    seconds = []
    for code in ((f"import palpate; {ask}",), command):
        before = os.times()
        with tempfile.TemporaryDirectory() as kept:
            env = {name: value for name, value in os.environ.items() if name not in KERNELS} | {"PALPATE_CURVES": kept}
            subprocess.run([sys.executable, "-c", *code], env=env, check=True, capture_output=True)
        after = os.times()
        seconds.append(after.children_user + after.children_system - before.children_user - before.children_system)
    fixed, own = seconds
    return Row(
        "solid: array, one ratio, cold: fixed kernels / the processor's own",
        f"{fixed:.1f} / {own:.1f} s = {fixed / own:.2f}",
        f">= {GAIN}",
        fixed / own >= GAIN,
    )


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


def _apart(sensor: SolidParameters) -> float:
    """Greatest difference of the force ratio on the coarsest mesh."""
    found = solid.curve(sensor, 0).poles
    moduli, mesh = np.array(COMPARED) * sensor.compliant_modulus, ladders.resolution(sensor, 0)
    known = [direct(replace(sensor, sensed_modulus=float(each)), mesh).force_ratio for each in moduli]
    return float(np.abs(found.force_ratios(moduli)[:, 0] - known).max())


def _errors_over_estimates(sensor: SolidParameters) -> list[float]:
    """The greatest over all moduli, for refinements 1 and 2 of a disc, which the round model knows; 1 of others."""
    own = replace(sensor, film=PVDF.round()) if sensor.outline == "round" else sensor
    moduli = RATIOS * own.compliant_modulus
    curves = [solid.curve(own, refinement).poles for refinement in (0, 1, 2)]
    # Of squares no other model knows better: a finer mesh has a third of the error or less.
    known: Curve = axisymmetric.curve(disc(own), 3) if own.outline == "round" else curves[2]
    shares = []
    for count in (2, 3) if own.outline == "round" else (2,):
        errors = np.abs(curves[count - 1].force_ratios(moduli) - known.force_ratios(moduli)).max(axis=1)
        bounds, _ = solid.estimates(curves[:count], own, moduli)
        shares.append(float((errors / bounds)[errors > NEGLIGIBLE].max(initial=0.0)))
    return shares
