"""What a tactile sensor is: a rigid tooth in a compliant ring, on plates, with films below.

One film lies under the tooth, one under the whole base; the ratio of the two forces tells how soft the
touched object is. Lengths in metres; forces and voltages of the thesis are peak to peak.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from instrument.errors import UnknownName
from instrument.material import Material


@dataclass(frozen=True, slots=True)
class Tooth:
    """The rigid cylinder."""

    radius: float
    height: float
    material: Material

    @property
    def area(self) -> float:
        """Cross-section [m2]."""
        return math.pi * self.radius**2


@dataclass(frozen=True, slots=True)
class Ring:
    """The compliant hollow cylinder around the tooth."""

    inner_radius: float
    outer_radius: float
    height: float
    material: Material

    @property
    def area(self) -> float:
        """Cross-section [m2]."""
        return math.pi * (self.outer_radius**2 - self.inner_radius**2)


@dataclass(frozen=True, slots=True)
class Plate:
    """One of the two base plates."""

    length: float
    width: float
    thickness: float
    material: Material


@dataclass(frozen=True, slots=True)
class FilmSheet:
    """The films as bodies: a disc under the tooth, a rectangle under the base, of one thickness."""

    disc_radius: float
    length: float
    width: float
    thickness: float
    material: Material


@dataclass(frozen=True, slots=True)
class Film:
    """One film as a signal.

    Attributes:
        channel: channel of the sensor node, from 1.
        sensitivity: voltage per force on the film [V/N].
        scatter: relative standard deviation of the sensitivity from one load set to the next.
    """

    name: str
    channel: int
    sensitivity: float
    scatter: float


@dataclass(frozen=True, slots=True)
class Design:
    """One sensor: dimensions, materials, films, and what the thesis measured with it.

    Attributes:
        plate_count: base plates below the tooth, with the base film between them.
        films: by channel.
        ratio_scatter: relative standard deviation of the force ratio from one load set to the next.
        thesis_force_ratio: sample name -> mean force ratio over the load sets, as printed.
        thesis_softness_order: sample names, hard to soft.
        source: where dimensions and figures come from.
    """

    name: str
    tooth: Tooth
    ring: Ring
    plate: Plate
    plate_count: int
    film_sheet: FilmSheet
    films: tuple[Film, ...]
    ratio_scatter: float
    thesis_force_ratio: Mapping[str, float] = field(hash=False)
    thesis_softness_order: tuple[str, ...]
    source: str

    @property
    def gap(self) -> float:
        """Radial clearance between tooth and ring [m]."""
        return self.ring.inner_radius - self.tooth.radius

    @property
    def film_correlation(self) -> float:
        """Correlation of the scatter of the films "rigid" and "total" that gives the ratio its own scatter.

        The ratio of two quantities of relative scatter a and b and correlation r scatters by
        sqrt(a^2 + b^2 - 2 r a b), to first order.
        """
        a, b = self.film("rigid").scatter, self.film("total").scatter
        return (a**2 + b**2 - self.ratio_scatter**2) / (2 * a * b)

    def film(self, name: str) -> Film:
        """The film of that name.

        Raises:
            UnknownName: the design has no such film.
        """
        for film in self.films:
            if film.name == name:
                return film
        raise UnknownName(f"film of design {self.name!r}", name, [film.name for film in self.films])
