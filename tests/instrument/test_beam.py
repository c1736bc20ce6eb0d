"""The beam: against its exact solution, that against decimal numbers, and the thesis' program against its listing."""

from __future__ import annotations

import functools
import itertools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from decimal import Decimal, localcontext

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError
from palpate.instrument.models import beam
from palpate.instrument.models.beam import BeamSegment, exact_force_ratio, exact_forces
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.instrument.thesis import program_lines, read_table

Array = NDArray[np.float64]

SINGLE = get_design("single")
# Foundations that bend the beam well: wave length and stretch are alike.
EI, BENT = 4.85e-3, (BeamSegment(1.4e-3, 8e6), BeamSegment(3.5e-3, 3e5))
SAMPLES = ("1", "2", "3", "4", "5", "6")


def object_of(modulus: float, thickness: float = 3e-3) -> Sample:
    return replace(get_sample("1"), modulus=modulus, thickness=thickness)


def percent_errors(thickness: float, outer: float) -> Array:
    """Table 5.8's errors of the experiments, in percent of a beam of that thickness and outer stretch [m]."""
    found = []
    for name in SAMPLES:
        bending, (tooth, ring) = beam.beam_of(SINGLE, get_sample(name).modulus, thickness)
        ratio = beam.ratio_of(bending, (tooth, replace(ring, length=outer)), beam.ELEMENTS)
        found.append(100 * (SINGLE.thesis_force_ratio[name] / ratio - 1))
    return np.array(found)


def test_refinement_converges_to_the_exact_solution_with_the_fourth_power() -> None:
    exact = exact_forces(EI, BENT)[0]
    errors = [abs(beam.stretch_forces(EI, BENT, elements)[0] / exact - 1) for elements in (2, 4, 8, 16)]
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((rates > 3.7) & (rates < 4.3))
    assert errors[-1] < 1e-6


def test_the_beam_is_exact_but_for_what_bends_within_an_element() -> None:
    for thickness, within in [(1e-4, 4e-5), (1e-3, 3e-8), (3e-3, 3e-10), (0.1, 1e-12)]:
        for modulus in [1e-6, 1.49e4, 1e6, 140e9, 1e15]:
            sensed = object_of(modulus, thickness)
            assert abs(beam.force_ratio(SINGLE, sensed) - exact_force_ratio(SINGLE, sensed)) < within


@pytest.mark.parametrize("solved", [lambda *beam_: beam.deflections(*beam_, elements=2), exact_forces])
@pytest.mark.parametrize(
    ("bending", "stretch"),
    [
        (-1.0, BeamSegment(1e-3, 1.0)),
        (math.nan, BeamSegment(1e-3, 1.0)),
        (1.0, BeamSegment(0.0, 1.0)),
        (1.0, BeamSegment(1e-3, 0.0)),
        (1.0, BeamSegment(1e-3, math.inf)),
    ],
)
def test_a_beam_needs_positive_finite_data(bending: float, stretch: BeamSegment, solved: Callable[..., object]) -> None:
    with pytest.raises(RangeError, match="is not above 0"):
        solved(bending, (stretch, BeamSegment(1e-3, 1.0)))


def test_the_beam_is_the_object_and_not_the_plate() -> None:
    assert beam.bending(SINGLE, 1e5, 3e-3) == pytest.approx(1e5 * 5e-3 * 3e-3**3 / 12, rel=1e-12)
    steel = replace(SINGLE, plate=replace(SINGLE.plate, material=replace(SINGLE.plate.material, modulus=200e9)))
    for ratio in (beam.force_ratio, exact_force_ratio, beam.printed_force_ratio):
        assert ratio(steel, get_sample("1")) == ratio(SINGLE, get_sample("1"))


def test_two_lengths_are_chosen_so_that_the_beam_meets_table_5_8() -> None:
    """A fit: without either the mean error is 4 and 50 percent away from the table's."""
    table = read_table("5.8")
    printed = table.values("single_vs_2D_error_percent")
    assert printed[-1] == 20.08
    errors = percent_errors(3e-3, 3.6e-3)
    assert errors.mean() == pytest.approx(19.48, abs=0.01)
    assert math.sqrt(np.mean((errors - printed[:-1]) ** 2)) == pytest.approx(2.94, abs=0.01)
    assert percent_errors(3e-3, 3.5e-3).mean() == pytest.approx(15.90, abs=0.01)
    assert percent_errors(0.55e-3, 3.6e-3).mean() == pytest.approx(-28.98, abs=0.01)
    ratios = [beam.force_ratio(SINGLE, get_sample(name)) for name in SAMPLES]
    mine = [100 * (SINGLE.thesis_force_ratio[name] / ratio - 1) for name, ratio in zip(SAMPLES, ratios, strict=True)]
    rms = math.sqrt(np.mean([((1 + a / 100) / (1 + b / 100) - 1) ** 2 for a, b in zip(printed, mine, strict=False)]))
    assert rms == pytest.approx(0.024, abs=5e-4)


# --- The program of Appendix A2.1, run from its repaired lines, beside the model that stands for it ----


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


# --- The exact beam against the same equation in decimal numbers of 120 digits -------------------------

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
