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
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.arrays import Floats, Indices
from palpate.instrument.errors import EstimateError
from palpate.instrument.models.finite_elements.elements import differences, nodal
from palpate.instrument.models.finite_elements.work import Each

if TYPE_CHECKING:
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import SuperLU


# --- factors: the inside of each element is eliminated first, then each half by itself -------------------

# The first cut of a nested dissection leaves two subdomains that meet along a seam. Each one, in a thread of its own,
# eliminates the inside of its elements in batches, and then all unknowns that it does not share with the other. The
# small dense stiffness of each against the seam is left. Both add up to one last matrix.


# glibc gives freed arrays back to the system and gets them again page by page, until an array as large as this one has
# been freed.
np.empty(4_000_000)

BATCH = 32  # number of elements in a batch; more do not fit into the cache


@dataclass(frozen=True, slots=True)
class Elements:
    """Element matrices with their unknowns.

    Attributes:
        stiffness: (elements, n, n), against the unknowns of `elements.differences`, without the dilatation of mixed
            elements.
        unknowns: (elements, n), global numbers; unknowns that are fixed to zero have the number `size`.
        inner: (n,), whether an unknown belongs to no other element.
        size: number of unknowns; those that elements share come first, in the order of their elimination.
        shared: number of shared unknowns.
        mixed: numbers of the elements that keep their pressure.
        dilatation: (mixed, q, n), projected dilatation, from the unknowns of `elements.differences`.
        compliance: (mixed,) 1/λ [1/Pa], 0 at Poisson ratio 0.5.
        bound: (mixed,) least compliance that is factorised [1/Pa].
        subdomain: (elements,) 0 or 1; all 0 where there is one subdomain only.
        subdomains: number of subdomains.
        seam: number of unknowns that lie in one subdomain only; the first subdomain's come first.
    """

    stiffness: Floats
    unknowns: Indices
    inner: NDArray[np.bool_]
    size: int
    shared: int
    mixed: Indices
    dilatation: Floats
    compliance: Floats
    bound: Floats
    subdomain: Indices
    subdomains: int
    seam: int

    def strained(self, displacement: Floats, rest: Floats) -> Floats:
        """Unknowns (elements, n) of the element matrices, from a displacement and its rounding error."""
        return differences(displacement[self.unknowns], rest[self.unknowns])

    def internal_forces(self, strained: Floats, pressure: Floats, each: Each) -> tuple[Floats, float]:
        """Internal forces (elements, n), and the norm of the terms that add up to those without pressure."""
        forces = np.empty_like(strained)

        def found(share: list[slice]) -> float:
            terms = 0.0
            # In batches that the cache holds, reading twice takes the time of reading once.
            for batch in share:
                forces[batch] = product(self.stiffness[batch], strained[batch])
                terms += float(np.square(product(np.abs(self.stiffness[batch]), np.abs(strained[batch]))).sum())
            return terms

        every = batches(len(strained))
        terms = sum(each(found, [every[k :: self.subdomains] for k in range(self.subdomains)]))
        forces[self.mixed] += product(self.dilatation.transpose(0, 2, 1), pressure)
        return forces, math.sqrt(terms)

    def gather(self, forces: Floats) -> Floats:
        """Sum (size + 1,) of element forces on nodes; the last entry is zero."""
        total: Floats = np.bincount(
            self.unknowns.ravel(), weights=nodal(forces.copy()).ravel(), minlength=self.size + 1
        ).astype(np.float64)
        total[self.size] = 0.0
        return total


def product(matrices: Floats, vectors: Floats) -> Floats:
    """Product of each matrix (elements, m, n) with its vector (elements, n)."""
    found: Floats = np.matmul(matrices, vectors[:, :, None])[:, :, 0]
    return found


def batches(count: int) -> list[slice]:
    """Slices of elements, each with as many as the cache holds."""
    return [slice(start, start + BATCH) for start in range(0, count, BATCH)]


class Factorised:
    """Factors of the stiffness with bounded bulk moduli.

    Args:
        elements: the elements.
        bounded: compliances that are factorised.
        each: runs a function for all subdomains at once.
    """

    def __init__(self, elements: Elements, bounded: Floats, each: Each) -> None:
        from scipy.linalg import lu_factor

        self._seam = slice(elements.seam, elements.shared + 1)
        members = [np.flatnonzero(elements.subdomain == number) for number in range(elements.subdomains)]
        self._each = each
        self._subdomains = each(lambda own: _Subdomain(elements, own, bounded), members)
        self._scale = 1 / np.sqrt(sum(part.springs for part in self._subdomains))
        stiffness = sum(part.stiffness for part in self._subdomains) * np.outer(self._scale, self._scale)
        self._factors = lu_factor(stiffness, overwrite_a=True, check_finite=False)

    def __call__(self, right: Floats) -> Floats:
        """Displacements (size + 1,) under forces (size + 1,); the last entries are zero."""
        from scipy.linalg import lu_solve

        forward = self._each(lambda part: (part, *part.forward(right)), self._subdomains)
        forces = right[self._seam] + sum(part.held(found) for part, _, found in forward)
        forces[-1] = 0.0
        moved = self._scale * lu_solve(self._factors, self._scale * forces, check_finite=False)
        answer = np.zeros_like(right)
        answer[self._seam] = moved
        self._each(lambda done: done[0].back(right, *done[1:], moved, answer), forward)
        return answer

    def close(self) -> None:
        """Give the factors' memory back."""
        self._each(_Subdomain.close, self._subdomains)


class _Subdomain:
    """Elements on one side of the seam, condensed and factorised.

    Without the other side nothing may hold this one. So springs along the seam hold it, as stiff as its elements there.

    Attributes:
        stiffness: stiffness against displacements of the seam; the last one belongs to all fixed unknowns.
        springs: diagonal of the springs' stiffness.
    """

    def __init__(self, elements: Elements, members: Indices, bounded: Floats) -> None:
        unknowns, seam = elements.unknowns[members], elements.seam
        self._inner = unknowns[:, elements.inner]
        # One more unknown replaces all fixed ones; it is coupled to none.
        outer = np.minimum(unknowns[:, ~elements.inner], elements.shared)
        alone = outer < seam
        self._alone = slice(int(outer.min()), int(outer[alone].max()) + 1)
        # Numbers in this subdomain: first its own unknowns, then the seam's.
        self._count = self._alone.stop - self._alone.start
        self._size = self._count + elements.shared + 1 - seam
        self._outer = np.where(alone, outer - self._alone.start, outer - seam + self._count).astype(np.int32)
        self._factorise(self._condense(elements, members, bounded))

    def close(self) -> None:
        del self._factors

    def forward(self, right: Floats) -> tuple[Floats, Floats]:
        """Forces (size,) with those inside elements condensed, and their displacements while springs hold the seam."""
        inside = product(self._eliminated.transpose(0, 2, 1), right[self._inner])
        load = np.zeros(self._size)
        load[: self._count] = right[self._alone]
        load -= np.bincount(self._outer.ravel(), inside.ravel(), self._size)
        load[-1] = 0.0
        return load, self._factors.solve(load)

    def held(self, found: Floats) -> Floats:
        """Forces that displacements of the seam need, springs included."""
        forces: Floats = self._held @ found[self._count :]
        return forces

    def back(self, right: Floats, load: Floats, found: Floats, moved: Floats, answer: Floats) -> None:
        """Fill in this subdomain's displacements, from the results of `forward` and those of the seam."""
        found[self._count :] -= moved
        push = self.held(found)
        if push.any():
            load[self._count :] -= push
            found = self._factors.solve(load)
        found[self._count :] = moved
        answer[self._alone] = found[: self._count]
        inside = product(self._inverse, right[self._inner]) - product(self._eliminated, found[self._outer])
        answer[self._inner] = inside

    def _condense(self, elements: Elements, members: Indices, bounded: Floats) -> Floats:
        """Stiffness of each element against its rim."""
        inner, outer = (np.flatnonzero(which) for which in (elements.inner, ~elements.inner))
        pairs = ((inner, inner), (inner, outer), (outer, outer))
        blocks = [rows[:, None] * len(elements.inner) + columns for rows, columns in pairs]
        self._inverse, self._eliminated, condensed = (np.empty((len(members), *block.shape)) for block in blocks)
        for batch in batches(len(members)):
            matrix = elements.stiffness[members[batch]]
            _, mixed, own = np.intersect1d(elements.mixed, members[batch], assume_unique=True, return_indices=True)
            for place, number in zip(own, mixed, strict=True):  # one matrix at a time stays in the cache
                spread = elements.dilatation[number]
                matrix[place] += spread.T @ (spread / bounded[number])
            # Only shape functions on an element's rim differ between nodal values and the matrix's unknowns.
            flat = nodal(matrix).reshape(len(matrix), -1)
            inside, coupling, rim = (flat.take(block, axis=1) for block in blocks)
            self._inverse[batch] = inverse = np.linalg.inv(inside)
            self._eliminated[batch] = eliminated = inverse @ coupling
            condensed[batch] = rim - coupling.transpose(0, 2, 1) @ eliminated
        return condensed

    def _factorise(self, condensed: Floats) -> None:
        fixed, seam = self._outer == self._size - 1, self._outer >= self._count
        condensed[fixed] = 0.0
        condensed.transpose(0, 2, 1)[fixed] = 0.0
        diagonal = np.einsum("eii->ei", condensed)
        diagonal[fixed] = 1.0
        self.springs = np.bincount(self._outer[seam] - self._count, diagonal[seam])
        diagonal[seam] *= 2
        self._factors = ordered_factors(_assembled(condensed, self._outer, self._size))
        self._held = np.diag(2 * self.springs)
        if len(self._held) > 1:
            # Without its seam a half of the sensor is still connected, so SuperLU leaves the seam last.
            lower, upper = (part[self._count :, self._count :].toarray() for part in (self._factors.L, self._factors.U))
            self._held = lower @ upper
        self.stiffness = self._held - np.diag(self.springs)


def _assembled(matrices: Floats, unknowns: NDArray[np.int32], size: int) -> csc_array:
    """Sum of symmetric element matrices (elements, n, n) on unknowns (elements, n) below `size`."""
    from scipy.sparse import csr_array

    # Rows are sorted here and columns by transposing: half the time of a coordinate matrix, which sorts each column.
    count = unknowns.shape[1]
    order = np.argsort(unknowns, axis=None, kind="stable")
    starts = count * np.searchsorted(unknowns.ravel()[order], np.arange(size + 1))
    columns, values = unknowns[order // count], matrices.reshape(-1, count)[order]
    rows = csr_array((values.ravel(), columns.ravel(), starts.astype(np.int32)), shape=(size, size))
    found: csc_array = rows.tocsc()
    found.has_sorted_indices = True
    found.sum_duplicates()
    return found


def ordered_factors(matrix: csc_array) -> SuperLU:
    """Factors of a symmetric positive definite matrix of unit diagonal, its unknowns in a good order for elimination.

    Raises:
        EstimateError: the factors do not fit into memory.
    """
    from scipy.sparse.linalg import splu

    try:
        # No step of the elimination can meet a small pivot.
        return splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except MemoryError:
        raise EstimateError(
            f"the factors of {matrix.shape[0]} unknowns do not fit into memory; give a larger tolerance"
        ) from None


# --- the solution, step by step --------------------------------------------------------------------------

RESIDUAL_GOAL, RESIDUAL_LIMIT = 1e-13, 1e-9
STEPS = 20
SETTLED = 1e-10  # share of the displacement; after a step this small the next one would be mere rounding
# Divisors of the bound, which are tried in turn.
EASINGS = (1.0, 30.0, 1000.0)


@dataclass(frozen=True, slots=True)
class ElementSolution:
    """Displacement (size + 1,), its last entry zero; forces on nodes (elements, n); residual over its terms."""

    displacement: Floats
    internal: Floats
    residual: float


def solve(elements: Elements, loads: Sequence[Floats], each: Each) -> list[ElementSolution]:
    """Displacement and pressure under each load alone. The first must be solved to the last digit.

    Args:
        elements: the elements.
        loads: (size + 1,) each, forces on the unknowns; the last entry is zero.
        each: runs a function for all subdomains at once.

    Raises:
        EstimateError: the first source's residual stays above 1e-9 of its terms.
    """
    tried: list[list[ElementSolution]] = []
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


def _refine(elements: Elements, load: Floats, bounded: Floats, solver: Factorised, each: Each) -> ElementSolution:
    """Refine iteratively as long as steps gain a digit, until they no longer move anything.

    The residual alone does not tell the end: beside rubber it is down to rounding while a foil still moves.
    """
    # A second array holds the digits of the displacements for which a double has no room.
    displacement, rest = np.zeros(elements.size + 1), np.zeros(elements.size + 1)
    pressure = np.zeros(elements.dilatation.shape[:2])
    spread = elements.dilatation.transpose(0, 2, 1)
    right, gap, best = load, np.zeros_like(pressure), math.inf

    def lacking(internal: Floats) -> Floats:
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
    return ElementSolution(displacement, nodal(internal), residual)


def _relative(remainder: Floats, terms: float) -> float:
    """Norm of the remainder over the norm of the terms of which it is the sum; 0 where there are none."""
    return _norm(remainder) / terms if terms else 0.0


def _norm(vector: Floats) -> float:
    # BLAS wakes threads for a norm, and on a busy machine waits for them longer than everything else takes.
    return math.sqrt(np.square(vector).sum())
