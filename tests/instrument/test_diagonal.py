"""Sensors that are their own mirror image about the diagonal: what is eliminated in sums and differences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid import parts
from palpate.instrument.models.solid.ladders import OF_FEW_TEETH
from palpate.instrument.models.solid.parts import Diagonal, SolidStack
from palpate.instrument.models.solid.system import System, symmetry
from palpate.instrument.sensor.material import PVDF
from tests.shares import first_of

SMALLEST = OF_FEW_TEETH.resolutions[0]
MODULI = 24e3 * np.logspace(-2, 8, 21)
SOFT = SolidParameters(sensed_modulus=1.0)
# Softer across the film than along it, and sheared more easily: the mirror turns it into another film.
UNEQUAL = replace(
    PVDF, compliance=(0.082e-8, 0.2e-8, 0.0945e-8, -0.035e-8, -0.03e-8, -0.0265e-8, 0.5e-8, 0.225e-8, 0.3e-8)
)


CHANGES: dict[str, dict[str, Any]] = {
    "unequal film": {"film": UNEQUAL},
    "rigid": {"support": "rigid"},
    "frictionless": {"interface": "frictionless"},
    "incompressible": {"sensed_poisson": 0.5, "compliant_poisson": 0.5},
}
PLAIN = ("unequal film",)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in PLAIN else pytest.mark.slow) for name in CHANGES]
)
def test_sums_and_differences_give_what_the_unknowns_give(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sensor = replace(SOFT, **CHANGES[name])
    halved = System(sensor, SMALLEST)
    monkeypatch.setattr(parts, "_elements", lambda plan: None)
    whole = System(sensor, SMALLEST)
    found, known = (system.curve([system.load(sensor.load_at)]).poles for system in (halved, whole))
    tolerance = 1e-7 if sensor.sensed_poisson == 0.5 else 1e-10
    for answers in ("force_ratios", "values", "voltages"):
        values, expected = (getattr(curve, answers)(MODULI) for curve in (found, known))
        assert values == pytest.approx(expected, rel=tolerance, abs=tolerance * np.abs(expected).max(initial=1e-300))


@pytest.mark.slow
def test_displacements_are_those_of_the_unknowns(monkeypatch: pytest.MonkeyPatch) -> None:
    sensor = replace(SOFT, film=UNEQUAL)
    halved = System(sensor, SMALLEST)
    monkeypatch.setattr(parts, "_elements", lambda plan: None)
    whole = System(sensor, SMALLEST)
    found, known = (system.displacement(system.load(None)) for system in (halved, whole))
    assert found == pytest.approx(known, rel=1e-9, abs=1e-9 * np.abs(known).max())


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
