"""A share of `python -m tests.benchmarks estimates`, and what its figures are made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest

from palpate.instrument.models.finite_elements.error_estimate import Bounds, Energies, Judged, bounds
from tests.benchmarks import estimates

MESHES = [Judged(0.4, (0.2, 0.1), Energies(1e-3, 200.0)), Judged(0.4, (0.21, 0.1), Energies(1.01e-3, 201.0))]


def test_the_greatest_change_of_a_voltage_counts_for_every_film() -> None:
    assert bounds(MESHES, closed_gap=False).voltage == pytest.approx(4 * 0.01)


def test_where_all_voltages_of_two_meshes_agree_the_estimate_is_not_nothing() -> None:
    """The error of one of 62 sensors was nine times the greatest change: 3.5e-4 of the voltage."""
    agreeing = [replace(mesh, voltages=(0.2, 0.1)) for mesh in MESHES]
    assert bounds(agreeing, closed_gap=False).voltage == pytest.approx(0.4 * 0.2 * math.sqrt(1e-5 / 1.01e-3))


# Number of a random sensor -> voltages on two meshes [V], the load's energies there [J], voltages of a finer model [V].
VOLTAGES = {
    675: ((0.0063683657, 0.0068590449), (0.0063730675, 0.0068669242), (5.9047452e-06, 5.8995967e-06),
          (0.0064054211, 0.0068731478)),
    810: ((0.2525054605, 0.1713786182), (0.2523460018, 0.1714599884), (8.4407073e-06, 8.4498746e-06),
          (0.2532195205, 0.1715178664)),
    840: ((0.2301099048, 0.0699676168), (0.2298950349, 0.0698597719), (2.1758281e-05, 2.1871939e-05),
          (0.2335380007, 0.0695731263)),
    910: ((3.9436707793, 1.0690713968), (3.9440791301, 1.0705482697), (2.473700563e-04, 2.482583064e-04),
          (3.9758045218, 1.0718828525)),
}  # fmt: skip


@pytest.mark.parametrize("number", VOLTAGES)
def test_voltages_that_hardly_moved_while_the_solution_did_are_not_trusted(number: int) -> None:
    """What the meshes of four random sensors gave whose voltages were off by up to 2.2 times an earlier estimate."""
    coarse, fine, energies, finer = VOLTAGES[number]
    judged = [Judged(0.4, volts, Energies(energy, 1.0)) for volts, energy in zip((coarse, fine), energies, strict=True)]
    error = max(abs(own - true) for own, true in zip(fine, finer, strict=True))
    assert 0 < error < 0.6 * bounds(judged, closed_gap=False).voltage


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
