"""Converged force ratios against which errors are measured, each checked by a second method."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.parameters import PHYSICAL
from palpate.instrument.models.price_list import ReferenceRatios, fingerprint
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.procedures.accuracy.meshes import (
    MODULI,
    TIMED,
    MeshedProblem,
    Results,
    references,
    refinements,
)

Array = NDArray[np.float64]

# What the limit of so many meshes may leave unseen of the priced designs, all of one tooth, ring and gap: of the single
# sensor the second of many teeth is 5e-4 from the limit, and the third of few teeth 2e-5.
UNSEEN = {2: 1e-3, 3: 5e-5}


def reference_of(design: Design, solved: Results) -> ReferenceRatios:
    """Reference by a round design's finest mesh, or by the limit of the solid model's refinements."""
    if design.outline == "round":
        return _round(design, solved)
    load = PHYSICAL.load(TIMED)
    limit, left, count = _limit(design, solved)
    (second,) = references(design, load)
    other = solved[second.at(TIMED)]
    if other.force_ratio is None:
        apart, checked = 0.0, f"not checked by a finer or other mesh: {other.failure}"
    else:
        apart = abs(other.force_ratio - limit[MODULI.index(TIMED)])
        way = "a finer mesh" if len(design.teeth) > 2 else "elements of another degree and grading"
        checked = f"{way} by {apart:.0e} at {show(TIMED, 'Pa', 3)}"
    unseen = UNSEEN[count]
    how = f"solid, limit of its refinements up to {count - 1}: the last differs by {left.max():.0e} at most, {checked}"
    return _reference(design, solved, limit, np.maximum(left, max(apart, unseen)), how)


def _round(design: Design, solved: Results) -> ReferenceRatios:
    load = PHYSICAL.load(TIMED)
    mesh, second_way = references(design, load)
    coarser_mesh = refinements(design, load)["axisymmetric"][-1]

    def at(of: MeshedProblem) -> Array:
        return np.array([solved[of.at(modulus)].force_ratio for modulus in MODULI], dtype=np.float64)

    ratios, second = at(mesh), at(second_way)
    coarser = np.abs(ratios - at(coarser_mesh))
    limit, _, _ = _limit(design, solved)
    how = (
        f"axisymmetric, refinement {mesh.refinement}: the plain displacement form differs by"
        f" {np.abs(ratios - second).max():.0e} at most, refinement {axisymmetric.REFINEMENTS[-1]} by"
        f" {coarser.max():.0e}, the limit of the solid model by {np.abs(ratios - limit).max():.0e}"
    )
    return _reference(design, solved, ratios, np.maximum(np.abs(ratios - second), coarser), how)


def _reference(design: Design, solved: Results, ratios: Array, uncertainties: Array, how: str) -> ReferenceRatios:
    load = PHYSICAL.load(TIMED)
    own = [solved[mesh.at(modulus)] for mesh in references(design, load) for modulus in mesh.moduli]
    return ReferenceRatios(
        design=design.name,
        fingerprint=fingerprint(design, load),
        force_ratios=tuple(ratios.tolist()),
        uncertainties=tuple(uncertainties.tolist()),
        how=how,
        seconds=math.fsum(math.fsum(each.seconds) for each in own),
    )


def _limit(design: Design, solved: Results) -> tuple[Array, Array, int]:
    """Limit of the solid model's refinements, the remaining distance to it, and the number of solved refinements.

    From three on the changes go on falling alike. The second of two is left with a third of the first one's error or
    less: with none to half of the change, a quarter for both.
    """
    own = refinements(design, PHYSICAL.load(TIMED))["solid"]
    found = [[solved[mesh.at(modulus)].force_ratio for modulus in MODULI] for mesh in own]
    known = np.array([ratios for ratios in found if None not in ratios], dtype=np.float64)
    *before, change = np.diff(known, axis=0)
    left = change / 4
    if before:
        falling = np.divide(change, before[-1], out=np.full_like(change, 0.5), where=before[-1] != 0).clip(0.1, 0.5)
        left = change * falling / (1 - falling)
    return known[-1] + left, np.abs(left), len(known)
