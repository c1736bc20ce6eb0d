"""The program of Appendix A2.1, run from its repaired lines, beside the model that stands for it."""

from __future__ import annotations

import functools
import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError
from palpate.instrument.models import beam
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.thesis import program_lines

Array = NDArray[np.float64]

SINGLE = get_design("single")
SCANNED = {each.line: each.repaired for each in program_lines() if each.kind == "scan"}


def polynomials(text: str, length: float) -> list[Polynomial]:
    """Four polynomials in X, written as `1/L^3*[(2*X^3-3*X^2*L+L^3) ...`."""
    found = []
    for bracket in re.findall(r"\(([^)]*)\)", text):
        total = Polynomial([0.0])
        for sign, term in re.findall(r"([+-]?)([^+-]+)", bracket):
            product = Polynomial([-1.0 if sign == "-" else 1.0]) / length**3
            for factor, power in re.findall(r"(\d+|X|L)(?:\^(\d))?", term):
                value = {"X": Polynomial([0, 1]), "L": Polynomial([length])}.get(factor) or Polynomial([float(factor)])
                product *= value ** int(power or 1)
            total += product
        found.append(total)
    return found


def products(one: list[Polynomial], other: list[Polynomial], length: float) -> Array:
    return np.array([[(a * b).integ()(length) for b in other] for a in one])


@functools.cache
def element(length: float) -> tuple[Array, Array, Array]:
    """Lines 11 to 20 for an element of that length: bending over E I, foundation over Kf, load over P."""
    n, m, c = (polynomials(SCANNED[line], length) for line in (11, 12, 14))
    load = np.array([each.integ()(length) for each in m])
    return products(c, [each.deriv(2) for each in n], length), products(m, n, length), -load


def run_listing(moduli: list[float], frozen: bool) -> list[float]:
    """Lines 22 to 54: two elements of 1.4 and 3.5 mm."""
    a1, t1, t2, a2, e2 = np.pi * 1.4e-3**2, 0.55e-3, 3.88e-3, SINGLE.ring.area, 2.4e4
    second_moment = 5e-3 * t1**3 / 12
    lengths = (1.4e-3, 3.5e-3)

    def foundations(e1: float) -> tuple[float, float]:
        return a1 * e1 / t1, 1 / (1 / (a2 * e1 / t1) + 1 / (a2 * e2 / t2))

    def displacement(e1: float) -> Array:
        k, f = np.zeros((6, 6)), np.zeros(6)
        for place, length, kf in zip((slice(0, 4), slice(2, 6)), lengths, foundations(e1), strict=True):
            bending, foundation, load = element(length)
            k[place, place] += e1 * second_moment * bending + kf * foundation
            f[place] += load
        return np.linalg.inv(k) @ f

    ratios = []
    for e1 in moduli:
        disp = displacement(moduli[0] if frozen else e1)
        force1, force2 = foundations(e1)[0] * disp[0], foundations(e1)[1] * disp[4]
        ratios.append(force1 / (force2 + force1))
    return ratios


@pytest.mark.parametrize("frozen", [True, False])
def test_the_model_prints_what_the_repaired_listing_does(frozen: bool) -> None:
    moduli = list(beam.SERIES)
    assert (len(moduli), moduli[-1]) == (15, 1.4149e6)
    assert SINGLE.ring.area == pytest.approx(71.47e-6, abs=5e-9)  # line 9
    assert beam.printed_ratios(SINGLE, moduli, frozen) == pytest.approx(run_listing(moduli, frozen), rel=1e-9)


def test_the_frozen_matrix_makes_a_rising_curve_of_one_that_falls_below_zero_and_comes_back_above_one() -> None:
    frozen, renewed = (beam.printed_ratios(SINGLE, beam.SERIES, each) for each in (True, False))
    assert np.all(np.diff(frozen) > 0)
    assert [round(ratio, 2) for ratio in (frozen[0], frozen[1], frozen[-1])] == [0.53, 0.88, 0.99]
    assert [round(ratio, 2) for ratio in renewed[:4]] == [0.53, 0.39, 0.22, -0.08]
    assert (round(min(renewed), 1), round(max(renewed), 1), round(renewed[-1], 1)) == (-3.3, 9.5, 1.3)


def test_at_the_samples_moduli_the_program_prints_063_to_088() -> None:
    ratios = [beam.printed_force_ratio(SINGLE, get_sample(str(number))) for number in range(1, 7)]
    assert (round(min(ratios), 2), round(max(ratios), 2)) == (0.63, 0.88)


def test_the_program_overlooks_the_thickness_of_the_object() -> None:
    thick = replace(get_sample("4"), thickness=9e-3)
    assert beam.printed_force_ratio(SINGLE, thick) == beam.printed_force_ratio(SINGLE, get_sample("4"))


@pytest.mark.parametrize("modulus", [0.0, -1.0, float("nan"), float("inf")])
def test_a_modulus_that_is_none_is_refused(modulus: float) -> None:
    with pytest.raises(RangeError, match="modulus"):
        beam.printed_ratios(SINGLE, [1.49e4, modulus])


def test_every_line_that_does_not_stand_as_printed_has_its_reason() -> None:
    lines = program_lines()
    assert [each.kind for each in lines] == ["scan"] * 16 + ["slip"] * 5
    for kind in ("scan", "slip"):
        numbers = [each.line for each in lines if each.kind == kind]
        assert numbers == sorted(set(numbers))
    assert all(each.printed and each.repaired and each.why and each.printed != each.repaired for each in lines)
