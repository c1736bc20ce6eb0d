"""Readings of a bare support and of a pad on it give the pad's modulus, whatever yields beside it."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.instrument.errors import EstimateError
from palpate.instrument.findings.compression import DisplaySeries, compress
from palpate.instrument.uncertainty import budget
from tests.procedures.conftest import IDEAL_CALIBRATION

MODULUS, THICKNESS, AREA = 60e3, 3e-3, 1e-4
COMPLIANCE, SUPPORT = 1.2e-3, 12e-3
POSITIONS = np.linspace(9.4e-3, 13e-3, 8)


def pushed(positions: np.ndarray, yielding: float, contact: float, noise: float = 0.0, seed: int = 0) -> DisplaySeries:
    """Displays of a cell of 10.306 mV/N behind something that yields [m/N], in steps of 1 mV where there is noise."""
    ideal = 10.306 * (positions - contact)[:, np.newaxis] / yielding + np.zeros(10)
    if not noise:
        return DisplaySeries(positions, ideal)
    return DisplaySeries(positions, np.rint(1.81 + ideal + np.random.default_rng(seed).normal(0, noise, ideal.shape)))


def three(noise: float = 0.0, seed: int = 0) -> tuple[DisplaySeries, DisplaySeries, DisplaySeries]:
    pad = COMPLIANCE + THICKNESS / (MODULUS * AREA)
    bare = pushed(SUPPORT + np.linspace(0.5e-3, 6e-3, 8), COMPLIANCE, SUPPORT, noise, 3 * seed)
    up = pushed(POSITIONS, pad, SUPPORT - THICKNESS, noise, 3 * seed + 1)
    return bare, up, pushed(POSITIONS[::-1], pad, SUPPORT - THICKNESS, noise, 3 * seed + 2)


@pytest.fixture(autouse=True)
def few_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "TRIALS", 2000)


def test_modulus_thickness_and_compliance_come_back_exactly_with_stress_strain_and_secant_of_each_point() -> None:
    found = compress(*three(), IDEAL_CALIBRATION, AREA, 0.0)
    for value, true in (
        (found.tangent, MODULUS), (found.secant, MODULUS), (found.unloading, MODULUS), (found.thickness, THICKNESS),
        (found.compliance, COMPLIANCE),
    ):  # fmt: skip
        assert value.budget.value == pytest.approx(true, rel=1e-9)
    assert found.energy_loss.value == pytest.approx(0, abs=1e-9)
    assert found.linearity == pytest.approx(0, abs=1e-9)
    for point in found.points:
        assert point.stress_Pa == pytest.approx(point.load_N / AREA)
        assert (point.stress_Pa / point.strain, point.secant_modulus_Pa) == pytest.approx((MODULUS, MODULUS), rel=1e-9)
        assert point.extrapolated == (point.load_N < IDEAL_CALIBRATION.least_N)


def test_work_that_is_not_given_back_shows_as_loss() -> None:
    bare, up, down = three()
    lower = DisplaySeries(down.positions, down.displays - 4 * (down.displays < down.displays.max()))
    assert compress(bare, up, lower, IDEAL_CALIBRATION, AREA, 0.0).energy_loss.value > 0.05


def test_a_series_without_contact_is_refused() -> None:
    bare, up, down = three()
    with pytest.raises(EstimateError, match=r"loading: 2 loads are above .* N, .* 3 are needed; compress further"):
        compress(bare, DisplaySeries(up.positions[:2], up.displays[:2]), down, IDEAL_CALIBRATION, AREA, 0.0)


def test_a_pad_that_is_no_softer_than_the_bench_is_refused() -> None:
    bare, up, down = three()
    with pytest.raises(EstimateError, match="the pad must be the softer: check which of them was under the probe"):
        compress(up, bare, down, IDEAL_CALIBRATION, AREA, 0.0)
