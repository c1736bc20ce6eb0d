"""The finite-element meshes that the price list rests on, and how they are solved, two at a time."""

from __future__ import annotations

import math
import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.axisymmetric.curves import found_on
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import (
    PHYSICAL,
    RoundParameters,
    SolidParameters,
    round_parameters,
    solid_parameters,
)
from palpate.instrument.models.price_list import ReferenceRatios, fingerprint
from palpate.instrument.models.solid import ladders
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import SAMPLES, Load
from palpate.procedures.console.terminal import Progress

PROCESSES = 2
Apply = Callable[[Callable[[Any], Any], Sequence[Any]], Iterator[Any]]

# The thesis' softest and hardest objects, the ends of the rubber samples, and one more.
MODULI = (1.49e4, SAMPLES["2"].modulus, SAMPLES["1"].modulus, 1e6, 140e9)
MIDDLES = tuple((low * high) ** 0.5 for low, high in pairwise(MODULI))
BETWEEN = 100  # number of moduli in each interval, for what answers at once
TIMED = MODULI[2]

# The second way to a reference: no pressure among the unknowns (axisymmetric); another grading and degree (solid):
OTHER_FAMILY = Resolution(layers=4, ratio=0.2, sectors=1, degree=4)
FINER = 2  # refinement that is the second way of many teeth, and not priced


@dataclass(frozen=True, slots=True)
class MeshedProblem:
    """A problem and the mesh on which it is solved.

    Attributes:
        parameters: parameters of the problem.
        refinement: refinement of the finite-element model; also one beyond the axisymmetric model's own.
        second: whether to solve it in the second, independent way to a reference.
    """

    parameters: RoundParameters | SolidParameters
    refinement: int
    second: bool = False

    @property
    def model(self) -> str:
        """Name of the model in `table.MODELS`."""
        return "axisymmetric" if isinstance(self.parameters, RoundParameters) else "solid"

    @property
    def moduli(self) -> Sequence[float]:
        """Moduli of the object for which it is solved [Pa]; fewer where the second way takes a minute each."""
        if self.model == "solid":
            return (TIMED,) if self.second else MODULI
        return MODULI if self.second else (*MODULI, *MIDDLES)

    def at(self, modulus: float) -> MeshedProblem:
        """The same mesh under an object of that modulus [Pa]."""
        return replace(self, parameters=replace(self.parameters, sensed_modulus=modulus))


@dataclass(frozen=True, slots=True)
class MeshSolution:
    """The solution on a mesh.

    Attributes:
        force_ratio: the force ratio; None: the solution failed.
        seconds: processor time to build, to solve, and to evaluate [s].
        failure: why the solution failed; empty: it did not.
        curve: curve of the mesh over the modulus of the object.
    """

    force_ratio: float | None
    seconds: tuple[float, float, float] = (0.0, 0.0, 0.0)
    failure: str = ""
    curve: Curve | None = None


Results = Mapping[MeshedProblem, MeshSolution]


def refinements(design: Design, load: Load) -> dict[str, list[MeshedProblem]]:
    """The meshes of each finite-element model that holds for the design, from the coarsest one."""
    around = round_parameters(design, load) if len(design.teeth) == 1 else None
    found = (
        {"axisymmetric": [MeshedProblem(around, refinement) for refinement in axisymmetric.REFINEMENTS]}
        if around
        else {}
    )
    square = solid_parameters(design, load)
    own = ladders.refinements(square)[: FINER if ladders.has_many_teeth(square) else None]
    return {**found, "solid": [MeshedProblem(square, refinement) for refinement in own]}


def references(design: Design, load: Load) -> list[MeshedProblem]:
    """The meshes that only the reference needs: a finer one for the round design, and the second way."""
    if design.outline == "round":
        finest = MeshedProblem(round_parameters(design, load), axisymmetric.REFINEMENTS[-1] + 1)
        return [finest, replace(finest, second=True)]
    square = solid_parameters(design, load)
    return [MeshedProblem(square, ladders.refinements(square)[-1], second=True)]


def solve(mesh: MeshedProblem) -> MeshSolution:
    """Solve. A mesh of the solid model is eliminated once for all moduli, where these are asked in one process."""
    try:
        if isinstance(mesh.parameters, RoundParameters):
            # Degree and layers go on as in axisymmetric.solve.
            start = time.process_time()
            found = found_on(mesh.parameters, mesh.refinement + 2, mesh.refinement + 1, mixed=not mesh.second)
            built = time.process_time()
            ratio = float(found.force_ratios(np.array([mesh.parameters.sensed_modulus]))[0, 0])
            return MeshSolution(ratio, curve=found, seconds=(0.0, built - start, time.process_time() - built))
        resolution = _resolution(mesh.parameters, mesh)
        answer = solid.solve_on(mesh.parameters, resolution)
        whole = solid.curve_on(mesh.parameters, resolution)
        return MeshSolution(answer.force_ratio, curve=whole.poles, seconds=(*answer.seconds, 0.0))
    except EstimateError as error:
        return MeshSolution(None, failure=str(error))


def _resolution(of: SolidParameters, mesh: MeshedProblem) -> Resolution:
    if mesh.second:
        return ladders.resolution(of, FINER) if ladders.has_many_teeth(of) else OTHER_FAMILY
    return ladders.resolution(of, mesh.refinement)


def solve_all(designs: Sequence[Design], progress: Progress) -> dict[MeshedProblem, MeshSolution]:
    """Every mesh of every design at its moduli: first where it is timed, for a mesh that fails there is left alone."""
    load = PHYSICAL.load(TIMED)
    families = [family for design in designs for family in refinements(design, load).values()]
    priced = list(dict.fromkeys(mesh for family in families for mesh in family))
    checks = [mesh.at(modulus) for design in designs for mesh in references(design, load) for modulus in mesh.moduli]
    total = len(checks) + sum(len(mesh.moduli) for mesh in priced)
    solved: dict[MeshedProblem, MeshSolution] = {}
    with side_by_side() as apply:

        def take(meshes: Sequence[MeshedProblem], what: str) -> None:
            for mesh, found in zip(meshes, apply(solve, meshes), strict=True):
                solved[mesh] = found
                progress(len(solved), total, what)

        # The slow ones first, that none is left to run alone at the end.
        take(priced[::-1], "each mesh, timed")
        able = [mesh for mesh in priced if solved[mesh].force_ratio is not None]
        for mesh in priced:
            if mesh not in able:
                solved.update({mesh.at(modulus): solved[mesh] for modulus in mesh.moduli})
        take(checks, "references")
        take([mesh.at(m) for mesh in able[::-1] for m in mesh.moduli if m != TIMED], "the same at other moduli")
    return solved


@contextmanager
def side_by_side() -> Iterator[Apply]:
    """`map` in two processes, which end with the block however it is left."""
    with multiprocessing.get_context("spawn").Pool(PROCESSES, _leave_interrupts) as pool:
        yield pool.imap


def _leave_interrupts() -> None:
    """Ctrl-C is the first process' business: it ends this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


# --- Converged force ratios against which errors are measured, each checked by a second method ---------

Array = NDArray[np.float64]

# What the limit of so many meshes may leave unseen of the priced designs, all of one tooth, ring and gap: of the single
# sensor the second of many teeth is 5e-4 from the limit, and the third of few teeth 2e-5.
UNSEEN = {2: 1e-3, 3: 5e-5}


def reference_of(design: Design, solved: Results) -> ReferenceRatios:
    """Reference by a round design's finest mesh, or by the limit of the solid model's refinements."""
    if design.outline == "round":
        return _round(design, solved)
    load = PHYSICAL.load(TIMED)
    limit, left, count = _limit(design, solved)
    (second,) = references(design, load)
    other = solved[second.at(TIMED)]
    if other.force_ratio is None:
        apart, checked = 0.0, f"not checked by a finer or other mesh: {other.failure}"
    else:
        apart = abs(other.force_ratio - limit[MODULI.index(TIMED)])
        way = "a finer mesh" if len(design.teeth) > 2 else "elements of another degree and grading"
        checked = f"{way} by {apart:.0e} at {show(TIMED, 'Pa', 3)}"
    unseen = UNSEEN[count]
    how = f"solid, limit of its refinements up to {count - 1}: the last differs by {left.max():.0e} at most, {checked}"
    return _reference(design, solved, limit, np.maximum(left, max(apart, unseen)), how)


def _round(design: Design, solved: Results) -> ReferenceRatios:
    load = PHYSICAL.load(TIMED)
    mesh, second_way = references(design, load)
    coarser_mesh = refinements(design, load)["axisymmetric"][-1]

    def at(of: MeshedProblem) -> Array:
        return np.array([solved[of.at(modulus)].force_ratio for modulus in MODULI], dtype=np.float64)

    ratios, second = at(mesh), at(second_way)
    coarser = np.abs(ratios - at(coarser_mesh))
    limit, _, _ = _limit(design, solved)
    how = (
        f"axisymmetric, refinement {mesh.refinement}: the plain displacement form differs by"
        f" {np.abs(ratios - second).max():.0e} at most, refinement {axisymmetric.REFINEMENTS[-1]} by"
        f" {coarser.max():.0e}, the limit of the solid model by {np.abs(ratios - limit).max():.0e}"
    )
    return _reference(design, solved, ratios, np.maximum(np.abs(ratios - second), coarser), how)


def _reference(design: Design, solved: Results, ratios: Array, uncertainties: Array, how: str) -> ReferenceRatios:
    load = PHYSICAL.load(TIMED)
    own = [solved[mesh.at(modulus)] for mesh in references(design, load) for modulus in mesh.moduli]
    return ReferenceRatios(
        design=design.name,
        fingerprint=fingerprint(design, load),
        force_ratios=tuple(ratios.tolist()),
        uncertainties=tuple(uncertainties.tolist()),
        how=how,
        seconds=math.fsum(math.fsum(each.seconds) for each in own),
    )


def _limit(design: Design, solved: Results) -> tuple[Array, Array, int]:
    """Limit of the solid model's refinements, the remaining distance to it, and the number of solved refinements.

    From three on the changes go on falling alike. The second of two is left with a third of the first one's error or
    less: with none to half of the change, a quarter for both.
    """
    own = refinements(design, PHYSICAL.load(TIMED))["solid"]
    found = [[solved[mesh.at(modulus)].force_ratio for modulus in MODULI] for mesh in own]
    answered = np.array([ratios for ratios in found if None not in ratios], dtype=np.float64)
    *before, change = np.diff(answered, axis=0)
    left = change / 4
    if before:
        falling = np.divide(change, before[-1], out=np.full_like(change, 0.5), where=before[-1] != 0).clip(0.1, 0.5)
        left = change * falling / (1 - falling)
    return answered[-1] + left, np.abs(left), len(answered)
