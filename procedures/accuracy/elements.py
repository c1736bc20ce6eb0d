"""Prices of the finite-element models, refinement by refinement."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import PHYSICAL, Parameters, RoundParameters
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
    refinements,
)

Array = NDArray[np.float64]
Intervals = tuple[float | None, ...]


def element_prices(
    design: Design, truth: ReferenceRatios, middles: Array, surface_errors: Array, solved: Results
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
            errors = errors_of(_ratios(mesh, solved, MODULI), truth)
            if name == "axisymmetric":
                inside = np.abs(_ratios(mesh, solved, MIDDLES) - middles) + surface_errors
                errors = np.maximum(errors, inside)
            own.append(mesh)
            spent += sum(found.seconds)
            estimates = _estimates([solved[each].curve for each in own], mesh.parameters)
            build, solve, evaluate = (None, None, None) if found.failure else found.seconds
            yield Price(
                design=design.name,
                model=name,
                refinement=f"refinement {mesh.refinement}",
                errors=tuple(None if math.isnan(error) else error for error in errors.tolist()),
                estimates=estimates,
                build_s=build,
                solve_s=solve,
                evaluate_s=evaluate,
                answer_s=None if None in estimates else spent + _beside(mesh.parameters, len(own)),
                failure=found.failure,
            )


def errors_of(ratios: Array, truth: ReferenceRatios) -> Array:
    """Errors of force ratios at MODULI, with the reference's uncertainty: the greater of both ends of each interval."""
    errors = np.abs(ratios - truth.force_ratios) + truth.uncertainties
    return np.maximum(errors[:-1], errors[1:])


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


def _ratios(mesh: MeshedProblem, solved: Results, moduli: Sequence[float]) -> Array:
    """Force ratios on a mesh; NaN where it could not be solved."""
    return np.array([solved[mesh.at(modulus)].force_ratio for modulus in moduli], dtype=np.float64)
