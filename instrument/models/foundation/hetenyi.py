"""Exact solution of a beam on two or more stretches of elastic foundation: the beam model's reference.

With lengths over the span L, deflections over L^4 / EI and κ = k L^4 / EI the equation of each stretch is
v'''' + κ v = 1 under a uniform load (Winkler 1867; Hetényi, Beams on Elastic Foundation, 1946). Moment and
shear vanish at both ends of the beam, and v to v''' are continuous where stretches meet.

The solution on a stretch that is longer than its waves is a sum of waves that die away from either end, so none
overflows. On a shorter stretch these waves are nearly dependent, and power series that tend to 1, x, x²/2, x³/6 replace
them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.foundation.beam import Stretch, beam_of, require_beam
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample

Array = NDArray[np.float64]

# κ times the fourth power of the length, up to which series replace the waves; they lose no digit there.
SHORT = 20.0
TERMS = 12


def exact_force_ratio(design: Design, sensed: Sample) -> float:
    """Tooth force over total force.

    Raises:
        RangeError: the modulus or thickness of the object is not positive and finite.
    """
    tooth, ring = exact_forces(*beam_of(design, sensed.modulus, sensed.thickness))
    return tooth / (tooth + ring)


def exact_forces(bending: float, beam: Sequence[Stretch]) -> list[float]:
    """Foundation force below each stretch [N] for a load of 1 N/m.

    Args:
        bending: bending stiffness [N m2].
        beam: stretches from one free end to the other.

    Raises:
        RangeError: bending stiffness, a length or a foundation is not positive and finite.
    """
    require_beam(bending, beam)
    span = math.fsum(stretch.length for stretch in beam)
    lengths = [stretch.length / span for stretch in beam]
    # (start or end, order of derivative, four functions and the particular solution)
    modes = [
        _modes(stretch.foundation * span**4 / bending, length) for stretch, length in zip(beam, lengths, strict=True)
    ]
    size = 4 * len(beam)
    matrix, right = np.zeros((size, size)), np.zeros(size)
    matrix[:2, :4], right[:2] = modes[0][0, 2:, :4], -modes[0][0, 2:, 4]
    matrix[-2:, -4:], right[-2:] = modes[-1][1, 2:, :4], -modes[-1][1, 2:, 4]
    for index in range(len(beam) - 1):
        before, after = modes[index][1], modes[index + 1][0]
        rows = slice(2 + 4 * index, 6 + 4 * index)
        matrix[rows, 4 * index : 4 * index + 8] = np.hstack([before[:, :4], -after[:, :4]])
        right[rows] = after[:, 4] - before[:, 4]
    column = 1 / np.abs(matrix).max(axis=0)
    row = 1 / np.abs(matrix * column).max(axis=1)
    weights = (column * np.linalg.solve(row[:, None] * matrix * column, row * right)).reshape(-1, 4)
    forces = []
    for length, mode, weight in zip(lengths, modes, weights, strict=True):
        start, end = mode[:, 3, :4] @ weight + mode[:, 3, 4]
        forces.append(float(span * (length - (end - start))))
    return forces


def _modes(foundation: float, length: float) -> Array:
    return _series(foundation, length) if foundation * length**4 < SHORT else _waves(foundation, length)


def _waves(foundation: float, length: float) -> Array:
    """1/κ and two waves from either end, with their derivatives at both ends.

    The first wave has no moment at its end, the second no shear. On a limp stretch moment and shear differ so much in
    size that one would vanish in the other's rounding.
    """
    beta = (foundation / 4) ** 0.25
    modes = np.zeros((2, 4, 5))
    modes[:, 0, 4] = 1 / foundation
    for order in range(4):
        for end, x in enumerate((0.0, length)):
            for wave, (sign, away) in enumerate(((1, x), (-1, length - x))):
                value = (sign * beta) ** order * (-1 + 1j) ** order * np.exp(beta * (-1 + 1j) * away)
                modes[end, order, 2 * wave : 2 * wave + 2] = value.real, ((1 + 1j) * value).real
    return modes


def _series(foundation: float, length: float) -> Array:
    """Sums of (-κ)^n x^(4n+j) / (4n+j)! for j = 0 to 4, with their derivatives at both ends.

    The derivative of each sum is the sum before it; that of the first sum is -κ times the fourth.
    """
    modes = np.zeros((2, 4, 5))
    for end, x in enumerate((0.0, length)):
        value = [
            math.fsum((-foundation) ** n * x ** (4 * n + j) / math.factorial(4 * n + j) for n in range(TERMS))
            for j in range(5)
        ]
        for order in range(4):
            for j in range(5):
                modes[end, order, j] = value[j - order] if j >= order else -foundation * value[4 + j - order]
    return modes
