"""Parameters of the finite-element models: those of both, those of the round sensor, and those of the square lattice.

The sensor consists, from below, of plate, base film and plate. On them are film and tooth in the middle and the
compliant ring around both. The sensed object lies on top, under a uniform pressure unless a load says otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import Any

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.sensor.design import OUTLINES, SUPPORTS, Design
from palpate.instrument.sensor.material import PVDF, FilmMaterial
from palpate.instrument.sensor.sample import INTERFACES, Load, Sample, require_nested, require_positive

# --- parameters ----------------------------------------------------------------------------------------


# Limits of other lengths over the ring's outer radius: beyond them the result no longer changes, and digits are lost.
PROPORTIONS = (1e-5, 300.0)
# Limits of moduli, far beyond those of any matter [Pa]: outside them squares leave the range of a double.
MODULI = (1e-3, 1e20)
CLOSED = 1e-3  # share of the tooth's radius; a smaller gap counts as closed
LOADS = ("pressure", "platen")

_MODULI = ("sensed_modulus", "compliant_modulus", "tooth_modulus", "plate_modulus")
_POISSON = ("sensed_poisson", "compliant_poisson", "tooth_poisson", "plate_poisson")
SHARED_LENGTHS = (
    "sensed_thickness",
    "tooth_radius",
    "ring_inner_radius",
    "ring_outer_radius",
    "sensor_height",
    "plate_thickness",
    "film_thickness",
)


@dataclass(frozen=True, slots=True)
class SensorParameters:
    """Dimensions [m], Young moduli [Pa], Poisson ratios, and how the parts touch. Defaults: case A at 0.1 MPa.

    Attributes:
        interface: "bonded": the object sticks to tooth and ring; "frictionless": it slides on both; "capped": it slides
            on both, and a rigid cap that cannot tilt keeps the ring's top level.
        support: "elastic": tooth, films and plates deform; "rigid": only object and ring do.
        sensor_height: height of the tooth, and of the ring above the tooth's film.
        film_thickness: thickness of each film; the ring is higher than the tooth by one film, so that the face is flat.

    Raises:
        RangeError: a modulus or length is not positive and finite, a Poisson ratio is outside (-1, 0.5],
            parts overlap, or a capped ring touches its tooth.
        UnknownName: there is no such interface or support.
    """

    sensed_modulus: float = 1e5
    sensed_poisson: float = 0.3
    sensed_thickness: float = 3e-3  # rubber samples, 5.4.2
    compliant_modulus: float = 24e3  # 3.1.4
    compliant_poisson: float = 0.49
    tooth_modulus: float = 4.1e9  # 3.1.3
    tooth_poisson: float = 0.3
    plate_modulus: float = 70e6  # Table 3.1
    plate_poisson: float = 0.3
    film: FilmMaterial = PVDF
    interface: str = "bonded"
    support: str = "elastic"
    tooth_radius: float = 1.4e-3  # 3.1.3
    ring_inner_radius: float = 1.5e-3  # 3.1.4
    ring_outer_radius: float = 5e-3
    sensor_height: float = 3.88e-3
    plate_thickness: float = 0.55e-3  # Table 3.1
    film_thickness: float = 25e-6  # 3.1.2

    def __post_init__(self) -> None:
        _require_positive(self, _MODULI, "Pa")
        for name in _MODULI:
            if not (MODULI[0] <= getattr(self, name) <= MODULI[1]):
                raise RangeError(
                    f"{name} {getattr(self, name):g} Pa is outside {MODULI[0]:g} to {MODULI[1]:g} Pa;"
                    " give a Young modulus that a body has"
                )
        _require_positive(self, SHARED_LENGTHS, "m")
        _require_proportionate(self, SHARED_LENGTHS)
        for name in _POISSON:
            value = getattr(self, name)
            if not (-1 < value <= 0.5):
                raise RangeError(f"{name} {value:g} is outside (-1, 0.5]; give a Poisson ratio")
        require_name(self, "interface", INTERFACES)
        require_name(self, "support", SUPPORTS)
        gap = self.ring_inner_radius - self.tooth_radius
        if self.interface == "capped" and 0 <= gap < CLOSED * self.tooth_radius:
            raise RangeError(
                f"ring_inner_radius {self.ring_inner_radius:g} m leaves the capped ring a gap of {gap:g} m, which is"
                f" below {CLOSED:g} of the tooth's radius: the cap would hang on the tooth; widen the gap, or take"
                " interface 'frictionless'"
            )

    def _require_nested(self, outermost: str, limit: float) -> None:
        radii = {name: getattr(self, name) for name in ("tooth_radius", "ring_inner_radius", "ring_outer_radius")}
        require_nested({**radii, outermost: limit})

    @property
    def modulus_ratio(self) -> float:
        """Young modulus of the object over that of the ring."""
        return self.sensed_modulus / self.compliant_modulus

    def canonical(self) -> str:
        """Every field with its exact value, in one order: the text from which a content hash is made."""
        return ";".join(f"{field.name}={getattr(self, field.name)!r}" for field in fields(self))


@dataclass(frozen=True, slots=True)
class RoundParameters(SensorParameters):
    """Parameters of the axisymmetric model: one sensor under a round object, on round plates.

    The thesis' sensor is square (10 x 10 mm); the radii are those of the disc that replaces it.

    Attributes:
        sensed_radius: radius of the object [m].
        plate_radius: radius of plates and base film [m].
    """

    sensed_radius: float = 5e-3
    plate_radius: float = 5e-3

    def __post_init__(self) -> None:
        SensorParameters.__post_init__(self)
        _require_positive(self, ("sensed_radius", "plate_radius"), "m")
        self._require_nested("plate_radius", self.plate_radius)
        if self.sensed_radius <= self.ring_inner_radius:
            raise RangeError(
                f"sensed_radius {self.sensed_radius:g} m does not reach the ring at ring_inner_radius"
                f" {self.ring_inner_radius:g} m; give a larger object"
            )


@dataclass(frozen=True, slots=True)
class SolidParameters(SensorParameters):
    """Parameters of the solid model: equal cells, each with a tooth and ring in its middle, under one object.

    Attributes:
        ring_outline: "round"; or "square": the compliant part fills its cell outside the gap.
        outline: outline of object and plates: "square"; or "round": no wider than the ring, for one tooth only.
        cell_length, cell_width: size of the plan for each tooth [m].
        columns, rows: number of teeth along length and width.
        separate_bases: whether each tooth has plates and a base film of its own.
        load: uniform "pressure" on the object, or a flat rigid "platen" that is glued to it.
        load_at: point of the object for a point load instead, (x, y) from its corner [m].
        force: whole force [N].

    Raises:
        RangeError: the force is not positive and finite, or the load is off the object.
        UnknownName: there is no such outline or load.
    """

    ring_outline: str = "round"
    outline: str = "square"
    cell_length: float = 10e-3
    cell_width: float = 10e-3
    columns: int = 1
    rows: int = 1
    separate_bases: bool = False
    load: str = "pressure"
    load_at: tuple[float, float] | None = None
    force: float = 1.0

    def __post_init__(self) -> None:
        SensorParameters.__post_init__(self)
        _require_positive(self, ("cell_length", "cell_width"), "m")
        _require_positive(self, ("force",), "N")
        require_name(self, "ring_outline", OUTLINES)
        require_name(self, "outline", OUTLINES)
        require_name(self, "load", LOADS)
        self._require_nested("half of the cell", min(self.cell_length, self.cell_width) / 2)
        if self.columns < 1 or self.rows < 1:
            raise RangeError(f"{self.columns} x {self.rows} teeth: give at least one column and one row")
        if self.outline == "round" and (self.columns, self.rows) != (1, 1):
            raise RangeError(f"outline 'round' holds one tooth, not {self.columns} x {self.rows}; make it 'square'")
        if self.load_at is not None:
            self._require_inside(*self.load_at)

    def _require_inside(self, x: float, y: float) -> None:
        inside = 0 <= x <= self.length and 0 <= y <= self.width
        if self.outline == "round":
            inside = math.hypot(x - self.length / 2, y - self.width / 2) <= self.ring_outer_radius
        if not inside:
            raise RangeError(
                f"load at ({x:g}, {y:g}) m is off the object of {self.length:g} x {self.width:g} m; move it inside"
            )

    @property
    def length(self) -> float:
        """Length of the object along x [m]."""
        return self.columns * self.cell_length

    @property
    def width(self) -> float:
        """Width of the object along y [m]."""
        return self.rows * self.cell_width

    @property
    def load_area(self) -> float:
        """Area on which the object is pressed [m2]."""
        return math.pi * self.ring_outer_radius**2 if self.outline == "round" else self.length * self.width


Parameters = RoundParameters | SolidParameters


def _require_positive(of: object, names: Sequence[str], unit: str) -> None:
    """Check that attributes are above 0 and finite. Raises RangeError."""
    for name in names:
        require_positive(getattr(of, name), name, unit)


def _require_proportionate(of: SensorParameters, names: Sequence[str]) -> None:
    """Check that no length is too small or too large beside the sensor for a mesh. Raises RangeError."""
    for name in names:
        value, low, high = getattr(of, name), *(share * of.ring_outer_radius for share in PROPORTIONS)
        if not (low <= value <= high):
            raise RangeError(
                f"{name} {value:g} m is outside {low:g} to {high:g} m, {PROPORTIONS[0]:g} to {PROPORTIONS[1]:g} times"
                " the ring's outer radius; give a length of the sensor's order"
            )


def require_name(of: object, kind: str, valid: Sequence[str]) -> None:
    """Check that an attribute is one of the valid names. Raises UnknownName."""
    if getattr(of, kind) not in valid:
        raise UnknownName(kind, getattr(of, kind), valid)


def round_parameters(design: Design, load: Load) -> RoundParameters:
    """Parameters of a design with one tooth under a load; discs replace squares.

    Raises:
        RangeError: the design has more than one tooth, or the load acts in one point.
    """
    if len(design.teeth) > 1:
        raise RangeError(f"design {design.name!r} has {len(design.teeth)} teeth, not one; take model 'solid'")
    if load.at is not None:
        raise RangeError(f"load at ({load.at[0]:g}, {load.at[1]:g}) m is not round; take model 'solid'")
    return RoundParameters(
        **_shared(design, load),
        sensed_radius=design.disc_radius,
        plate_radius=max(design.disc_radius, design.ring.outer_radius),
    )


def solid_parameters(design: Design, load: Load) -> SolidParameters:
    """Parameters of a design under a load."""
    length, width = design.cell
    return SolidParameters(
        **_shared(design, load),
        ring_outline=design.ring.outline,
        outline=design.outline,
        cell_length=length,
        cell_width=width,
        columns=design.columns,
        rows=design.rows,
        separate_bases=design.separate_bases,
        load_at=load.at,
        force=load.force,
    )


def _shared(design: Design, load: Load) -> dict[str, Any]:
    tooth, ring, plate, film = design.tooth, design.ring, design.plate, design.film_sheet
    return {
        "sensed_modulus": load.sensed.modulus,
        "sensed_poisson": load.sensed.poisson,
        "sensed_thickness": load.sensed.thickness,
        "compliant_modulus": ring.material.modulus,
        "compliant_poisson": ring.material.poisson,
        "tooth_modulus": tooth.material.modulus,
        "tooth_poisson": tooth.material.poisson,
        "plate_modulus": plate.material.modulus,
        "plate_poisson": plate.material.poisson,
        "film": film.material,
        "interface": load.interface,
        "support": design.support,
        "tooth_radius": tooth.radius,
        "ring_inner_radius": ring.inner_radius,
        "ring_outer_radius": ring.outer_radius,
        "sensor_height": tooth.height,
        "plate_thickness": plate.thickness,
        "film_thickness": film.thickness,
    }


# --- what numbers depend on, apart from the object's modulus and the force -------------------------------

# Raise this with every change of the models' numbers: stored ones of another version are not used.
CODE_VERSION = 5


def fixed(parameters: Parameters) -> str:
    """Text of everything on which a force ratio depends, except the object's modulus.

    The ring's modulus is in it, because it sets the sensor's stiffness against that of the plates.
    """
    apart = replace(parameters, sensed_modulus=parameters.compliant_modulus)
    if isinstance(apart, SolidParameters):
        apart = replace(apart, force=1.0)
    return apart.canonical()


# --- sets ----------------------------------------------------------------------------------------------

# chosen = get_parameter_set("identified", "axisymmetric")
# response(chosen.design(get_design("single")), chosen.load(modulus=100e3), "axisymmetric")


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """The sensed object, and the numbers of a design that are replaced; None keeps the design's own.

    Attributes:
        sensed_thickness, sensed_poisson, interface: thickness [m], Poisson ratio and interface of the object.
        compliant_poisson, ring_outline, support, disc_radius: see `palpate.instrument.sensor.design`.
        source: where the numbers come from.
        fitted_to: tables of the thesis to whose force ratios the numbers were fitted.
    """

    source: str
    sensed_thickness: float = 3e-3  # rubber samples, 5.4.2
    sensed_poisson: float = 0.3  # [A]
    interface: str = "bonded"
    compliant_poisson: float | None = None
    ring_outline: str | None = None
    support: str | None = None
    disc_radius: float | None = None
    fitted_to: tuple[str, ...] = ()

    def design(self, design: Design) -> Design:
        """The design with the numbers that the set replaces."""
        ring = design.ring
        if self.compliant_poisson is not None:
            ring = replace(ring, material=replace(ring.material, poisson=self.compliant_poisson))
        if self.ring_outline is not None:
            ring = replace(ring, outline=self.ring_outline)
        return replace(
            design,
            ring=ring,
            support=self.support or design.support,
            disc_radius=self.disc_radius or design.disc_radius,
        )

    def load(self, modulus: float, force: float = 1.0) -> Load:
        """The set's object, of that Young modulus [Pa], under a force [N].

        Raises:
            RangeError: the modulus or the force is not positive and finite.
        """
        sensed = Sample(
            name="sensed object",
            material="rubber",
            modulus=modulus,
            thickness=self.sensed_thickness,
            area=1e-4,
            poisson=self.sensed_poisson,
            source=self.source,
        )
        return Load(force=force, sensed=sensed, interface=self.interface)


PHYSICAL = ParameterSet(source="[T] the experiments' rubber, 5.4.2; Poisson ratio [A]")
THESIS = ParameterSet(
    source="[T] the program of Appendix A2.1 gives the object the plate's thickness", sensed_thickness=0.55e-3
)
# What all fitted sets share. Their numbers are effective ones, not physical ones.
_EFFECTIVE = ParameterSet(source="", interface="frictionless", support="rigid")
IDENTIFIED_ROUND = replace(
    _EFFECTIVE,
    source="fitted to Table A2.1: effective values, not physical ones; many other sets fit as well",
    sensed_thickness=2.01e-3,
    sensed_poisson=0.499,
    compliant_poisson=0.095,
    disc_radius=5.64e-3,  # the area of the 10 x 10 mm plate
    fitted_to=("A2.1",),
)
IDENTIFIED_SOLID = replace(
    _EFFECTIVE,
    # Round rings fit A2.1 alone, and miss A2.3 by up to 0.22.
    source="fitted to Tables A2.1 and A2.3 together: effective values, not physical ones",
    sensed_thickness=3.6e-3,
    sensed_poisson=0.05,
    compliant_poisson=0.455,
    ring_outline="square",
    fitted_to=("A2.1", "A2.3"),
)
CAPPED = replace(
    _EFFECTIVE,
    source="fitted to Table A2.7: effective values, not physical ones, for objects 4.5 times as hard as the ring",
    sensed_thickness=0.8e-3,
    sensed_poisson=0.3,
    interface="capped",
    compliant_poisson=0.3,
    fitted_to=("A2.7",),
)

PARAMETER_SETS = ("thesis", "physical", "identified", "capped")
_GIVEN: Mapping[str, ParameterSet] = MappingProxyType({"thesis": THESIS, "physical": PHYSICAL})
# One for each finite-element model: other models do not have the fitted numbers.
_FITTED: Mapping[str, Mapping[str, ParameterSet]] = MappingProxyType(
    {
        "identified": {
            "axisymmetric": IDENTIFIED_ROUND,
            "solid": IDENTIFIED_SOLID,
            "surface": IDENTIFIED_SOLID,
            "auto": IDENTIFIED_SOLID,
        },
        "capped": {"axisymmetric": CAPPED, "solid": CAPPED, "auto": CAPPED},
    }
)


def get_parameter_set(name: str, model: str) -> ParameterSet:
    """The parameter set of that name for a model.

    Raises:
        UnknownName: there is no such set, or none was identified for the model.
    """
    if name not in PARAMETER_SETS:
        raise UnknownName("parameter set", name, PARAMETER_SETS)
    if name in _GIVEN:
        return _GIVEN[name]
    if model not in _FITTED[name]:
        raise UnknownName(f"parameter set of model {model!r}", name, tuple(_GIVEN))
    return _FITTED[name][model]
