"""The rubber samples that the sensor touches, named by the thesis' numbers, and the load through a sensed object."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from palpate.instrument.errors import RangeError, UnknownName, named, quoted

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


# --- samples -------------------------------------------------------------------------------------------

#     parse_samples("1-3,6")          # ("1", "2", "3", "6")
#     get_sample("2").modulus         # 24131.65 Pa
#
# The moduli of samples 2 to 5 are the middle of a catalogue range; only 1 and 6 were measured.


@dataclass(frozen=True, slots=True)
class Sample:
    """A sensed object: a flat pad of one material.

    Attributes:
        modulus: Young modulus [Pa].
        thickness: thickness of the pad [m].
        area: area of the loaded face [m2].
        poisson: Poisson ratio, above -1 and at most 0.5.
        source: where the numbers come from.

    Raises:
        RangeError: a dimension or the modulus is not positive and finite, or the Poisson ratio is outside its limits.
    """

    name: str
    material: str
    modulus: float
    thickness: float
    area: float
    poisson: float
    source: str

    def __post_init__(self) -> None:
        for label, value, unit in (
            ("modulus", self.modulus, "Pa"),
            ("thickness", self.thickness, "m"),
            ("area", self.area, "m2"),
        ):
            if not (0 < value < math.inf):
                raise RangeError(
                    f"{label} {value:g} {unit} of sample {self.name!r} is not above 0 and finite; give a positive one"
                )
        if not (-1 < self.poisson <= 0.5):
            raise RangeError(
                f"Poisson ratio {self.poisson:g} of sample {self.name!r} is not above -1 and at most 0.5;"
                " give one inside, 0.5 for an incompressible object"
            )


def _rubber(name: str, material: str, modulus: float, source: str) -> Sample:
    return Sample(
        name=name,
        material=material,
        modulus=modulus,
        thickness=3e-3,
        area=1e-4,
        poisson=0.3,
        source=f"modulus: [T] {source}; 3 mm and 1 cm2: [T] 5.4.1; Poisson ratio: [A]",
    )


SAMPLES: dict[str, Sample] = {
    sample.name: sample
    for sample in (
        _rubber("1", "white silicone rubber", 112609.9, "mean of Table 5.2"),
        _rubber("2", "Neoprene G-231-N", 24131.65, "5.3, 3.5 psi"),
        _rubber("3", "NBR/PVC/NEO blend SC-42", 41368.54, "5.3, 6 psi"),
        _rubber("4", "Natural 1523", 48263.30, "5.3, 7 psi; printed 4823.30, a digit lost"),
        _rubber("5", "NBR/PVC/NEO blend SC-41", 27579.03, "5.3, 4 psi; printed 2579.03, a digit lost"),
        _rubber("6", "unknown", 102667.3, "mean of Table 5.3, measured on a pad of 4.70 mm"),
    )
}


def get_sample(name: str) -> Sample:
    """The sample of that name.

    Raises:
        UnknownName: no such sample.
    """
    return named("sample", name, SAMPLES)


def parse_samples(text: str) -> tuple[str, ...]:
    """Names of samples in a text such as "1-6", "2" or "1,3,5-6", in the order of the text.

    Raises:
        UnknownName: there is no sample of that name.
        RangeError: a sample is named twice, or a range runs backwards or lacks an end.
    """
    names: list[str] = []
    for item in text.split(","):
        for name in _expand(item.strip()):
            if name in names:
                raise RangeError(f"sample {name!r} is named twice in {quoted(text)}; name each sample once")
            names.append(name)
    return tuple(names)


def _expand(item: str) -> Iterator[str]:
    first, dash, last = item.partition("-")
    if not dash:
        yield get_sample(item).name
        return
    if not first.strip() or not last.strip():
        raise RangeError(f"sample range {quoted(item)} lacks an end; write for example '1-3'")
    low, high = int(get_sample(first.strip()).name), int(get_sample(last.strip()).name)
    if low > high:
        raise RangeError(f"sample range {quoted(item)} runs backwards; write '{high}-{low}'")
    for number in range(low, high + 1):
        yield get_sample(str(number)).name


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
