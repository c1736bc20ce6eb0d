"""Bounds on the errors of force ratio and voltages on a mesh, from its curve and those of coarser meshes.

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
from itertools import pairwise

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
class Manner:
    """How errors fall from mesh to mesh.

    Attributes:
        product: share of the product of energies that counts beside the change.
        first: factor on the greater of both for two meshes alone.
        later: factor with more meshes.
        falls: whether errors are known to fall at the rate of the last two results, so that the root of this rate
            counts, too. The product is about the error of the coarser mesh, that of the finer one is less by the rate.
        luck: least bound over the bound before: two meshes may agree by luck.
    """

    product: float
    first: float
    later: float
    falls: bool
    luck: float


# Of the solid model, which has factors of its own.
PLAIN = Manner(product=1.0, first=1.0, later=1.0, falls=False, luck=0.0)
# Of the round model, for sensors that are special (`is_special`) and for all others. The numbers are not derived: with
# these the bounds hold for random sensors (`python -m tests.benchmarks estimates`). Two meshes of one of those sensors
# agreed by chance, and were off by 2.7 times a bound without `luck`.
REGULAR = Manner(product=0.3, first=0.7, later=1.4, falls=True, luck=0.05)
SPECIAL = Manner(product=1.0, first=2.0, later=1.0, falls=False, luck=0.1)
SLOWEST = 0.9  # greatest rate at which errors are believed to fall; a least one would never count beside `luck`
# Factor where tooth and ring meet in a closed gap, because the error only halves from mesh to mesh there.
SLOW = 3.0


def estimates(
    curves: Sequence[Curve], moduli: Array, manner: Manner = PLAIN, safety: float = 1.0
) -> tuple[Array, Array]:
    """Bounds on the errors of force ratio and voltages [V] of the last of two or more meshes, each finer than the one
    before.

    That of the ratio comes from the greatest change of it between two meshes, or product of energies, over half a
    decade of the modulus on either side, in a `Manner`. That of the voltages is likewise four times the change of any.
    More moduli cost next to nothing.

    Args:
        curves: the curves of the meshes.
        moduli: moduli of the object [Pa].
        manner: how errors fall.
        safety: factor on the bounds, for errors that fall slowly.
    """
    around = _around(moduli)
    ratio, voltage, before = np.zeros(len(moduli)), np.zeros(len(moduli)), None
    for coarse, fine in pairwise(curves):
        greatest, volts = (_greatest(each, around) for each in _changes(coarse, fine, around.grid, manner.product))
        if before is None:
            ratio = safety * manner.first * greatest
        elif manner.falls:
            rate = np.minimum(np.divide(greatest, before, out=np.ones_like(before), where=before > 0), SLOWEST)
            fallen = safety * manner.later * greatest * np.maximum(np.sqrt(rate), rate / (1 - rate))
            ratio = np.maximum(fallen, manner.luck * ratio)
        else:
            ratio = np.maximum(safety * manner.later * greatest, manner.luck * ratio)
        voltage = np.maximum(safety * VOLTAGE_SAFETY * volts, manner.luck * voltage)
        before = greatest
    return ratio, voltage


def differences(one: Curve, other: Curve, moduli: Array, factor: float) -> tuple[Array, Array]:
    """Greatest differences of force ratios and voltages [V], over half a decade around each modulus [Pa].

    Args:
        one, other: the curves.
        moduli: moduli of the object.
        factor: how many times the other's voltages are to be taken.
    """
    around = _around(moduli)
    ratio = np.abs(one.force_ratios(around.grid) - other.force_ratios(around.grid)).max(axis=1)
    voltages = np.abs(one.voltages(around.grid) - factor * other.voltages(around.grid))
    voltage = voltages.max(axis=(1, 2), initial=0.0)
    return _greatest(ratio, around), _greatest(voltage, around)


def _changes(coarse: Curve, fine: Curve, grid: Array, product: float) -> tuple[Array, Array]:
    """Change of the force ratio, or share of the product of energies, and change of any voltage [V]; on a grid."""
    change = np.abs(fine.force_ratios(grid) - coarse.force_ratios(grid)).max(axis=1)
    (load, jump), (finer_load, finer_jump) = coarse.energies(grid), fine.energies(grid)
    products = np.sqrt(np.abs(finer_load - load).max(axis=1) * np.abs(finer_jump - jump))
    volts = np.abs(fine.voltages(grid) - coarse.voltages(grid)).max(axis=(1, 2), initial=0.0)
    return np.maximum(change, product * products), volts


@dataclass(frozen=True, slots=True)
class _Around:
    """Moduli of the grid [Pa], and for each modulus that is asked the first and the last of these around it."""

    grid: Array
    first: NDArray[np.intp]
    last: NDArray[np.intp]


def _around(moduli: Array) -> _Around:
    places = STEPS * np.log10(moduli)
    first, last = np.floor(places).astype(np.intp) - REACH, np.ceil(places).astype(np.intp) + REACH
    start, stop = (int(first.min()), int(last.max()) + 1) if len(moduli) else (0, 1)
    return _Around(10.0 ** (np.arange(start, stop) / STEPS), first - start, last - start)


def _greatest(values: Array, around: _Around) -> Array:
    """The greatest value from `first` to `last`, for each pair."""
    # Places between two points of the grid have one more of them than those on a point.
    places = np.minimum(around.first[:, None] + np.arange(2 * REACH + 2), around.last[:, None])
    found: Array = values[places].max(axis=1)
    return found
