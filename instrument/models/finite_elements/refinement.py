"""Solve for the displacements of finite elements, to the last digit.

Nearly incompressible material keeps its pressure as an unknown. The factorised matrix has a bounded bulk modulus, and
steps of iterative refinement on the displacement-pressure equations reach the true answer, also for Poisson ratio 0.5.
A high bound costs digits in the factorisation, and in a foil of 10 µm all of them. With a low bound the steps converge
slowly where rubber is squeezed flat. So the search begins with a high bound and lowers it where the residual asks for
it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.finite_elements.condensed import Elements, Factorised, product
from palpate.instrument.models.finite_elements.elements import nodal
from palpate.instrument.models.finite_elements.threads import Each

Array = NDArray[np.float64]

RESIDUAL_GOAL, RESIDUAL_LIMIT = 1e-13, 1e-9
STEPS = 20
SETTLED = 1e-10  # share of the displacement; after a step this small the next one would be mere rounding
# Divisors of the bound, which are tried in turn.
EASINGS = (1.0, 30.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Solved:
    """Displacement (size + 1,), its last entry zero; forces on nodes (elements, n); residual over its terms."""

    displacement: Array
    internal: Array
    residual: float


def solve(elements: Elements, loads: Sequence[Array], each: Each) -> list[Solved]:
    """Displacement and pressure under each load alone. The first must be solved to the last digit.

    Args:
        elements: the elements.
        loads: (size + 1,) each, forces on the unknowns; the last entry is zero.
        each: runs a function for all subdomains at once.

    Raises:
        EstimateError: the first source's residual stays above 1e-9 of its terms.
    """
    tried: list[list[Solved]] = []
    before = None
    for easing in EASINGS:
        bounded = np.maximum(elements.compliance, easing * elements.bound)
        if before is not None and np.array_equal(bounded, before):
            continue
        before = bounded
        with closing(Factorised(elements, bounded, each)) as solver:
            tried.append([_refine(elements, load, bounded, solver, each) for load in loads])
        if tried[-1][0].residual <= RESIDUAL_GOAL:
            break
    best = min(tried, key=lambda solved: solved[0].residual)
    if not (best[0].residual <= RESIDUAL_LIMIT):
        raise EstimateError(
            f"finite elements: residual {best[0].residual:.1e} of its terms stays above {RESIDUAL_LIMIT:g};"
            " bring moduli and dimensions closer together"
        )
    return best


def _refine(elements: Elements, load: Array, bounded: Array, solver: Factorised, each: Each) -> Solved:
    """Refine iteratively as long as steps gain a digit, until they no longer move anything.

    The residual alone does not tell the end: beside rubber it is down to rounding while a foil still moves.
    """
    # A second array holds the digits of the displacements for which a double has no room.
    displacement, rest = np.zeros(elements.size + 1), np.zeros(elements.size + 1)
    pressure = np.zeros(elements.dilatation.shape[:2])
    spread = elements.dilatation.transpose(0, 2, 1)
    right, gap, best = load, np.zeros_like(pressure), math.inf

    def lacking(internal: Array) -> Array:
        """Forces that are not yet in balance; the next step takes them up."""
        forces = internal.copy()
        forces[elements.mixed] += product(spread, gap / bounded[:, None])
        return load - elements.gather(forces)

    for step in range(STEPS):
        change = solver(right)
        moved = elements.strained(change, np.zeros_like(change))[elements.mixed]
        pressure += (product(elements.dilatation, moved) + gap) / bounded[:, None]
        total = displacement + change
        kept = total - displacement
        rest += (displacement - (total - kept)) + (change - kept)
        displacement = total
        strained = elements.strained(displacement, rest)
        internal, terms = elements.internal_forces(strained, pressure, each)
        gap = product(elements.dilatation, strained[elements.mixed])
        gap -= elements.compliance[:, None] * pressure
        gap_terms = product(np.abs(elements.dilatation), np.abs(strained[elements.mixed]))
        residual = max(_relative(load - elements.gather(internal), terms), _relative(gap, _norm(gap_terms)))
        if step > 0 and (residual > 0.1 * best or _norm(change) <= SETTLED * _norm(displacement)):
            break
        best = residual
        right = lacking(internal)
    return Solved(displacement, nodal(internal), residual)


def _relative(remainder: Array, terms: float) -> float:
    """Norm of the remainder over the norm of the terms of which it is the sum; 0 where there are none."""
    return _norm(remainder) / terms if terms else 0.0


def _norm(vector: Array) -> float:
    # BLAS wakes threads for a norm, and on a busy machine waits for them longer than everything else takes.
    return math.sqrt(np.square(vector).sum())
