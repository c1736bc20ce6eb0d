"""Effect of a force along the sensor's face on the films, and the load off centre that has the same effect.

    shear(get_design("common_base"), get_sample("1"))["rigid_1"].off_centre("object")    # m N/N

It is computed by the solid model with a bonded object. The force acts along x, the line of the teeth: on the top of the
first tooth alone, or evenly on the object's upper side, as a probe drags it. Everything is linear and given for 1 N.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError
from palpate.instrument.models.parameters import solid_parameters
from palpate.instrument.models.solid.ladders import resolution
from palpate.instrument.models.solid.mesh import TOOTH, PlanElements
from palpate.instrument.models.solid.system import System
from palpate.instrument.models.table import place_among_films
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Load, Sample

Vector = NDArray[np.float64]

DRAGGED = ("tooth", "object")
NOTHING = 1e-6  # share of the load that rounding leaves of a force that is zero by symmetry
MESHES = (0, 1)  # the third takes a minute
SECONDS = 5.0  # s of processor time that the finer one takes for a pair of sensors [M]
ALIKE = 0.1  # relative difference below which two films count as being at the same position


@dataclass(frozen=True, slots=True)
class FilmShear:
    """Compressive force on a film.

    Attributes:
        pressed: under 1 N that is spread evenly over the object [N].
        leaning: under a pressure that rises evenly along x, for each metre that its resultant of 1 N is off centre
            [N/m].
        dragged: under 1 N of shear, by the body on which it acts (`DRAGGED`) [N].
        length: length of the object [m].
    """

    pressed: float
    leaning: float
    dragged: Mapping[str, float]
    length: float

    def off_centre(self, what: str) -> float | None:
        """Distance from the centre [m] at which a load adds as much as an equal shear; None: no load adds any."""
        if abs(self.leaning) * self.length < NOTHING:
            return None
        return self.dragged[what] / self.leaning

    def cleaned(self, what: str) -> float:
        """`dragged`, with 0 where only rounding is left [N]."""
        return self.dragged[what] if abs(self.dragged[what]) > NOTHING else 0.0

    def change(self, coarse: FilmShear) -> float:
        """Greatest change of a force by shear from another mesh to this one [N]."""
        return max(abs(self.cleaned(what) - coarse.cleaned(what)) for what in DRAGGED)

    def summary(self, coarse: FilmShear) -> dict[str, float | None]:
        """The numbers with the names that JSON has; `coarse`: the same film on the mesh before."""
        found: dict[str, float | None] = {"pressed_N": self.pressed, "change_N": self.change(coarse)}
        for what in DRAGGED:
            found |= {f"{what}_N": self.cleaned(what), f"{what}_off_centre_m": self.off_centre(what)}
        return found


def shear_pattern(films: Mapping[str, FilmShear]) -> str:
    """How films show shear on the object: "not" at all, as one position "off centre", or as positions "apart"."""
    places = [place for film in films.values() if (place := film.off_centre("object")) is not None]
    if not places:
        return "not"
    return "apart" if max(places) - min(places) > ALIKE * max(map(abs, places)) else "off centre"


def shear(design: Design, sensed: Sample, refinement: int = MESHES[0]) -> dict[str, FilmShear]:
    """Effect of shear on each film by its name.

    Raises:
        RangeError: there are several rows of teeth, there is no such refinement, or no mesh resolves a length or
            modulus.
        EstimateError: the linear system cannot be solved accurately.
    """
    if design.rows > 1:
        raise RangeError(
            f"design {design.name!r} has {design.rows} rows of teeth; shear is worked out for one row: take"
            " 'common_base' or 'different_base'"
        )
    parameters = replace(solid_parameters(design, Load(1.0, sensed, "bonded")), load_at=None)
    system = System(parameters, resolution(parameters, refinement), mirrored=(False, True))
    stack, upper = system.stack, system.stack.object.body.plan
    below = PlanElements(stack.basis, np.flatnonzero((stack.plan.region == TOOTH) & (stack.plan.cell == 0)), 1)
    on_tooth = np.zeros(len(upper.nodes))
    on_tooth[np.searchsorted(upper.nodes, below.nodes)] = below.integrals / (2 * below.areas.sum())
    off_centre = stack.places[0] - parameters.length / 2 * stack.one
    lever = _first_moments(upper, off_centre)
    compressions = system.curve(
        [
            system.forces(axis, level, weights)
            for axis, level, weights in (
                (2, -1, -upper.integrals / parameters.load_area),
                (2, -1, -lever / (2 * float(lever @ off_centre[upper.nodes]))),
                (0, 0, on_tooth),
                (0, -1, upper.integrals / parameters.load_area),
            )
        ]
    )
    pressed, *others = compressions.poles.values(np.array([parameters.sensed_modulus]))[0].T
    films = {}
    for film in design.films:
        place = place_among_films(design, film)
        leaning, tooth, whole = (float(found[place]) for found in others)
        films[film.name] = FilmShear(
            float(pressed[place]), leaning, dict(zip(DRAGGED, (tooth, whole), strict=True)), parameters.length
        )
    return films


def _first_moments(plan: PlanElements, coordinate: Vector) -> Vector:
    """Integrals of a coordinate, given by its coefficients, times the shape functions, for each node of the plan."""
    found = np.zeros(len(plan.nodes))
    np.add.at(found, plan.local, (plan.products[:, 2, 2] @ coordinate[plan.nodes][plan.local][..., None])[..., 0])
    return found
