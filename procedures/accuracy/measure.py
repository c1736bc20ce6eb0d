"""Measures the price list: errors against converged references, and the time of each answer on this machine."""

from __future__ import annotations

import functools
import itertools
import math
import os
import platform
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import ConfigError, RangeError
from palpate.instrument.models import beam, surface
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import PHYSICAL, Parameters, RoundParameters, get_parameter_set
from palpate.instrument.models.price_list import Machine, Price, PriceList, ReferenceRatios, stored
from palpate.instrument.models.response import response
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.surface import Surface
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.accuracy.meshes import (
    BETWEEN,
    MIDDLES,
    MODULI,
    PROCESSES,
    TIMED,
    MeshedProblem,
    Results,
    reference_of,
    refinements,
    solve_all,
)
from palpate.procedures.accuracy.numerics import seconds_of
from palpate.procedures.console.terminal import Progress


def this_machine() -> Machine:
    """Name of the processor, where the system tells it, and today's date."""
    cpu = platform.processor() or platform.machine()
    information = Path("/proc/cpuinfo")
    if information.exists():
        named = [line for line in information.read_text().splitlines() if line.startswith("model name")]
        cpu = named[0].partition(":")[2].strip() if named else cpu
    return Machine(
        cpu=cpu,
        cores=os.cpu_count() or 1,
        system=f"{platform.system()} {platform.machine()}",
        python=platform.python_version(),
        date=datetime.now(UTC).date().isoformat(),
    )


# --- the price list ------------------------------------------------------------------------------------

DESIGNS = ("single_round", "single", "common_base", "different_base", "array", "array_16")


def measure(designs: Sequence[str], progress: Progress) -> PriceList:
    """Measure every model of some designs.

    Raises:
        RangeError: a design has no shipped curves that fit it, which are what errors between moduli need.
    """
    chosen = [get_design(name) for name in designs]
    surfaces = [surface.find(design, PHYSICAL.load(TIMED)) for design in chosen]
    solved = solve_all(chosen, progress)
    prices: list[Price] = []
    found = []
    for design, curves in zip(chosen, surfaces, strict=True):
        truth = reference_of(design, solved)
        errors = errors_of(curves.force_ratios(np.array(MODULI)), truth)
        found.append(truth)
        for name in ("column", "column_fitted", "experiment", "beam_printed", "beam_exact"):
            prices.append(_at_once(design, curves, errors, name, "closed form"))
        prices.append(_at_once(design, curves, errors, "beam", f"{beam.ELEMENTS} elements a stretch"))
        prices += element_prices(design, truth, curves.force_ratios(np.array(MIDDLES)), errors, solved)
        prices.append(_surface(design, curves, errors))
    return PriceList(machine=this_machine(), moduli_Pa=MODULI, references=tuple(found), prices=tuple(prices))


def expected_seconds(designs: Sequence[str]) -> float:
    """Time that `measure` takes for some designs on two free cores [s], by the stored prices of those that it has.

    Each process eliminates a mesh of the solid model once for all moduli. The axisymmetric model solves each anew.
    """
    priced, references = _stored(designs)
    times = {"solid": PROCESSES, "axisymmetric": len(MODULI) + len(MIDDLES)}
    meshes = math.fsum(times.get(each.model, 1) * (each.seconds or 0.0) for each in priced)
    return (meshes + math.fsum(each.seconds for each in references)) / PROCESSES


def expected_curve_seconds(name: str) -> float:
    """Processor time that finding a design's curves takes [s], by the shipped ones.

    Where those do not fit the design's sensors any more, or a file of them is missing or damaged, it is the build time
    of the stored prices; 0: not priced there either.
    """
    try:
        sensors = [(get_parameter_set(each, "surface"), get_design(name)) for each in sets_of(name)]
        return math.fsum(surface.find(own.design(design), own.load(TIMED)).seconds for own, design in sensors)
    except (RangeError, ConfigError):
        return math.fsum(price.build_s or 0.0 for price in _stored([name])[0] if price.model == "surface")


def _stored(designs: Sequence[str]) -> tuple[list[Price], list[ReferenceRatios]]:
    """Stored prices and references of some designs; none where the list is missing or damaged: it is made anew then."""
    try:
        shipped = stored()
    except ConfigError:
        return [], []
    return [each for each in shipped.prices if each.design in designs], [
        each for each in shipped.references if each.design in designs
    ]


def sets_of(name: str) -> tuple[str, ...]:
    """Parameter sets that the design has shipped curves of."""
    return surface.SETS if get_design(name).thesis_force_ratio else surface.SETS[:1]


def sensor_of(name: str, parameters: str) -> Parameters:
    """The sensor of which a design's curves with a set of parameters are."""
    chosen = get_parameter_set(parameters, "surface")
    return surface.surface_parameters(chosen.design(get_design(name)), chosen.load(TIMED))


# --- what answers at once ------------------------------------------------------------------------------


def _at_once(design: Design, curves: Surface, curve_errors: Floats, model: str, refinement: str) -> Price:
    """A price beside a design's shipped curves, whose own error in each interval counts as well."""
    ratio = functools.partial(_ask, design, model)
    errors: list[float | None] = []
    failure = ""
    for (low, high), own in zip(itertools.pairwise(MODULI), curve_errors, strict=True):
        kinks = [sample.modulus for sample in SAMPLES.values() if low < sample.modulus < high]  # the experiment's
        moduli = np.array([low, *np.geomspace(low, high, BETWEEN)[1:-1], *kinks, high])
        try:
            apart = np.abs([ratio(float(modulus)) for modulus in moduli] - curves.force_ratios(moduli))
            errors.append(float(apart.max() + own))
        except RangeError as error:
            errors.append(None)
            failure = str(error)
    answers = any(error is not None for error in errors)
    return Price(
        design=design.name,
        model=model,
        refinement=refinement,
        errors=tuple(errors),
        estimates=(None,) * len(errors),
        build_s=None,
        solve_s=None,
        evaluate_s=(seconds := seconds_of(functools.partial(ratio, TIMED)) if answers else None),
        answer_s=seconds,
        failure=failure,
    )


def _surface(design: Design, curves: Surface, curve_errors: Floats) -> Price:
    """The price of a design's shipped curves."""
    ends = [np.geomspace(low, high, BETWEEN) for low, high in itertools.pairwise(MODULI)]
    many = np.geomspace(MODULI[0], MODULI[-1], 10_000)
    return Price(
        design=design.name,
        model="surface",
        refinement=f"{len(curves.poles.rates)} poles of {curves.model}",
        errors=tuple(curve_errors.tolist()),
        estimates=tuple(float(curves.estimates(moduli)[0].max()) for moduli in ends),
        build_s=curves.seconds,
        solve_s=None,
        evaluate_s=seconds_of(functools.partial(curves.force_ratios, many)) / len(many),
        answer_s=seconds_of(functools.partial(_ask, design, "surface", TIMED)),
    )


def _ask(design: Design, model: str, modulus: float) -> float:
    """The force ratio as a caller gets it."""
    return response(design, PHYSICAL.load(modulus), model).force_ratio


# --- Prices of the finite-element models, refinement by refinement -------------------------------------

Intervals = tuple[float | None, ...]


def element_prices(
    design: Design, truth: ReferenceRatios, middles: Floats, surface_errors: Floats, solved: Results
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


def errors_of(ratios: Floats, truth: ReferenceRatios) -> Floats:
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


def _ratios(mesh: MeshedProblem, solved: Results, moduli: Sequence[float]) -> Floats:
    """Force ratios on a mesh; NaN where it could not be solved."""
    return np.array([solved[mesh.at(modulus)].force_ratio for modulus in moduli], dtype=np.float64)
