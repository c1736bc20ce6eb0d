"""Films on their own circuits, coupled to what moves them.

A film's electrodes lie across it, and each has one potential. With the charge b·u that leaves short-circuited films
under displacements u, open films carry no charge: C V = b·u, and their voltages act back with the forces -b V. So one
more solution for each film, z = K⁻¹ b, couples any load:

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
        capacity: inverse of C + bᵀz [1/F], (films, films): the less, the more the films are free to move.

    Args:
        capacitances: of clamped films [F], (films,).
        charges: of each film under the forces b of each, (films, films) [C/V].
    """

    def __init__(self, capacitances: Array, charges: Array) -> None:
        # By films that may differ in size by far: scaled, their matrix has a diagonal of 1 and little beside.
        matrix = np.diag(capacitances) + (charges + charges.T) / 2
        scale = 1 / np.sqrt(capacitances)
        self.capacity: Array = np.outer(scale, scale) * np.linalg.inv(matrix * np.outer(scale, scale))

    def voltages(self, charges: Array) -> Array:
        """Of open films [V], from the charges that would leave them in short circuit [C]."""
        found: Array = self.capacity @ charges
        return found


def capacitance(material: FilmMaterial, area: float, thickness: float) -> float:
    """Of a clamped film [F]."""
    return material.stiff()[2] * area / thickness


def charge(material: FilmMaterial, area: float, along: float, across: float, normal: float) -> float:
    """That leaves a short-circuited film under mean stresses along its axes [C]."""
    d31, d32, d33 = material.strain
    return area * (d31 * along + d32 * across + d33 * normal)
