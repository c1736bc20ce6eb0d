"""A sensor's meshes from coarse to fine, of which the first whose error estimate meets a tolerance answers.

ladder = Ladder("solid", (0, 1, 2), mesh, poles, estimates, read, rounding=1e-8)
ladder.solve_at(np.array([24e3, 1e5]), tolerance=1e-3)    # solutions and error estimates
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.quantity import check_tolerance

Array = NDArray[np.float64]
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
    estimates: Callable[[Sequence[Curve], Array], tuple[Array, Array]]
    read: Callable[[M, Array, Array], Sequence[S]]
    rounding: float

    def solve_at(self, moduli: Array, tolerance: float) -> list[tuple[S, float]]:
        """For each modulus the answer of the first mesh that meets the tolerance there, and its error estimate.

        Args:
            moduli: moduli of the object [Pa]. All together cost hardly more than one.
            tolerance: greatest error of the force ratio.

        Raises:
            RangeError: the tolerance is not above 0 or is above 0.5, or no mesh meets it.
            EstimateError: a stiffness is not positive definite to working precision, or a mesh does not fit into
                memory.
        """
        found: dict[int, tuple[S, float]] = {}
        left, best = np.arange(len(moduli)), np.full(len(moduli), np.inf)
        for mesh, curves in self._refined(tolerance):
            ratio, voltage = self.estimates(curves, moduli[left])
            good = ratio <= tolerance
            answers = self.read(mesh, moduli[left[good]], voltage[good])
            found.update(zip(left[good].tolist(), zip(answers, ratio[good].tolist(), strict=True), strict=True))
            left, best = left[~good], np.minimum(best[~good], ratio[~good])
            if not len(left):
                return [found[place] for place in range(len(moduli))]
        raise self._out_of_reach(tolerance, float(best.max()))

    def poles_to(self, moduli: Array, tolerance: float) -> tuple[Curve, float]:
        """The curve of the first mesh that meets the tolerance at all moduli, and its greatest error estimate there.

        Arguments and errors are those of `solve_at`.
        """
        best = np.inf
        for _, curves in self._refined(tolerance):
            greatest = float(self.estimates(curves, moduli)[0].max())
            if greatest <= tolerance:
                return curves[-1], greatest
            best = min(best, greatest)
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
            f"model {self.model!r} cannot meet tolerance {tolerance:g}: its least error here is {best:.1e}; give a"
            " larger tolerance"
        )
