"""Projection of a large contact onto the few displacements that its curve is made of.

Solutions for all loads and goals at some moduli of the object, and the first terms of their series around these, span
what solutions at any modulus need (rational Krylov subspace: Ruhe 1984). More moduli are taken where what is left of
the equations may still change an answer, until it may nowhere. A large contact has thousands of poles; to find them all
took ten times as long as to eliminate the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, qr, solve_triangular

from palpate.instrument.models.finite_elements.dense import factorised
from palpate.instrument.models.finite_elements.threads import go_on

Array = NDArray[np.float64]

# Moduli of the object at which is looked what is left, over the one in their middle; those at which solutions are taken
# first; and the most at which they are before all poles are sought.
CHECKED = np.geomspace(1e-3, 1e8, 12)
FIRST = CHECKED[[2, 5, 9]]
MOST = 9
# Terms of the series around each, of which the first is the solution itself: of loads and the force ratio, whose
# energies are asked as well, and of other goals. An error of a goal is a product of what both miss.
TERMS, TERMS_OF_GOALS = 8, 3
# Bounds on what an answer may miss; most miss a hundredth of these.
RATIO_ERROR, GOAL_ERROR = 1e-10, 1e-8  # of the greatest force ratio, and of the greatest value of another goal
ALL_POLES = 3.5  # multiplications to find them all, over the cube of their number [M]
DEPENDENT = 1e-12  # share of a column that counts as nothing new


@dataclass(frozen=True, slots=True)
class Projected:
    """A contact on few displacements.

    Attributes:
        onto: (contact, fewer), these displacements, orthonormal.
        stiffness, sensed: (fewer, fewer), of the sensor, and of the object at a modulus of 1 Pa.
    """

    onto: Array
    stiffness: Array
    sensed: Array


def projected(
    stiffness: Array, sensed: Array, loads: Array, ratio: Array, goals: Array, modes: Array, modulus: float
) -> Projected | None:
    """The contact on what its solutions need; None: that would hardly be less, or does not suffice.

    Args:
        stiffness: (contact, contact), of the sensor.
        sensed: (contact, contact), of the object at a modulus of 1 Pa.
        loads: (contact, loads).
        ratio: (contact, 1), the force ratio by the displacements.
        goals: (contact, goals), all others.
        modes: (contact, modes), rigid motions of the object.
        modulus: modulus of the object in the middle of a soft and a hard object's behaviour, as that of the ring [Pa].

    Raises:
        LinAlgError: the sensor is not held.
    """
    main, others = _independent(np.concatenate([loads, ratio], axis=1)), _independent(goals)
    fewer = _most(main.shape[1], others.shape[1]) + modes.shape[1]
    if 2 * fewer > len(stiffness):
        return None
    factors: dict[float, Array] = {}
    onto = _independent(modes)
    pushed = [matrix @ onto for matrix in (stiffness, sensed)]
    wanted = (modulus * FIRST).tolist()
    while len(factors) < MOST:
        found = []
        for place in wanted:
            # The matrix is symmetric, and its transpose is already as LAPACK wants it.
            matrix = place * sensed
            matrix += stiffness
            go_on()
            factor = factorised(matrix.T)
            if factor is None:
                raise np.linalg.LinAlgError("not positive definite")
            factors[place] = factor
            term = np.concatenate([main, others], axis=1)
            for count in range(TERMS):
                if count == TERMS_OF_GOALS:
                    term = term[:, : main.shape[1]]
                term = cho_solve((factor, True), term, check_finite=False)
                found.append(term)
                term = sensed @ (term / np.linalg.norm(term, axis=0))
        new = _independent(np.concatenate(found, axis=1), onto)
        if not new.shape[1]:
            return None
        onto = np.concatenate([onto, new], axis=1)
        pushed = [
            np.concatenate([before, matrix @ new], axis=1)
            for before, matrix in zip(pushed, (stiffness, sensed), strict=True)
        ]
        own = Projected(onto, *(onto.T @ each for each in pushed))
        left = _left(own, pushed, factors, np.concatenate([loads, ratio, goals], axis=1), loads.shape[1], modulus)
        if left.max() <= 1:
            return own
        wanted = [modulus * float(CHECKED[left.argmax()])]
        if wanted[0] in factors:
            return None
    return None


def _most(main: int, others: int) -> int:
    """Number of displacements that the first moduli give for some columns."""
    return len(FIRST) * (TERMS * main + TERMS_OF_GOALS * others)


def operations(contact: int, loads: int, goals: int) -> float:
    """Multiplications in which the poles of a contact are found, projected or not [M].

    Args:
        contact: number of its unknowns.
        loads: number of loads.
        goals: number of all goals but the force ratio.
    """
    fewer = _most(loads + 1, goals)
    if 2 * fewer > contact:
        return ALL_POLES * contact**3
    checked = len(CHECKED) * (loads + 1 + goals) / 2
    return len(FIRST) * contact**3 / 6 + contact**2 * (4 * fewer + checked)


def _left(
    own: Projected, pushed: list[Array], factors: dict[float, Array], columns: Array, loads: int, modulus: float
) -> Array:
    """Bounds on what solutions on these displacements miss, over what they may, at the moduli that are checked.

    The stiffness rises with the modulus, by no larger share than the modulus itself. So energies of what is left of the
    equations are bounded by those with a stiffness that was factorised. By Cauchy and Schwarz a goal misses no more
    than the root of its own energy and of the load's.

    Args:
        own: the displacements.
        pushed: forces (contact, fewer) on the contact by them, of the sensor and of an object of 1 Pa.
        factors: Cholesky factors of the stiffness by the modulus of the object.
        columns: (contact, columns), the loads, the force ratio, and all other goals.
        loads: number of loads.
        modulus: as in `projected`.
    """
    moduli, held = modulus * CHECKED, own.onto.T @ columns
    solved = np.array([np.linalg.solve(own.stiffness + each * own.sensed, held) for each in moduli])
    values = np.einsum("dl,edc->elc", held[:, :loads], solved)
    known = np.array(sorted(factors))
    nearest = np.maximum(np.searchsorted(known, moduli * (1 + 1e-9)) - 1, 0)
    energies = np.empty((len(moduli), columns.shape[1]))
    for number, place in enumerate(known):
        those = np.flatnonzero(nearest == number)
        if not len(those):
            continue
        share = solved[those].transpose(1, 0, 2).reshape(len(held), -1)
        scaled = (solved[those] * moduli[those, None, None]).transpose(1, 0, 2).reshape(len(held), -1)
        rest = np.tile(columns, len(those)) - pushed[0] @ share - pushed[1] @ scaled
        rest = solve_triangular(factors[place], rest, lower=True, check_finite=False)
        sums = (rest**2).sum(axis=0).reshape(len(those), -1)
        energies[those] = sums * np.maximum(place / moduli[those], 1.0)[:, None]
    errors = np.full(columns.shape[1], GOAL_ERROR)
    errors[loads] = RATIO_ERROR
    allowed = errors * np.abs(values).max(axis=(0, 1))
    missed = np.sqrt(energies[:, :loads, None] * energies[:, None, :])
    shares: Array = (missed / np.where(allowed > 0, allowed, np.inf)).max(axis=(1, 2))
    return shares


def _independent(columns: Array, beside: Array | None = None) -> Array:
    """An orthonormal basis of the span of some columns, or of what they add to that of others."""
    sizes = np.linalg.norm(columns, axis=0)
    found = columns[:, sizes > 0] / sizes[sizes > 0]
    if beside is not None:
        found -= beside @ (beside.T @ found)
    first, triangle, _ = qr(found, mode="economic", pivoting=True)
    found = first[:, np.abs(np.diag(triangle)) > DEPENDENT]
    if beside is not None and found.shape[1]:  # small columns have lost digits of their being independent
        found = qr(found - beside @ (beside.T @ found), mode="economic")[0]
    independent: Array = found
    return independent
