"""Prices of the finite-element models, refinement by refinement."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameter_sets import PHYSICAL
from palpate.instrument.models.parameters import Parameters, RoundParameters
from palpate.instrument.models.price_list import Price, ReferenceRatios
from palpate.instrument.models.solid import model as solid
from palpate.instrument.sensor.design import Design
from palpate.procedures.accuracy.meshes import (
    BETWEEN,
    MIDDLES,
    MODULI,
    TIMED,
    MeshedProblem,
    Results,
    Values,
    refinements,
)

Array = NDArray[np.float64]
Intervals = tuple[float | None, ...]


def element_prices(
    design: Design, truth: ReferenceRatios, middles: Values, surface_errors: Values, solved: Results
) -> Iterator[Price]:
    """Prices of every refinement of the axisymmetric and of the solid model.

    Args:
        design: the sensor.
        truth: the reference.
        middles: force ratios at MIDDLES by the design's surface.
        surface_errors: errors of the surface, in each interval.
        solved: solutions on all meshes.
    """
    for name, family in refinements(design, PHYSICAL.load(TIMED)).items():
        spent = 0.0
        own: list[MeshedProblem] = []
        for mesh in family:
            found = solved[mesh]
            errors = by_interval(errors_of(_ratios(mesh, solved, MODULI), truth))
            if name == "axisymmetric":
                inside = _apart(_ratios(mesh, solved, MIDDLES), middles, surface_errors)
                errors = tuple(_greater(*pair) for pair in zip(errors, inside, strict=True))
            own.append(mesh)
            spent += sum(found.seconds)
            estimates = _estimates([solved[each].curve for each in own], mesh.parameters)
            build, solve, evaluate = (None, None, None) if found.failure else found.seconds
            yield Price(
                design=design.name,
                model=name,
                refinement=f"refinement {mesh.refinement}",
                errors=errors,
                estimates=estimates,
                build_s=build,
                solve_s=solve,
                evaluate_s=evaluate,
                answer_s=None if None in estimates else spent + _beside(mesh.parameters, len(own)),
                failure=found.failure,
            )


def errors_of(ratios: Values, truth: ReferenceRatios) -> Values:
    """Errors of force ratios at MODULI, with the reference's uncertainty added."""
    return _apart(ratios, truth.force_ratios, truth.uncertainties)


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


def _estimates(found: Sequence[Curve | None], parameters: Parameters) -> Intervals:
    """Greatest error estimate in each interval that a model gives for the last of some refinements.

    Args:
        found: curves of all refinements from the first on; None: a mesh that could not be solved.
        parameters: the sensor; its modulus of the object has no effect.

    Returns: None in each interval where the model would not stop there, since it needs two meshes for an estimate.
    """
    curves = [each for each in found if each is not None]
    if len(curves) < max(2, len(found)):
        return (None,) * (len(MODULI) - 1)
    greatest: list[float] = []
    for low, high in itertools.pairwise(MODULI):
        moduli = np.geomspace(low, high, BETWEEN)
        if isinstance(parameters, RoundParameters):
            bounds, _ = axisymmetric.estimates(curves, parameters, moduli)
        else:
            bounds, _ = solid.estimates(curves, parameters, moduli)
        greatest.append(float(bounds.max()))
    return tuple(greatest)


def _beside(parameters: Parameters, meshes: int) -> float:
    """Processor time of the meshes that an estimate needs beside those that answer [s]; 0 where it needs none."""
    if isinstance(parameters, RoundParameters):
        return 0.0
    return sum((sum(solid.curve_on(*each).seconds) for each in solid.beside(parameters, meshes)), 0.0)


def _ratios(mesh: MeshedProblem, solved: Results, moduli: Sequence[float]) -> Values:
    return [solved[mesh.at(modulus)].force_ratio for modulus in moduli]
