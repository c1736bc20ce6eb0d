"""A mesh's answers in closed form over the modulus of the sensed object.

    sensor = Sensor(condensed, films, capacitances)
    found = curve(sensor, sensed, modes, rows, offsets, ratio)
    found.values(np.array([24e3, 1e5]))

The stiffness is K0 + E K1, with the sensor in K0 and the object of modulus E in K1. Both share the displacements u of
the contact alone. Condensed on them, (S0 + E S1) u = f, where f does not depend on E. With S0 = L Lᵀ and the
eigenvectors V and eigenvalues μ of L⁻¹ S1 L⁻ᵀ, every linear goal is a sum of poles,

    gᵀ u = Σ bᵢ aᵢ / (1 + E μᵢ),    a = Vᵀ L⁻¹ f,    b = Vᵀ L⁻¹ g.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError
from palpate.instrument.models.finite_elements.work import go_on
from palpate.instrument.sensor.material import FilmMaterial

if TYPE_CHECKING:
    from palpate.instrument.models.finite_elements.elimination import Condensed


# Poles are left out while the sum of their residues is below this share of that of all.
NEGLIGIBLE = 1e-15
# A rate is one energy over another, so never below 0. Rounding may bring it there, by a share of the greatest rate that
# was 2e-7 for 0.5 µm of rubber that keeps its volume, 2e-8 for any foil in the plane, and 0 for other objects.
ROUNDED = 1e-6
SHAPES = ("loads", "goals", "offsets", "ratio", "clamped", "charges", "capacity")
BY_POLE = ("rates", "loads", "goals", "ratio", "charges")


class Sensor:
    """A sensor with open films, condensed onto its contact.

    Attributes:
        stiffness: (contact, contact), with open films.
        charges: (contact, films), charges that leave the films in short circuit, by the contact's displacements.
        capacity: (films, films), voltages of open films by these charges [1/F].

    Args:
        condensed: the sensor with its films in short circuit. Among its loads are the forces of the films under 1 V.
        films: places of these loads.
        capacitances: (films,), capacitances of clamped films [F].
    """

    def __init__(self, condensed: Condensed, films: slice, capacitances: Floats) -> None:
        self._condensed, self._films = condensed, films
        self.charges = condensed.loads[:, films]
        self.capacity = _capacity(capacitances, condensed.work[films, films])
        self.stiffness = condensed.stiffness + self.charges @ self.capacity @ self.charges.T

    def rows(self, places: slice, volts: Floats) -> Floats:
        """Rows (contact, goals) of goals by the displacements of the contact, with open films.

        Args:
            places: places of the goals, as forces on all unknowns, among the loads.
            volts: (films, goals), change of each goal with each voltage.
        """
        condensed = self._condensed
        seen = volts - condensed.work[self._films, places]
        found: Floats = condensed.loads[:, places] + self.charges @ (self.capacity @ seen)
        return found

    def torn(self, row: Floats, place: int, volts: Floats, energy: float) -> float:
        """Twice the energy that a jump inside the sensor leaves when the contact is free [J].

        Args:
            row: (contact,), the jump's forces on the contact, as `rows` gives them.
            place: place of the jump's forces on all unknowns among the loads.
            volts: (films,), charges by the jump alone.
            energy: twice its energy with all unknowns held.
        """
        work = self._condensed.work
        seen = volts - work[self._films, place]
        clamped = energy - work[place, place] + seen @ self.capacity @ seen
        return float(clamped - row @ np.linalg.solve(self.stiffness, row))


@dataclass(frozen=True, slots=True)
class Curve:
    """Answers of one mesh to loads on the object, with open films.

    Attributes:
        rates: (poles,), μ [1/Pa].
        loads: (poles, loads), a.
        goals: (poles, goals), b.
        offsets: (goals, loads), what each goal is without any displacement of the contact.
        ratio: (poles,), b of the force ratio, which is the work of a load of 1 N on a jump that raises all teeth by 1.
        share: what the force ratio is without any displacement of the contact: 1 over rigid teeth, else 0.
        least: twice the energy by that jump under an infinitely soft object [J].
        clamped: (loads,), twice the energy of an object of 1 Pa by each load, with the contact held [J Pa].
        charges: (poles, films), b of the charges that leave the films in short circuit.
        capacity: (films, films), voltages of open films by the charges [1/F].
    """

    rates: Floats
    loads: Floats
    goals: Floats
    offsets: Floats
    ratio: Floats
    share: float
    least: float
    clamped: Floats
    charges: Floats
    capacity: Floats

    def __post_init__(self) -> None:
        (poles,), (_, loads), (_, goals), (_, films) = (
            each.shape for each in (self.rates, self.loads, self.goals, self.charges)
        )
        found = {name: getattr(self, name).shape for name in SHAPES}
        expected = (poles, loads), (poles, goals), (goals, loads), (poles,), (loads,), (poles, films), (films, films)
        if tuple(found.values()) != expected:
            raise ValueError(f"{found} of {poles} poles do not go together")

    def without(self, share: float = NEGLIGIBLE) -> Curve:
        """The same without poles that all together change neither goals nor energies by more than a share of these."""
        count = len(self.rates)
        goals = np.column_stack([self.goals, self.ratio, self.charges])
        sizes = np.column_stack(
            [
                np.abs(self.loads[:, :, None] * goals[:, None, :]).reshape(count, -1),
                self.loads**2,
                self.ratio**2,
                np.abs((self.charges @ self.capacity) * self.charges).sum(axis=1),
            ]
        )
        sums = sizes.sum(axis=0)
        sizes = sizes[:, sums > 0] / sums[sums > 0]
        greatest = sizes.max(axis=1, initial=0.0)
        order = np.argsort(greatest)
        kept = np.sort(order[np.cumsum(greatest[order]) > share])
        return replace(self, **{name: getattr(self, name)[kept] for name in BY_POLE})

    def values(self, moduli: Floats) -> Floats:
        """Goals (moduli, goals, loads) at moduli of the object [Pa]."""
        shares = 1 / (1 + np.multiply.outer(moduli, self.rates))
        found: Floats = np.einsum("em,mg,ml->egl", shares, self.goals, self.loads, optimize=True) + self.offsets
        return found

    def force_ratios(self, moduli: Floats) -> Floats:
        """Force on the teeth over the whole force (moduli, loads)."""
        shares = 1 / (1 + np.multiply.outer(moduli, self.rates))
        found: Floats = self.share + (shares * self.ratio) @ self.loads
        return found

    def slopes(self, moduli: Floats) -> Floats:
        """Derivatives (moduli, loads) of the force ratio by the modulus [1/Pa]."""
        shares = -self.rates / (1 + np.multiply.outer(moduli, self.rates)) ** 2
        found: Floats = (shares * self.ratio) @ self.loads
        return found

    def voltages(self, moduli: Floats) -> Floats:
        """Voltages (moduli, films, loads) of open films [V]."""
        shares = 1 / (1 + np.multiply.outer(moduli, self.rates))
        charges = np.einsum("em,mf,ml->efl", shares, self.charges, self.loads, optimize=True)
        found: Floats = self.capacity @ charges
        return found

    def shorted(self, moduli: Floats) -> Floats:
        """Charges (moduli, films, loads) that leave the films when all are short-circuited [C]."""
        shares = 1 / (1 + np.multiply.outer(moduli, self.rates))
        charges = np.einsum("em,mf,ml->efl", shares, self.charges, self.loads, optimize=True)
        own = np.einsum("em,mf,mg->efg", shares, self.charges, self.charges, optimize=True)
        found: Floats = np.linalg.solve(np.eye(len(self.capacity)) - own @ self.capacity, charges)
        return found

    def energies(self, moduli: Floats) -> tuple[Floats, Floats]:
        """Twice the energies [J]: under each load (moduli, loads), and by the jump (moduli,)."""
        products = np.multiply.outer(moduli, self.rates)
        load = self.clamped / moduli[:, None] + (1 / (1 + products)) @ self.loads**2
        return load, self.least + (products / (1 + products)) @ self.ratio**2


def curve(
    sensor: Sensor,
    sensed: Condensed,
    modes: Floats,
    rows: Floats,
    offsets: Floats,
    ratio: Floats,
    share: float = 0.0,
    least: float = 0.0,
    middle: float | None = None,
) -> Curve:
    """The curve of a sensor with an object, both condensed onto the unknowns of their contact.

    Args:
        sensor: the sensor with open films.
        sensed: the object at a modulus of 1 Pa, with the loads on it.
        modes: (contact, modes), displacements of the contact by which the object moves freely as a rigid body. Their
            poles are exactly 0, which an eigensolver would not quite find: it would spoil hard objects.
        rows: (contact, goals), goals by the displacements of the contact.
        offsets: (goals, loads), what each goal is without any displacement of the contact.
        ratio: (contact,), the force ratio by the displacements of the contact.
        share: what the force ratio is without any displacement of the contact.
        least: twice the energy by the jump over the teeth under an infinitely soft object [J].
        middle: modulus in the middle of those of the object, as that of the ring, for a large contact, of which only
            the poles that count between 1e-3 and 1e8 times this are found; None: all are found.

    Raises:
        EstimateError: the sensor is not held, or rounding spoils the stiffness of the object.
    """
    from scipy.linalg import cholesky, solve_triangular

    matrices = sensor.stiffness, sensed.stiffness
    columns: tuple[Floats, ...] = (modes, sensed.loads, rows, ratio[:, None], sensor.charges)
    try:
        fewer = None
        if middle is not None:
            goals = np.concatenate([rows, sensor.charges], axis=1)
            fewer = projected(*matrices, sensed.loads, ratio[:, None], goals, modes, middle)
        if fewer is not None:
            matrices = fewer.stiffness, fewer.sensed
            columns = tuple(fewer.onto.T @ each for each in columns)
        lower = cholesky(matrices[0], lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        raise EstimateError(
            "finite elements: the stiffness of the sensor is not positive definite to working precision; bring moduli"
            " and dimensions closer together"
        ) from None

    def turned(columns: Floats) -> Floats:
        found: Floats = solve_triangular(lower, columns, lower=True, check_finite=False)
        return found

    softened = turned(turned(matrices[1]).T)
    count = modes.shape[1]
    reflected = np.linalg.qr(lower.T @ columns[0], mode="complete")[0] if count else np.eye(len(lower))
    turned_rest = reflected[:, count:].T @ ((softened + softened.T) / 2) @ reflected[:, count:]
    rates, vectors = np.linalg.eigh(turned_rest)
    if not (rates >= -ROUNDED * rates.max(initial=0.0)).all():
        raise EstimateError(
            "finite elements: rounding makes the stiffness of the object negative; give a thicker object, or a Poisson"
            " ratio further below 0.5"
        )
    vectors = np.concatenate([reflected[:, :count], reflected[:, count:] @ vectors], axis=1)
    loads, goals, ratios, charges = (vectors.T @ turned(each) for each in columns[1:])
    found = Curve(
        rates=np.concatenate([np.zeros(count), np.maximum(rates, 0.0)]),
        loads=loads,
        goals=goals,
        offsets=offsets,
        ratio=ratios[:, 0],
        share=share,
        least=least,
        clamped=np.diag(sensed.work).copy(),
        charges=charges,
        capacity=sensor.capacity,
    )
    return found.without()


def _capacity(capacitances: Floats, work: Floats) -> Floats:
    """Voltages of open films by their charges in short circuit, with the contact held [1/F]."""
    # Films may differ much in size. The scaled matrix has a diagonal of 1 and small other elements.
    scale = 1 / np.sqrt(capacitances)
    found: Floats = np.outer(scale, scale) * np.linalg.inv((np.diag(capacitances) + work) * np.outer(scale, scale))
    return found


# --- a large contact, projected onto the few displacements that its curve is made of ---------------------

# Solutions for all loads and goals at some moduli of the object, and the first terms of their series around these, span
# what solutions at any modulus need (rational Krylov subspace: Ruhe 1984). More moduli are taken where what is left of
# the equations may still change an answer, until it may nowhere. A large contact has thousands of poles; to find them
# all took ten times as long as to eliminate the rest.

# Moduli of the object at which is looked what is left, over the one in their middle; those at which solutions are taken
# first; and the most at which they are before all poles are sought.
CHECKED = np.geomspace(1e-3, 1e8, 12)
FIRST = CHECKED[[2, 5, 9]]
MOST = 9
# Terms of the series around each, of which the first is the solution itself: of loads and the force ratio, whose
# energies are asked as well, and of other goals. An error of a goal is a product of what both miss.
TERMS, TERMS_OF_GOALS = 8, 3
# Bounds on what an answer may miss; most miss a hundredth of these.
RATIO_ERROR, GOAL_ERROR = 1e-10, 1e-8  # of the greatest force ratio, and of the greatest value of another goal
ALL_POLES = 3.5  # multiplications to find them all, over the cube of their number [M]
DEPENDENT = 1e-12  # share of a column that counts as nothing new


@dataclass(frozen=True, slots=True)
class Projected:
    """A contact on few displacements.

    Attributes:
        onto: (contact, fewer), these displacements, orthonormal.
        stiffness, sensed: (fewer, fewer), of the sensor, and of the object at a modulus of 1 Pa.
    """

    onto: Floats
    stiffness: Floats
    sensed: Floats


def projected(
    stiffness: Floats, sensed: Floats, loads: Floats, ratio: Floats, goals: Floats, modes: Floats, modulus: float
) -> Projected | None:
    """The contact on what its solutions need; None: that would hardly be less, or does not suffice.

    Args:
        stiffness: (contact, contact), of the sensor.
        sensed: (contact, contact), of the object at a modulus of 1 Pa.
        loads: (contact, loads).
        ratio: (contact, 1), the force ratio by the displacements.
        goals: (contact, goals), all others.
        modes: (contact, modes), rigid motions of the object.
        modulus: modulus of the object in the middle of a soft and a hard object's behaviour, as that of the ring [Pa].

    Raises:
        LinAlgError: the sensor is not held.
    """
    from scipy.linalg import cho_solve

    from palpate.instrument.models.finite_elements.elimination import factorised

    main, others = _independent(np.concatenate([loads, ratio], axis=1)), _independent(goals)
    fewer = _most(main.shape[1], others.shape[1]) + modes.shape[1]
    if 2 * fewer > len(stiffness):
        return None
    factors: dict[float, Floats] = {}
    onto = _independent(modes)
    pushed = [matrix @ onto for matrix in (stiffness, sensed)]
    wanted = (modulus * FIRST).tolist()
    while len(factors) < MOST:
        found = []
        for place in wanted:
            # The matrix is symmetric, and its transpose is already as LAPACK wants it.
            matrix = place * sensed
            matrix += stiffness
            go_on()
            factor = factorised(matrix.T)
            if factor is None:
                raise np.linalg.LinAlgError("not positive definite")
            factors[place] = factor
            term = np.concatenate([main, others], axis=1)
            for count in range(TERMS):
                if count == TERMS_OF_GOALS:
                    term = term[:, : main.shape[1]]
                term = cho_solve((factor, True), term, check_finite=False)
                found.append(term)
                term = sensed @ (term / np.linalg.norm(term, axis=0))
        new = _independent(np.concatenate(found, axis=1), onto)
        if not new.shape[1]:
            return None
        onto = np.concatenate([onto, new], axis=1)
        pushed = [
            np.concatenate([before, matrix @ new], axis=1)
            for before, matrix in zip(pushed, (stiffness, sensed), strict=True)
        ]
        own = Projected(onto, *(onto.T @ each for each in pushed))
        left = _left(own, pushed, factors, np.concatenate([loads, ratio, goals], axis=1), loads.shape[1], modulus)
        if left.max() <= 1:
            return own
        wanted = [modulus * float(CHECKED[left.argmax()])]
        if wanted[0] in factors:
            return None
    return None


def _most(main: int, others: int) -> int:
    """Number of displacements that the first moduli give for some columns."""
    return len(FIRST) * (TERMS * main + TERMS_OF_GOALS * others)


def operations(contact: int, loads: int, goals: int) -> float:
    """Multiplications in which the poles of a contact are found, projected or not [M].

    Args:
        contact: number of its unknowns.
        loads: number of loads.
        goals: number of all goals but the force ratio.
    """
    fewer = _most(loads + 1, goals)
    if 2 * fewer > contact:
        return ALL_POLES * contact**3
    checked = len(CHECKED) * (loads + 1 + goals) / 2
    return len(FIRST) * contact**3 / 6 + contact**2 * (4 * fewer + checked)


def _left(
    own: Projected, pushed: list[Floats], factors: dict[float, Floats], columns: Floats, loads: int, modulus: float
) -> Floats:
    """Bounds on what solutions on these displacements miss, over what they may, at the moduli that are checked.

    The stiffness rises with the modulus, by no larger share than the modulus itself. So energies of what is left of the
    equations are bounded by those with a stiffness that was factorised. By Cauchy and Schwarz a goal misses no more
    than the root of its own energy and of the load's.

    Args:
        own: the displacements.
        pushed: forces (contact, fewer) on the contact by them, of the sensor and of an object of 1 Pa.
        factors: Cholesky factors of the stiffness by the modulus of the object.
        columns: (contact, columns), the loads, the force ratio, and all other goals.
        loads: number of loads.
        modulus: as in `projected`.
    """
    from scipy.linalg import solve_triangular

    moduli, held = modulus * CHECKED, own.onto.T @ columns
    solved = np.array([np.linalg.solve(own.stiffness + each * own.sensed, held) for each in moduli])
    values = np.einsum("dl,edc->elc", held[:, :loads], solved)
    places = np.array(sorted(factors))
    nearest = np.maximum(np.searchsorted(places, moduli * (1 + 1e-9)) - 1, 0)
    energies = np.empty((len(moduli), columns.shape[1]))
    for number, place in enumerate(places):
        those = np.flatnonzero(nearest == number)
        if not len(those):
            continue
        share = solved[those].transpose(1, 0, 2).reshape(len(held), -1)
        scaled = (solved[those] * moduli[those, None, None]).transpose(1, 0, 2).reshape(len(held), -1)
        rest = np.tile(columns, len(those)) - pushed[0] @ share - pushed[1] @ scaled
        rest = solve_triangular(factors[place], rest, lower=True, check_finite=False)
        sums = (rest**2).sum(axis=0).reshape(len(those), -1)
        energies[those] = sums * np.maximum(place / moduli[those], 1.0)[:, None]
    errors = np.full(columns.shape[1], GOAL_ERROR)
    errors[loads] = RATIO_ERROR
    allowed = errors * np.abs(values).max(axis=(0, 1))
    missed = np.sqrt(energies[:, :loads, None] * energies[:, None, :])
    shares: Floats = (missed / np.where(allowed > 0, allowed, np.inf)).max(axis=(1, 2))
    return shares


def _independent(columns: Floats, beside: Floats | None = None) -> Floats:
    """An orthonormal basis of the span of some columns, or of what they add to that of others."""
    from scipy.linalg import qr

    sizes = np.linalg.norm(columns, axis=0)
    found = columns[:, sizes > 0] / sizes[sizes > 0]
    if beside is not None:
        found -= beside @ (beside.T @ found)
    first, triangle, _ = qr(found, mode="economic", pivoting=True)
    found = first[:, np.abs(np.diag(triangle)) > DEPENDENT]
    if beside is not None and found.shape[1]:  # small columns have lost digits of their being independent
        found = qr(found - beside @ (beside.T @ found), mode="economic")[0]
    independent: Floats = found
    return independent


# --- voltages of open films, coupled to the mechanics ----------------------------------------------------

# A film's electrodes cover its faces, and each has one potential. Under displacements u the charge b·u leaves
# short-circuited films. Open films carry no charge, so C V = b·u, and their voltages act back by the forces -b V. One
# more solution for each film, z = K⁻¹ b, therefore couples any load:
#
#     (C + bᵀz) V = b·u,    displacements u - z V


def capacitance(material: FilmMaterial, area: float, thickness: float) -> float:
    """Capacitance of a clamped film [F]."""
    return material.stiff()[2] * area / thickness


def charge(material: FilmMaterial, area: float, along: float, across: float, normal: float) -> float:
    """Charge [C] that leaves a short-circuited film under mean stresses along its axes [Pa]."""
    d31, d32, d33 = material.strain
    return area * (d31 * along + d32 * across + d33 * normal)
