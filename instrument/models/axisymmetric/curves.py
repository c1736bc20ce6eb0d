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

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric.bodies import compliance_of, constants, keeps_pressure, keeps_volume
from palpate.instrument.models.axisymmetric.fields import on
from palpate.instrument.models.axisymmetric.forces import (
    capacitance_of,
    charging,
    pressing,
    stress_by_voltage,
    stressing,
)
from palpate.instrument.models.axisymmetric.mesh import grid
from palpate.instrument.models.axisymmetric.numbering import AXIAL, Part, number, parts, within
from palpate.instrument.models.finite_elements import elements as el
from palpate.instrument.models.finite_elements.fronts import Condensed, Mesh, condense
from palpate.instrument.models.finite_elements.incompressible import extrapolated
from palpate.instrument.models.finite_elements.kept import keep
from palpate.instrument.models.finite_elements.poles import Curve, Sensor, curve
from palpate.instrument.models.finite_elements.threads import single
from palpate.instrument.models.parameters import RoundParameters

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

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
    return _kept(replace(parameters, sensed_modulus=1.0), degree, layers, mixed)


@functools.lru_cache(maxsize=64)
def _kept(parameters: RoundParameters, degree: int, layers: int, mixed: bool) -> Curve:
    text = f"axisymmetric;degree={degree};layers={layers};mixed={mixed};{parameters.canonical()}"
    return keep(text, Curve, lambda: found_on(parameters, degree, layers, mixed))


@single()
def found_on(parameters: RoundParameters, degree: int, layers: int, mixed: bool = True) -> Curve:
    """Compute what `curve_on` gives, without looking for a kept curve and without keeping it."""
    mesh = grid(replace(parameters, sensed_modulus=1.0), layers)
    r, z = el.line(mesh.radii, degree, radial=True), el.line(mesh.heights, degree, radial=False)
    bodies = parts(mesh)
    unknowns, size = (numbering := number(parameters, mesh, r, z, bodies)).unknowns, numbering.size
    films = [part for part in bodies if part.body.film is not None]
    forces = [(film, charging(r, z, film)) for film in films]
    forces += [(film, by) for film in films for by in stressing(r, z, film)]
    sensed = _Side(r, z, bodies[:1], unknowns, size, mixed, [(bodies[0], pressing(r, bodies[0]))])
    sensor = _Side(r, z, bodies[1:], unknowns, size, mixed, forces)
    contact = sensed.touched & sensor.touched

    # The shape functions of the object's vertices on the face add up to 1.
    vertices = on(unknowns, bodies[0])[:, 0, AXIAL, :2, 0]
    over = within(parameters.tooth_radius, mesh, r)[r.dofs[bodies[0].columns][:, :2]]

    def raised(places: NDArray[np.bool_]) -> Array:
        displacement = np.zeros(size + 1)
        displacement[vertices[places]] = 1.0
        return displacement[:-1][contact]

    felt, pressed = sensor.condensed(contact), sensed.condensed(contact)
    rigid, count = parameters.support == "rigid", len(films)
    found = Sensor(felt, slice(0, count), np.array([capacitance_of(film.body) for film in films]))
    volts = np.array([stress_by_voltage(film.body) for film in films]).reshape(count, 1, 2)
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


@dataclass(frozen=True, slots=True)
class _Side:
    """Parts on one side of the contact, and forces on them per radian.

    Attributes:
        r, z: integrals over the radius and over the height.
        parts: the parts.
        unknowns: (elements, n), numbers of the unknowns of all elements.
        size: number of unknowns, and the number of those that are fixed.
        mixed: whether bodies may keep their pressure as an unknown.
        forces: parts, each with forces on its elements.
    """

    r: el.Line
    z: el.Line
    parts: Sequence[Part]
    unknowns: Indices
    size: int
    mixed: bool
    forces: Sequence[tuple[Part, Array]]

    @property
    def touched(self) -> NDArray[np.bool_]:
        """Whether an unknown belongs to any part."""
        found = np.zeros(self.size + 1, dtype=bool)
        for part in self.parts:
            found[self.unknowns[part.elements]] = True
        return found[:-1]

    def condensed(self, contact: NDArray[np.bool_]) -> Condensed:
        """What is left on the contact."""
        own = np.flatnonzero(self.touched)
        numbers = np.full(self.size + 1, -1)
        numbers[own] = np.arange(len(own))
        loads = np.zeros((self.size + 1, len(self.forces)))
        for column, (part, forces) in enumerate(self.forces):
            np.add.at(loads[:, column], self.unknowns[part.elements], 2 * math.pi * el.nodal(forces))
        places = [np.meshgrid(part.columns, part.rows, indexing="ij") for part in self.parts]
        bodies = [part.body for part in self.parts]

        def condensed_at(added: float) -> Condensed:
            matrices = self._matrices(added)
            return condense(
                Mesh(
                    unknowns=np.concatenate([numbers[self.unknowns[part.elements]] for part in self.parts]),
                    coordinates=np.concatenate([np.stack([x.ravel(), y.ravel()], axis=1) for x, y in places]),
                    matrices=lambda elements: matrices[elements],
                    kept=contact[own],
                    loads=loads[own],
                )
            )

        return (
            extrapolated(condensed_at, ADDED)
            if self.mixed and any(keeps_volume(body) for body in bodies)
            else condensed_at(0.0)
        )

    def _matrices(self, added: float) -> Array:
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
