"""Measures the price list: errors against converged references, and the time of each answer on this machine."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from instrument.design import Design
from instrument.designs import get_design
from instrument.errors import RangeError
from instrument.models import axisymmetric, beam, solid, surface
from instrument.models.parameter_sets import PHYSICAL
from instrument.models.price_list import Price, PriceList, Reference, fingerprint
from instrument.models.response import response
from instrument.models.surface import ResponseSurface
from instrument.quantity import show
from instrument.sample import SAMPLES
from procedures.accuracy.machine import seconds_of, this_machine
from procedures.accuracy.meshes import Mesh, Solved, references, refinements, side_by_side, solve

Array = NDArray[np.float64]
Values = Sequence[float | None]
Progress = Callable[[int, int, str], None]
Results = Mapping[Mesh, Solved]

DESIGNS = ("single_round", "single")
SURFACES = (*DESIGNS, "common_base")
# The thesis' softest and hardest objects, the ends of the rubber samples, and one more.
MODULI = (1.49e4, SAMPLES["2"].modulus, SAMPLES["1"].modulus, 1e6, 140e9)
TIMED = MODULI[2]
BEAM_ELEMENTS = (1, 2, 4, 8, 16)
STRIDES = (8, 4, 2, 1)  # every eighth node of a surface, and so on
BETWEEN = 100  # moduli in each interval, where looking costs nothing


@dataclass(frozen=True, slots=True)
class Case:
    """One design, what its errors are taken against, and its surface, which knows the ratios between the moduli.

    Attributes:
        surface_errors: of the surface, in each interval.
    """

    design: Design
    reference: Reference
    surface: ResponseSurface
    surface_errors: Array

    def surface_ratio(self, moduli: Array) -> Array:
        """Force ratio by the surface at moduli of the object [Pa]."""
        return self.surface.force_ratio(moduli / self.design.ring.material.modulus)


def measure(designs: Sequence[str], progress: Progress) -> PriceList:
    """Measure every model of some designs.

    Raises:
        RangeError: a design has no response surface that fits it, which is what errors between moduli need.
    """
    chosen = [get_design(name) for name in designs]
    surfaces = [surface.find(design, PHYSICAL.load(TIMED)) for design in chosen]
    solved = _solve_all(chosen, progress)
    prices: list[Price] = []
    found = []
    for design, known in zip(chosen, surfaces, strict=True):
        reference = _reference(design, solved)
        at_moduli = known.force_ratio(np.array(MODULI) / design.ring.material.modulus)
        errors = np.array(_by_interval(_errors(at_moduli.tolist(), reference)), dtype=np.float64)
        case = Case(design, reference, known, errors)
        found.append(reference)
        prices += [*_closed_forms(case), *_elements(case, solved), *_surfaces(case)]
    return PriceList(machine=this_machine(), moduli_Pa=MODULI, references=tuple(found), prices=tuple(prices))


def build_surface(name: str, progress: Progress) -> ResponseSurface:
    """The response surface of a design, solved in two processes.

    Raises:
        EstimateError: the surface does not reach its error limit, or a linear system cannot be solved accurately.
    """
    with side_by_side() as imap:

        def apply(one: Callable[[float], float], ratios: Sequence[float]) -> Iterator[float]:
            for done, found in enumerate(imap(one, ratios)):
                progress(done, len(ratios), f"{name}: {len(ratios)} moduli")
                yield found

        return surface.build(surface.surface_parameters(get_design(name), PHYSICAL.load(TIMED)), apply=apply)


# --- finite elements -----------------------------------------------------------------------------------


def _solve_all(designs: Sequence[Design], progress: Progress) -> dict[Mesh, Solved]:
    """Every mesh of every design at every modulus: at one of them nothing else runs, so that its time counts."""
    load = PHYSICAL.load(TIMED)
    priced = list(
        dict.fromkeys(mesh for design in designs for family in refinements(design, load).values() for mesh in family)
    )
    others = [mesh for design in designs for mesh in references(design, load)]
    rest = [mesh.at(modulus) for mesh in priced for modulus in MODULI if modulus != TIMED]
    # The slow ones first, that none is left to run alone at the end.
    rest = [mesh.at(modulus) for mesh in others for modulus in _checked_at(mesh)] + rest[::-1]
    total = len(priced) + len(rest)
    solved: dict[Mesh, Solved] = {}
    for mesh in priced:
        progress(len(solved), total, f"{mesh.model}, refinement {mesh.refinement}")
        solved[mesh] = solve(mesh)
    with side_by_side() as apply:
        for mesh, found in zip(rest, apply(solve, rest), strict=True):
            solved[mesh] = found
            progress(len(solved), total, "the same at other moduli")
    return solved


def _checked_at(mesh: Mesh) -> Sequence[float]:
    """Where the mesh of a reference is solved: the second way takes a minute with the solid model."""
    return (TIMED,) if mesh.model == "solid" else MODULI


def _reference(design: Design, solved: Results) -> Reference:
    load = PHYSICAL.load(TIMED)
    families = {name: [_ratios(mesh, solved) for mesh in meshes] for name, meshes in refinements(design, load).items()}
    ways = [
        np.array([solved[mesh.at(modulus)].force_ratio for modulus in _checked_at(mesh)], dtype=np.float64)
        for mesh in references(design, load)
    ]
    limit, left = _limit(np.array(families["solid"][-3:], dtype=np.float64))
    if design.outline == "round":
        ratios, second = ways
        coarser = np.abs(ratios - np.array(families["axisymmetric"][-1], dtype=np.float64))
        uncertainties = np.maximum(np.abs(ratios - second), coarser)
        how = (
            f"axisymmetric, refinement {axisymmetric.REFINEMENTS[-1] + 1}: the plain displacement form differs by"
            f" {np.abs(ratios - second).max():.0e} at most, refinement {axisymmetric.REFINEMENTS[-1]} by"
            f" {coarser.max():.0e}, the limit of the solid model by {np.abs(ratios - limit).max():.0e}"
        )
    else:
        ratios = limit
        apart = abs(ways[0][0] - limit[MODULI.index(TIMED)])
        uncertainties = np.maximum(left, apart)
        how = (
            f"solid, limit of its refinements: the last one differs by {left.max():.0e} at most, elements of another"
            f" degree and grading by {apart:.0e} at {show(TIMED, 'Pa', 3)}"
        )
    return Reference(
        design=design.name,
        fingerprint=fingerprint(design, load),
        force_ratios=tuple(ratios.tolist()),
        uncertainties=tuple(uncertainties.tolist()),
        how=how,
    )


def _limit(ratios: Array) -> tuple[Array, Array]:
    """Where three refinements (3, moduli) lead if the changes go on falling alike, and how far that still is."""
    before, change = np.diff(ratios, axis=0)
    falling = np.clip(np.divide(change, before, out=np.full_like(change, 0.5), where=before != 0), 0.1, 0.5)
    left = change * falling / (1 - falling)
    return ratios[-1] + left, np.abs(left)


def _elements(case: Case, solved: Results) -> Iterator[Price]:
    """Every refinement of the axisymmetric and of the solid model."""
    families = refinements(case.design, PHYSICAL.load(TIMED))
    if "axisymmetric" not in families:
        yield _refused(case, "axisymmetric")
    for name, family in families.items():
        spent = 0.0
        for k, mesh in enumerate(family):
            found = solved[mesh]
            spent += sum(found.seconds)
            estimates = [_estimate([solved[m.at(modulus)] for m in family[: k + 1]], name) for modulus in MODULI]
            build, solve_, evaluate = found.seconds
            yield Price(
                design=case.design.name,
                model=name,
                refinement=f"refinement {mesh.refinement}",
                errors=_by_interval(_errors(_ratios(mesh, solved), case.reference)),
                estimates=_by_interval(estimates),
                build_s=build,
                solve_s=solve_,
                evaluate_s=evaluate,
                answer_s=None if None in estimates else spent,
                failure=found.failure,
            )


def _estimate(results: Sequence[Solved], model: str) -> float | None:
    """What `solve_to` would say of the last of some refinements; None: it would not stop there."""
    ratios = [result.force_ratio for result in results if result.force_ratio is not None]
    if len(ratios) < len(results) or len(ratios) < 2:
        return None
    if model == "axisymmetric":
        return axisymmetric.error_estimate(ratios, results[-1].imbalance)
    return solid.error_estimate(ratios)


def _ratios(mesh: Mesh, solved: Results) -> Values:
    return [solved[mesh.at(modulus)].force_ratio for modulus in MODULI]


def _errors(ratios: Values, reference: Reference) -> Values:
    return [
        None if ratio is None else abs(ratio - true) + uncertainty
        for ratio, true, uncertainty in zip(ratios, reference.force_ratios, reference.uncertainties, strict=True)
    ]


def _by_interval(values: Values) -> tuple[float | None, ...]:
    """From values at the moduli the greater of each two neighbours."""
    return tuple(None if a is None or b is None else max(a, b) for a, b in itertools.pairwise(values))


# --- what answers at once ------------------------------------------------------------------------------


def _closed_forms(case: Case) -> Iterator[Price]:
    for name in ("column", "experiment", "beam_printed", "beam_exact"):
        yield _at_once(case, name, "closed form", functools.partial(_ask, case.design, name))
    for elements in BEAM_ELEMENTS:
        ratio = functools.partial(_beam_ratio, case.design, elements)
        yield _at_once(case, "beam", f"{elements} elements a stretch", ratio, offered=elements == beam.ELEMENTS)


def _at_once(case: Case, model: str, refinement: str, ratio: Callable[[float], float], offered: bool = True) -> Price:
    errors: list[float | None] = []
    failure = ""
    for (low, high), own in zip(itertools.pairwise(MODULI), case.surface_errors, strict=True):
        kinks = [sample.modulus for sample in SAMPLES.values() if low < sample.modulus < high]  # the experiment's
        moduli = np.array([low, *np.geomspace(low, high, BETWEEN)[1:-1], *kinks, high])
        try:
            apart = np.abs([ratio(float(modulus)) for modulus in moduli] - case.surface_ratio(moduli))
            errors.append(float(apart.max() + own))
        except RangeError as error:
            errors.append(None)
            failure = str(error)
    answers = any(error is not None for error in errors)
    return Price(
        design=case.design.name,
        model=model,
        refinement=refinement,
        errors=tuple(errors),
        estimates=(None,) * len(errors),
        build_s=None,
        solve_s=None,
        evaluate_s=seconds_of(functools.partial(ratio, TIMED)) if answers else None,
        answer_s=seconds_of(functools.partial(_ask, case.design, model, TIMED)) if answers and offered else None,
        failure=failure,
    )


def _surfaces(case: Case) -> Iterator[Price]:
    """The stored surface, and what it would be with fewer nodes."""
    nodes = len(case.surface.coefficients)
    moduli = [np.geomspace(low, high, BETWEEN) for low, high in itertools.pairwise(MODULI)]
    for stride in STRIDES:
        thin = case.surface.thinned(stride)
        apart = [np.abs(replace(case, surface=thin).surface_ratio(some) - case.surface_ratio(some)) for some in moduli]
        bounds = [case.surface.error_bound + case.surface.discretisation] * len(moduli)
        many = np.geomspace(surface.LOWEST, surface.HIGHEST, 10_000)
        yield Price(
            design=case.design.name,
            model="surface",
            refinement=f"{(nodes - 1) // stride + 1} nodes of {case.surface.model}",
            errors=tuple(float(some.max() + own) for some, own in zip(apart, case.surface_errors, strict=True)),
            estimates=tuple(bounds) if stride == 1 else (None,) * len(bounds),
            build_s=case.surface.seconds / stride,
            solve_s=None,
            evaluate_s=seconds_of(functools.partial(thin.force_ratio, many)) / len(many),
            answer_s=seconds_of(functools.partial(_ask, case.design, "surface", TIMED)) if stride == 1 else None,
        )


def _refused(case: Case, model: str) -> Price:
    """A model that does not know the design, with its own words."""
    nothing = (None,) * (len(MODULI) - 1)
    try:
        _ask(case.design, model, TIMED)
    except RangeError as error:
        return Price(
            design=case.design.name,
            model=model,
            refinement="-",
            errors=nothing,
            estimates=nothing,
            build_s=None,
            solve_s=None,
            evaluate_s=None,
            answer_s=None,
            failure=str(error),
        )
    raise AssertionError(f"model {model!r} answers for {case.design.name!r} after all")


def _ask(design: Design, model: str, modulus: float) -> float:
    """The force ratio as a caller gets it."""
    return response(design, PHYSICAL.load(modulus), model).force_ratio


def _beam_ratio(design: Design, elements: int, modulus: float) -> float:
    stretches = beam.stretches(design, modulus, PHYSICAL.sensed_thickness)
    tooth, ring = beam.stretch_forces(beam.bending(design), stretches, elements)
    return tooth / (tooth + ring)
