"""Each model's answer to one question: what force does the tooth take, and what do the films give?

Every model here is linear in the force.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError
from palpate.instrument.models import beam, experiment, springs
from palpate.instrument.models.parameters import round_parameters, solid_parameters
from palpate.instrument.sensor.design import FILM_KINDS, Design, Film
from palpate.instrument.sensor.sample import Load, Sample

if TYPE_CHECKING:
    from palpate.instrument.models.axisymmetric.model import Solution
    from palpate.instrument.models.solid.model import SolidSolution


@dataclass(frozen=True, slots=True)
class FilmLoad:
    """Load on a film, and its signal where the model knows its stresses (else None).

    Attributes:
        force: compressive force [N].
        plane_stress: mean stress along axes 1 and 2 of the open film [Pa].
        voltage: voltage of the open film, coupled to the mechanics [V].
        voltage_error: bound on the error of the voltage by the discretisation [V].
        charge: charge with all films in short circuit [C].
    """

    force: float
    plane_stress: tuple[float, float] | None = None
    voltage: float | None = None
    voltage_error: float | None = None
    charge: float | None = None

    def times(self, factor: float) -> Self:
        """The same under a force that is larger by this factor."""
        if factor == 1:
            return self
        voltage, error, charge = (
            None if value is None else value * factor for value in (self.voltage, self.voltage_error, self.charge)
        )
        stress = None if self.plane_stress is None else (self.plane_stress[0] * factor, self.plane_stress[1] * factor)
        return type(self)(self.force * factor, stress, voltage, error, charge)


@dataclass(frozen=True, slots=True)
class Response:
    """Response of a sensor to a load.

    Attributes:
        model: name of the model that answered.
        force_rigid: force on the teeth [N].
        force_total: force on the base [N].
        force_ratio: force_rigid / force_total.
        error_estimate: bound on the error of `force_ratio`, relative to it; None: the model has none. For a
            finite-element model it counts the discretisation alone, for "column_fitted" the distance from the tables to
            which it was fitted.
        tooth_forces: force on each tooth [N].
        films: load on each film by its name.
        stiffness: stiffness of the stack of object and sensor [N/m], always by the column model: other models have no
            deflection that could be measured.
        why: why the model was chosen; empty where it was asked for.
    """

    model: str
    force_rigid: float
    force_total: float
    force_ratio: float
    error_estimate: float | None
    tooth_forces: tuple[float, ...]
    films: Mapping[str, FilmLoad]
    stiffness: float
    why: str = ""


@dataclass(frozen=True, slots=True)
class Model:
    """One model of the registry.

    Attributes:
        answers: function of design, loads and tolerance that gives the responses; a tolerance of None is left to the
            model. The loads differ in the modulus of their object alone.
        default_tolerance: tolerance of a model that refines until its error estimate meets it; None: it does not
            refine.
    """

    answers: Callable[[Design, Sequence[Load], float | None], list[Response]]
    default_tolerance: float | None = None

    def answer(self, design: Design, load: Load, tolerance: float | None) -> Response:
        """The response to one load."""
        (found,) = self.answers(design, [load], tolerance)
        return found


def _closed_form(
    name: str,
    force_ratio: Callable[[Design, Sample], float],
    estimate: Callable[[Design], float | None] = lambda _: None,
) -> Model:
    def answer(design: Design, load: Load) -> Response:
        if load.at is not None:
            raise RangeError(
                f"load at ({load.at[0]:g}, {load.at[1]:g}) m: model {name!r} knows a uniform pressure only;"
                " take model 'solid'"
            )
        ratio = force_ratio(design, load.sensed)
        return _response(name, design, load, ratio, estimate(design))

    return Model(lambda design, loads, _: [answer(design, load) for load in loads])


def _axisymmetric(design: Design, loads: Sequence[Load], tolerance: float | None) -> list[Response]:
    from palpate.instrument.models.axisymmetric import model as axisymmetric

    asked = AXISYMMETRIC_TOLERANCE if tolerance is None else tolerance
    found = axisymmetric.ladder(round_parameters(design, loads[0])).solve_at(_moduli(loads), asked)
    return [_round_response("axisymmetric", design, load, *each) for load, each in zip(loads, found, strict=True)]


def _solid(design: Design, loads: Sequence[Load], tolerance: float | None) -> list[Response]:
    from palpate.instrument.models.solid import model as solid

    asked = SOLID_TOLERANCE if tolerance is None else tolerance
    # Forces and stresses are proportional to the load: those of 1 N are kept for the next call.
    parameters = solid_parameters(design, replace(loads[0], force=1.0))
    found = solid.ladder(parameters).solve_at(_moduli(loads), asked)
    return [_solid_response("solid", design, load, *each) for load, each in zip(loads, found, strict=True)]


def _surface(design: Design, loads: Sequence[Load], tolerance: float | None) -> list[Response]:
    from palpate.instrument.models import surface
    from palpate.instrument.models.axisymmetric.model import Solution

    found = surface.find(design, loads[0]).solve_at(_moduli(loads))
    return [
        _round_response("surface", design, load, solution, estimate)
        if isinstance(solution, Solution)
        else _solid_response("surface", design, load, solution, estimate)
        for load, (solution, estimate) in zip(loads, found, strict=True)
    ]


def _moduli(loads: Sequence[Load]) -> NDArray[np.float64]:
    return np.array([load.sensed.modulus for load in loads])


def _round_response(model: str, design: Design, load: Load, solution: Solution, estimate: float) -> Response:
    felt = {
        kind: FilmLoad(film.force, (film.plane_stress,) * 2, film.voltage, film.voltage_error, film.charge)
        for kind, below in zip(FILM_KINDS, ("tooth", "base"), strict=True)
        if (film := solution.films.get(below)) is not None
    }
    return _response(model, design, load, solution.force_ratio, estimate, felt)


def _solid_response(model: str, design: Design, load: Load, solution: SolidSolution, estimate: float) -> Response:
    """Response from a solution under 1 N."""
    forces = (*solution.tooth_forces, *solution.base_forces)
    stresses = (*solution.tooth_films, *solution.base_films)
    films = {}
    for film in design.films:
        place = place_among_films(design, film)
        felt = FilmLoad(forces[place])
        if stresses:
            voltage, charge = solution.signals[place]
            felt = FilmLoad(forces[place], stresses[place], voltage, solution.voltage_error, charge)
        films[film.name] = felt.times(load.force)
    tooth_forces = tuple(force * load.force for force in solution.tooth_forces)
    return Response(
        model=model,
        force_rigid=sum(tooth_forces),
        force_total=solution.total_force * load.force,
        force_ratio=solution.force_ratio,
        error_estimate=estimate / abs(solution.force_ratio),
        tooth_forces=tooth_forces,
        films=films,
        stiffness=springs.stiffness(design, load.sensed),
    )


def place_among_films(design: Design, film: Film) -> int:
    """Place of a film in the solid model's order: the films of all teeth, then those of the bases."""
    tooth = film.teeth[0]
    if film.kind == FILM_KINDS[0]:
        return tooth
    return len(design.teeth) + (tooth if design.separate_bases else 0)


def _response(
    model: str,
    design: Design,
    load: Load,
    ratio: float,
    estimate: float | None,
    felt: Mapping[str, FilmLoad] = MappingProxyType({}),
) -> Response:
    """Response of a model that shares the force evenly between teeth; `felt`: load on films of each kind under 1 N."""
    teeth = len(design.teeth)
    tooth_forces = (ratio * load.force / teeth,) * teeth
    films = {}
    for film in design.films:
        share = len(film.teeth) / teeth * (ratio if film.kind == FILM_KINDS[0] else 1.0)
        films[film.name] = replace(felt.get(film.kind, FilmLoad(share)), force=share).times(load.force)
    return Response(
        model=model,
        force_rigid=ratio * load.force,
        force_total=load.force,
        force_ratio=ratio,
        error_estimate=None if estimate is None else estimate / ratio,
        tooth_forces=tooth_forces,
        films=films,
        stiffness=springs.stiffness(design, load.sensed),
    )


# Default tolerances, relative to the force ratio: answers take about a second, also for the softest objects.
AXISYMMETRIC_TOLERANCE, SOLID_TOLERANCE = 1e-4, 5e-2

MODELS: Mapping[str, Model] = MappingProxyType(
    {
        "column": _closed_form("column", springs.force_ratio),
        "column_fitted": _closed_form("column_fitted", springs.fitted_force_ratio, springs.residual),
        "beam_printed": _closed_form("beam_printed", beam.printed_force_ratio),
        "beam": _closed_form("beam", beam.force_ratio),
        "beam_exact": _closed_form("beam_exact", beam.exact_force_ratio),
        "experiment": _closed_form("experiment", experiment.force_ratio),
        "axisymmetric": Model(_axisymmetric, AXISYMMETRIC_TOLERANCE),
        "solid": Model(_solid, SOLID_TOLERANCE),
        "surface": Model(_surface),
    }
)
