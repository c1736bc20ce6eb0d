"""The program of Appendix A2.1, as it is printed: the beam of section 4.1 in two elements, with the program's slips.

The scan damages many characters. `instrument/thesis/program_A2_1.csv` has each repaired line with the reason. It also
has the lines that are wrong in the program itself. These are kept here as they are:

- T1 = 0.55 mm is taken for the thickness of the object, but is that of the plate;
- the tooth's force is Kf1 times the deflection at the axis, the ring's Kf2 times that of the outer end: one deflection
  counts for a whole stretch;
- `K = subs(K)` puts the first modulus of the loop into K. No symbol is left in it, so every later modulus uses the
  displacements of the first one, with foundation constants of its own.

The frozen K changes the curve. The program goes from 14.9 kPa to 1.41 MPa in steps of 0.1 MPa, and prints ratios that
rise from 0.53 over 0.88 to 0.99: the odds of tooth to ring grow as Kf1 / Kf2, a straight line in the modulus. If K were
renewed, it would print 0.53, 0.39, 0.22, -0.08 and so on to -3.3, then 9.5 down to 1.3: from 0.3 MPa on the free end at
the axis lifts off, and its deflection counts for the whole tooth. The slip thus makes a wrong curve look plausible. At
the six samples' moduli the program has 0.63 to 0.88, where Table 5.8 implies 0.13 to 0.24.
"""

from __future__ import annotations

from collections.abc import Sequence

from palpate.instrument.models.foundation.beam import Stretch, beam_of, deflections
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample

FIRST_MODULUS = 1.49e4
# The program's loop over moduli begins here [Pa].
SERIES = tuple(FIRST_MODULUS + 1e5 * step for step in range(15))


def force_ratio(design: Design, sensed: Sample) -> float:
    """Tooth force over total force, as the program prints it for a modulus that is not its first.

    The object's thickness has no effect, because the program takes the plate's.
    """
    return ratios(design, (FIRST_MODULUS, sensed.modulus))[1]


def ratios(design: Design, moduli: Sequence[float], frozen: bool = True) -> list[float]:
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
        deflection, _ = deflections(*_beam(design, moduli[0] if frozen else modulus), elements=1)
        _, (tooth, ring) = _beam(design, modulus)
        force_tooth, force_ring = tooth.foundation * deflection[0], ring.foundation * deflection[2]
        found.append(float(force_tooth / (force_tooth + force_ring)))
    return found


def _beam(design: Design, modulus: float) -> tuple[float, tuple[Stretch, Stretch]]:
    bending, (tooth, ring) = beam_of(design, modulus, design.plate.thickness)
    return bending, (tooth, Stretch(design.ring.outer_radius - design.ring.inner_radius, ring.foundation))
