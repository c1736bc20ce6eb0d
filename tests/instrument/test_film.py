from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models.film import (
    CoupledSystem,
    coupled_system,
    film_response,
    solve_condensed,
    symmetric_scale,
)
from palpate.instrument.sensor.material import FILM_MATERIALS

THESIS = FILM_MATERIALS["thesis"]
AREA, THICKNESS, FORCE = 1e-4, 25e-6, 1.0


def exactly(system: CoupledSystem) -> NDArray[np.float64]:
    """Gauss elimination in rational numbers: no rounding at all."""
    rows = [[Fraction(float(x)) for x in (*row, right)] for row, right in zip(system.matrix, system.right, strict=True)]
    size = len(rows)
    for pivot in range(size):
        for row in range(pivot + 1, size):
            factor = rows[row][pivot] / rows[pivot][pivot]
            if factor:
                rows[row] = [a - factor * b for a, b in zip(rows[row], rows[pivot], strict=True)]
    answer = [Fraction(0)] * size
    for row in reversed(range(size)):
        known = sum((rows[row][k] * answer[k] for k in range(row + 1, size)), Fraction(0))
        answer[row] = (rows[row][size] - known) / rows[row][row]
    return np.array([float(value) for value in answer])


def system(layers: int) -> CoupledSystem:
    return coupled_system(THESIS, AREA, THICKNESS, FORCE, "free", "open", (0.0, 0.0), layers)


@pytest.mark.parametrize("layers", [1, 4, 16])
def test_the_raw_matrix_is_singular_to_working_precision_and_the_scaled_one_is_not(layers: int) -> None:
    matrix = system(layers).matrix
    scale = symmetric_scale(matrix)
    assert np.linalg.cond(matrix) > 1e16
    assert np.linalg.cond(matrix * np.outer(scale, scale)) < 10 * layers**2


@pytest.mark.parametrize("layers", [1, 4, 16])
def test_condensed_solutions_are_exact_where_the_raw_least_squares_loses_the_voltage(
    layers: int,
) -> None:
    coupled = system(layers)
    exact = exactly(coupled)
    raw = np.linalg.lstsq(coupled.matrix, coupled.right)[0]
    assert abs(raw[-1] / exact[-1] - 1) > 0.99
    solved = solve_condensed(coupled)
    assert solved[-1] == pytest.approx(exact[-1], rel=1e-12)
    assert solved[coupled.mechanical - 1] == pytest.approx(exact[coupled.mechanical - 1], rel=1e-12)


@pytest.mark.parametrize("name", sorted(FILM_MATERIALS))
def test_a_free_film_gives_d33_force_as_charge_and_g33_thickness_over_area_as_voltage(name: str) -> None:
    material = FILM_MATERIALS[name]
    d33 = material.strain[2]
    short = film_response(material, AREA, THICKNESS, FORCE, "free", "short")
    opened = film_response(material, AREA, THICKNESS, FORCE, "free", "open")
    assert short.charge == pytest.approx(-d33 * FORCE, rel=1e-12)
    assert opened.voltage == pytest.approx(-d33 * FORCE * THICKNESS / (material.permittivity * AREA), rel=1e-12)
    assert (short.voltage, opened.charge) == (0.0, 0.0)


def test_stress_along_the_plane_adds_d31_and_d32() -> None:
    stress = (3e4, -1e4)
    short = film_response(THESIS, AREA, THICKNESS, FORCE, "free", "short", stress)
    d31, d32, d33 = THESIS.strain
    assert short.charge == pytest.approx(AREA * (d31 * 3e4 - d32 * 1e4) - d33 * FORCE, rel=1e-12)
    assert short.plane_stress == pytest.approx(stress, rel=1e-9)


def test_the_clamped_charge_is_that_of_the_closed_form() -> None:
    stiffness, stress, _ = THESIS.stiff()
    expected = -stress[2] * FORCE / stiffness[2, 2]
    glued = film_response(THESIS, AREA, THICKNESS, FORCE, "clamped", "short")
    assert glued.charge == pytest.approx(expected, rel=1e-12)
    assert glued.plane_stress[0] == pytest.approx(-stiffness[0, 2] / stiffness[2, 2] * FORCE / AREA, rel=1e-12)


def test_the_material_is_stable() -> None:
    for material in FILM_MATERIALS.values():
        stiffness, _, permittivity = material.stiff()
        assert (np.linalg.eigvalsh(stiffness) > 0).all()
        assert 0 < permittivity < material.permittivity


@pytest.mark.parametrize(
    ("area", "thickness", "force", "message"),
    [
        (0.0, 25e-6, 1.0, "area 0 m2"),
        (1e-4, math.nan, 1.0, "thickness nan m"),
        (1e-4, 25e-6, math.inf, "force inf N"),
    ],
)
def test_a_value_outside_its_limits_is_refused(area: float, thickness: float, force: float, message: str) -> None:
    with pytest.raises(RangeError, match=message):
        film_response(THESIS, area, thickness, force, "free", "open")


def test_unknown_edges_or_circuit_are_refused() -> None:
    with pytest.raises(UnknownName, match="clamped"):
        film_response(THESIS, AREA, THICKNESS, FORCE, "glued", "open")
    with pytest.raises(UnknownName, match="short"):
        film_response(THESIS, AREA, THICKNESS, FORCE, "free", "shut")
