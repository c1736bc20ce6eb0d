"""The finite-element meshes that the price list rests on, and how they are solved, two at a time."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from instrument.design import Design
from instrument.errors import EstimateError
from instrument.load import Load
from instrument.models import axisymmetric, solid
from instrument.models.parameters import RoundParameters, SolidParameters, round_parameters, solid_parameters
from instrument.models.solid_mesh import Resolution

PROCESSES = 2
Apply = Callable[[Callable[[Any], Any], Sequence[Any]], Iterator[Any]]

# The second way to a reference: no pressure among the unknowns (axisymmetric), another grading and degree (solid).
PLAIN = 1.0
OTHER_FAMILY = Resolution(layers=3, ratio=0.15, sectors=1, degree=4)


@dataclass(frozen=True, slots=True)
class Mesh:
    """What to solve, and on which mesh.

    Attributes:
        refinement: of the finite-element model; the axisymmetric one also beyond its own.
        second: the second way to a reference.
    """

    parameters: RoundParameters | SolidParameters
    refinement: int
    second: bool = False

    @property
    def model(self) -> str:
        """Of `response.MODELS`."""
        return "axisymmetric" if isinstance(self.parameters, RoundParameters) else "solid"

    def at(self, modulus: float) -> Mesh:
        """The same mesh under an object of that modulus [Pa]."""
        return replace(self, parameters=replace(self.parameters, sensed_modulus=modulus))


@dataclass(frozen=True, slots=True)
class Solved:
    """What came of it; without a force ratio, why.

    Attributes:
        imbalance: of the forces, over the total force.
        seconds: to build, to solve, and to evaluate.
    """

    force_ratio: float | None
    imbalance: float = 0.0
    seconds: tuple[float, float, float] = (0.0, 0.0, 0.0)
    failure: str = ""


def refinements(design: Design, load: Load) -> dict[str, list[Mesh]]:
    """The meshes of each finite-element model that knows the design, from the coarsest."""
    around = round_parameters(design, load) if len(design.teeth) == 1 else None
    found = {"axisymmetric": [Mesh(around, refinement) for refinement in axisymmetric.REFINEMENTS]} if around else {}
    return {**found, "solid": [Mesh(solid_parameters(design, load), refinement) for refinement in solid.REFINEMENTS]}


def references(design: Design, load: Load) -> list[Mesh]:
    """What is solved for the reference alone: a finer mesh of the round design, and the second way."""
    if design.outline == "round":
        finest = Mesh(round_parameters(design, load), axisymmetric.REFINEMENTS[-1] + 1)
        return [finest, replace(finest, second=True)]
    return [Mesh(solid_parameters(design, load), solid.REFINEMENTS[-1], second=True)]


def solve(mesh: Mesh) -> Solved:
    """Solve with the core dependencies alone, whatever else is installed."""
    try:
        if isinstance(mesh.parameters, RoundParameters):
            form = PLAIN if mesh.second else axisymmetric.MIXED_POISSON
            # Degree and layers go on as in axisymmetric.solve.
            found = axisymmetric.solve_on(mesh.parameters, mesh.refinement + 2, mesh.refinement + 1, form)
            return Solved(found.force_ratio, found.imbalance, found.seconds)
        if mesh.second:
            answer = solid.solve_on(mesh.parameters, OTHER_FAMILY, "superlu")
        else:
            answer = solid.solve(mesh.parameters, mesh.refinement, "superlu")
        return Solved(answer.force_ratio, seconds=(*answer.seconds, 0.0))
    except EstimateError as error:
        return Solved(None, failure=str(error))


@contextmanager
def side_by_side() -> Iterator[Apply]:
    """`map` in two processes, which end with the block however it is left."""
    with multiprocessing.get_context("spawn").Pool(PROCESSES, _leave_interrupts) as pool:
        yield pool.imap


def _leave_interrupts() -> None:
    """Ctrl-C is the first process' business: it ends this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
