"""Prices of the finite-element models, refinement by refinement."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.parameter_sets import PHYSICAL
from palpate.instrument.models.parameters import RoundParameters
from palpate.instrument.models.prices.price import Price
from palpate.instrument.models.solid import model as solid
from palpate.instrument.sensor.design import Design
from palpate.procedures.accuracy.meshes import (
    COARSEST,
    MIDDLES,
    MODULI,
    TIMED,
    Mesh,
    Results,
    Solved,
    Values,
    refinements,
)
from palpate.procedures.accuracy.references import Truth

Array = NDArray[np.float64]
Intervals = tuple[float | None, ...]


def element_prices(
    design: Design, truth: Truth, between: Callable[[Array], Array], surface_errors: Sequence[float], solved: Results
) -> Iterator[Price]:
    """Prices of every refinement of the axisymmetric and of the solid model.

    Args:
        design: the sensor.
        truth: the reference.
        between: force ratios by the design's surface at moduli of the object [Pa], where there is no finer mesh.
        surface_errors: errors of the surface, in each interval.
        solved: solutions on all meshes.
    """
    middles, uncertain = truth.middles, truth.middle_uncertainties
    if not middles:
        middles, uncertain = between(np.array(MIDDLES)).tolist(), surface_errors
    for name, family in refinements(design, PHYSICAL.load(TIMED)).items():
        spent = 0.0
        own: list[Mesh] = []
        for mesh in family:
            found = solved[mesh]
            errors = by_interval(errors_of(_ratios(mesh, solved, MODULI), truth))
            if name == "axisymmetric":
                inside = _apart(_ratios(mesh, solved, MIDDLES), middles, uncertain)
                errors = tuple(_greater(*pair) for pair in zip(errors, inside, strict=True))
            if mesh.refinement != COARSEST:
                own.append(mesh)
                spent += sum(found.seconds)
            estimates = [_estimate(own, [solved[m.at(modulus)] for m in own]) for modulus in MODULI]
            build, solve, evaluate = (None, None, None) if found.failure else found.seconds
            yield Price(
                design=design.name,
                model=name,
                refinement="coarser still" if mesh.refinement == COARSEST else f"refinement {mesh.refinement}",
                errors=errors,
                estimates=by_interval(estimates),
                build_s=build,
                solve_s=solve,
                evaluate_s=evaluate,
                answer_s=None if None in estimates else spent,
                failure=found.failure,
            )


def errors_of(ratios: Values, truth: Truth) -> Values:
    """Errors of force ratios at MODULI, with the reference's uncertainty added."""
    return _apart(ratios, truth.reference.force_ratios, truth.reference.uncertainties)


def by_interval(values: Values) -> Intervals:
    """The greater of each two neighbours, from values at the moduli."""
    return tuple(_greater(*pair) for pair in itertools.pairwise(values))


def _greater(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else max(one, other)


def _apart(ratios: Values, truth: Values, uncertainties: Values) -> Values:
    return [
        None if ratio is None or true is None or u is None else abs(ratio - true) + u
        for ratio, true, u in zip(ratios, truth, uncertainties, strict=True)
    ]


def _estimate(meshes: Sequence[Mesh], results: Sequence[Solved]) -> float | None:
    """Error estimate that a model would give for the last of some refinements; None: it would not stop there."""
    if len(results) < 2:
        return None
    curves = [result.curve for result in results if result.curve is not None]
    if len(curves) < len(results):
        return None
    parameters = meshes[0].parameters
    moduli = np.array([parameters.sensed_modulus])
    if isinstance(parameters, RoundParameters):
        bounds, _ = axisymmetric.estimates(curves, parameters, moduli)
    else:
        bounds, _ = solid.estimates(curves, parameters, moduli)
    return float(bounds[0])


def _ratios(mesh: Mesh, solved: Results, moduli: Sequence[float]) -> Values:
    return [solved[mesh.at(modulus)].force_ratio for modulus in moduli]
