"""Refines a sensor's meshes until error estimates meet a tolerance, for many moduli of the object at once.

solve_at("solid", meshes, estimates, read, moduli, tolerance=1e-3)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError

Array = NDArray[np.float64]
M = TypeVar("M")  # what is known of a mesh over the modulus
S = TypeVar("S")  # answer of a mesh at one modulus
Estimates = Callable[[Sequence[M], Array], tuple[Array, Array]]
"""Bounds on the errors of force ratio and voltages of the last of two or more meshes, at each modulus."""


def solve_at(
    model: str,
    meshes: Iterable[M],
    estimates: Estimates[M],
    read: Callable[[M, Array, Array], Sequence[S]],
    moduli: Array,
    tolerance: float,
) -> list[tuple[S, float]]:
    """For each modulus the answer of the first mesh that meets the tolerance there, and its error estimate.

    No mesh is set up that no modulus needs.

    Args:
        model: name of the model.
        meshes: the meshes, each finer than the one before.
        estimates: bounds on the errors.
        read: function of mesh, moduli and bounds of voltages, which gives the answers.
        moduli: moduli of the object [Pa].
        tolerance: greatest error of the force ratio.

    Raises:
        RangeError: no mesh meets the tolerance.
    """
    known: list[M] = []
    found: dict[int, tuple[S, float]] = {}
    left, best = np.arange(len(moduli)), np.full(len(moduli), np.inf)
    for mesh in meshes:
        known.append(mesh)
        if len(known) == 1:
            continue
        ratio, voltage = estimates(known, moduli[left])
        good = ratio <= tolerance
        answers = read(mesh, moduli[left[good]], voltage[good])
        found.update(zip(left[good].tolist(), zip(answers, ratio[good].tolist(), strict=True), strict=True))
        left, best = left[~good], np.minimum(best[~good], ratio[~good])
        if not len(left):
            return [found[place] for place in range(len(moduli))]
    raise _out_of_reach(model, tolerance, float(best.max()))


def finest_to(
    model: str, meshes: Iterable[M], estimates: Estimates[M], moduli: Array, tolerance: float
) -> tuple[M, float]:
    """The first mesh that meets the tolerance at all moduli, and its greatest error estimate there.

    Raises:
        RangeError: no mesh meets the tolerance.
    """
    known: list[M] = []
    best = np.inf
    for mesh in meshes:
        known.append(mesh)
        if len(known) == 1:
            continue
        greatest = float(estimates(known, moduli)[0].max())
        if greatest <= tolerance:
            return mesh, greatest
        best = min(best, greatest)
    raise _out_of_reach(model, tolerance, best)


def _out_of_reach(model: str, tolerance: float, best: float) -> RangeError:
    return RangeError(
        f"model {model!r} cannot meet tolerance {tolerance:g}: its least error here is {best:.1e}; give a larger"
        " tolerance"
    )
