"""The exact beam against the same equation in decimal numbers of 120 digits."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from decimal import Decimal, localcontext

import numpy as np
import pytest

from palpate.instrument.models import beam
from palpate.instrument.models.beam import BeamSegment, exact_force_ratio, exact_forces
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample

SINGLE = get_design("single")
FOUNDATIONS = (1e-12, 20.0, 1e4, 1e7)


def decimal_forces(stretches: Sequence[BeamSegment]) -> list[float]:
    """Initial values carried from end to end by power series (v, v', v'', v''' over v(0), v'(0) and 1); EI = 1."""
    with localcontext() as context:
        context.prec = 120
        state = [[Decimal(row == column) for column in range(3)] for row in range(4)]
        state[2], state[3] = [Decimal(0)] * 3, [Decimal(0)] * 3
        shears = [state[3]]
        for stretch in stretches:
            k, x = Decimal(stretch.foundation), Decimal(stretch.length)
            v = [
                sum(
                    (-k) ** n * x ** (4 * n + j) / math.factorial(4 * n + j)
                    for n in range(30 + int(2 * k.sqrt().sqrt()))
                )
                for j in range(5)
            ]
            carry = [[v[j - row] if j >= row else -k * v[4 + j - row] for j in range(4)] for row in range(4)]
            state = [
                [
                    sum((carry[row][j] * state[j][column] for j in range(4)), v[4 - row] * (column == 2))
                    for column in range(3)
                ]
                for row in range(4)
            ]
            shears.append(state[3])
        (a, b, c), (d, e, f) = state[2:]
        first, slope = (b * f - c * e) / (a * e - b * d), (c * d - a * f) / (a * e - b * d)
        shear = [p * first + q * slope + r for p, q, r in shears]
        return [float(Decimal(stretch.length) - (shear[i + 1] - shear[i])) for i, stretch in enumerate(stretches)]


@pytest.mark.parametrize("first", [0.01, 0.25, 0.9375])
def test_forces_are_exact_to_1e_12_from_a_rigid_beam_to_a_limp_one(first: float) -> None:
    for one, other in itertools.product(FOUNDATIONS, FOUNDATIONS):
        stretches = (BeamSegment(first, one), BeamSegment(1 - first, other))
        assert exact_forces(1.0, stretches) == pytest.approx(decimal_forces(stretches), abs=1e-12)


@pytest.mark.parametrize(("limit", "foundation"), [(0.0, 1e-24), (math.inf, 1e8)])
def test_waves_alone_are_dependent_on_a_rigid_beam_and_series_alone_diverge_on_a_limp_one(
    monkeypatch: pytest.MonkeyPatch, limit: float, foundation: float
) -> None:
    stretches = (BeamSegment(0.25, 2 * foundation), BeamSegment(0.75, foundation))
    exact = exact_forces(1.0, stretches)
    monkeypatch.setattr(beam, "SHORT", limit)
    naive = exact_forces(1.0, stretches)
    assert not abs(naive[0] / exact[0] - 1) < 1e-3


@pytest.mark.parametrize("pieces", [1, 2, 7])
def test_where_a_stretch_is_cut_does_not_matter(pieces: int) -> None:
    tooth, ring = stretches = (BeamSegment(1.4e-3, 8e6), BeamSegment(3.5e-3, 3e5))
    cut = exact_forces(0.1, (tooth, *[BeamSegment(ring.length / pieces, ring.foundation)] * pieces))
    assert [cut[0], sum(cut[1:])] == pytest.approx(exact_forces(0.1, stretches), rel=1e-12)


def test_neither_end_of_the_range_of_moduli_overflows() -> None:
    moduli = [10.0**exponent for exponent in range(-300, 300, 4)]
    ratios = [exact_force_ratio(SINGLE, replace(get_sample("1"), modulus=modulus)) for modulus in moduli]
    assert np.diff(ratios).min() > -1e-12
    assert ratios[0] == pytest.approx(exact_force_ratio(SINGLE, replace(get_sample("1"), modulus=1e-3)), rel=1e-7)
    assert ratios[0] < 0.1 < 0.9 < ratios[-1] <= 1


@pytest.mark.parametrize("flexible", [1e-20, 1e-60, 1e-300])
def test_a_beam_without_stiffness_hands_each_stretch_the_load_above_it(flexible: float) -> None:
    forces = exact_forces(flexible, (BeamSegment(1.4e-3, 8e6), BeamSegment(3.5e-3, 3e5)))
    assert forces == pytest.approx([1.4e-3, 3.5e-3], rel=1e-3)
