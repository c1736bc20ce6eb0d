"""Curves of the round sensor over the modulus of the sensed object: sensor and object, each condensed onto the contact.

    found = curve_on(RoundParameters(), degree=4, layers=3)
    found.force_ratios(np.array([24e3, 1e5]))

The sensor has its films in short circuit there; `poles` opens them.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.arrays import Floats, Indices
from palpate.instrument.models.axisymmetric.mesh import (
    AXIAL,
    AxisymmetricBody,
    BodyElements,
    Grid,
    compliance_of,
    constants,
    grid,
    inside,
    keeps_pressure,
    keeps_volume,
    number,
    parts,
    within,
)
from palpate.instrument.models.finite_elements import elements as el
from palpate.instrument.models.finite_elements.elimination import (
    Condensed,
    ElementSystem,
    condense,
    extrapolated,
    extrapolated_number,
)
from palpate.instrument.models.finite_elements.poles import Curve, Sensor, capacitance, curve
from palpate.instrument.models.finite_elements.work import keep, single
from palpate.instrument.models.parameters import RoundParameters

Number = TypeVar("Number", bound=np.generic)

# glibc gives freed arrays back to the system and gets them again page by page, until an array as large as this one has
# been freed.
np.empty(4_000_000)

# --- displacements over every body, and the pressure on the sensor's face --------------------------------


POINTS = 5  # number of points along a side of an element


@dataclass(frozen=True, slots=True)
class DisplacementField:
    """Displacements of a body on a grid of points, for a total force of 1 N.

    Attributes:
        radius, height: coordinates of the undeformed points [m], (columns, rows).
        radial, axial: displacements [m], (columns, rows).
    """

    radius: Floats
    height: Floats
    radial: Floats
    axial: Floats


@dataclass(frozen=True, slots=True)
class FacePressure:
    """Pressure of the object on the sensor's face at Gauss points, from the axis outwards, for a total force of 1 N.

    The pressure is singular at the edges of parts: the finer the mesh, the higher it reaches there. The whole force on
        a part is not affected. Elsewhere the pressure converges more slowly than forces do, most slowly at the axis.

    Attributes:
        radius: radii of the points [m]; none lie over the gap.
        pressure: pressure, positive in compression [Pa]; negative where a bonded object pulls.
        area: area of the face that belongs to each point [m2].
    """

    radius: Floats
    pressure: Floats
    area: Floats


@dataclass(frozen=True, slots=True)
class RoundSection:
    """What a picture of the sensor shows: displacements of each body by its name, and the pressure on the face."""

    fields: dict[str, DisplacementField]
    face: FacePressure


def on(local: NDArray[Number], part: BodyElements) -> NDArray[Number]:
    """Element vectors of a body as (columns, rows, axis, radial shape, axial shape)."""
    shapes = math.isqrt(local.shape[1] // 2)
    return local[part.elements].reshape(len(part.columns), len(part.rows), 2, shapes, shapes)


def displacements(
    mesh: Grid, r: el.LineIntegrals, bodies: Sequence[BodyElements], moved: Floats
) -> dict[str, DisplacementField]:
    """Displacement field of every body, by its name, from the displacements (elements, 2 (p + 1)^2) of all elements."""
    points = np.linspace(0, 1, POINTS)
    shapes, _ = el.shape_functions(r.dofs.shape[1] - 1, points)

    def along(lines: Floats, intervals: Indices) -> Floats:
        return (lines[intervals][:, None] + np.diff(lines)[intervals][:, None] * points).ravel()

    found = {}
    for part in bodies:
        sampled = np.einsum("xyckl,ki,lj->cxiyj", on(moved, part), shapes, shapes, optimize=True)
        radius, height = np.meshgrid(along(mesh.radii, part.columns), along(mesh.heights, part.rows), indexing="ij")
        radial, axial = sampled.reshape(2, *radius.shape)
        found[part.body.name] = DisplacementField(radius, height, radial, axial)
    return found


def face(p: RoundParameters, mesh: Grid, dofs: Indices, forces: Floats) -> FacePressure:
    """Pressure on the face, from the forces of the object on the shape functions of its lower side [N]."""
    outer = min(p.ring_outer_radius, p.sensed_radius)
    touching = np.concatenate(
        [inside(mesh.radii, part) for part in ((0.0, p.tooth_radius), (p.ring_inner_radius, outer))]
    )
    return face_pressure(mesh, dofs, touching, forces)


def face_pressure(mesh: Grid, dofs: Indices, touching: Indices, forces: Floats) -> FacePressure:
    """The pressure whose work on every shape function of the face is that of the nodal forces.

    Such consistent tractions are far more accurate than stresses from the gradients of displacements (Carey, Chow and
    Seager 1985). They balance the forces exactly, and need no stress of a body whose pressure is an unknown.

    Args:
        mesh: grid of the sensor.
        dofs: numbers of the shape functions of each interval of the radius, (intervals, p + 1).
        touching: intervals where the object touches the sensor.
        forces: forces of the object on the face, by number of the shape function [N].
    """
    from scipy.linalg import solve

    degree = dofs.shape[1] - 1
    numbers, local = np.unique(dofs[touching], return_inverse=True)
    local = local.reshape(len(touching), -1)
    shapes, _, area = _quadrature(mesh.radii, touching, degree, degree + 2)
    mass = np.zeros((len(numbers), len(numbers)))
    np.add.at(mass, (local[:, :, None], local[:, None, :]), np.einsum("eq,iq,jq->eij", area, shapes, shapes))
    scale = 1 / np.sqrt(np.diag(mass))
    nodal = scale * solve(mass * np.outer(scale, scale), scale * forces[numbers], assume_a="pos")
    # These points suffice for the integrals, and the highest polynomial, the least certain part, is zero there.
    shapes, radius, area = _quadrature(mesh.radii, touching, degree, degree)
    return FacePressure(radius.ravel(), (nodal[local] @ shapes).ravel(), area.ravel())


def _quadrature(radii: Floats, intervals: Indices, degree: int, count: int) -> tuple[Floats, Floats, Floats]:
    """Shape functions (degree + 1, count), radii [m] and areas [m2] (intervals, count) at Gauss points."""
    points, weights = np.polynomial.legendre.leggauss(count)
    width = np.diff(radii)[intervals][:, None]
    radius = radii[intervals][:, None] + width * (points + 1) / 2
    shapes, _ = el.shape_functions(degree, (points + 1) / 2)
    return shapes, radius, math.pi * radius * width * weights


# --- loads on the elements, and what they do to the stresses of films ------------------------------------


def pressing(r: el.LineIntegrals, part: BodyElements) -> Floats:
    """Forces of 1 N, spread evenly over the top of the object, per radian: (elements of the object, n)."""
    shapes = r.dofs.shape[1]
    load = np.zeros((len(part.columns), len(part.rows), 2, shapes, shapes))
    # The first shape function is 1, so these are the integrals ∫ r φ.
    load[:, -1, AXIAL, :, :2] -= r.value_value[part.columns][:, :, :1] / (math.pi * part.body.radii[1] ** 2)
    return load.reshape(len(part), -1)


def charging(r: el.LineIntegrals, z: el.LineIntegrals, part: BodyElements) -> Floats:
    """Forces of a film under 1 V, against its voltage, per radian: (elements of the film, n)."""
    assert part.body.film is not None
    low, high = part.body.heights
    _, stress, _ = part.body.film.stiff()
    return el.polarised(r, z, part.columns, part.rows, stress[0] / (high - low), stress[2] / (high - low))


def capacitance_of(body: AxisymmetricBody) -> float:
    """Capacitance of a film [F]."""
    assert body.film is not None
    return capacitance(body.film, body.area, body.heights[1] - body.heights[0])


def stressing(r: el.LineIntegrals, z: el.LineIntegrals, part: BodyElements) -> tuple[Floats, Floats]:
    """Forces (elements of the film, n) per radian whose work is what strains add to the film's mean stresses.

    These are the stress in the plane and that along the axis.
    """
    c, volume = constants(part.body, mixed=False), part.body.volume
    plane = el.polarised(r, z, part.columns, part.rows, (c.c11 + c.c12) / 2 / volume, c.c13 / volume)
    return plane, el.polarised(r, z, part.columns, part.rows, c.c13 / volume, c.c33 / volume)


def stress_by_voltage(body: AxisymmetricBody) -> tuple[float, float]:
    """What 1 V across a film adds to its mean stresses in the plane and along the axis [Pa/V]."""
    assert body.film is not None
    _, stress, _ = body.film.stiff()
    thickness = body.heights[1] - body.heights[0]
    return float(stress[0]) / thickness, float(stress[2]) / thickness


# --- curves ----------------------------------------------------------------------------------------------

# Compliance, over that of shear, that is added where a body keeps its volume: less would cost digits.
ADDED = 3e-3
BATCH = 32  # number of elements in a batch; more do not fit into the cache


def curve_on(parameters: RoundParameters, degree: int, layers: int, mixed: bool = True) -> Curve:
    """The curve on a mesh of any degree and number of layers, under 1 N that is spread evenly over the object.

    Its goals are the mean stresses of each film, in the plane and along the axis [Pa]. The parameters' modulus of the
    object has no effect. The curve is kept for the next time, in memory and on disk.

    Args:
        parameters: the sensor.
        degree: degree of the elements, at least 2.
        layers: number of geometric layers at the corners.
        mixed: whether bodies keep their pressure as an unknown where that gains digits; otherwise none does.

    Raises:
        EstimateError: a stiffness is not positive definite to working precision.
    """
    return kept_curve(replace(parameters, sensed_modulus=1.0), degree, layers, mixed)


@functools.lru_cache(maxsize=64)
def kept_curve(parameters: RoundParameters, degree: int, layers: int, mixed: bool) -> Curve:
    text = f"axisymmetric;degree={degree};layers={layers};mixed={mixed};{parameters.canonical()}"
    return keep(text, Curve, lambda: found_on(parameters, degree, layers, mixed))


@single()
def found_on(parameters: RoundParameters, degree: int, layers: int, mixed: bool = True) -> Curve:
    """Compute what `curve_on` gives, without looking for a kept curve and without keeping it."""
    of = _Model(parameters, degree, layers, mixed)
    # The shape functions of the object's vertices on the face add up to 1.
    vertices = on(of.unknowns, of.bodies[0])[:, 0, AXIAL, :2, 0]
    over = within(parameters.tooth_radius, of.mesh, of.r)[of.r.dofs[of.bodies[0].columns][:, :2]]

    def raised(places: NDArray[np.bool_]) -> Floats:
        displacement = np.zeros(of.size + 1)
        displacement[vertices[places]] = 1.0
        return displacement[:-1][of.contact]

    felt, pressed = of.sensor.condensed(of.contact), of.sensed.condensed(of.contact)
    rigid, count = parameters.support == "rigid", len(of.films)
    found = of.opened(felt)
    volts = np.array([stress_by_voltage(film.body) for film in of.films]).reshape(count, 1, 2)
    # A rigid tooth carries what the ring does not.
    jump = raised(~over) if rigid else -raised(over)
    return curve(
        found,
        pressed,
        modes=np.zeros((len(jump), 0)) if rigid else raised(np.ones_like(over))[:, None],
        rows=found.rows(slice(count, 3 * count), (np.eye(count)[:, :, None] * volts).reshape(count, 2 * count)),
        offsets=np.zeros((2 * count, 1)),
        ratio=found.stiffness @ jump,
        share=1.0 if rigid else 0.0,
    )


@single()
def section(parameters: RoundParameters, degree: int, layers: int) -> RoundSection:
    """Displacements and pressure for a force of 1 N that is spread evenly over the object.

    Raises:
        EstimateError: a stiffness is not positive definite to working precision.
    """
    of, modulus = _Model(parameters, degree, layers), parameters.sensed_modulus
    body, dofs = of.bodies[0], of.r.dofs

    def solved(added: float) -> Floats:
        """Displacements of all unknowns, then forces on the shape functions of the object's lower side."""
        felt, pressed = (side.condensed_at(of.contact, added, remembers=True) for side in (of.sensor, of.sensed))
        sensor = of.opened(felt)
        stiffness = sensor.stiffness + modulus * pressed.stiffness
        moved = np.asarray(np.linalg.solve(stiffness, pressed.loads[:, 0]), dtype=np.float64)
        factors = np.zeros(felt.loads.shape[1])
        factors[: len(of.films)] = -sensor.capacity @ (sensor.charges.T @ moved)
        displacement = np.zeros(of.size + 1)
        for side, what, factor in ((of.sensor, felt, factors), (of.sensed, pressed, np.array([1 / modulus]))):
            assert what.inside is not None
            displacement[:-1][side.touched] = what.inside(moved, factor)
        local = displacement[of.unknowns[body.elements]]
        internal = modulus * np.matmul(of.sensed.matrices(added), local[:, :, None])[:, :, 0]
        forces = np.zeros(dofs.max() + 1)
        np.add.at(forces, dofs[body.columns], on(internal, body)[:, 0, AXIAL, :, 0])
        return np.concatenate([displacement, forces])

    keeps = any(keeps_volume(part.body) for part in of.bodies)
    found = extrapolated_number(solved, ADDED) if keeps else solved(0.0)
    displacement, forces = np.split(found, [of.size + 1])
    fields = displacements(of.mesh, of.r, of.bodies, displacement[of.unknowns])
    return RoundSection(fields, face(parameters, of.mesh, dofs, forces))


class _Model:
    """The sensor and the object on a mesh, with a modulus of the object of 1 Pa.

    Attributes:
        mesh: the grid.
        r, z: integrals over the radius and over the height.
        bodies: elements of each body, the object first.
        films: those of the films.
        unknowns: (elements, n), numbers of the unknowns of all elements.
        size: number of unknowns, and the number of those that are fixed.
        sensed, sensor: both sides of the contact.
        contact: (size,), whether an unknown belongs to both.
    """

    def __init__(self, parameters: RoundParameters, degree: int, layers: int, mixed: bool = True) -> None:
        self.mesh = grid(replace(parameters, sensed_modulus=1.0), layers)
        self.r = el.line(self.mesh.radii, degree, radial=True)
        self.z = el.line(self.mesh.heights, degree, radial=False)
        self.bodies = parts(self.mesh)
        self.films = [part for part in self.bodies if part.body.film is not None]
        self.unknowns, self.size = number(parameters, self.mesh, self.r, self.z, self.bodies)
        forces = [(film, charging(self.r, self.z, film)) for film in self.films]
        forces += [(film, by) for film in self.films for by in stressing(self.r, self.z, film)]
        on_mesh = self.r, self.z, self.unknowns, self.size, mixed
        body = self.bodies[0]
        self.sensed = _Side(*on_mesh, [body], [(body, pressing(self.r, body))])
        self.sensor = _Side(*on_mesh, self.bodies[1:], forces)
        self.contact = self.sensed.touched & self.sensor.touched

    def opened(self, felt: Condensed) -> Sensor:
        """The sensor with open films, from what is left of it with these in short circuit."""
        return Sensor(felt, slice(0, len(self.films)), np.array([capacitance_of(film.body) for film in self.films]))


@dataclass(frozen=True, slots=True)
class _Side:
    """Parts on one side of the contact, and forces on them per radian.

    Attributes:
        r, z, unknowns, size: as in `_Model`.
        mixed: whether bodies may keep their pressure as an unknown.
        parts: the parts.
        forces: parts, each with forces on its elements.
    """

    r: el.LineIntegrals
    z: el.LineIntegrals
    unknowns: Indices
    size: int
    mixed: bool
    parts: Sequence[BodyElements]
    forces: Sequence[tuple[BodyElements, Floats]]

    @property
    def touched(self) -> NDArray[np.bool_]:
        """Whether an unknown belongs to any part."""
        found = np.zeros(self.size + 1, dtype=bool)
        for part in self.parts:
            found[self.unknowns[part.elements]] = True
        return found[:-1]

    def condensed(self, contact: NDArray[np.bool_]) -> Condensed:
        """What is left on the contact."""
        if self.mixed and any(keeps_volume(part.body) for part in self.parts):
            return extrapolated(lambda added: self.condensed_at(contact, added), ADDED)
        return self.condensed_at(contact, 0.0)

    def condensed_at(self, contact: NDArray[np.bool_], added: float, remembers: bool = False) -> Condensed:
        """What is left on the contact, with a compliance of bodies that keep their volume, as in `matrices`."""
        own = np.flatnonzero(self.touched)
        numbers = np.full(self.size + 1, -1)
        numbers[own] = np.arange(len(own))
        loads = np.zeros((self.size + 1, len(self.forces)))
        for column, (part, forces) in enumerate(self.forces):
            np.add.at(loads[:, column], self.unknowns[part.elements], 2 * math.pi * el.nodal(forces.copy()))
        places = [np.meshgrid(part.columns, part.rows, indexing="ij") for part in self.parts]
        matrices = self.matrices(added)
        system = ElementSystem(
            unknowns=np.concatenate([numbers[self.unknowns[part.elements]] for part in self.parts]),
            coordinates=np.concatenate([np.stack([x.ravel(), y.ravel()], axis=1) for x, y in places]),
            matrices=lambda elements: matrices[elements],
            kept=contact[own],
            loads=loads[own],
        )
        return condense(system, remembers)

    def matrices(self, added: float) -> Floats:
        """Stiffness (elements, n, n) on nodes, over the whole circle, with the pressures eliminated.

        Args:
            added: compliance, over that of shear, that is added to that of a body that keeps its volume.
        """
        fill, size = el.Stiffness(self.r, self.z), self.unknowns.shape[1]
        matrices, start = np.empty((sum(map(len, self.parts)), size, size)), 0
        for part in self.parts:
            body, columns, rows = part.body, part.columns, part.rows
            mixed = self.mixed and keeps_pressure(body)
            found = fill(columns, rows, constants(body, mixed), out=matrices[start : start + len(part)])
            if mixed:
                spread = el.dilatation(self.r, self.z, columns, rows)
                compliance = compliance_of(body) + (added if keeps_volume(body) else 0.0)
                for few in range(0, len(part), BATCH):
                    own = spread[few : few + BATCH]
                    found[few : few + BATCH] += own.transpose(0, 2, 1) @ (own * (body.shear / compliance))
            start += len(part)
        matrices *= 2 * math.pi
        # Triangles differ by rounding, of which hard objects on some processors keep ten times less from the lower one.
        return el.nodal(matrices).transpose(0, 2, 1)
