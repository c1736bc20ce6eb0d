"""A beam on an elastic foundation: the two-dimensional theory of the thesis (sections 4.1 and 4.5.1).

The sensed object over half the sensor, from the axis outwards, is a beam (equation 4.1). Over the tooth its foundation
is the object's own compression, since the tooth is rigid. Over the ring its foundation is the compression of object and
ring in series (4.17 to 4.21). A uniform load presses on it. Elements are Hermite cubic, with consistent foundation and
load.

The program of Appendix A2.1 (`printed_force_ratio`) departs from section 4.1, and does not print the curve that the
thesis shows. `force_ratio` differs from the program in four points (rows of `instrument/thesis/program_A2_1.csv`):

- T1 is the object's thickness, 3 mm; the program has the plate's, 0.55 mm;
- the force of a stretch is integrated over its foundation; the program takes the deflection of one end for all of it;
- K is assembled anew for each modulus; the program's `K = subs(K)` keeps that of the first modulus;
- the beam reaches to the edge of the sensor, so that its outer stretch is 3.6 mm; the program's outer stretch is as
  long as the ring is wide, 3.5 mm, and leaves out the gap.

At the samples' moduli this meets the theory that Table 5.8 implies to 2.4 % rms. The mean error of the experiments is
19.5 %, where the table has 20.08 %. With 3.5 mm these are 4.5 % rms and 15.9 %. Thickness and length were chosen to
meet that table, so the agreement does not prove that the thesis was computed in this way.

Two errors stay because Table 5.8 has them. Both ends are free, although symmetry asks for zero slope at the axis. The
foundation constant A E / T is a force per deflection (N/m), although a force per deflection and length of beam (N/m2)
is needed; so the result holds for lengths in metres only. Divided by the length of its stretch, the constant would have
the right dimension, and the ratio would be 0.23 to 0.31, where the table implies 0.13 to 0.24.

Bending stiffness and foundation both grow with the object's modulus. So the ratio depends on thickness and area alone
where the ring is much harder than the object (0.071 for the single sensor), and tends to 1 under a hard object. A beam
much thinner than 0.1 mm bends within less than an element: `beam_exact` gives its ratio, and this model misses it by
1e-3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.models.springs import stretch_stiffness
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample, require_positive

ELEMENTS = 16


@dataclass(frozen=True, slots=True)
class BeamSegment:
    """A length of beam [m] on a foundation [N/m2: force per length of beam and deflection]."""

    length: float
    foundation: float


def force_ratio(design: Design, sensed: Sample) -> float:
    """Tooth force over total force, with 16 elements in each stretch."""
    return ratio_of(*beam_of(design, sensed.modulus, sensed.thickness), ELEMENTS)


def ratio_of(bending: float, beam: Sequence[BeamSegment], elements: int) -> float:
    """Force below the first stretch over the force below all; arguments as in `stretch_forces`."""
    forces = stretch_forces(bending, beam, elements)
    return forces[0] / sum(forces)


def beam_of(design: Design, modulus: float, thickness: float) -> tuple[float, tuple[BeamSegment, BeamSegment]]:
    """Bending stiffness [N m2] of an object with this modulus [Pa] and thickness [m], and its stretches.

    Raises:
        RangeError: the modulus or the thickness is not positive and finite.
    """
    tooth, ring, _ = stretch_stiffness(design, modulus, thickness)
    outer = design.ring.outer_radius - design.tooth.radius
    return bending(design, modulus, thickness), (BeamSegment(design.tooth.radius, tooth), BeamSegment(outer, ring))


def bending(design: Design, modulus: float, thickness: float) -> float:
    """Bending stiffness E I of an object half as wide as the plate [N m2]."""
    return modulus * design.plate.width / 2 * thickness**3 / 12


def stretch_forces(bending: float, beam: Sequence[BeamSegment], elements: int) -> list[float]:
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


def deflections(bending: float, beam: Sequence[BeamSegment], elements: int) -> tuple[Floats, Floats]:
    """Deflections [m] and slopes at the nodes of a beam with free ends under 1 N/m, each (len(beam) * elements + 1,).

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

    # Unknowns: heave, tilt, and the deflection from the tangent at the axis. A soft foundation is a billionth of the
    # bending stiffness. With rigid motion as separate unknowns, rounding in the bending terms does not hide it.
    basis = np.eye(size)
    basis[0::2, 0], basis[1::2, 0] = 1, 0
    basis[0::2, 1], basis[1::2, 1] = nodes, 1
    matrix = basis.T @ springs @ basis
    matrix[2:, 2:] += stiff[2:, 2:]
    scale = 1 / np.sqrt(np.diag(matrix))
    unknowns = scale * np.linalg.solve(matrix * np.outer(scale, scale), scale * (basis.T @ load))
    motion = basis @ unknowns
    return motion[0::2], motion[1::2] / span


def require_beam(bending: float, beam: Sequence[BeamSegment]) -> None:
    """Check that bending stiffness, lengths and foundations are positive and finite. Raises RangeError."""
    require_positive(bending, "bending stiffness", "N m2", "beam")
    for stretch in beam:
        require_positive(stretch.length, "length of a stretch", "m", "beam")
        require_positive(stretch.foundation, "foundation of a stretch", "N/m2", "beam")


def _bending_matrix(h: float) -> Floats:
    return np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h**2, -6 * h, 2 * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h**2, -6 * h, 4 * h**2],
        ]
    ) / h**3  # fmt: skip


def _foundation_matrix(h: float) -> Floats:
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


# --- the program of Appendix A2.1, as it is printed ------------------------------------------------------

# The scan damages many characters. `instrument/thesis/program_A2_1.csv` has each repaired line with the reason. It also
# has the lines that are wrong in the program itself. These are kept here as they are:
#
# - T1 = 0.55 mm is taken for the thickness of the object, but is that of the plate;
# - the tooth's force is Kf1 times the deflection at the axis, the ring's Kf2 times that of the outer end: one
#   deflection counts for a whole stretch;
# - `K = subs(K)` puts the first modulus of the loop into K. No symbol is left in it, so every later modulus uses the
#   displacements of the first one, with foundation constants of its own.
#
# The frozen K changes the curve. The program goes from 14.9 kPa to 1.41 MPa in steps of 0.1 MPa, and prints ratios that
# rise from 0.53 over 0.88 to 0.99: the odds of tooth to ring grow as Kf1 / Kf2, a straight line in the modulus. If K
# were renewed, it would print 0.53, 0.39, 0.22, -0.08 and so on to -3.3, then 9.5 down to 1.3: from 0.3 MPa on the free
# end at the axis lifts off, and its deflection counts for the whole tooth. The slip thus makes a wrong curve look
# plausible. At the six samples' moduli the program has 0.63 to 0.88, where Table 5.8 implies 0.13 to 0.24.

FIRST_MODULUS = 1.49e4
# The program's loop over moduli begins here [Pa].
SERIES = tuple(FIRST_MODULUS + 1e5 * step for step in range(15))


def printed_force_ratio(design: Design, sensed: Sample) -> float:
    """Tooth force over total force, as the program prints it for a modulus that is not its first.

    The object's thickness has no effect, because the program takes the plate's.
    """
    return printed_ratios(design, (FIRST_MODULUS, sensed.modulus))[1]


def printed_ratios(design: Design, moduli: Sequence[float], frozen: bool = True) -> list[float]:
    """Force ratios that the program prints for a series of moduli [Pa].

    Args:
        design: the sensor.
        moduli: in the order of the program's loop [Pa].
        frozen: whether K keeps the first modulus, as printed; otherwise K is renewed for each modulus.

    Returns:
        One ratio for each modulus. Where the first modulus is 0.3 MPa or more, or K is not frozen, they may lie outside
        0 to 1, because the beam lifts off at the axis.

    Raises:
        RangeError: a modulus is not positive and finite.
    """
    found = []
    for modulus in moduli:
        deflection, _ = deflections(*_printed_beam(design, moduli[0] if frozen else modulus), elements=1)
        _, (tooth, ring) = _printed_beam(design, modulus)
        force_tooth, force_ring = tooth.foundation * deflection[0], ring.foundation * deflection[2]
        found.append(float(force_tooth / (force_tooth + force_ring)))
    return found


def _printed_beam(design: Design, modulus: float) -> tuple[float, tuple[BeamSegment, BeamSegment]]:
    bending, (tooth, ring) = beam_of(design, modulus, design.plate.thickness)
    return bending, (tooth, BeamSegment(design.ring.outer_radius - design.ring.inner_radius, ring.foundation))


# --- exact solution: the beam model's reference ----------------------------------------------------------

# With lengths over the span L, deflections over L^4 / EI and κ = k L^4 / EI the equation of each stretch is v'''' + κ v
# = 1 under a uniform load (Winkler 1867; Hetényi, Beams on Elastic Foundation, 1946). Moment and shear vanish at both
# ends of the beam, and v to v''' are continuous where stretches meet.
#
# The solution on a stretch that is longer than its waves is a sum of waves that die away from either end, so none
# overflows. On a shorter stretch these waves are nearly dependent, and power series that tend to 1, x, x²/2, x³/6
# replace them.

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


def exact_forces(bending: float, beam: Sequence[BeamSegment]) -> list[float]:
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


def _modes(foundation: float, length: float) -> Floats:
    return _series(foundation, length) if foundation * length**4 < SHORT else _waves(foundation, length)


def _waves(foundation: float, length: float) -> Floats:
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


def _series(foundation: float, length: float) -> Floats:
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
