"""A share of `python -m tests.benchmarks estimates`, and what its figures are made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest

from instrument.models.error_estimate import Bounds, Energies, Judged, bounds
from tests.benchmarks import estimates

MESHES = [Judged(0.4, (0.2, 0.1), Energies(1e-3, 200.0)), Judged(0.4, (0.21, 0.1), Energies(1.01e-3, 201.0))]


def test_the_greatest_change_of_a_voltage_counts_for_every_film() -> None:
    assert bounds(MESHES, closed_gap=False).voltage == pytest.approx(4 * 0.01)


def test_where_all_voltages_of_two_meshes_agree_the_estimate_is_not_nothing() -> None:
    """The error of one of 62 sensors was nine times the greatest change: 3.5e-4 of the voltage."""
    agreeing = [replace(mesh, voltages=(0.2, 0.1)) for mesh in MESHES]
    assert bounds(agreeing, closed_gap=False).voltage == pytest.approx(0.1 * 0.2 * math.sqrt(1e-5 / 1.01e-3))


def test_under_a_point_load_changes_alone_count() -> None:
    pointed = [Judged(ratio, (), Energies(None, jump)) for ratio, jump in ((0.4, 200.0), (0.41, 300.0))]
    assert bounds(pointed, closed_gap=False).force_ratio == pytest.approx(1.5 * 0.01)


@pytest.mark.slow
@pytest.mark.parametrize("numbers", [range(1, 6, 4), range(10, 20, 10)], ids=["crossings", "solid"])
def test_no_estimate_of_some_random_sensors_is_below_the_error(numbers: Sequence[int]) -> None:
    found = [claim for number in numbers for claim in estimates.claims(estimates.tried(number))]
    assert len(found) >= len(numbers)
    assert all(0 < claim.ratio <= 1 and not claim.voltage > 1 for claim in found)


def test_an_estimate_below_the_error_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of meshes that agree on a ratio that the reference has not, by an estimate that believes the change."""
    meshes = [{"force_ratio": ratio, "voltages": [], "energies": {"load": 1.0, "jump": 1.0}, "imbalance": 0.0}
              for ratio in (0.4, 0.4, 0.40002)]  # fmt: skip
    monkeypatch.setattr(estimates.axisymmetric, "error_estimate", lambda *_: Bounds(1e-5, math.inf))
    (claim,) = estimates.claims(estimates.Tried(2, "random", meshes, None))
    assert claim.ratio == pytest.approx(2.0)
    rows = {row.figure.strip(): row for row in estimates.rows([estimates.Tried(2, "random", meshes, None)], goal=1)}
    assert (
        rows["optimistic estimates of the ratio"].met is False
        and "sensor 2" in rows["optimistic estimates of the ratio"].measured
    )
