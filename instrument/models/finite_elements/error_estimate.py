"""Bounds on the errors of force ratio and voltages on a mesh, from the curves of two meshes.

The change from one mesh to the next is no bound. As functions of the object's modulus, the ratios of two meshes cross;
there the change is zero while the error is not. Energies do not cross. The force ratio is the work of the load on a
jump, the object raised by 1 from the teeth. On nested meshes such a work changes by at most √(ΔJ ΔJ'), where J and J'
are twice the energies under the load and by the jump (Cauchy and Schwarz). That is about the error of the coarser mesh.
Pressures are projected, and meshes around a circle are not quite nested; so a bound is the greater of change and
product, over a window of the modulus (`python -m tests.benchmarks estimates solid`).

For a voltage the same kind of product would be a thousand times the error, because a film's own energy lies at its
edges. So four times the greatest change of any voltage counts for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.poles import Curve

Array = NDArray[np.float64]

# Factor on the greatest change of a voltage; no error was more than a third of the result.
VOLTAGE_SAFETY = 4.0
# Meshes are compared at moduli of a fixed grid: within half a decade of the one that is asked, and next to these. Where
# two meshes cross at one modulus, they do not at all of these.
STEPS, REACH = 8, 4  # of the grid in a decade, and on either side


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds on the errors of the last of some meshes: of the force ratio, and of any film's voltage [V]."""

    force_ratio: float
    voltage: float


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
