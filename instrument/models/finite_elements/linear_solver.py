"""Direct solution of large symmetric positive definite systems, scaled and checked.

Moduli from 10 kPa to 140 GPa stand side by side in one matrix. Scaled by its diagonal on both sides it is
well within double precision, and needs no pivoting: no step of the elimination can meet a small pivot.
PARDISO does the work where pypardiso is installed, SuperLU otherwise.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import os
import sys
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from palpate.instrument.errors import EstimateError, UnknownName

Vector = NDArray[np.float64]
Factor = Callable[[Vector], Vector]

RESIDUAL_LIMIT = 1e-8


class SymmetricSolver:
    """Factors of a symmetric positive definite matrix.

    Args:
        matrix: sparse, shape (n, n).
        backend: "pardiso", "superlu", or "" for PARDISO where it is installed.

    Raises:
        UnknownName: no such backend, or it is not installed.
        EstimateError: the matrix is singular to working precision.
    """

    def __init__(self, matrix: sparse.csc_array, backend: str = "") -> None:
        name = chosen(backend)
        diagonal = matrix.diagonal()
        if not (diagonal > 0).all():
            raise EstimateError("a stiffness on the diagonal is not positive: a part is not held; hold every part")
        self.backend = name
        self.matrix = matrix
        self._scale = 1 / np.sqrt(diagonal)
        scaled = matrix.copy()
        scaled.data *= self._scale[scaled.indices] * np.repeat(self._scale, np.diff(scaled.indptr))
        self._norm = float(abs(scaled).sum(axis=1).max())
        self._factor = factorised(scaled, name)

    def __call__(self, load: Vector) -> tuple[Vector, float]:
        """Solve, and refine once.

        Args:
            load: shape (n,).

        Returns:
            Solution, and its residual relative to |A| |x| + |b|, by the largest entries of the scaled system.

        Raises:
            EstimateError: the residual stays above RESIDUAL_LIMIT.
        """
        solution = self._solve(load)
        solution += self._solve(load - self.matrix @ solution)
        left = np.max(np.abs(load - self.matrix @ solution) * self._scale)
        size = self._norm * np.max(np.abs(solution / self._scale)) + np.max(np.abs(load * self._scale))
        residual = float(left / size) if size != 0 else 0.0  # the load is zero, as for a film without charge
        if not residual <= RESIDUAL_LIMIT:
            raise EstimateError(
                f"residual {residual:.1e} of the stiffness system is above {RESIDUAL_LIMIT:g}: it is singular to "
                "working precision; hold every part, or bring the moduli closer together"
            )
        return solution, residual

    def _solve(self, load: Vector) -> Vector:
        solution: Vector = self._scale * self._factor(self._scale * load)
        return solution


def factorised(scaled: sparse.csc_array, backend: str = "") -> Factor:
    """Function that solves with a symmetric positive definite matrix (n, n) of unit diagonal.

    Raises:
        UnknownName: there is no such backend, or it is not installed.
        EstimateError: the factors do not fit into memory.
    """
    name = chosen(backend)
    with _fitting(scaled, name):
        return BACKENDS[name](scaled)


def ordered_factors(matrix: sparse.csc_array) -> SuperLU:
    """Factors of a symmetric positive definite matrix whose unknowns are in a good order for elimination.

    SuperLU then needs no longer than PARDISO.

    Raises:
        EstimateError: the factors do not fit into memory.
    """
    with _fitting(matrix, "superlu"):
        return _factors(matrix, "NATURAL")


@contextmanager
def _fitting(matrix: sparse.csc_array, name: str) -> Iterator[None]:
    try:
        yield
    except MemoryError:
        raise EstimateError(
            f"the factors of {matrix.shape[0]} unknowns do not fit into what {name!r} can hold; give a larger"
            " tolerance, or install the extra 'fast'"
        ) from None


def chosen(backend: str) -> str:
    """Name of the backend; where none is named, the fastest that is installed.

    Raises:
        UnknownName: there is no such backend, or it is not installed.
    """
    name = backend or available()[0]
    if name not in available():
        raise UnknownName("solver", name, available())
    return name


@functools.cache
def available() -> tuple[str, ...]:
    """Names of the installed backends, the fastest first."""
    installed = importlib.util.find_spec("pypardiso") is not None
    return tuple(name for name in BACKENDS if name != "pardiso" or installed)


def _factors(matrix: sparse.csc_array, order: Literal["NATURAL", "MMD_AT_PLUS_A"]) -> SuperLU:
    return splu(matrix, permc_spec=order, diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _superlu(matrix: sparse.csc_array) -> Factor:
    factors = _factors(matrix, "MMD_AT_PLUS_A")

    def solve(load: Vector) -> Vector:
        return cast(Vector, factors.solve(load))

    return solve


def _pardiso(matrix: sparse.csc_array) -> Factor:
    # Without a path pypardiso searches the whole installation for the library, a second each time.
    for library in sorted(Path(sys.prefix, "lib").glob("libmkl_rt.*")):
        os.environ.setdefault("PYPARDISO_MKL_RT", str(library))
    solver: Any = importlib.import_module("pypardiso").PyPardisoSolver(mtype=2)
    upper = sparse.csr_matrix(sparse.triu(matrix, format="csr"))
    upper.sort_indices()
    solver.factorize(upper)

    def solve(load: Vector) -> Vector:
        solver.set_phase(33)
        return cast(Vector, solver._call_pardiso(upper, np.asfortranarray(load)).reshape(load.shape))

    weakref.finalize(solve, solver.free_memory, everything=True)
    return solve


BACKENDS: dict[str, Callable[[sparse.csc_array], Factor]] = {"pardiso": _pardiso, "superlu": _superlu}
