"""The shape functions of the round sensor's elements."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from skfem import ElementLinePp

from palpate.instrument.models.finite_elements.elements import shape_functions


@pytest.mark.parametrize("degree", [3, 6, 9])
def test_shape_functions_are_those_of_scikit_fem(degree: int) -> None:
    points, element = np.linspace(0, 1, 7), ElementLinePp(degree)
    theirs = [element.lbasis(points[None, :], index) for index in range(degree + 1)]
    values, slopes = shape_functions(degree, points)
    assert values == pytest.approx(np.array([value for value, _ in theirs]), abs=1e-14)
    assert slopes == pytest.approx(np.array([slope[0] for _, slope in theirs]), abs=1e-13)


@pytest.mark.slow
def test_a_round_sensor_is_set_up_without_scikit_fem() -> None:
    """Its import takes as long as a coarse mesh."""
    code = """
import sys
from palpate.instrument.models.axisymmetric.curves import found_on
from palpate.instrument.models.parameters import RoundParameters
found_on(RoundParameters(), 3, 1)
assert "skfem" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
