"""Voltages of open films, coupled to the mechanics.

A film's electrodes cover its faces, and each has one potential. Under displacements u the charge b·u leaves
short-circuited films. Open films carry no charge, so C V = b·u, and their voltages act back by the forces -b V. One
more solution for each film, z = K⁻¹ b, therefore couples any load:

    (C + bᵀz) V = b·u,    displacements u - z V
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.sensor.film_material import FilmMaterial

Array = NDArray[np.float64]


class Circuits:
    """Open films.

    Attributes:
        capacity: (films, films), inverse of C + bᵀz [1/F].

    Args:
        capacitances: (films,), capacitances of clamped films [F].
        charges: (films, films), charge of each film under the forces b of each film [C/V].
    """

    def __init__(self, capacitances: Array, charges: Array) -> None:
        # Films may differ much in size. The scaled matrix has a diagonal of 1 and small other elements.
        matrix = np.diag(capacitances) + (charges + charges.T) / 2
        scale = 1 / np.sqrt(capacitances)
        self.capacity: Array = np.outer(scale, scale) * np.linalg.inv(matrix * np.outer(scale, scale))

    def voltages(self, charges: Array) -> Array:
        """Voltages of open films [V], from the charges that would leave them in short circuit [C]."""
        found: Array = self.capacity @ charges
        return found


def capacitance(material: FilmMaterial, area: float, thickness: float) -> float:
    """Capacitance of a clamped film [F]."""
    return material.stiff()[2] * area / thickness


def charge(material: FilmMaterial, area: float, along: float, across: float, normal: float) -> float:
    """Charge [C] that leaves a short-circuited film under mean stresses along its axes [Pa]."""
    d31, d32, d33 = material.strain
    return area * (d31 * along + d32 * across + d33 * normal)
