"""Direct solution of large symmetric positive definite systems, scaled and checked.

Moduli from 10 kPa to 140 GPa stand side by side in one matrix. Scaled by its diagonal on both sides it is
well within double precision, and needs no pivoting: no step of the elimination can meet a small pivot.
PARDISO does the work where pypardiso is installed, SuperLU otherwise.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from instrument.errors import EstimateError, UnknownName

Vector = NDArray[np.float64]
Factor = Callable[[Vector], Vector]

RESIDUAL_LIMIT = 1e-8


class SymmetricSolver:
    """Factors of a symmetric positive definite matrix.

    Args:
        matrix: sparse, shape (n, n).
        points: shape (d, n), where the unknowns sit; the elimination order is made from them.
        backend: "pardiso", "superlu", or "" for PARDISO where it is installed.

    Raises:
        UnknownName: no such backend, or it is not installed.
        EstimateError: the matrix is singular to working precision.
    """

    def __init__(self, matrix: sparse.csc_array, points: Vector, backend: str = "") -> None:
        name = backend or next(iter(available()))
        if name not in available():
            raise UnknownName("solver", name, available())
        diagonal = matrix.diagonal()
        if not (diagonal > 0).all():
            raise EstimateError("a stiffness on the diagonal is not positive: a part is not held; hold every part")
        self.backend = name
        self.matrix = matrix
        self._scale = 1 / np.sqrt(diagonal)
        scaling = sparse.diags_array(self._scale)
        scaled = sparse.csc_array(scaling @ matrix @ scaling)
        self._factor = BACKENDS[name](scaled, points)

    def __call__(self, load: Vector) -> tuple[Vector, float]:
        """Solve, and refine once.

        Args:
            load: shape (n,).

        Returns:
            Solution, and its residual relative to |A| |x| + |b|, the largest of its entries.

        Raises:
            EstimateError: the residual stays above RESIDUAL_LIMIT.
        """
        solution = self._solve(load)
        solution += self._solve(load - self.matrix @ solution)
        left = np.abs(load - self.matrix @ solution)
        size = abs(self.matrix) @ np.abs(solution) + np.abs(load)
        residual = float(np.max(left * self._scale) / np.max(size * self._scale))
        if not residual <= RESIDUAL_LIMIT:
            raise EstimateError(
                f"residual {residual:.1e} of the stiffness system is above {RESIDUAL_LIMIT:g}: it is singular to "
                "working precision; hold every part, or bring the moduli closer together"
            )
        return solution, residual

    def _solve(self, load: Vector) -> Vector:
        return self._scale * self._factor(self._scale * load)


def available() -> dict[str, Callable[[sparse.csc_array, Vector], Factor]]:
    """Backends that are installed, the fastest first."""
    installed = importlib.util.find_spec("pypardiso") is not None
    return {name: make for name, make in BACKENDS.items() if name != "pardiso" or installed}


def _superlu(matrix: sparse.csc_array, points: Vector) -> Factor:
    order = nested_dissection(matrix, points)
    factors = splu(
        sparse.csc_array(matrix[order][:, order]),
        permc_spec="NATURAL",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )

    def solve(load: Vector) -> Vector:
        solution = np.empty_like(load)
        solution[order] = factors.solve(load[order])
        return solution

    return solve


def _pardiso(matrix: sparse.csc_array, points: Vector) -> Factor:
    del points  # PARDISO finds its own order
    upper = sparse.csr_array(sparse.triu(matrix, format="csr"))
    upper.sort_indices()
    solver: Any = importlib.import_module("pypardiso").PyPardisoSolver(mtype=2)
    solver.factorize(sparse.csr_matrix(upper))
    held = sparse.csr_matrix(upper)

    def solve(load: Vector) -> Vector:
        solver.set_phase(33)
        return cast(Vector, solver._call_pardiso(held, np.asfortranarray(load)).reshape(load.shape))

    return solve


BACKENDS: dict[str, Callable[[sparse.csc_array, Vector], Factor]] = {"pardiso": _pardiso, "superlu": _superlu}


def nested_dissection(matrix: sparse.csc_array, points: Vector, leaf: int = 60) -> NDArray[np.intp]:
    """Elimination order by halving space: each half first, the unknowns that part them last.

    Args:
        matrix: sparse and symmetric, shape (n, n).
        points: shape (d, n).
        leaf: parts of at most this many unknowns are not halved.
    """
    graph = sparse.csr_array(matrix)
    side = np.zeros(graph.shape[0], dtype=np.int8)

    def order(part: NDArray[np.intp]) -> list[NDArray[np.intp]]:
        if len(part) <= leaf:
            return [part]
        best: tuple[NDArray[np.intp], ...] | None = None
        rows = graph[part]
        for axis in range(len(points)):
            middle = np.median(points[axis, part])
            low = points[axis, part] <= middle
            if low.all():
                low = points[axis, part] < middle
            if low.all() or not low.any():
                continue
            side[part] = np.where(low, 1, 2)
            weight = sparse.csr_array(rows)
            touches = np.add.reduceat(side[weight.indices] == 2, weight.indptr[:-1]) > 0
            parting = low & touches
            side[part] = 0
            if best is None or parting.sum() < len(best[2]):
                best = part[low & ~parting], part[~low], part[parting]
        if best is None or len(best[0]) == 0 or len(best[1]) == 0:
            return [part]
        return [*order(best[0]), *order(best[1]), best[2]]

    return np.concatenate(order(np.arange(graph.shape[0])))
