"""Solve element matrices: the inside of each element is eliminated first, the rest by one sparse factorisation.

Nearly incompressible material keeps its pressure as an unknown: the factorised matrix has a bounded bulk
modulus, and steps of iterative refinement on the displacement-pressure equations carry the answer to the
true one, Poisson ratio 0.5 included. A high bound costs digits in the factorisation, and in a foil of 10 µm
all of them; with a low one the steps creep where rubber is squeezed flat. So the bound is eased on demand.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from instrument.errors import EstimateError
from instrument.models.elements import differences, nodal
from instrument.models.linear_solver import factorised

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

RESIDUAL_GOAL, RESIDUAL_LIMIT = 1e-13, 1e-9
STEPS = 20
BATCH = 128  # elements that a thread condenses in one go; more of them leave the cache
# What the bound is divided by, in turn.
EASINGS = (1.0, 30.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Elements:
    """Element matrices with their unknowns.

    Attributes:
        stiffness: (elements, n, n), without the dilatation of the mixed elements, of `elements.differences`.
        unknowns: (elements, n): global numbers; those fixed to zero have the number `size`.
        inner: which of the n belong to no other element.
        size: number of unknowns; those shared between elements come first, in the order of their elimination.
        shared: how many are shared.
        mixed: indices of the elements with a pressure.
        dilatation: (mixed, q, n), projected dilatation, of `elements.differences`.
        compliance: (mixed,) 1/λ [1/Pa], 0 at Poisson ratio 0.5.
        bound: (mixed,) the least compliance that is factorised [1/Pa].
    """

    stiffness: Array
    unknowns: Indices
    inner: NDArray[np.bool_]
    size: int
    shared: int
    mixed: Indices
    dilatation: Array
    compliance: Array
    bound: Array

    def strained(self, displacement: Array, rest: Array) -> Array:
        """Unknowns of the element matrices, (elements, n), of a displacement and what it is rounded by."""
        return differences(displacement[self.unknowns], rest[self.unknowns])

    def internal_forces(self, strained: Array, pressure: Array) -> Array:
        """Element by element: (elements, n)."""
        forces = self._multiply(self.stiffness, strained)
        forces[self.mixed] += self._multiply(self.dilatation.transpose(0, 2, 1), pressure)
        return forces

    def gather(self, forces: Array) -> Array:
        """Sum of element forces on nodes, (size + 1,), its last entry zero."""
        total: Array = np.bincount(
            self.unknowns.ravel(), weights=nodal(forces).ravel(), minlength=self.size + 1
        ).astype(np.float64)
        total[self.size] = 0.0
        return total

    @staticmethod
    def _multiply(matrices: Array, vectors: Array) -> Array:
        product: Array = np.matmul(matrices, vectors[:, :, None])[:, :, 0]
        return product


@dataclass(frozen=True, slots=True)
class Solved:
    """Displacement (size + 1,), the last entry zero; forces on nodes (elements, n); residual over its terms."""

    displacement: Array
    internal: Array
    residual: float


def solve(elements: Elements, load: Array) -> Solved:
    """Displacement and pressure under a load vector (size + 1,).

    Raises:
        EstimateError: the residual stays above 1e-9 of its terms.
    """
    tried: list[Solved] = []
    before = None
    for easing in EASINGS:
        bounded = np.maximum(elements.compliance, easing * elements.bound)
        if before is not None and np.array_equal(bounded, before):
            continue
        before = bounded
        tried.append(_refine(elements, load, bounded))
        if tried[-1].residual <= RESIDUAL_GOAL:
            break
    best = min(tried, key=lambda solved: solved.residual)
    if not (best.residual <= RESIDUAL_LIMIT):
        raise EstimateError(
            f"finite elements: residual {best.residual:.1e} of its terms stays above {RESIDUAL_LIMIT:g};"
            " bring moduli and dimensions closer together"
        )
    return best


def _refine(elements: Elements, load: Array, bounded: Array) -> Solved:
    """Steps of iterative refinement, as long as they gain a digit."""
    solver = _Factorised(elements, bounded)
    # Displacements carry the digits that a double has no room for in a second one.
    displacement, rest = np.zeros(elements.size + 1), np.zeros(elements.size + 1)
    pressure = np.zeros(elements.dilatation.shape[:2])
    spread = elements.dilatation.transpose(0, 2, 1)
    magnitude = np.abs(elements.stiffness)
    right, gap, best = load, np.zeros_like(pressure), math.inf
    for step in range(STEPS):
        change = solver(right)
        moved = elements.strained(change, np.zeros_like(change))[elements.mixed]
        pressure += (elements._multiply(elements.dilatation, moved) + gap) / bounded[:, None]
        total = displacement + change
        kept = total - displacement
        rest += (displacement - (total - kept)) + (change - kept)
        displacement = total
        strained = elements.strained(displacement, rest)
        internal = elements.internal_forces(strained, pressure)
        gap = elements._multiply(elements.dilatation, strained[elements.mixed])
        gap -= elements.compliance[:, None] * pressure
        residual = max(
            _relative(load - elements.gather(internal), elements._multiply(magnitude, np.abs(strained))),
            _relative(gap, elements._multiply(np.abs(elements.dilatation), np.abs(strained[elements.mixed]))),
        )
        if step > 0 and residual > 0.1 * best:
            break
        best = residual
        lacking = internal.copy()
        lacking[elements.mixed] += elements._multiply(spread, gap / bounded[:, None])
        right = load - elements.gather(lacking)
    return Solved(displacement, nodal(internal), residual)


def _relative(remainder: Array, terms: Array) -> float:
    """Norm of what is left over that of the terms it is the sum of; 0 where there are none."""
    # BLAS wakes threads for a norm, and waits for them longer than all else takes on a busy machine.
    left, size = (math.sqrt(np.square(part).sum()) for part in (remainder, terms))
    return left / size if size else 0.0


class _Factorised:
    """The factorised stiffness, with bounded bulk moduli."""

    def __init__(self, elements: Elements, bounded: Array) -> None:
        from scipy.sparse import coo_array

        # The inside first, so that all blocks are slices.
        order, inner = np.argsort(~elements.inner, kind="stable"), int(elements.inner.sum())
        unknowns = elements.unknowns[:, order].astype(np.int32)
        self._elements = elements
        self._inner, self._outer = unknowns[:, :inner], unknowns[:, inner:]
        # Nodes on the rim of an element share it with the unknowns of its matrix, those inside are the same.
        rim = nodal(np.eye(len(order)), axis=0)[np.ix_(order[inner:], order[inner:])].T

        def condense(start: int) -> tuple[Array, Array, Array]:
            matrix = elements.stiffness[start : start + BATCH].take(order, axis=1).take(order, axis=2)
            mixed = slice(*np.searchsorted(elements.mixed, [start, start + BATCH]))
            spread = elements.dilatation[mixed].take(order, axis=2)
            matrix[elements.mixed[mixed] - start] += spread.transpose(0, 2, 1) @ (spread / bounded[mixed, None, None])
            coupling = matrix[:, :inner, inner:] @ rim
            inverse = np.linalg.inv(matrix[:, :inner, :inner]).astype(np.float64, copy=False)
            eliminated = inverse @ coupling
            outer = rim.T @ (matrix[:, inner:, inner:] @ rim) - coupling.transpose(0, 2, 1) @ eliminated
            return inverse, eliminated, outer

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            parts = zip(*pool.map(condense, range(0, len(unknowns), BATCH)), strict=True)
        condensed: Array
        self._inverse, self._eliminated, condensed = (np.concatenate(part) for part in parts)

        # One more stands for all that is fixed: it has a stiffness of its own and no other.
        joined = np.minimum(self._outer, elements.shared)
        own = np.einsum("eii->ei", condensed)
        self._scale = 1 / np.sqrt(np.bincount(joined.ravel(), own.ravel(), elements.shared + 1))
        self._scale[-1] = 0.0
        condensed *= self._scale[joined][:, :, None] * self._scale[joined][:, None, :]
        own[joined == elements.shared] = 1.0
        rows, columns = np.broadcast_arrays(joined[:, :, None], joined[:, None, :])
        shape = (elements.shared + 1,) * 2
        assembled = coo_array((condensed.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
        self._factor = factorised(assembled.tocsc(), ordered=True)

    def __call__(self, right: Array) -> Array:
        elements, shared = self._elements, self._elements.shared
        inside = right[self._inner]
        local = elements._multiply(self._eliminated.transpose(0, 2, 1), inside)
        left = right - np.bincount(self._outer.ravel(), local.ravel(), len(right))
        answer = np.zeros_like(right)
        answer[: shared + 1] = self._scale * self._factor(self._scale * left[: shared + 1])
        answer[self._inner] = elements._multiply(self._inverse, inside) - elements._multiply(
            self._eliminated, answer[self._outer]
        )
        return answer
