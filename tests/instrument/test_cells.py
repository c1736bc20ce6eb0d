"""Cells of an array that are alike: what one of them leaves serves for all."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.ladders import OF_FEW_TEETH
from palpate.instrument.models.solid.parts import Diagonal, SolidStack
from palpate.instrument.models.solid.system import alike, symmetry
from tests.shares import first_of


def test_cells_are_alike_where_places_and_joints_are() -> None:
    """Three cells of two elements in a row, the last one held at its end; then one whose elements do not touch."""
    unknowns = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, -1], [6, 7], [8, 9]])
    cells, relative = np.arange(8) // 2, np.arange(8)[:, None] % 2
    found = alike(unknowns, cells, relative)
    assert found is not None
    assert found.names.tolist() == [[0, 1, 2], [2, 3, 4], [4, 5, -1]]
    assert found.elements.tolist() == [[0, 1], [2, 3], [4, 5]]
    assert found.places.tolist() == [[0, 1], [1, 2]]
    assert alike(unknowns[:2], cells[:2], relative[:2]) is None
    assert alike(unknowns, cells, np.arange(8)[:, None]) is None  # no element is another's translation
    assert alike(unknowns, np.zeros(8, dtype=int), relative) is None


# --- Sensors that are their own mirror image about the diagonal: what is eliminated in sums and differences

SMALLEST = OF_FEW_TEETH.resolutions[0]
SOFT = SolidParameters(sensed_modulus=1.0)


@pytest.mark.parametrize(
    ("changed", "is_halved"),
    first_of(
        [
            ({}, True),
            ({"load_at": (5e-3, 5e-3)}, True),
            ({"load_at": (6e-3, 5e-3)}, False),
            ({"load_at": (6e-3, 6e-3)}, True),
            ({"columns": 2}, False),
            ({"cell_width": 11e-3}, False),
            ({"rows": 2, "columns": 2, "separate_bases": True}, True),
        ]
    ),
)
def test_a_sensor_is_halved_where_it_is_its_own_mirror_image(changed: dict[str, Any], is_halved: bool) -> None:
    sensor = replace(SOFT, **changed)
    found = Diagonal(SolidStack(sensor, SMALLEST, symmetry(sensor)))
    columns = np.arange(3.0 * found.stack.unknowns).reshape(-1, 3)
    assert np.array_equal(found.turned(columns), columns) is not is_halved
    assert found.turned(found.turned(columns)) == pytest.approx(columns)


def test_halves_have_half_of_the_unknowns_but_for_those_on_the_diagonal() -> None:
    stack = SolidStack(SOFT, SMALLEST, (True, True))
    sums, differences = Diagonal(stack).pieces(stack.object)
    counts = [len(np.unique(piece.unknowns[piece.unknowns >= 0])) for piece in (sums, differences)]
    free = np.unique(stack.object.names[stack.object.names >= 0])
    assert sum(counts) == len(free)
    assert counts[0] > counts[1] > 0.4 * len(free)
    assert not np.intersect1d(sums.unknowns[sums.unknowns >= 0], differences.unknowns).size
