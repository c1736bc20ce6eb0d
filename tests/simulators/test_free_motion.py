"""Modes that are no modes, and rates that are far apart: each state keeps its own digits."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.simulators.linear.lti import StateSpace, first_order_low_pass
from palpate.simulators.linear.periodic import CYCLE, HERTZ, Periodic
from tests.simulators.linear_systems import DAY, SECOND, output, random_system, sine


def jordan(rate: float, order: int) -> Floats:
    return rate * np.eye(order) + np.diag(np.ones(order - 1), 1)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_a_defective_system_decays_by_powers_of_time(order: int) -> None:
    """x[0] = exp(rate t) t^k / k! from a one in state k."""
    system = StateSpace(jordan(-7.0, order), np.zeros((order, 1)), np.eye(order), np.zeros((order, 1)))
    assert system.motion.modes is None
    times = np.array([0, 1, 1000, 123_456_789, SECOND, 5 * SECOND + 1])
    t = 1e-9 * times
    for k in range(order):
        decayed = system.motion.free(np.eye(order)[k], times)[0]
        exact = np.exp(-7.0 * t) * t**k / math.factorial(k)
        assert np.abs(decayed - exact).max() <= 1e-13 * exact.max()


@pytest.mark.parametrize("apart", [0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2])
def test_rates_that_nearly_coincide_lose_no_digits_where_their_modes_lose_all(apart: float) -> None:
    """x[0] = (exp(p t) - exp(q t)) / (p - q) from a one in state 1, with the difference taken exactly."""
    p, q = -7.0, -7.0 * (1 + apart)
    system = StateSpace(np.array([[p, 1.0], [0.0, q]]), np.zeros((2, 1)), np.eye(2), np.zeros((2, 1)))
    times = np.array([1, 1000, 123_456_789, SECOND])
    t = 1e-9 * times
    half = (p - q) * t / 2
    exact = t * np.exp((p + q) * t / 2) * np.where(half > 0, np.sinh(half) / np.where(half > 0, half, 1), 1.0)
    assert np.abs(system.motion.free(np.array([0.0, 1.0]), times)[0] - exact).max() < 2e-13 * exact.max()
    if 0 < apart <= 1e-10:
        naive = (np.exp(p * t) - np.exp(q * t)) / (p - q)
        assert np.abs(naive - exact).max() > 1e-7 * exact.max()


def test_units_of_the_states_do_not_make_modes_parallel() -> None:
    """The shaker's armature beside a stop of 1e6 N/m: amperes, metres and metres a second."""
    a = np.array([[-3.5e4, 0, -4e4], [0, 0, 1], [4 / 0.03, -1e6 / 0.03, -2 / 0.03]])
    system = StateSpace(a, np.zeros((3, 1)), np.eye(3), np.zeros((3, 1)))
    assert system.motion.modes is not None
    assert np.linalg.cond(system.motion.modes[1]) > 1e3
    x0, times = np.array([1.0, 1e-3, 0.1]), np.array([1, 1000, 1_000_000, 10_000_000])
    exact = np.array([scipy.linalg.expm(a * 1e-9 * t) @ x0 for t in times]).T
    assert (np.abs(system.motion.free(x0, times) - exact).max(axis=1) < 1e-11 * np.abs(exact).max(axis=1)).all()


def test_a_state_that_only_integrates_gives_the_integral() -> None:
    """x'' = u of a cosine from rest: (1 - cos w t) / w^2."""
    system = StateSpace(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), np.eye(2)[:1], np.zeros((1, 1)))
    drive = Periodic(0.0, 10 * HERTZ, 0, 0, np.array([1]), np.array([1.0 + 0j]))
    times, w = np.arange(0, 2 * SECOND, 7_654_321), 20 * math.pi
    exact = (1 - np.cos(w * 1e-9 * times)) / w**2
    assert np.abs(output(system, drive, np.zeros(2), times) - exact).max() < 2e-13 * exact.max()


def test_an_integrator_under_0_hz_stands_where_it_is() -> None:
    """Two states, one of which nothing acts on: A is singular at the very frequency of the drive."""
    system = StateSpace(np.diag([0.0, -10.0]), np.array([[0.0], [10.0]]), np.eye(2), np.zeros((2, 1)))
    held = Periodic(1.0, 0, 0, CYCLE // 4, np.array([1]), np.array([-2j]))
    state = system.drive((held,)).state(0, np.array([5.0, 0.0]), np.array([0, 10 * SECOND]))
    assert state == pytest.approx(np.array([[5.0, 5.0], [0.0, 3.0]]), abs=1e-12)


RATES = [1e9, 1e6, 1e3, 1.0, 1e-3, 1e-6, 1e-9]


@pytest.mark.parametrize("order", [RATES, RATES[::-1]])
def test_rates_from_a_nanosecond_to_thirty_years_side_by_side_each_keep_theirs(order: list[float]) -> None:
    system = first_order_low_pass(1 / order[0])
    for rate in order[1:]:
        system = system.beside(first_order_low_pass(1 / rate))
    drives = tuple(sine(mean=1.0) for _ in order)
    times = np.array([0, 1, 1000, 1_000_000, SECOND, 3600 * SECOND, 30 * DAY + 12_345_678])
    x = system.drive(drives).state(0, np.full(len(order), 2.0), times)
    t, w = 1e-9 * times, 20 * math.pi
    for row, rate in zip(x, order, strict=True):
        phasor = -1j / (1 + 1j * w / rate)
        wave = (phasor * np.exp(2j * np.pi * drives[0].phase(times) / CYCLE)).real
        exact = 1 + wave + (1 - phasor.real) * np.exp(-rate * t)
        assert np.abs(row - exact).max() < 1e-12


@pytest.mark.parametrize("order", [(1e9, 1e-9), (1e-9, 1e9), (1e9, 1.0, 1e-9), (1e6, 1e-3, 1e3)])
def test_rates_far_apart_in_series_keep_theirs(order: tuple[float, ...]) -> None:
    """The first state begins at one; partial fractions give the last state."""
    system = first_order_low_pass(1 / order[0])
    for rate in order[1:]:
        system = system.then(first_order_low_pass(1 / rate))
    times = np.array([1, 1000, 1_000_000, SECOND, 3600 * SECOND, 30 * DAY])
    last = system.motion.free(np.eye(len(order))[0], times)[-1]
    exact = np.zeros(len(times))
    for rate in order:
        others = math.prod(other - rate for other in order if other != rate)
        exact += np.exp(-rate * 1e-9 * times) * math.prod(order[1:]) / others
    assert np.abs(last - exact).max() < 1e-10 * np.abs(exact).max()


def rest_in_fractions(a: Floats, push: Floats) -> list[Fraction]:
    """x with A x = -push by elimination in exact arithmetic."""
    rows = [[Fraction(float(v)) for v in row] + [-Fraction(float(p))] for row, p in zip(a, push, strict=True)]
    size = len(rows)
    for k in range(size):
        pivot = next(i for i in range(k, size) if rows[i][k])
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [v / rows[k][k] for v in rows[k]]
        for i in range(size):
            if i != k and rows[i][k]:
                factor = rows[i][k]
                rows[i] = [v - factor * own for v, own in zip(rows[i], rows[k], strict=True)]
    return [row[-1] for row in rows]


@pytest.mark.parametrize("seed", range(8))
def test_the_mean_of_a_badly_scaled_system_is_good_in_each_of_its_states(seed: int) -> None:
    draw = np.random.default_rng(seed)
    plain = random_system(seed, 5)
    rate, unit = 10.0 ** draw.uniform(-6, 6, 5), 10.0 ** draw.uniform(-6, 6, 5)
    a = rate[:, np.newaxis] * plain.a * (unit[:, np.newaxis] / unit)  # rows as fast, states as large as you like
    b = (rate * unit)[:, np.newaxis] * plain.b
    drive = Periodic(1.0, 10 * HERTZ, 0, 0, np.zeros(0, int), np.zeros(0, complex))
    mean = StateSpace(a, b, np.eye(5), np.zeros((5, 1))).drive((drive,)).mean
    exact = rest_in_fractions(a, b[:, 0])
    assert max(abs(float(Fraction(float(m)) / e - 1)) for m, e in zip(mean, exact, strict=True)) < 1e-10
