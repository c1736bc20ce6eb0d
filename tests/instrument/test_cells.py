"""Cells of an array that are alike: what one of them leaves serves for all."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.models.solid.system import Alike, System, alike

SMALL = Resolution(layers=1, ratio=0.2, sectors=1, degree=2)
MODULI = 24e3 * np.logspace(-2, 8, 21)
ROW = SolidParameters(
    sensed_modulus=1.0, cell_length=12e-3, cell_width=12e-3, outline="square", ring_outline="round", columns=2
)
CHANGES: dict[str, dict[str, Any]] = {
    "two and a half of five": {"columns": 5},
    "bases of their own": {"columns": 4, "rows": 2, "separate_bases": True},
    "capped": {"columns": 4, "interface": "capped"},
}
PLAIN = ("capped",)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in PLAIN else pytest.mark.slow) for name in CHANGES]
)
def test_one_cell_for_all_gives_what_each_for_itself_does(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sensor = replace(ROW, **CHANGES[name])
    system = System(sensor, SMALL)
    assert all(isinstance(each._alike, Alike) for each in (system._sensor, system._sensed))
    found = system.curve([system.load(sensor.load_at)]).poles
    monkeypatch.setattr("palpate.instrument.models.solid.system.alike", lambda *_: None)
    apart = System(sensor, SMALL)
    known = apart.curve([apart.load(sensor.load_at)]).poles
    tolerance = 1e-7 if sensor.sensed_poisson == 0.5 else 1e-10
    for answers in ("force_ratios", "values", "voltages", "shorted"):
        values, expected = (getattr(curve, answers)(MODULI) for curve in (found, known))
        assert values == pytest.approx(expected, rel=tolerance, abs=tolerance * np.abs(expected).max(initial=1e-300))
    for energies, expected in zip(found.energies(MODULI), known.energies(MODULI), strict=True):
        assert energies == pytest.approx(expected, rel=1e-7)


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
