"""A PVDF film between electrodes: elasticity and electrostatics coupled, as in Appendix I of the thesis.

Axes: 1 along the stretching direction of the film, 2 across it, 3 through the thickness. The film is cut
into layers; unknowns are its two plane strains, and displacement and potential at the layers' faces:

    [ Kuu  Kuφ ] [u]   [forces ]
    [ Kφu -Kφφ ] [φ] = [charges]

Kuu is about 1e9 N/m and Kφφ about 1e-10 F, so the unscaled matrix is singular to working precision. Symmetric scaling,
which only chooses the unit of voltage, cures it. So does static condensation of the potentials: Kuu + Kuφ Kφφ⁻¹ Kφu has
mechanical entries only. `film_response` does both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models.table import Response
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.material import FilmMaterial

EDGES = ("free", "clamped")
CIRCUITS = ("open", "short")


@dataclass(frozen=True, slots=True)
class FilmResponse:
    """Response of a film to a force.

    Attributes:
        voltage: voltage of the upper electrode against the lower one [V]; 0 in short circuit.
        charge: charge that leaves the upper electrode through the short circuit [C]; 0 in open circuit.
        approach: distance by which the faces come closer [m].
        plane_stress: stresses along axes 1 and 2 [Pa].
    """

    voltage: float
    charge: float
    approach: float
    plane_stress: tuple[float, float]


@dataclass(frozen=True, slots=True)
class CoupledSystem:
    """System K x = right of a film.

    Unknowns are the plane strains if they are free, the displacements, and the potentials that are not given.

    Attributes:
        mechanical: number of unknowns that are not potentials.
    """

    matrix: Floats
    right: Floats
    mechanical: int


def film_response(
    material: FilmMaterial,
    area: float,
    thickness: float,
    force: float,
    edges: str,
    circuit: str,
    plane_stress: tuple[float, float] = (0.0, 0.0),
) -> FilmResponse:
    """Voltage and charge of a film that is pressed between its electrodes.

    Args:
        material: material of the film.
        area: area of the electrodes [m2].
        thickness: thickness of the film [m].
        force: compressive force [N].
        edges: "free": the stress along 1 and 2 is `plane_stress` [Pa], as neighbouring plates impose it;
            "clamped": glued to something rigid, the strain along 1 and 2 is zero.
        circuit: "open" or "short".
        plane_stress: stresses along axes 1 and 2 [Pa], of free edges.

    Raises:
        RangeError: area or thickness is not positive and finite, or force or stress is not finite.
        UnknownName: there are no such edges or circuit.
    """
    system = coupled_system(material, area, thickness, force, edges, circuit, plane_stress, layers=1)
    unknowns = solve_condensed(system)
    stiffness, stress, permittivity = material.stiff()
    approach = unknowns[system.mechanical - 1]
    voltage = float(unknowns[-1]) if circuit == "open" else 0.0
    strains = np.zeros(3)
    if edges == "free":
        strains[:2] = unknowns[:2]
    strains[2] = approach / thickness
    field = -voltage / thickness
    stresses = stiffness @ strains - stress * field
    displacement = float(stress @ strains) + permittivity * field
    return FilmResponse(
        voltage=voltage,
        charge=displacement * area if circuit == "short" else 0.0,
        approach=-float(approach),
        plane_stress=(float(stresses[0]), float(stresses[1])),
    )


@dataclass(frozen=True, slots=True)
class FilmSignal:
    """Signal of a film.

    Attributes:
        force: compressive force [N].
        plane_stress: stresses along axes 1 and 2 [Pa]; None: unknown, and taken as 0, as in a film that is free to
            stretch.
        charge: charge in short circuit [C].
        voltage: voltage in open circuit [V].
        voltage_error: bound on the voltage's error [V]; None: the model has none.
    """

    force: float
    plane_stress: tuple[float, float] | None
    charge: float
    voltage: float
    voltage_error: float | None


def signals(design: Design, response: Response) -> dict[str, FilmSignal]:
    """Signal of each film under a sensor's response, by name.

    A finite-element model gives the signals itself, coupled to everything around the films. With any other model a film
    is taken to be free to stretch. These are signals of bare films; the design's measured sensitivities include cable
    and amplifier.
    """
    pvdf, thickness = design.film_sheet.material, design.film_sheet.thickness
    given = {}
    for film in design.films:
        felt, area = response.films[film.name], design.film_area(film)
        charge, voltage = felt.charge, felt.voltage
        if charge is None or voltage is None:
            charge = film_response(pvdf, area, thickness, felt.force, "free", "short").charge
            voltage = film_response(pvdf, area, thickness, felt.force, "free", "open").voltage
        given[film.name] = FilmSignal(felt.force, felt.plane_stress, charge, voltage, felt.voltage_error)
    return given


def coupled_system(
    material: FilmMaterial,
    area: float,
    thickness: float,
    force: float,
    edges: str,
    circuit: str,
    plane_stress: tuple[float, float],
    layers: int,
) -> CoupledSystem:
    """Coupled system in SI units. Fields are uniform, so any number of layers is exact.

    Raises:
        RangeError, UnknownName: as in `film_response`.
    """
    for label, value, unit in (("area", area, "m2"), ("thickness", thickness, "m")):
        if not (0 < value < math.inf):
            raise RangeError(f"film: {label} {value:g} {unit} is not above 0 and finite; give a positive one")
    for label, value, unit in (("force", force, "N"), *(("plane stress", t, "Pa") for t in plane_stress)):
        if not math.isfinite(value):
            raise RangeError(f"film: {label} {value:g} {unit} is not finite; give a number")
    if edges not in EDGES:
        raise UnknownName("edges of a film", edges, EDGES)
    if circuit not in CIRCUITS:
        raise UnknownName("circuit of a film", circuit, CIRCUITS)

    stiffness, stress, permittivity = material.stiff()
    layer = thickness / layers
    # The electric enthalpy of a layer is a quadratic form in (S1, S2, S3, -E3).
    form = np.block([[stiffness, stress[:, None]], [stress[None, :], np.array([[-permittivity]])]])
    size = 2 + 2 * layers
    matrix = np.zeros((size, size))
    for index in range(layers):
        motion = np.zeros((4, size))
        motion[0, 0] = motion[1, 1] = 1
        for row, first in ((2, 2), (3, 2 + layers)):
            motion[row, first + index] = 1 / layer
            if index:
                motion[row, first + index - 1] = -1 / layer
        matrix += area * layer * motion.T @ form @ motion
    right = np.zeros(size)
    right[:2] = np.array(plane_stress) * area * thickness
    right[1 + layers] = -force
    keep = np.ones(size, dtype=bool)
    keep[:2] = edges == "free"
    keep[-1] = circuit == "open"
    mechanical = int(keep[: 2 + layers].sum())
    return CoupledSystem(matrix[np.ix_(keep, keep)], right[keep], mechanical)


def symmetric_scale(matrix: Floats) -> Floats:
    """Factors s that give diag(s) K diag(s) a diagonal of ±1."""
    scale: Floats = 1 / np.sqrt(np.abs(np.diag(matrix)))
    return scale


def solve_condensed(system: CoupledSystem) -> Floats:
    """Solve the potentials out first, each block scaled: Kuu + Kuφ Kφφ⁻¹ Kφu is positive definite."""
    m = system.mechanical
    scale = symmetric_scale(system.matrix)
    matrix, right = system.matrix * np.outer(scale, scale), scale * system.right
    if m == len(right):
        return scale * np.linalg.solve(matrix, right)
    carried = np.linalg.solve(matrix[m:, m:], np.column_stack([matrix[m:, :m], right[m:]]))
    moved = np.linalg.solve(
        matrix[:m, :m] - matrix[:m, m:] @ carried[:, :-1], right[:m] - matrix[:m, m:] @ carried[:, -1]
    )
    answer: Floats = scale * np.concatenate([moved, carried[:, -1] - carried[:, :-1] @ moved])
    return answer
