"""A sensor's meshes from coarse to fine, of which the first whose error estimate meets a tolerance answers.

ladder = Ladder("solid", (0, 1, 2), mesh, poles, estimates, read, rounding=1e-8)
ladder.solve_at(np.array([24e3, 1e5]), tolerance=1e-3)    # solutions and error estimates
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.quantity import check_tolerance, plus_minus

M = TypeVar("M")  # what is known of a mesh over the modulus of the object
S = TypeVar("S")  # answer of a mesh at one modulus

LEAST = 2  # meshes, of which the second knows its error


@dataclass(frozen=True, slots=True)
class Ladder(Generic[M, S]):
    """A model's meshes of one sensor, each finer than the one before.

    Attributes:
        model: name of the model.
        refinements: numbers of the meshes.
        judge: function that is called before so many meshes, from the first on, are set up. It says what they cost, and
            raises EstimateError if they do not fit into memory.
        mesh: function that sets up the mesh of a refinement; it is called for none that is not needed.
        poles: function that gives the curve of a mesh.
        estimates: function of the curves of two or more meshes from the first on, and of moduli of the object [Pa]. It
            gives bounds on the errors of force ratio and voltages [V] of the last of these meshes, at each modulus.
        read: function of a mesh, of moduli, and of these bounds on the errors of voltages. It gives the mesh's answer
            at each modulus.
        rounding: error of the force ratio by rounding; no smaller tolerance can be met.
    """

    model: str
    refinements: Sequence[int]
    judge: Callable[[int], object]
    mesh: Callable[[int], M]
    poles: Callable[[M], Curve]
    estimates: Callable[[Sequence[Curve], Floats], tuple[Floats, Floats]]
    read: Callable[[M, Floats, Floats], Sequence[S]]
    rounding: float

    def solve_at(self, moduli: Floats, tolerance: float) -> list[tuple[S, float]]:
        """For each modulus the answer of the first mesh that meets the tolerance there, and its error estimate.

        Args:
            moduli: moduli of the object [Pa]. All together cost hardly more than one.
            tolerance: greatest error of the force ratio, relative to it.

        Raises:
            RangeError: the tolerance is not above 0 or is above 0.5, or no mesh meets it.
            EstimateError: a stiffness is not positive definite to working precision, or a mesh does not fit into
                memory.
        """
        found: dict[int, tuple[S, float]] = {}
        left, best = np.arange(len(moduli)), np.full(len(moduli), np.inf)
        for mesh, curves in self._refined(tolerance):
            ratio, voltage = self.estimates(curves, moduli[left])
            relative = ratio / _ratios(curves[-1], moduli[left])
            good = relative <= tolerance
            answers = self.read(mesh, moduli[left[good]], voltage[good])
            found.update(zip(left[good].tolist(), zip(answers, ratio[good].tolist(), strict=True), strict=True))
            left, best = left[~good], np.minimum(best[~good], relative[~good])
            if not len(left):
                return [found[place] for place in range(len(moduli))]
        raise self._out_of_reach(tolerance, float(best.max()))

    def poles_to(self, moduli: Floats, tolerance: float) -> tuple[Curve, float]:
        """The curve of the first mesh that meets the tolerance at all moduli, and its greatest error estimate there.

        Arguments and errors are those of `solve_at`.
        """
        best = np.inf
        for _, curves in self._refined(tolerance):
            errors, _ = self.estimates(curves, moduli)
            relative = float((errors / _ratios(curves[-1], moduli)).max())
            if relative <= tolerance:
                return curves[-1], float(errors.max())
            best = min(best, relative)
        raise self._out_of_reach(tolerance, best)

    def _refined(self, tolerance: float) -> Iterator[tuple[M, Sequence[Curve]]]:
        """Each mesh from the second on, with its own curve and those of all before."""
        check_tolerance(tolerance, f"tolerance {tolerance:g}")
        if tolerance < self.rounding:
            raise RangeError(
                f"tolerance {tolerance:g}: model {self.model!r} rounds its ratio by up to {self.rounding:g};"
                " give a larger one"
            )
        curves: list[Curve] = []
        for count, refinement in enumerate(self.refinements, 1):
            self.judge(max(LEAST, count))
            mesh = self.mesh(refinement)
            curves.append(self.poles(mesh))
            if count >= LEAST:
                yield mesh, curves

    def _out_of_reach(self, tolerance: float, best: float) -> RangeError:
        return RangeError(
            f"model {self.model!r} cannot meet tolerance {tolerance:g}: its least error here is {plus_minus(best)} of"
            " the force ratio; give a larger tolerance"
        )


def _ratios(curve: Curve, moduli: Floats) -> Floats:
    found: Floats = np.abs(curve.force_ratios(moduli)).min(axis=1)
    return found


# --- bounds on the errors of a mesh, from its curve and those of coarser meshes --------------------------

# The change from one mesh to the next is no bound. As functions of the object's modulus, the ratios of two meshes
# cross; there the change is zero while the error is not. Energies do not cross. The force ratio is the work of the load
# on a jump, the object raised by 1 from the teeth. On nested meshes such a work changes by at most √(ΔJ ΔJ'), where J
# and J' are twice the energies under the load and by the jump (Cauchy and Schwarz). That is about the error of the
# coarser mesh. Pressures are projected, and meshes around a circle are not quite nested; so a bound is the greater of
# change and product, over a window of the modulus (`python -m tests.benchmarks estimates estimates_solid`).
#
# Two meshes may also agree by luck, at all moduli of a window. So no bound falls below a share of the bound before.
# Where meshes have the same degree along the height, nothing of this shows what that leaves: the change by a higher one
# tells it, on a coarse mesh.
#
# For a voltage the same kind of product would be a thousand times the error, because a film's own energy lies at its
# edges. So the greatest change of any voltage, several times, counts for each.

# Meshes are compared at moduli of a fixed grid: so many in a decade, as far as half a decade, a decade or four decades
# from the one that is asked, and next to these. Where two meshes cross at one modulus, they do not at all of these.
STEPS, HALF_DECADE = 8, 4
DECADE, FOUR_DECADES = 2 * HALF_DECADE, 8 * HALF_DECADE


@dataclass(frozen=True, slots=True)
class Manner:
    """How errors fall from mesh to mesh.

    Attributes:
        product: share of the product of energies that counts beside the change.
        factors: factors on the greater of both from each mesh to the next; the last one counts for all further meshes.
        voltages: the same on the greatest change of any voltage.
        luck: least bound over the bound before: two meshes may agree by luck, or because the finer one is finer only
            in what does not matter.
        height: factor on the change by a higher degree along the height.
        far: share with which moduli count that are more than half a decade away, up to a decade.
        distant: the same of those that are up to four decades away: meshes may agree on all moduli nearby.
    """

    product: float
    factors: tuple[float, ...]
    voltages: tuple[float, ...]
    luck: float
    height: float = 0.0
    far: float = 0.0
    distant: float = 0.0

    def widened(self, times: float) -> Manner:
        """The same with bounds several times as wide."""
        factors, voltages = (tuple(times * each for each in given) for given in (self.factors, self.voltages))
        return replace(self, factors=factors, voltages=voltages, height=times * self.height)


def estimates(
    curves: Sequence[Curve], moduli: Floats, manner: Manner, heights: Sequence[Curve] = ()
) -> tuple[Floats, Floats]:
    """Bounds on the errors of force ratio and voltages [V] of the last of two or more meshes, each finer than the one
    before.

    That of the ratio comes from the greatest change of it between two meshes, or product of energies, over some of the
    modulus on either side, in a `Manner`. That of the voltages is likewise the greatest change of any, times a factor.
    More moduli cost next to nothing.

    Args:
        curves: the curves of the meshes.
        moduli: moduli of the object [Pa].
        manner: how errors fall.
        heights: curves of two coarse meshes that differ by the degree along the height, if that is to count.
    """
    shares = {HALF_DECADE: 1.0, DECADE: manner.far, FOUR_DECADES: manner.distant}
    farthest = max(reach for reach, share in shares.items() if share)
    around = _around(moduli, farthest)
    ratio, voltage = np.zeros(len(moduli)), np.zeros(len(moduli))

    def greatest_of(values: Floats) -> Floats:
        counted = [
            share * _greatest(values, around.narrowed(farthest - reach)) for reach, share in shares.items() if share
        ]
        found: Floats = np.max(counted, axis=0)
        return found

    for step, (coarse, fine) in enumerate(pairwise(curves)):
        greatest, volts = (greatest_of(each) for each in _changes(coarse, fine, around.grid, manner.product))
        ratio = np.maximum(_of_step(manner.factors, step) * greatest, manner.luck * ratio)
        voltage = np.maximum(_of_step(manner.voltages, step) * volts, manner.luck * voltage)
    for low, high in pairwise(heights):
        left, volts = (greatest_of(each) for each in _changes(low, high, around.grid, 0.0))
        ratio, voltage = np.maximum(ratio, manner.height * left), np.maximum(voltage, manner.height * volts)
    return ratio, voltage


def by_likeness(
    curves: Sequence[Curve], likes: Sequence[Curve], best: Curve, doubt: Floats, moduli: Floats, least: float
) -> Floats:
    """Bounds on the error of the force ratio on a mesh, from that of a smaller sensor on the same mesh.

    Errors arise at the edges of teeth, rings and gaps, which both sensors have. How much larger they are here than
    there, the change from the mesh before tells; they are always taken for somewhat larger.

    Args:
        curves: curves of the meshes; only the last two count.
        likes: curves of the smaller sensor on these two.
        best: its curve on a mesh that knows better.
        doubt: (moduli,), bound on the error of that.
        moduli: moduli of the object [Pa].
        least: by how much they are taken for larger at least.
    """
    around = _around(moduli, HALF_DECADE)

    def greatest(one: Curve, other: Curve) -> Floats:
        apart = np.abs(one.force_ratios(around.grid) - other.force_ratios(around.grid)).max(axis=1)
        return _greatest(apart, around)

    own, there = greatest(*curves[-2:]), greatest(*likes)
    larger = np.maximum(own / np.where(there > 0, there, np.inf), least)
    found: Floats = larger * (greatest(likes[-1], best) + doubt)
    return found


def _of_step(factors: Sequence[float], step: int) -> float:
    return factors[min(step, len(factors) - 1)]


def differences(one: Curve, other: Curve, moduli: Floats, factor: float) -> tuple[Floats, Floats]:
    """Greatest differences of force ratios and voltages [V], over half a decade around each modulus [Pa].

    Args:
        one, other: the curves.
        moduli: moduli of the object.
        factor: how many times the other's voltages are to be taken.
    """
    around = _around(moduli, HALF_DECADE)
    ratio = np.abs(one.force_ratios(around.grid) - other.force_ratios(around.grid)).max(axis=1)
    voltages = np.abs(one.voltages(around.grid) - factor * other.voltages(around.grid))
    voltage = voltages.max(axis=(1, 2), initial=0.0)
    return _greatest(ratio, around), _greatest(voltage, around)


def _changes(coarse: Curve, fine: Curve, grid: Floats, product: float) -> tuple[Floats, Floats]:
    """Change of the force ratio, or share of the product of energies, and change of any voltage [V]; on a grid."""
    change = np.abs(fine.force_ratios(grid) - coarse.force_ratios(grid)).max(axis=1)
    (load, jump), (finer_load, finer_jump) = coarse.energies(grid), fine.energies(grid)
    products = np.sqrt(np.abs(finer_load - load).max(axis=1) * np.abs(finer_jump - jump))
    volts = np.abs(fine.voltages(grid) - coarse.voltages(grid)).max(axis=(1, 2), initial=0.0)
    return np.maximum(change, product * products), volts


@dataclass(frozen=True, slots=True)
class _Around:
    """Moduli of the grid [Pa], and for each modulus that is asked the first and the last of these around it."""

    grid: Floats
    first: NDArray[np.intp]
    last: NDArray[np.intp]

    def narrowed(self, steps: int) -> _Around:
        """The same without so many on either side."""
        return replace(self, first=self.first + steps, last=self.last - steps)


def _around(moduli: Floats, reach: int) -> _Around:
    places = STEPS * np.log10(moduli)
    first, last = np.floor(places).astype(np.intp) - reach, np.ceil(places).astype(np.intp) + reach
    start, stop = (int(first.min()), int(last.max()) + 1) if len(moduli) else (0, 1)
    return _Around(10.0 ** (np.arange(start, stop) / STEPS), first - start, last - start)


def _greatest(values: Floats, around: _Around) -> Floats:
    """The greatest value from `first` to `last`, for each pair."""
    # Places between two points of the grid have one more of them than those on a point.
    most = int((around.last - around.first).max(initial=0)) + 1
    places = np.minimum(around.first[:, None] + np.arange(most), around.last[:, None])
    found: Floats = values[places].max(axis=1)
    return found
