"""Bounds on the errors of force ratio and voltages on a mesh, from the coarser meshes before it.

The change from one mesh to the next is no bound. As functions of the object's modulus, the ratios of two meshes cross;
there the change is zero while the error is not. Energies do not cross. The force ratio is the work of the load on a
jump, the object raised by 1 from the teeth. On nested meshes such a work changes by at most √(ΔJ ΔJ'), where J and J'
are twice the energies under the load and by the jump (Cauchy and Schwarz). Meshes here are not quite nested, and
pressures are projected; so a bound is 1.5 times the greater of change and product.

For a voltage the same kind of product would be a thousand times the error, because a film's own energy lies at its
edges. So four times the greatest change of any voltage counts for each. Since all voltages may cross at once, the
greatest voltage times √(ΔJ/J) counts as well, the share by which the whole solution still changes. Of random sensors
the worst error was 0.47 of that, on the two coarsest meshes of the solid model (`python -m tests.benchmarks
estimates`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.poles import Curve

Array = NDArray[np.float64]

# Factor on the greater of change and product of energies. On three meshes or more, no random sensor's error was more
# than half of the result (`python -m tests.benchmarks estimates`).
SAFETY = 1.5
# Least bound over the bound before: two meshes may agree by luck.
LUCK = 0.1
# Factor where tooth and ring meet in a closed gap, because the error only halves from mesh to mesh there.
SLOW = 3.0
# Factor on the greatest change of a voltage; no error was more than a third of the result.
VOLTAGE_SAFETY = 4.0


@dataclass(frozen=True, slots=True)
class Energies:
    """Twice the energies on one mesh.

    Attributes:
        load: twice the energy under 1 N [J]; None: under a point load, which stores no finite energy.
        jump: twice the energy by the jump over the teeth by 1 m [J].
    """

    load: float | None
    jump: float


@dataclass(frozen=True, slots=True)
class Judged:
    """Results of one mesh from which errors are estimated.

    Attributes:
        force_ratio: tooth force over total force.
        voltages: voltages of the films under 1 N [V].
        energies: energies under the load and by the jump.
        imbalance: imbalance of the forces, over the total force.
    """

    force_ratio: float
    voltages: tuple[float, ...]
    energies: Energies
    imbalance: float = 0.0


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds on the errors of the last of some meshes: of the force ratio, and of any film's voltage [V]."""

    force_ratio: float
    voltage: float


def bounds(meshes: Sequence[Judged], slowly: bool, safety: float = SAFETY) -> Bounds:
    """Bounds on the errors of the finest of two or more meshes, from how results change from mesh to mesh.

    Args:
        meshes: results of the meshes, each finer than the one before.
        slowly: whether errors fall slowly as the mesh is refined, as they do where a gap is closed.
        safety: factor on the force ratio's change from one mesh to the next, or on the bound of this change by the
            energies if that is greater.
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
    """Share of the solution, by its energy, that the finer mesh changes; 0 under a point load."""
    if coarse.load is None or fine.load is None:
        return 0.0
    return math.sqrt(abs(fine.load - coarse.load) / fine.load)


def _product(coarse: Energies, fine: Energies) -> float:
    """Bound on the change of the force ratio; 0 under a point load."""
    if coarse.load is None or fine.load is None:
        return 0.0
    return math.sqrt(abs(fine.load - coarse.load) * abs(fine.jump - coarse.jump))


# --- from curves over the modulus of the object -----------------------------------------------------------

# Meshes are compared at moduli of a fixed grid: within half a decade of the one that is asked, and next to these. Where
# two meshes cross at one modulus, they do not at all of these.
STEPS, REACH = 8, 4  # of the grid in a decade, and on either side


def estimate(curves: Sequence[Curve], modulus: float, safety: float = 1.0) -> Bounds:
    """Bounds on the errors of the last of two or more meshes at one modulus of the object [Pa]; see `estimates`."""
    ratio, voltage = estimates(curves, np.array([modulus]), safety)
    return Bounds(float(ratio[0]), float(voltage[0]))


def estimates(curves: Sequence[Curve], moduli: Array, safety: float = 1.0) -> tuple[Array, Array]:
    """Bounds on the errors of force ratio and voltages [V] of the last of two or more meshes, each finer than the one
    before.

    The greatest change of the force ratio between the last two meshes and the greatest product of energies, over half a
    decade of the modulus on either side; and likewise the change of any voltage. More moduli cost next to nothing.

    Args:
        curves: the curves of the meshes.
        moduli: moduli of the object [Pa].
        safety: factor on the bounds of the force ratio.
    """
    coarse, fine = curves[-2:]
    places = STEPS * np.log10(moduli)
    first, last = np.floor(places).astype(np.intp) - REACH, np.ceil(places).astype(np.intp) + REACH
    start = int(first.min(initial=0))
    grid = 10.0 ** (np.arange(start, int(last.max(initial=start)) + 1) / STEPS)
    change = np.abs(fine.force_ratios(grid) - coarse.force_ratios(grid)).max(axis=1)
    (load, jump), (finer_load, finer_jump) = coarse.energies(grid), fine.energies(grid)
    product = np.sqrt(np.abs(finer_load - load).max(axis=1) * np.abs(finer_jump - jump))
    voltages = np.abs(fine.voltages(grid) - coarse.voltages(grid)).max(axis=(1, 2), initial=0.0)
    ratio, voltage = (
        _greatest_around(each, first - start, last - start) for each in (np.maximum(change, product), voltages)
    )
    return safety * ratio, VOLTAGE_SAFETY * voltage


def _greatest_around(values: Array, first: NDArray[np.intp], last: NDArray[np.intp]) -> Array:
    """The greatest value from `first` to `last`, for each pair."""
    # Places between two points of the grid have one more of them than those on a point.
    found: Array = values[np.minimum(first[:, None] + np.arange(2 * REACH + 2), last[:, None])].max(axis=1)
    return found
