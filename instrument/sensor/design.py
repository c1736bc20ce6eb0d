"""Description of a tactile sensor: rigid teeth, each in a compliant ring, on plates, with films below.

One film lies under each tooth and one under each base. The ratio of the forces on teeth and bases tells how soft the
touched object is. Lengths are in metres; forces and voltages of the thesis are peak to peak.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.sensor.material import FilmMaterial, Material
from palpate.instrument.sensor.sample import require_nested

# --- Scatter of films' gains as a whole: its covariance, and the triangle by which it is drawn ---------
#
# Both are computed in plain Python: a triangle by a BLAS would give a simulated bench other bytes on another
# processor.

Matrix = tuple[tuple[float, ...], ...]
Correlations = Mapping[tuple[str, str], float]

NOTHING = 1e-9  # of a film's variance: what is left of it below that is rounding of the stated correlations


def covariance_of(scatter: Mapping[str, float], correlation: Correlations) -> Matrix:
    """Relative covariance (films, films) of gains.

    Args:
        scatter: film's name -> relative standard deviation of its gain.
        correlation: names of two films -> correlation of their gains; films of no such pair are independent.

    Raises:
        RangeError: a scatter is not 0 to 1, a pair names no two films or comes twice, a correlation is outside -1 to 1.
    """
    for name, deviation in scatter.items():
        if not 0 <= deviation < 1:
            raise RangeError(f"film {name!r}: its scatter {deviation:g} is not from 0 to below 1; correct it")
    coefficients = {(name, name): 1.0 for name in scatter}
    for pair, coefficient in correlation.items():
        if len({*pair} & {*scatter}) != 2 or len(pair) != 2:
            raise RangeError(
                f"scatter_correlation of {pair!r}: give the names of two of its films: {', '.join(scatter)}"
            )
        if pair in coefficients:
            raise RangeError(f"scatter_correlation of {pair!r}: the pair is given twice; leave one out")
        if not -1 <= coefficient <= 1:
            raise RangeError(f"scatter_correlation of {pair!r}: {coefficient:g} is not from -1 to 1; correct it")
        one, other = pair
        coefficients[one, other] = coefficients[other, one] = coefficient
    return tuple(
        tuple(coefficients.get((one, other), 0.0) * scatter[one] * scatter[other] for other in scatter)
        for one in scatter
    )


def triangle(covariance: Matrix, names: tuple[str, ...]) -> Matrix:
    """Lower triangle L with L Lᵀ = covariance: L z has that covariance where z are independent standard normals.

    Raises:
        RangeError: there is none, as the correlations cannot all be true together.
    """
    rows: list[list[float]] = []
    for i, wanted in enumerate(covariance):
        row: list[float] = []
        for j, other in enumerate([*rows, row]):
            left = wanted[j] - math.fsum(a * b for a, b in zip(row, other, strict=False))
            limit = NOTHING * math.sqrt(wanted[i] * covariance[j][j])
            if j == i and left >= -limit:
                row.append(math.sqrt(left) if left > limit else 0.0)
            elif j < i and other[j]:
                row.append(left / other[j])
            elif j < i and abs(left) <= math.sqrt(NOTHING) * math.sqrt(wanted[i] * covariance[j][j]):
                row.append(0.0)  # film j scatters just as those before it say
            else:
                raise RangeError(
                    f"scatter_correlation: film {names[i]!r} cannot correlate so with"
                    f" {', '.join(map(repr, names[:i]))}:"
                    " the matrix of all correlations is not positive semidefinite; bring those of this film nearer to 0"
                )
        rows.append(row)
    return tuple((*row, *[0.0] * (len(rows) - len(row))) for row in rows)


# --- the design ----------------------------------------------------------------------------------------

USUAL_NOISE = 2e-6  # V/√Hz, amplitude density of the noise of a film's channel where none is stated [A]
# The first words of films' names, for films under a tooth and under a base.
FILM_KINDS = ("rigid", "total")
THESIS_LOADS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)  # N, peak to peak: the load sets of Tables A2.9 to A2.14
MANY_TEETH = 4  # a model of more takes so long that its meshes are coarser
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
        scatter_correlation: names of two films -> correlation of their scatter from one load set to the next; films of
            no such pair are independent. With the films' scatter it is all that is stated of how results repeat.
        thesis_force_ratio: sample name -> mean force ratio over the load sets, as printed; empty: the thesis has none.
        thesis_softness_order: sample names, hard to soft.
        thesis_loads: loads of the thesis' load sets, peak to peak [N].
        source: where dimensions and figures come from.
        film_covariance: relative covariance (films, films) of the sensitivities; None: the films were not calibrated on
            this bench, and only their scatter is known.
        film_freedom: degrees of freedom of that covariance; None: infinitely many.
        pickup: greatest force that moving cables add to a film's in step with the drive, as a share of the load on the
            sensor (from the bench file); None: not known.
        noise: amplitude density of the films' noise near the drive (from the bench file) [V/√Hz]; None: not known.
        scatter_covariance: relative covariance (films, films) of the gains' scatter, from what is stated of it.
        scatter_triangle: lower triangle (films, films) that gives independent standard normals that covariance.

    Raises:
        RangeError: a dimension is not positive and finite, parts overlap, the films give no force ratio, or their
            scatter cannot correlate as stated.
        UnknownName: no such outline or support.
    """

    name: str
    tooth: Tooth
    ring: Ring
    plate: Plate
    plate_count: int
    film_sheet: FilmSheet
    films: tuple[Film, ...]
    scatter_correlation: Correlations = field(default_factory=dict, hash=False)
    thesis_force_ratio: Mapping[str, float] = field(default_factory=dict, hash=False)
    thesis_softness_order: tuple[str, ...] = ()
    source: str = ""
    teeth: tuple[tuple[float, float], ...] = ((5e-3, 5e-3),)
    thesis_loads: tuple[float, ...] = THESIS_LOADS
    separate_bases: bool = False
    outline: str = "square"
    disc_radius: float = 5e-3
    support: str = "elastic"
    film_covariance: tuple[tuple[float, ...], ...] | None = None
    film_freedom: float | None = None
    pickup: float | None = None
    noise: float | None = None
    scatter_covariance: Matrix = field(init=False, compare=False, repr=False)
    scatter_triangle: Matrix = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        for part in (self.tooth, self.ring, self.plate, self.film_sheet, self):
            for item in (each for each in fields(part) if each.init):
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
        scatter = {film.name: film.scatter for film in self.films}
        try:
            covariance = covariance_of(scatter, self.scatter_correlation)
            made = triangle(covariance, tuple(scatter))
        except RangeError as error:
            raise RangeError(f"design {self.name!r}: {error}") from None
        object.__setattr__(self, "scatter_covariance", covariance)
        object.__setattr__(self, "scatter_triangle", made)

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
    def ratio_slopes(self) -> tuple[float, ...]:
        """Relative change of the sensor's force ratio by that of each film's gain, where all teeth bear alike."""
        count = Counter(film.kind for film in self.films)
        return tuple((1 if film.kind == FILM_KINDS[0] else -1) / count[film.kind] for film in self.films)

    @property
    def ratio_scatter(self) -> float:
        """Relative standard deviation of the sensor's force ratio from one load set to the next, to first order.

        All teeth bear alike. Of one tooth's ratio `tooth_covariance` tells it.
        """
        slopes = self.ratio_slopes
        return math.sqrt(max(_sum(slopes, self.scatter_covariance, slopes), 0.0))

    @property
    def tooth_covariance(self) -> Matrix:
        """Relative covariance (teeth, teeth) of the teeth's force ratios from one load set to the next, to first order.

        They are in the order of the teeth's films.
        """
        rigid, total = ([film for film in self.films if film.kind == kind] for kind in FILM_KINDS)
        pairs = [(film, next(base for base in total if film.teeth[0] in base.teeth)) for film in rigid]
        slopes = [[float(each == film) - float(each == base) for each in self.films] for film, base in pairs]
        covariance = self.scatter_covariance
        return tuple(tuple(_sum(one, covariance, other) for other in slopes) for one in slopes)

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


def _sum(one: Sequence[float], covariance: Matrix, other: Sequence[float]) -> float:
    """Covariance of two sums of the films' gains with these slopes."""
    return math.fsum(
        a * b * each for a, row in zip(one, covariance, strict=True) for b, each in zip(other, row, strict=True)
    )
