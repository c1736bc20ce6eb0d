"""A mesh's answers in closed form over the modulus of the sensed object.

    found = curve(sensor, sensed, modes, Goals(rows, offsets, jump))
    found.values(np.array([24e3, 1e5]))

The stiffness is K0 + E K1, with the sensor in K0 and the object of modulus E in K1. Both share the displacements u of
the contact alone. Condensed on them, (S0 + E S1) u = f, where f does not depend on E. With S0 = L Lᵀ and the
eigenvectors V and eigenvalues μ of L⁻¹ S1 L⁻ᵀ, every linear goal is a sum of poles,

    gᵀ u = Σ bᵢ aᵢ / (1 + E μᵢ),    a = Vᵀ L⁻¹ f,    b = Vᵀ L⁻¹ g.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.fronts import Condensed

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Films:
    """Films of the sensor as loads on it.

    Attributes:
        loads: places of the films' forces under 1 V among the loads of the condensed sensor.
        capacitances: (films,), capacitances of clamped films [F].
    """

    loads: slice
    capacitances: Array


@dataclass(frozen=True, slots=True)
class Curve:
    """Answers of one mesh to loads on the object, with open films.

    Attributes:
        rates: (poles,), μ [1/Pa].
        loads: (poles, loads), a.
        goals: (poles, goals), b.
        offsets: (goals, loads), what each goal is without any displacement of the contact.
        jump: (poles,), b of the work on the jump that raises all teeth by 1.
        clamped: (loads,), twice the energy of an object of 1 Pa by each load, with the contact held [J Pa].
        charges: (poles, films), b of the charges that leave the films in short circuit.
        capacity: (films, films), voltages of open films by the charges [1/F].
    """

    rates: Array
    loads: Array
    goals: Array
    offsets: Array
    jump: Array
    clamped: Array
    charges: Array
    capacity: Array

    def values(self, moduli: Array) -> Array:
        """Goals (moduli, goals, loads) at moduli of the object [Pa]."""
        shares = 1 / (1 + np.multiply.outer(moduli, self.rates))
        found: Array = np.einsum("em,mg,ml->egl", shares, self.goals, self.loads, optimize=True) + self.offsets
        return found

    def slopes(self, moduli: Array) -> Array:
        """Derivatives (moduli, goals, loads) of the goals by the modulus [1/Pa]."""
        shares = -self.rates / (1 + np.multiply.outer(moduli, self.rates)) ** 2
        found: Array = np.einsum("em,mg,ml->egl", shares, self.goals, self.loads, optimize=True)
        return found

    def voltages(self, moduli: Array) -> Array:
        """Voltages (moduli, films, loads) of open films [V]."""
        shares = 1 / (1 + np.multiply.outer(moduli, self.rates))
        charges = np.einsum("em,mf,ml->efl", shares, self.charges, self.loads, optimize=True)
        found: Array = self.capacity @ charges
        return found

    def shorted(self, moduli: Array) -> Array:
        """Charges (moduli, films, loads) that leave the films when all are short-circuited [C]."""
        shares = 1 / (1 + np.multiply.outer(moduli, self.rates))
        charges = np.einsum("em,mf,ml->efl", shares, self.charges, self.loads, optimize=True)
        own = np.einsum("em,mf,mg->efg", shares, self.charges, self.charges, optimize=True)
        found: Array = np.linalg.solve(np.eye(len(self.capacity)) - own @ self.capacity, charges)
        return found

    def energies(self, moduli: Array) -> tuple[Array, Array]:
        """Twice the energies [J]: under each load (moduli, loads), and by the jump (moduli,)."""
        products = np.multiply.outer(moduli, self.rates)
        load = self.clamped / moduli[:, None] + (1 / (1 + products)) @ self.loads**2
        return load, (products / (1 + products)) @ self.jump**2


def curve(
    sensor: Condensed,
    sensed: Condensed,
    modes: Array,
    rows: Array,
    offsets: Array,
    jump: Array,
    films: Films,
) -> Curve:
    """The curve of a sensor with an object, both condensed onto the unknowns of their contact.

    Args:
        sensor: the sensor with its films in short circuit.
        sensed: the object at a modulus of 1 Pa, with the loads on it.
        modes: (contact, modes), displacements of the contact by which the object moves freely as a rigid body. Their
            poles are exactly 0, which an eigensolver would not quite find: it would spoil hard objects.
        rows: (contact, goals), goals by the displacements of the contact and with open films.
        offsets: (goals, loads), what each goal is without any displacement of the contact.
        jump: (contact,), the jump over the teeth; its work with the sensor's stiffness is the force on the teeth.
        films: the sensor's films.

    Raises:
        EstimateError: the sensor is not held.
    """
    from scipy.linalg import cholesky, solve_triangular

    polarised = sensor.loads[:, films.loads]
    capacity = _capacity(films.capacitances, sensor.work[films.loads, films.loads])
    stiffness = sensor.stiffness + polarised @ capacity @ polarised.T
    lower = cholesky(stiffness, lower=True, check_finite=False)

    def turned(columns: Array) -> Array:
        found: Array = solve_triangular(lower, columns, lower=True, check_finite=False)
        return found

    softened = turned(turned(sensed.stiffness).T)
    count = modes.shape[1]
    reflected = np.linalg.qr(lower.T @ modes, mode="complete")[0] if count else np.eye(len(lower))
    turned_rest = reflected[:, count:].T @ ((softened + softened.T) / 2) @ reflected[:, count:]
    rates, vectors = np.linalg.eigh(turned_rest)
    basis = np.concatenate([reflected[:, :count], reflected[:, count:] @ vectors], axis=1)
    loads, goals, jumped, charges = (
        basis.T @ turned(columns) for columns in (sensed.loads, rows, (stiffness @ jump)[:, None], polarised)
    )
    return Curve(
        rates=np.concatenate([np.zeros(count), np.maximum(rates, 0.0)]),
        loads=loads,
        goals=goals,
        offsets=offsets,
        jump=jumped[:, 0],
        clamped=np.diag(sensed.work),
        charges=charges,
        capacity=capacity,
    )


def _capacity(capacitances: Array, work: Array) -> Array:
    """Voltages of open films by their charges in short circuit, with the contact held [1/F]."""
    # Films may differ much in size. The scaled matrix has a diagonal of 1 and small other elements.
    scale = 1 / np.sqrt(capacitances)
    found: Array = np.outer(scale, scale) * np.linalg.inv((np.diag(capacitances) + work) * np.outer(scale, scale))
    return found
