"""Some parts of the solid model, condensed onto the unknowns that they share with the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.cost import Cost, total
from palpate.instrument.models.finite_elements.fronts import Condensed, Mesh, condense, cost_of
from palpate.instrument.models.finite_elements.incompressible import NODES, extrapolated
from palpate.instrument.models.solid.body import Names
from palpate.instrument.models.solid.cells import Alike, alike, condensed, costs
from palpate.instrument.models.solid.diagonal import Diagonal
from palpate.instrument.models.solid.parts import Part

Vector = NDArray[np.float64]

SAME = 1e-6  # of the length: elements at places that differ by less are translations of each other


class Side:
    """The sensor without the object, or the object without the sensor.

    Attributes:
        parts: the parts.
        has: (unknowns,), whether an unknown of the stack is one of these parts'.
        keeps_volume: whether the compliance of a part is too small for its element matrices.
    """

    def __init__(self, diagonal: Diagonal, parts: Sequence[Part]) -> None:
        self.parts, self._diagonal = parts, diagonal
        self.keeps_volume = any(part.step for part in parts)
        self.has = np.zeros(diagonal.stack.unknowns, dtype=bool)
        for part in parts:
            self.has[part.names[part.names >= 0]] = True
        own = np.full(diagonal.stack.unknowns + 1, -1)
        own[:-1][self.has] = np.arange(np.count_nonzero(self.has))
        pieces = [(piece, part) for part in parts for piece in diagonal.pieces(part)]
        self._pieces = [(piece, part.step) for piece, part in pieces]
        local = [own[piece.unknowns] for piece, _ in pieces]
        most = max(names.shape[1] for names in local)
        # Smaller elements get unknowns that are fixed, so that all have the same number.
        missing = [((0, 0), (0, most - names.shape[1])) for names in local]
        padded = [np.pad(names, pad, constant_values=-1) for names, pad in zip(local, missing, strict=True)]
        self._unknowns = np.concatenate(padded)
        self._coordinates = np.concatenate([piece.places for piece, _ in pieces])
        self._starts = np.cumsum([0, *map(len, local)])
        self._alike = None if diagonal.halves else self._cells()

    def _cells(self) -> Alike | None:
        """Cells of these parts that are alike."""
        stack, kinds = self._diagonal.stack, sorted({part.name for part in self.parts})
        x, y, _, z = self._coordinates.T
        places = np.stack([*stack.from_axis(x, y), z], axis=1)
        parts = np.concatenate([np.full(part.body.count, kinds.index(part.name)) for part in self.parts])
        cells = np.concatenate([stack.cells(part) for part in self.parts])
        return alike(
            self._unknowns, cells, np.column_stack([parts, np.round(places / (SAME * np.ptp(x))).astype(np.intp)])
        )

    def condensed(
        self, contact: NDArray[np.bool_], loads: Callable[[float], Vector], remembers: bool = False
    ) -> Condensed:
        """What is left on the contact.

        Args:
            contact: (unknowns,), the unknowns of the stack that are kept.
            loads: function that gives the loads (unknowns, loads) at an addition to 1/λ, in steps of each part.
            remembers: as in `fronts.condense`.

        Raises:
            EstimateError: as in `fronts.condense`.
        """
        if not self.keeps_volume:
            return self._at(0.0, contact, loads, remembers)
        if remembers:
            return self._at(1.0, contact, loads, remembers)
        return extrapolated(lambda added: self._at(added, contact, loads, remembers), 1.0)

    def cost(self, contact: NDArray[np.bool_], loads: int) -> Cost:
        """What `condensed` will cost, with a number of loads."""
        kept = contact[self.has]
        mesh = Mesh(self._unknowns, self._coordinates, lambda _: [], kept, np.broadcast_to(0.0, (len(kept), loads)))
        one = cost_of(mesh) if self._alike is None else costs(mesh, self._alike)
        return total([one] * (len(NODES) if self.keeps_volume else 1))

    def _at(
        self, added: float, contact: NDArray[np.bool_], loads: Callable[[float], Vector], remembers: bool
    ) -> Condensed:
        def matrices(elements: Names) -> list[Vector]:
            found: dict[int, Vector] = {}
            for (start, stop), (piece, step) in zip(pairwise(self._starts), self._pieces, strict=True):
                own = elements[(elements >= start) & (elements < stop)]
                if len(own):
                    found |= zip(own.tolist(), piece.stiffness(own - start, added * step), strict=True)
            return [found[element] for element in elements.tolist()]

        forces = self._diagonal.turned(loads(added))
        mesh = Mesh(self._unknowns, self._coordinates, matrices, contact[self.has], forces[self.has])
        return condense(mesh, remembers) if remembers or self._alike is None else condensed(mesh, self._alike)
