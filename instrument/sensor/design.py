"""Description of a tactile sensor: rigid teeth, each in a compliant ring, on plates, with films below.

One film lies under each tooth and one under each base. The ratio of the forces on teeth and bases tells how soft the
touched object is. Lengths are in metres; forces and voltages of the thesis are peak to peak.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.sensor.film_material import FilmMaterial
from palpate.instrument.sensor.limits import require_nested
from palpate.instrument.sensor.material import Material

USUAL_NOISE = 2e-6  # V/√Hz, amplitude density of the noise of a film's channel where none is stated [A]
# The first words of films' names, for films under a tooth and under a base.
FILM_KINDS = ("rigid", "total")
OUTLINES = ("square", "round")
SUPPORTS = ("elastic", "rigid")


@dataclass(frozen=True, slots=True)
class Tooth:
    """A rigid cylinder, through which the sensor is pressed at its middle."""

    radius: float
    height: float
    material: Material

    @property
    def area(self) -> float:
        """Cross-section [m2]."""
        return math.pi * self.radius**2


@dataclass(frozen=True, slots=True)
class Ring:
    """The compliant part around the tooth: a hollow cylinder ("round"), or one that fills its cell ("square")."""

    inner_radius: float
    outer_radius: float
    height: float
    material: Material
    outline: str = "round"

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
    material: FilmMaterial


@dataclass(frozen=True, slots=True)
class Film:
    """One film as a signal.

    Attributes:
        channel: channel of the sensor node, from 1.
        sensitivity: voltage per force on the film [V/N].
        scatter: relative standard deviation of the sensitivity from one load set to the next.
        teeth: numbers, from 0, of the teeth whose force the film takes: the teeth's force alone ("rigid"), or together
            with the force on everything beside them ("total").
    """

    name: str
    channel: int
    sensitivity: float
    scatter: float
    teeth: tuple[int, ...] = (0,)

    @property
    def kind(self) -> str:
        """Kind of the film, one of FILM_KINDS: where it lies."""
        return next(kind for kind in FILM_KINDS if self.name.startswith(kind))


@dataclass(frozen=True, slots=True)
class Design:
    """One sensor: dimensions, materials, films, and what the thesis measured with it.

    Attributes:
        tooth, ring: dimensions and materials that all teeth share.
        plate: dimensions and material that all base plates share.
        plate_count: number of base plates below a tooth; the base film lies between them.
        teeth: positions (x, y) of the teeth's axes from the corner of the sensor [m]: a lattice, row by row.
        separate_bases: whether each tooth has a base of its own.
        outline: outline of plates and sensed object: "square", or "round" for one tooth on a disc.
        disc_radius: radius [m] of the disc that replaces a square object in a model that knows only round ones.
        support: "elastic": tooth, films and plates deform; "rigid": only object and ring do.
        films: the films in the order of their channels.
        ratio_scatter: relative standard deviation of the force ratio from one load set to the next.
        thesis_force_ratio: sample name -> mean force ratio over the load sets, as printed.
        thesis_softness_order: sample names, hard to soft.
        source: where dimensions and figures come from.
        film_covariance: relative covariance (films, films) of the sensitivities; None: the films were not calibrated on
            this bench, and only their scatter is known.
        film_freedom: degrees of freedom of that covariance; None: infinitely many.
        pickup: greatest force that moving cables add to a film's in step with the drive, as a share of the load on the
            sensor (from the bench file); None: not known.
        noise: amplitude density of the films' noise near the drive (from the bench file) [V/√Hz]; None: not known.

    Raises:
        RangeError: a dimension is not positive and finite, parts overlap, or the films give no force ratio.
        UnknownName: no such outline or support.
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
    teeth: tuple[tuple[float, float], ...] = ((5e-3, 5e-3),)
    separate_bases: bool = False
    outline: str = "square"
    disc_radius: float = 5e-3
    support: str = "elastic"
    film_covariance: tuple[tuple[float, ...], ...] | None = None
    film_freedom: float | None = None
    pickup: float | None = None
    noise: float | None = None

    def __post_init__(self) -> None:
        for part in (self.tooth, self.ring, self.plate, self.film_sheet, self):
            for item in fields(part):
                value = getattr(part, item.name)
                if isinstance(value, float) and not (0 < value < math.inf):
                    raise RangeError(
                        f"design {self.name!r}: {item.name} {value:g} of its {type(part).__name__.lower()} is not"
                        " above 0 and finite; give a positive one"
                    )
        if self.outline not in OUTLINES:
            raise UnknownName("outline of a design", self.outline, OUTLINES)
        if self.ring.outline not in OUTLINES:
            raise UnknownName("outline of a ring", self.ring.outline, OUTLINES)
        if self.support not in SUPPORTS:
            raise UnknownName("support of a design", self.support, SUPPORTS)
        require_nested(
            {
                "radius of the tooth": self.tooth.radius,
                "inner radius of the ring": self.ring.inner_radius,
                "outer radius of the ring": self.ring.outer_radius,
                "half of the cell": min(self.cell) / 2,
            },
            f"design {self.name!r}: ",
        )
        self._check_films()

    def _check_films(self) -> None:
        """Raises RangeError: a name, a channel or a tooth of a film is wrong, or a film is missing."""
        rigid, total = FILM_KINDS
        bases = [{*film.teeth} for film in self.films if film.name.startswith(total)]
        seen = Counter(mark for film in self.films for mark in (film.name, film.channel))
        for film in self.films:
            problem = ""
            if not film.name.startswith(FILM_KINDS):
                problem = f"its name must begin with {rigid!r} or {total!r}"
            elif seen[film.name] > 1 or seen[film.channel] > 1 or film.channel < 1:
                problem = f"its name, and its channel {film.channel} from 1, must be those of no other film"
            elif not film.teeth or not {*film.teeth} <= {*range(len(self.teeth))}:
                problem = f"its teeth {film.teeth} must be one or more of the numbers 0 to {len(self.teeth) - 1}"
            elif film.kind == rigid and not any(base.issuperset(film.teeth) for base in bases):
                problem = f"there must be a {total!r} film that takes the force of its teeth, too"
            if problem:
                raise RangeError(f"design {self.name!r}: film {film.name!r}: {problem}; correct the design")
        if not any(film.kind == rigid for film in self.films):
            raise RangeError(f"design {self.name!r}: has no film whose name begins with {rigid!r}; add one")

    def with_pickup(self, share: float) -> Design:
        """The design with the pick-up that a bench file states for its cables; 0: the file states none."""
        return replace(self, pickup=share or None)

    def with_noise(self, density: float | None) -> Design:
        """The design with the noise that a bench file states for its films [V/√Hz]; None or 0: it states none."""
        return replace(self, noise=density or None)

    @property
    def columns(self) -> int:
        """Number of teeth along the length."""
        return len({x for x, _ in self.teeth})

    @property
    def rows(self) -> int:
        """Number of teeth along the width."""
        return len({y for _, y in self.teeth})

    @property
    def cell(self) -> tuple[float, float]:
        """Length and width [m] of the part of the plan that belongs to one tooth, which stands in its middle."""
        x, y = self.teeth[0]
        return 2 * x, 2 * y

    @property
    def gap(self) -> float:
        """Radial clearance between tooth and ring [m]."""
        return self.ring.inner_radius - self.tooth.radius

    @property
    def film_correlation(self) -> float:
        """Correlation between the scatter of a tooth's film and that of its base's film.

        It is the one that gives the force ratio its printed scatter: the ratio of two quantities of relative scatter a
            and b and correlation r scatters by sqrt(a^2 + b^2 - 2 r a b), to first order. Where no correlation does
            (common base), 1 comes nearest.
        """
        a, b = (next(film for film in self.films if film.kind == kind).scatter for kind in FILM_KINDS)
        return min(1.0, (a**2 + b**2 - self.ratio_scatter**2) / (2 * a * b))

    def film_area(self, film: Film) -> float:
        """Area of the film's electrodes [m2]."""
        sheet = self.film_sheet
        if film.kind == FILM_KINDS[0]:
            return math.pi * sheet.disc_radius**2
        return math.pi * self.disc_radius**2 if self.outline == "round" else sheet.length * sheet.width

    def film(self, name: str) -> Film:
        """The film of that name.

        Raises:
            UnknownName: the design has no such film.
        """
        for film in self.films:
            if film.name == name:
                return film
        raise UnknownName(f"film of design {self.name!r}", name, [film.name for film in self.films])
