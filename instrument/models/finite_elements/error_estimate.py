"""Bounds on the errors of force ratio and voltages on a mesh, from its curve and those of coarser meshes.

The change from one mesh to the next is no bound. As functions of the object's modulus, the ratios of two meshes cross;
there the change is zero while the error is not. Energies do not cross. The force ratio is the work of the load on a
jump, the object raised by 1 from the teeth. On nested meshes such a work changes by at most √(ΔJ ΔJ'), where J and J'
are twice the energies under the load and by the jump (Cauchy and Schwarz). That is about the error of the coarser mesh.
Pressures are projected, and meshes around a circle are not quite nested; so a bound is the greater of change and
product, over a window of the modulus (`python -m tests.benchmarks estimates estimates_solid`).

Two meshes may also agree because the finer one has more layers where the degree leaves most. So no bound falls below a
share of the bound before.

For a voltage the same kind of product would be a thousand times the error, because a film's own energy lies at its
edges. So the greatest change of any voltage, several times, counts for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.poles import Curve

Array = NDArray[np.float64]

# Meshes are compared at moduli of a fixed grid: so many in a decade, as far as half a decade from the one that is asked
# or further, and next to these. Where two meshes cross at one modulus, they do not at all of these.
STEPS, HALF_DECADE = 8, 4


@dataclass(frozen=True, slots=True)
class Manner:
    """How errors fall from mesh to mesh.

    Attributes:
        product: share of the product of energies that counts beside the change.
        factors: factors on the greater of both from each mesh to the next; the last one counts for all further meshes.
        voltages: the same on the greatest change of any voltage.
        luck: least bound over the bound before: two meshes may agree by luck, or because the finer one is finer only
            in what does not matter.
        falls: whether errors are known to fall at the rate of the last two results, so that the root of this rate
            counts, too. The product is about the error of the coarser mesh, that of the finer one is less by the rate.
        reach: how far away moduli count, in steps of the grid.
    """

    product: float
    factors: tuple[float, ...]
    voltages: tuple[float, ...]
    luck: float
    falls: bool = False
    reach: int = HALF_DECADE


SLOWEST = 0.9  # greatest rate at which errors are believed to fall; a least one would never count beside `luck`


def estimates(curves: Sequence[Curve], moduli: Array, manner: Manner, safety: float = 1.0) -> tuple[Array, Array]:
    """Bounds on the errors of force ratio and voltages [V] of the last of two or more meshes, each finer than the one
    before.

    That of the ratio comes from the greatest change of it between two meshes, or product of energies, over some of the
    modulus on either side, in a `Manner`. That of the voltages is likewise the greatest change of any, times a factor.
    More moduli cost next to nothing.

    Args:
        curves: the curves of the meshes.
        moduli: moduli of the object [Pa].
        manner: how errors fall.
        safety: factor on the bounds.
    """
    around = _around(moduli, manner.reach)
    ratio, voltage, before = np.zeros(len(moduli)), np.zeros(len(moduli)), None
    for step, (coarse, fine) in enumerate(pairwise(curves)):
        greatest, volts = (_greatest(each, around) for each in _changes(coarse, fine, around.grid, manner.product))
        found = _of_step(manner.factors, step) * greatest
        if manner.falls and before is not None:
            rate = np.minimum(np.divide(greatest, before, out=np.ones_like(before), where=before > 0), SLOWEST)
            found *= np.maximum(np.sqrt(rate), rate / (1 - rate))
        ratio = np.maximum(safety * found, manner.luck * ratio)
        voltage = np.maximum(safety * _of_step(manner.voltages, step) * volts, manner.luck * voltage)
        before = greatest
    return ratio, voltage


def _of_step(factors: Sequence[float], step: int) -> float:
    return factors[min(step, len(factors) - 1)]


def differences(one: Curve, other: Curve, moduli: Array, factor: float) -> tuple[Array, Array]:
    """Greatest differences of force ratios and voltages [V], over half a decade around each modulus [Pa].

    Args:
        one, other: the curves.
        moduli: moduli of the object.
        factor: how many times the other's voltages are to be taken.
    """
    around = _around(moduli, HALF_DECADE)
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


def _around(moduli: Array, reach: int) -> _Around:
    places = STEPS * np.log10(moduli)
    first, last = np.floor(places).astype(np.intp) - reach, np.ceil(places).astype(np.intp) + reach
    start, stop = (int(first.min()), int(last.max()) + 1) if len(moduli) else (0, 1)
    return _Around(10.0 ** (np.arange(start, stop) / STEPS), first - start, last - start)


def _greatest(values: Array, around: _Around) -> Array:
    """The greatest value from `first` to `last`, for each pair."""
    # Places between two points of the grid have one more of them than those on a point.
    most = int((around.last - around.first).max(initial=0)) + 1
    places = np.minimum(around.first[:, None] + np.arange(most), around.last[:, None])
    found: Array = values[places].max(axis=1)
    return found
