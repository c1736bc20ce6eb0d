"""Bounds on what a mesh leaves of force ratio and voltages, from the coarser meshes before it.

The change from one mesh to the next is no bound: over the modulus of the object the ratios of two meshes cross, and
there the change is nothing while the error is not. Energies do not cross. The force ratio is the work of the load on
a jump, the object raised by 1 from the teeth; on nested meshes the change of such a work is at most √(ΔJ ΔJ'), J and
J' being twice the energies under the load and by the jump (Cauchy and Schwarz). Meshes here are not quite nested, and
pressures are projected, so that the greater of change and product counts, and half as much again.

The same product is a thousand times the error of a voltage: a film's own energy is all at its edges. So the greatest
change of any voltage counts for each, four times; and, since all may cross at once, the greatest voltage times the
share √(ΔJ/J) by which the whole solution still moves: of random sensors the worst error was 0.47 of that, on the two
coarsest meshes of the solid model (`python -m tests.benchmarks estimates`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

# Of the greater of change and product of energies: of random sensors none took more than half of it on three meshes or
# more (`python -m tests.benchmarks estimates`).
SAFETY = 1.5
# Of the bound before, the least that the next may be: what both meshes say can be luck.
LUCK = 0.1
# Where tooth and ring meet in a closed gap, the error only halves from mesh to mesh.
SLOW = 3.0
# Of the greatest change of a voltage: none took more than a third.
VOLTAGE_SAFETY = 4.0


@dataclass(frozen=True, slots=True)
class Energies:
    """Twice the energies on one mesh.

    Attributes:
        load: under 1 N [J]; None: under a point load, which has none.
        jump: of the jump over the teeth by 1 m [J].
    """

    load: float | None
    jump: float


@dataclass(frozen=True, slots=True)
class Judged:
    """What one mesh gives.

    Attributes:
        force_ratio: tooth force over total force.
        voltages: of the films under 1 N [V].
        imbalance: of the forces, over the total force.
    """

    force_ratio: float
    voltages: tuple[float, ...]
    energies: Energies
    imbalance: float = 0.0


@dataclass(frozen=True, slots=True)
class Bounds:
    """On the errors of the last of some meshes: of the force ratio, and of any film's voltage [V]."""

    force_ratio: float
    voltage: float


def bounds(meshes: Sequence[Judged], slowly: bool, safety: float = SAFETY) -> Bounds:
    """From two or more meshes, each finer than the one before.

    Args:
        slowly: errors fall as in a closed gap.
        safety: how often the greater of change and product counts.
    """
    slow = SLOW if slowly else 1.0
    ratio = voltage = 0.0
    for coarse, fine in pairwise(meshes):
        changes = [abs(finer - coarser) for coarser, finer in zip(coarse.voltages, fine.voltages, strict=True)]
        greatest = max(abs(fine.force_ratio - coarse.force_ratio), _product(coarse.energies, fine.energies))
        ratio = max(safety * slow * greatest, LUCK * ratio)
        moving = _moving(coarse.energies, fine.energies) * max(map(abs, fine.voltages), default=0.0)
        voltage = max(VOLTAGE_SAFETY * slow * max(changes, default=0.0), slow * moving, LUCK * voltage)
    return Bounds(ratio, voltage)


def _moving(coarse: Energies, fine: Energies) -> float:
    """Share of the solution, by its energy, that the finer mesh has changed; 0 under a point load."""
    if coarse.load is None or fine.load is None:
        return 0.0
    return math.sqrt(abs(fine.load - coarse.load) / fine.load)


def _product(coarse: Energies, fine: Energies) -> float:
    """Bound on the change of the force ratio; 0 under a point load."""
    if coarse.load is None or fine.load is None:
        return 0.0
    return math.sqrt(abs(fine.load - coarse.load) * abs(fine.jump - coarse.jump))
