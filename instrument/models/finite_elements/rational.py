"""Projection of a large contact onto the few displacements that its curve is made of.

Solutions for all loads and goals at some moduli of the object, and the first terms of their series around these, span
what solutions at any modulus need (rational Krylov subspace: Ruhe 1984). With six moduli for eleven decades and four
terms each, ratios, voltages and energies keep 1e-11. A large contact has thousands of poles; to find them all took ten
times as long as to eliminate the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, qr

from palpate.instrument.models.finite_elements import set_up

Array = NDArray[np.float64]

# Moduli of the object at which solutions are taken, over the one in their middle; and terms of the series around each,
# of which the first is the solution itself.
PLACES = np.geomspace(1e-2, 1e7, 6)
TERMS = 4
DEPENDENT = 1e-12  # share of a column that counts as nothing new


def basis(stiffness: Array, sensed: Array, columns: Array, modes: Array, modulus: float) -> Array | None:
    """Orthonormal displacements (contact, fewer) to project on; None: that would hardly leave fewer.

    Args:
        stiffness: (contact, contact), of the sensor.
        sensed: (contact, contact), of the object at a modulus of 1 Pa.
        columns: (contact, columns), all loads and goals.
        modes: (contact, modes), rigid motions of the object.
        modulus: modulus of the object in the middle of a soft and a hard object's behaviour, as that of the ring [Pa].

    Raises:
        LinAlgError: the sensor is not held.
    """
    own = _independent(columns)
    if 2 * len(PLACES) * TERMS * own.shape[1] > len(stiffness):
        return None
    set_up.begin(len(PLACES) * len(stiffness) ** 3 / 6, len(stiffness))
    found = [modes]
    for place in modulus * PLACES:
        # The matrix is symmetric, and its transpose is already as LAPACK wants it.
        factor = cho_factor((stiffness + place * sensed).T, lower=True, overwrite_a=True, check_finite=False)
        term = own
        for _ in range(TERMS):
            term = cho_solve(factor, term, check_finite=False)
            found.append(term)
            term = sensed @ (term / np.linalg.norm(term, axis=0))
    return _independent(np.concatenate(found, axis=1))


def _independent(columns: Array) -> Array:
    """An orthonormal basis of the span of some columns."""
    sizes = np.linalg.norm(columns, axis=0)
    first, triangle, _ = qr(columns[:, sizes > 0] / sizes[sizes > 0], mode="economic", pivoting=True)
    kept = np.abs(np.diag(triangle)) > DEPENDENT
    found: Array = first[:, kept]
    return found
