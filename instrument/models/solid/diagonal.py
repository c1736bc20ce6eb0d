"""A sensor that is its own mirror image about the diagonal of its square, in sums and differences of mirrored unknowns.

Of two unknowns that the mirror turns into each other, the first is (s + d) / √2 and the second (s - d) / √2. An element
and its mirror image then make two elements, one of all s and one of all d, which know nothing of each other. So all but
the films, which differ along their two axes, falls into two halves of half as many unknowns each, whose fronts take a
quarter of the time. Loads and goals need no symmetry. s takes the name of the first unknown, d that of the second.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.solid.body import Names
from palpate.instrument.models.solid.mesh import SWAPPED, Plan
from palpate.instrument.models.solid.parts import Part, Stack
from palpate.instrument.sensor.film_material import FilmMaterial

Vector = NDArray[np.float64]
PLACED_ALIKE = 1e-9  # of the plan's size
HALF = math.sqrt(0.5)


@dataclass(frozen=True, slots=True)
class Piece:
    """Elements of a part as they are eliminated: its own, or sums or differences of mirrored ones, or both together.

    Attributes:
        unknowns: (elements, n), names of each element's unknowns; negative for those that are fixed.
        places: (elements, coordinates), coordinates along which elements may be parted.
        stiffness: function of numbers of these elements, and of an addition to the material's 1/λ [1/Pa], that gives
            the stiffness (elements, n, n).
    """

    unknowns: Names
    places: Vector
    stiffness: Callable[[Names, float], Vector]


class Diagonal:
    """The mirror images of a sensor's unknowns, if it is its own.

    Attributes:
        stack: the sensor.
        halves: whether it is its own mirror image.
    """

    def __init__(self, stack: Stack) -> None:
        self.stack = stack
        own = np.arange(stack.unknowns)
        self._images, partner = _elements(stack.plan), own
        if self._images is not None:
            found = _unknowns(stack, *self._images)
            partner = own if found is None else found
        # Fixed unknowns, of number -1, have the last place.
        self._partner = np.append(partner, -1)
        before = np.zeros(stack.unknowns + 1, dtype=bool)
        for part in stack.parts if (partner != own).any() else ():
            before[part.body.local(part.names, self._halved(part)[0])] = True
        # Of two that the diagonal itself has, x and y, x is the first.
        before[:-1] &= ~before[partner] | (own <= partner)
        self._is_first = before
        self._first = own[before[:-1] & (partner != own)]
        self._second = partner[self._first]
        self.halves = bool(len(self._first))

    def turned(self, columns: Vector) -> Vector:
        """Forces or displacements of sums and differences from those of the unknowns, or the other way round.

        Args:
            columns: (unknowns, ...).
        """
        found = columns.copy()
        one, other = columns[self._first], columns[self._second]
        found[self._first], found[self._second] = HALF * (one + other), HALF * (one - other)
        return found

    def pieces(self, part: Part) -> list[Piece]:
        """The elements of a part."""
        body, places = part.body, self.stack.centres(part)
        if not self.halves:
            return [Piece(body.local(part.names), places, body.stiffness)]
        kept, paired = self._halved(part)
        names = body.local(part.names, kept)
        partner, is_first = self._partner[names], self._is_first[names]
        alone = names == partner
        sums, differences = np.where(is_first, names, partner), np.where(is_first, partner, names)
        differences[alone] = -1
        # Two mirrored elements are as stiff as twice the first of them, which just makes up for the halves.
        of_sum = np.where(alone, np.where(paired, math.sqrt(2.0), 1.0), np.where(paired, 1.0, HALF))
        of_difference = np.where(paired, 1.0, HALF) * np.where(is_first, 1.0, -1.0)
        # Sums are parted from differences first, where nothing joins them.
        beside = [np.column_stack([places[kept], np.full(len(kept), at)]) for at in (0.0, 0.5, 1.0)]

        if isinstance(body.material, FilmMaterial):
            law = body.material.law
            turned = law[np.ix_(*4 * ([1, 0, 2],))]

            def of_film(numbers: Names, _: float) -> Vector:
                even, odd = (body.by_law(each / 2, kept[numbers]) for each in (law + turned, law - turned))
                weights = np.concatenate([of_sum[numbers], of_difference[numbers]], axis=1)
                return _scaled(np.block([[even, odd], [odd, even]]), weights)

            return [Piece(np.concatenate([sums, differences], axis=1), beside[1], of_film)]

        def of(weights: Vector) -> Callable[[Names, float], Vector]:
            return lambda numbers, added: _scaled(body.stiffness(kept[numbers], added), weights[numbers])

        return [Piece(sums, beside[0], of(of_sum)), Piece(differences, beside[2], of(of_difference))]

    def _halved(self, part: Part) -> tuple[Names, NDArray[np.bool_]]:
        """A part's elements without the mirror images of others, and whether each has one beside itself.

        Returns:
            (elements,) and (elements, 1).
        """
        assert self._images is not None
        body = part.body
        image = np.searchsorted(body.plan.elements, self._images[0][body.plan.elements])
        own = np.flatnonzero(np.arange(len(image)) <= image)
        steps = len(body.height.local)
        return (own[:, None] * steps + np.arange(steps)).ravel(), (own != image[own]).repeat(steps)[:, None]


def _scaled(matrices: Vector, weights: Vector) -> Vector:
    """Matrices (elements, n, n) with rows and columns times weights (elements, n), in place; most weights are 1."""
    changed = np.flatnonzero((weights != 1).any(axis=0))
    matrices[:, changed] *= weights[:, changed, None]
    matrices[:, :, changed] *= weights[:, None, changed]
    return matrices


def _elements(plan: Plan) -> tuple[Names, NDArray[np.bool_]] | None:
    """Mirror image of each element of a plan, and whether its two directions are exchanged there.

    None: the plan is not its own mirror image.
    """
    places = plan.mesh.doflocs[:, plan.mesh.dofs.element_dofs]
    turned, near = places[::-1], PLACED_ALIKE * np.ptp(places)
    order, of_turned = (np.lexsort(np.round(each.mean(axis=1) / near)) for each in (places, turned))
    images = np.empty(len(order), dtype=np.intp)
    images[of_turned] = order
    kept, swapped = (
        np.abs(turned - each[:, :, images]).max(axis=(0, 1)) < near for each in (places, places[:, SWAPPED])
    )
    return (images, swapped) if (kept | swapped).all() else None


def _nodes(stack: Stack, images: Names, swapped: NDArray[np.bool_]) -> Names:
    """Mirror image of each shape function of the plan."""
    functions, dofs = stack.basis.elem, stack.basis.element_dofs
    places = np.random.default_rng(0).random((2, 2 * len(dofs)))
    values, exchanged = (
        np.array([functions.lbasis(at, number)[0] for number in range(len(dofs))]) for at in (places, places[::-1])
    )
    order = np.abs(values - exchanged[:, None]).sum(axis=2).argmin(axis=1)
    found = np.empty(stack.basis.N, dtype=np.intp)
    found[dofs] = np.where(swapped, dofs[order][:, images], dofs[:, images])
    return found


def _unknowns(stack: Stack, images: Names, swapped: NDArray[np.bool_]) -> Names | None:
    """Mirror image of each unknown; None: the sensor is not its own."""
    nodes = _nodes(stack, images, swapped)
    found = np.arange(stack.unknowns)
    pairs = []
    for part in stack.parts:
        of = part.body.plan.nodes
        places = np.minimum(np.searchsorted(of, nodes[of]), len(of) - 1)
        if not np.array_equal(of[places], nodes[of]):
            return None
        pairs.append((part.names, part.names[[1, 0, 2]][:, :, places]))
        free = part.names >= 0
        found[part.names[free]] = pairs[-1][1][free]
    found = np.append(found, -1)
    return found[:-1] if all(np.array_equal(found[names], turned) for names, turned in pairs) else None
