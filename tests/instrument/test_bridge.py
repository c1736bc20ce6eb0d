"""The Wheatstone bridge of Appendix III: its output by Kirchhoff's laws, its balance, and gages on its arms."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.instrument.calibration.bridge import Bridge
from palpate.instrument.errors import RangeError


def test_the_output_is_the_voltage_between_the_middles_by_kirchhoffs_nodes() -> None:
    bridge = Bridge(350.0, 120.0, 500.0, 270.0, excitation=5.0)
    # Nodes between R1 and R2, and between R4 and R3: the currents into each add up to nothing.
    into = np.diag([1 / 350 + 1 / 120, 1 / 270 + 1 / 500])
    upper, lower = np.linalg.solve(into, [5 / 120, 5 / 500])
    assert bridge.output == pytest.approx(upper - lower, rel=1e-12)


def test_the_balancing_arm_gives_no_output_and_its_product_is_that_of_the_others() -> None:
    balanced = Bridge(120.0 * 270 / 500, 120.0, 500.0, 270.0)
    assert Bridge(1.0, 120.0, 500.0, 270.0).balancing_r1 == balanced.r1
    assert balanced.output == pytest.approx(0, abs=1e-15)
    assert Bridge(1.01 * balanced.r1, 120.0, 500.0, 270.0).output > 1e-3


def test_four_gages_give_four_times_one_and_are_straight() -> None:
    factor, strain = 8.98, 1e-3
    one = Bridge.of_gages(factor, strain, 0, 0, 0).output
    assert one == pytest.approx(factor * strain / 4 / (1 + factor * strain / 2), rel=1e-12)
    assert Bridge.of_gages(factor, strain, -strain, strain, -strain).output == pytest.approx(factor * strain, rel=1e-12)
    assert Bridge.of_gages(factor, strain, strain, strain, strain).output == 0


def test_an_arm_without_resistance_is_refused() -> None:
    with pytest.raises(RangeError, match=r"bridge: r3 0 must be above 0 and finite; correct it"):
        Bridge(1, 1, 0, 1)
