"""Meshes that are refined until made-up error estimates meet a tolerance, which is relative to a ratio of a half."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError
from palpate.instrument.models.finite_elements.ladder import Ladder
from palpate.instrument.models.finite_elements.poles import Curve

Array = NDArray[np.float64]
# Bounds by number of meshes, and then by modulus [Pa]. The second one is worse than the first at 1 Pa.
BOUNDS = {2: {1.0: 3e-3, 2.0: 1e-3, 3.0: 1e-4}, 3: {1.0: 7e-3, 2.0: 1e-4, 3.0: 1e-5}}


class Half(int):
    """The curve of a made-up mesh: at every modulus half of the force is on the tooth."""

    def force_ratios(self, moduli: Array) -> Array:
        return np.full((len(moduli), 1), 0.5)


def made_up(asked: list[int]) -> Ladder[int, tuple[int, float, float]]:
    """Three meshes; an answer is its mesh, modulus and bound of voltages. `asked` gets the meshes that are set up."""

    def mesh(refinement: int) -> int:
        asked.append(refinement)
        return refinement

    def estimates(curves: Sequence[Curve], moduli: Array) -> tuple[Array, Array]:
        found = np.array([BOUNDS[len(curves)][modulus] for modulus in moduli])
        return found, 10 * found

    def read(mesh: int, moduli: Array, bounds: Array) -> list[tuple[int, float, float]]:
        return [(mesh, float(modulus), float(bound)) for modulus, bound in zip(moduli, bounds, strict=True)]

    return Ladder(
        "made up", (5, 6, 7), lambda _count: None, mesh, lambda of: cast(Any, Half(of)), estimates, read, rounding=1e-8
    )


def test_each_modulus_is_answered_by_the_first_mesh_that_meets_the_tolerance() -> None:
    asked: list[int] = []
    ladder = made_up(asked)
    answers = ladder.solve_at(np.array([2.0, 3.0]), 1e-3)
    assert answers == [((7, 2.0, pytest.approx(1e-3)), 1e-4), ((6, 3.0, pytest.approx(1e-3)), 1e-4)]
    assert ladder.poles_to(np.array([2.0, 3.0]), 1e-3) == (7, 1e-4)
    asked.clear()
    assert [estimate for _, estimate in ladder.solve_at(np.array([1.0, 3.0]), 8e-3)] == [3e-3, 1e-4]
    assert ladder.poles_to(np.array([1.0, 3.0]), 8e-3) == (6, 3e-3)
    assert asked == [5, 6, 5, 6]


@pytest.mark.parametrize("way", ["solve_at", "poles_to"])
def test_the_least_error_of_all_meshes_is_told_where_none_meets_the_tolerance(way: str) -> None:
    ask = getattr(made_up([]), way)
    with pytest.raises(
        RangeError, match=r"cannot meet tolerance 0\.001: its least error here is ± 0\.6 % of the force ratio; give"
    ):
        ask(np.array([1.0, 3.0]), 1e-3)


@pytest.mark.parametrize("way", ["solve_at", "poles_to"])
def test_a_tolerance_below_rounding_is_refused_before_a_mesh_is_set_up(way: str) -> None:
    asked: list[int] = []
    ask = getattr(made_up(asked), way)
    for tolerance, why in ((1e-9, "rounds its ratio by up to 1e-08; give a larger one"), (0.0, "is not above 0")):
        with pytest.raises(RangeError, match=why):
            ask(np.array([3.0]), tolerance)
    assert asked == []
