"""Load on a sensor: a force through a sensed object."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.sensor.sample import Sample

INTERFACES = ("bonded", "frictionless", "capped")
LEAST, GREATEST = 1e-6, 1e6  # limits of a load [N]; beyond them forces vanish in round-off, or overflow


@dataclass(frozen=True, slots=True)
class Load:
    """A force on the sensor [N], peak to peak, through a sensed object that covers it.

    Attributes:
        force: peak to peak [N].
        sensed: the object that the force goes through.
        interface: "bonded": the object sticks to tooth and ring; "frictionless": it slides on both; "capped": it slides
            on both, and a rigid cap that cannot tilt keeps the ring's top level.
        at: point of the object in which the force acts, (x, y) from its corner [m]; None: a uniform pressure.

    Raises:
        RangeError: as in `check_force`.
        UnknownName: there is no such interface.
    """

    force: float
    sensed: Sample
    interface: str = "bonded"
    at: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_force(self.force)
        if self.interface not in INTERFACES:
            raise UnknownName("interface", self.interface, INTERFACES)


def check_force(force: float) -> None:
    """Refuse a load [N] that is not positive, or that no sensor feels or survives. Raises RangeError."""
    if not (0 < force < math.inf):
        raise RangeError(f"load {force:g} N is not above 0 and finite; give a positive force")
    if not LEAST <= force <= GREATEST:
        raise RangeError(f"load {force:g} N is outside {LEAST:g} to {GREATEST:g} N; give one inside")


def through(load: Load, modulus: float) -> Load:
    """The same load through an object of another modulus [Pa]."""
    return replace(load, sensed=replace(load.sensed, modulus=modulus))
