"""A beam on an elastic foundation: the two-dimensional theory of the thesis (equations 4.1 to 4.31).

The base plate over half the sensor, from the axis outwards, is a beam. It rests on one foundation under
the tooth (the object alone, for the tooth is rigid) and on another under the ring (object and ring in
series), and a uniform load presses on it. Hermite cubic elements, consistent foundation and load.

What is known of the program of Appendix A2.1, and what is reconstructed
------------------------------------------------------------------------
Printed and known: two elements of 1.4 and 3.5 mm; I = 5 mm (0.55 mm)^3 / 12; object thickness T1 = 0.55 mm
(the plate's, where the rubber has 3 mm); foundation constants A E / T, a stiffness in N/m put where N/m2
belongs; forces from end displacements; and `K = subs(K)`, which overwrites the symbolic stiffness in the
first pass of the loop over moduli, so that every later modulus meets the displacements of the first one,
1.49e4 Pa, with foundation constants of its own.

Reconstructed, by trying boundary conditions, loads, foundations and forces against two figures: both ends
free, no condition of symmetry at the axis; tooth force Kf1 v(axis), ring force Kf2 v(outer edge). At the
moduli of the six samples this gives

- as the only modulus of a run: 0.403 to 0.519, where 0.40 to 0.52 is to be met;
- after 1.49e4 Pa, as the program prints it: 0.640 to 0.882. With the slip no variant can meet 0.40 to 0.52:
  the foundation constants alone move the odds of tooth to ring by 4.2, and that range is 1.6 wide;
- with the rubber's 3 mm, integrated forces and each modulus solved: 0.137 to 0.243, within 4.7 % rms of the
  theory that Table 5.8 implies, experiment / (1 + error) at 3 N with 0.3136 for sample 1 (4.9 % with the
  0.329 that is printed; 10.0 % if the error is relative to the experiment). With zero slope at the axis it
  would be 35 %.

`printed_ratios` is the program; `force_ratio` is its corrected form, in three points: the object's own
thickness, integrated forces, each modulus solved. Free ends and the constants A E / T stay, because
Table 5.8 has them. The constant's slip hardly shows: against this foundation the beam is nearly rigid, and
A E / T per beam length, which has the right dimension, changes the ratio by less than 0.4 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from instrument.design import Design
from instrument.limits import require_positive
from instrument.models.springs import stretch_stiffness
from instrument.sample import Sample

Array = NDArray[np.float64]

PRINTED_FIRST_MODULUS = 1.49e4
ELEMENTS = 16


@dataclass(frozen=True, slots=True)
class Stretch:
    """A length of beam [m] on a foundation [N/m2: force per length of beam and deflection]."""

    length: float
    foundation: float


def force_ratio(design: Design, sensed: Sample) -> float:
    """Tooth force over total force, corrected form, 16 elements a stretch."""
    tooth, ring = stretch_forces(bending(design), stretches(design, sensed.modulus, sensed.thickness), ELEMENTS)
    return tooth / (tooth + ring)


def printed_force_ratio(design: Design, sensed: Sample) -> float:
    """Tooth force over total force, as the program prints it for a modulus that is not its first.

    The object's own thickness is not looked at: the program has the plate's.
    """
    return printed_ratios(design, (PRINTED_FIRST_MODULUS, sensed.modulus))[1]


def printed_ratios(design: Design, moduli: Sequence[float]) -> list[float]:
    """Force ratios that the program of Appendix A2.1 prints for its series of moduli [Pa].

    The first is solved; all later ones keep its displacements. A first modulus of 0.3 MPa or more
    lifts the beam at the axis, and what is printed is no ratio between 0 and 1 any more.
    """
    thickness = design.plate.thickness
    deflection, _ = deflections(bending(design), stretches(design, moduli[0], thickness), elements=1)
    ratios = []
    for modulus in moduli:
        tooth, ring = stretches(design, modulus, thickness)
        force_tooth, force_ring = tooth.foundation * deflection[0], ring.foundation * deflection[2]
        ratios.append(float(force_tooth / (force_tooth + force_ring)))
    return ratios


def bending(design: Design) -> float:
    """Bending stiffness EI of the beam: half the plate's width [N m2]."""
    plate = design.plate
    return plate.material.modulus * plate.width / 2 * plate.thickness**3 / 12


def stretches(design: Design, modulus: float, thickness: float) -> tuple[Stretch, Stretch]:
    """Tooth and ring below an object of that modulus [Pa] and thickness [m], with A E / T per metre."""
    tooth, ring, _ = stretch_stiffness(design, modulus, thickness)
    width = design.ring.outer_radius - design.ring.inner_radius
    return Stretch(design.tooth.radius, tooth), Stretch(width, ring)


def stretch_forces(bending: float, beam: Sequence[Stretch], elements: int) -> list[float]:
    """Foundation force below each stretch [N] for a load of 1 N/m, by exact integration of the elements.

    Args:
        bending: bending stiffness [N m2].
        beam: stretches from one free end to the other.
        elements: Hermite cubic elements in each stretch.

    Converges with the fourth power of the element length.
    """
    deflection, slope = deflections(bending, beam, elements)
    forces = []
    for index, stretch in enumerate(beam):
        h, first = stretch.length / elements, index * elements
        v, t = deflection[first : first + elements + 1], slope[first : first + elements + 1]
        area = h * (v[:-1] + v[1:]) / 2 + h**2 * (t[:-1] - t[1:]) / 12
        forces.append(float(stretch.foundation * area.sum()))
    return forces


def deflections(bending: float, beam: Sequence[Stretch], elements: int) -> tuple[Array, Array]:
    """Nodal deflections [m] and slopes of a beam with free ends under 1 N/m, each of len(beam) * elements + 1.

    Raises:
        RangeError: bending stiffness, a length or a foundation is not positive and finite.
    """
    require_beam(bending, beam)
    lengths = np.repeat([stretch.length / elements for stretch in beam], elements)
    foundations = np.repeat([stretch.foundation for stretch in beam], elements)
    span = float(lengths.sum())
    nodes = np.concatenate([[0.0], np.cumsum(lengths / span)])
    size = 2 * len(nodes)
    stiff, springs, load = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    for index, (h, foundation) in enumerate(zip(lengths / span, foundations, strict=True)):
        span_of = slice(2 * index, 2 * index + 4)
        stiff[span_of, span_of] += _bending_matrix(h) * (bending / span**3)
        springs[span_of, span_of] += _foundation_matrix(h) * (foundation * span)
        load[span_of] += np.array([h / 2, h**2 / 12, h / 2, -(h**2) / 12]) * span

    # Unknowns: heave, tilt, and the deflection from the tangent at the axis. A soft foundation is a
    # billionth of the bending stiffness; with rigid motion apart, bending cannot drown it in rounding.
    basis = np.eye(size)
    basis[0::2, 0], basis[1::2, 0] = 1, 0
    basis[0::2, 1], basis[1::2, 1] = nodes, 1
    matrix = basis.T @ springs @ basis
    matrix[2:, 2:] += stiff[2:, 2:]
    scale = 1 / np.sqrt(np.diag(matrix))
    unknowns = scale * np.linalg.solve(matrix * np.outer(scale, scale), scale * (basis.T @ load))
    motion = basis @ unknowns
    return motion[0::2], motion[1::2] / span


def require_beam(bending: float, beam: Sequence[Stretch]) -> None:
    """Raises RangeError: bending stiffness, a length or a foundation is not positive and finite."""
    require_positive(bending, "bending stiffness", "N m2", "beam")
    for stretch in beam:
        require_positive(stretch.length, "length of a stretch", "m", "beam")
        require_positive(stretch.foundation, "foundation of a stretch", "N/m2", "beam")


def _bending_matrix(h: float) -> Array:
    return np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h**2, -6 * h, 2 * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h**2, -6 * h, 4 * h**2],
        ]
    ) / h**3  # fmt: skip


def _foundation_matrix(h: float) -> Array:
    return (
        np.array(
            [
                [156, 22 * h, 54, -13 * h],
                [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                [54, 13 * h, 156, -22 * h],
                [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
            ]
        )
        * h
        / 420
    )
