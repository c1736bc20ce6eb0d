"""What presses on a sensor: a force through a sensed object."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from instrument.errors import RangeError, UnknownName
from instrument.sample import Sample

INTERFACES = ("bonded", "frictionless")


@dataclass(frozen=True, slots=True)
class Load:
    """A force on the sensor [N], peak to peak, through a sensed object that covers it.

    Attributes:
        interface: "bonded": the object sticks to tooth and ring; "frictionless": it slides on both.
        at: the force acts in one point of the object, (x, y) from its corner [m]; None: a uniform pressure.

    Raises:
        RangeError: the force is not positive and finite.
        UnknownName: no such interface.
    """

    force: float
    sensed: Sample
    interface: str = "bonded"
    at: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not (0 < self.force < math.inf):
            raise RangeError(f"load {self.force:g} N is not above 0 and finite; give a positive force")
        if self.interface not in INTERFACES:
            raise UnknownName("interface", self.interface, INTERFACES)


def through(load: Load, modulus: float) -> Load:
    """The load through an object of that modulus [Pa]."""
    return replace(load, sensed=replace(load.sensed, modulus=modulus))
