"""Dense algebra of large matrices during which other threads of Python go on, so that a solve can be interrupted.

scipy's own functions keep Python's lock: with a matrix of 8000 unknowns nobody can interrupt one for half a minute.
These call the same routines of the same library, so that no digit differs. Matrices should be in Fortran's order;
others are copied.
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_char_p, c_double, c_int, c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cython_blas, cython_lapack

Array = NDArray[np.float64]

_TEXT, _COUNT, _NUMBER, _MATRIX = c_char_p, POINTER(c_int), POINTER(c_double), c_void_p


def _routine(module: Any, name: str, *types: Any) -> Any:
    """A routine of the library with which scipy computes (scipy.linalg.cython_blas tells where it is)."""
    name_of, pointer_of = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    name_of.restype, name_of.argtypes = c_char_p, [ctypes.py_object]
    pointer_of.restype, pointer_of.argtypes = c_void_p, [ctypes.py_object, c_char_p]
    capsule = module.__pyx_capi__[name]
    return ctypes.CFUNCTYPE(None, *types)(pointer_of(capsule, name_of(capsule)))


_DPOTRF = _routine(cython_lapack, "dpotrf", _TEXT, _COUNT, _MATRIX, _COUNT, _COUNT)
_DTRSM = _routine(
    cython_blas, "dtrsm", _TEXT, _TEXT, _TEXT, _TEXT, _COUNT, _COUNT, _NUMBER, _MATRIX, _COUNT, _MATRIX, _COUNT
)
_DSYRK = _routine(
    cython_blas, "dsyrk", _TEXT, _TEXT, _COUNT, _COUNT, _NUMBER, _MATRIX, _COUNT, _NUMBER, _MATRIX, _COUNT
)


def factorised(matrix: Array) -> Array | None:
    """Cholesky factor, in the lower triangle, of a symmetric matrix (n, n), of which only the lower triangle counts.

    The matrix is overwritten. None: it is not positive definite to working precision.
    """
    found, failed = np.asfortranarray(matrix), c_int(0)
    if len(found):
        size = c_int(len(found))
        _DPOTRF(b"L", size, found.ctypes.data, size, failed)
    return None if failed.value else found


def solved(factor: Array, columns: Array) -> Array:
    """X (m, n) of X Lᵀ = B, with L in the lower triangle of a factor (n, n); B (m, n) is overwritten."""
    found = np.asfortranarray(columns)
    rows, count = map(c_int, found.shape)
    if found.size:
        _DTRSM(b"R", b"L", b"T", b"N", rows, count, c_double(1.0), factor.ctypes.data, count, found.ctypes.data, rows)
    return found


def less_square(matrix: Array, of: Array) -> Array:
    """A - B Bᵀ in the lower triangle of A (m, m), which is overwritten; B is (m, n)."""
    found, of = np.asfortranarray(matrix), np.asfortranarray(of)
    rows, count = map(c_int, of.shape)
    if of.size:
        places = of.ctypes.data, rows, c_double(1.0), found.ctypes.data, rows
        _DSYRK(b"L", b"N", rows, count, c_double(-1.0), *places)
    return found
