"""Parameter sets: numbers that the thesis leaves open or gives twice. They replace a design's own, and name the object.

chosen = get_parameter_set("identified", "axisymmetric")
response(chosen.design(get_design("single")), chosen.load(modulus=100e3), "axisymmetric")
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from palpate.instrument.errors import UnknownName
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.load import Load
from palpate.instrument.sensor.sample import Sample


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
