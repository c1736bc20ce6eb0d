"""Load on a sensor: a force through a sensed object."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.sensor.sample import Sample

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

# --- Checks of numbers that designs and models share, with their messages ------------------------------


def require_positive(value: ArrayLike, label: str, unit: str, of: str = "") -> None:
    """Check that a number, or each number of an array, is above 0 and finite. Raises RangeError."""
    import numpy as np  # not with the module: designs are known before

    values = np.atleast_1d(np.asarray(value, dtype=np.float64))
    bad = ~((values > 0) & np.isfinite(values))
    if bad.any():
        whose = f" of the {of}" if of else ""
        raise RangeError(f"{label} {values[bad][0]:g} {unit}{whose} is not above 0 and finite; give a positive one")


def require_nested(radii: Mapping[str, float], where: str = "") -> None:
    """Check that each radius [m] fits into the next: tooth, ring's inside and outside, cell. Raises RangeError.

    A gap between tooth and ring is not needed, but a ring needs some width. A cell may be just as wide as its ring.
    """
    for place, ((inner, low), (outer, high)) in enumerate(pairwise(radii.items())):
        if not (low <= high * (1 + 1e-12)) or (place == 1 and low == high):
            raise RangeError(
                f"{where}parts overlap: {inner} {low:g} m is not below {outer} {high:g} m; make it smaller"
            )


# --- the load ------------------------------------------------------------------------------------------

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
