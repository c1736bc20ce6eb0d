"""Modes that are no modes, and rates that are far apart: each state keeps its own digits."""

from __future__ import annotations

import itertools
import math
from random import Random
from typing import Any

import mpmath
import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.simulators.linear.crossing import measure_of
from palpate.simulators.linear.free_motion import BLOCK, Doublings, FreeMotion
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


@pytest.mark.parametrize("seed", range(8))
def test_the_mean_of_a_badly_scaled_system_is_good_in_each_of_its_states(seed: int) -> None:
    draw = np.random.default_rng(seed)
    plain = random_system(seed, 5)
    rate, unit = 10.0 ** draw.uniform(-6, 6, 5), 10.0 ** draw.uniform(-6, 6, 5)
    a = rate[:, np.newaxis] * plain.a * (unit[:, np.newaxis] / unit)  # rows as fast, states as large as you like
    b = (rate * unit)[:, np.newaxis] * plain.b
    drive = Periodic(1.0, 10 * HERTZ, 0, 0, np.zeros(0, int), np.zeros(0, complex))
    mean = StateSpace(a, b, np.eye(5), np.zeros((5, 1))).drive((drive,)).mean
    with mpmath.workdps(DIGITS):
        exact = mpmath.lu_solve(mpmath.matrix(a.tolist()), mpmath.matrix((-b[:, 0]).tolist()))
        assert max(abs(float(m / e - 1)) for m, e in zip(mean.tolist(), exact, strict=True)) < 1e-10


# --- exponentials of matrices ------------------------------------------------------------------------

APART = [0.0, 1e-16, 3e-16, 1e-15, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-5, 1e-4, 1e-3]  # of their size
DIGITS = 50


def question(draw: Random, most: int = 12) -> tuple[Floats, int]:
    """A matrix, and a time [ns] in which one of its poles is at work: long after it exp(|A| t) bounds nothing."""
    a = chain(draw, most)
    rate = abs(draw.choice(a.diagonal())) or 1.0
    return a, max(1, int(1e9 / rate * 10.0 ** draw.uniform(-2, 1)))


def chain(draw: Random, most: int = 12) -> Floats:
    """Stages in series, of which some have nearly the same pole, some feed back, and one or two may swing."""
    order = draw.randint(2, most)
    rates: list[float] = []
    while len(rates) < order:
        if rates and draw.random() < 0.5:
            rates.append(draw.choice(rates) * (1 + draw.choice(APART)))
        else:
            rates.append(10.0 ** draw.uniform(-3, 6))
    random = np.random.default_rng(draw.randrange(2**32))
    a = np.tril(random.normal(size=(order, order)) * 10.0 ** random.uniform(-3, 3, (order, order)), -1)
    a[random.random(a.shape) < draw.choice([0.0, 0.5])] = 0.0
    a -= np.diag(rates)
    for _ in range(draw.choice([0, 0, 1, 2])):  # an armature: x' = v, v' = -w^2 x - d v
        at, w = draw.randint(0, order - 2), 10.0 ** draw.uniform(0, 3)
        a[at : at + 2, at : at + 2] = [[0.0, 1.0], [-w * w, -w * draw.choice([0.1, 2.0])]]
    return a


def exact_exponential(a: Floats, elapsed_ns: int) -> Any:
    """exp(a t) by mpmath."""
    with mpmath.workdps(DIGITS + 30):
        return mpmath.expm(mpmath.matrix(a.tolist()) * mpmath.mpf(elapsed_ns) / 10**9, method="taylor")


def worst(found: Floats, exact: Any, bound: Any) -> float:
    """The greatest error of an element of `found` over the same element of `bound`."""
    order, errors = len(found), [0.0]
    with mpmath.workdps(DIGITS):
        for i in range(order):
            for k in range(order):
                off = abs(mpmath.mpf(found[i, k]) - exact[i, k])
                if off > 1e-300:
                    errors.append(float(off / bound[i, k]) if bound[i, k] else float("inf"))
    return max(errors)


GOAL = 1e-13


def hold(a: Floats, elapsed_ns: int) -> None:
    """Elements of exp(A t) as doublings give them, and as products of these do."""
    exact = exact_exponential(a, elapsed_ns)
    bound = exact_exponential(np.abs(a), elapsed_ns)
    unit = np.array([elapsed_ns])
    decayed = np.array([FreeMotion(a).decay(column, unit)[:, 0] for column in np.eye(len(a))]).T
    assert worst(decayed, exact, bound) <= GOAL


@pytest.mark.parametrize("apart", APART[::3] + APART[-1:])
def test_poles_that_nearly_coincide_keep_the_digits_of_those_that_do(apart: float) -> None:
    a = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0 * (1 + apart), 0.0], [1.0, 1.0, -10.0]])
    hold(a, 1_000_000_007)


def test_every_element_of_a_chain_keeps_thirteen_digits() -> None:
    for seed in range(4):
        hold(*question(Random(seed), most=4))


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_every_element_of_a_long_chain_keeps_thirteen_digits() -> None:
    for seed in range(6):
        hold(*question(Random(seed)))


@pytest.mark.parametrize("bit", [0, 13, 27, 40])
def test_a_doubling_is_right_to_the_last_digit(bit: int) -> None:
    a = chain(Random(bit), most=4)
    exact = exact_exponential(a, 2**bit)
    assert worst(Doublings(a, "1e-9")[bit], exact, exact) <= 2e-16


@pytest.mark.parametrize("apart", [0.0, 2e-16, 1e-10, 1e-5])
def test_samples_of_parallel_modes_are_those_of_single_times_whatever_block_they_are_asked_in(apart: float) -> None:
    a = np.array([[-3.0, 0.0, 0.0], [2.0, -3.0 * (1 + apart), 0.0], [0.0, 5.0, -40.0]])
    motion, rows, x = FreeMotion(a), np.array([[1.0, -2.0, 3.0], [0.0, 0.0, 1.0]]), np.array([1.0, 0.5, -0.25])
    assert motion.modes is None
    step_ns, seen = 1_000_003, motion.seen(rows, x)
    times = 5000 + step_ns * np.arange(1, 3 * BLOCK)
    whole = seen(times, 5000, step_ns)
    assert np.abs(whole - seen(times, 5000, 0)).max() <= 1e-14 * np.abs(whole).max()
    for part in (slice(0, 1), slice(7, BLOCK + 9), slice(2 * BLOCK, None)):
        assert (seen(times[part], 5000, step_ns) == whole[:, part]).all()


def test_what_bounds_a_motion_without_modes_never_grows_along_it() -> None:
    """Amperes, metres and metres a second beside slow filters: in plain units Lyapunov's equation has no digit left."""
    a = np.zeros((6, 6))
    a[:3, :3] = [[-3.5e4, 0, -4e4], [0, 0, 1], [4 / 0.03, -1e6 / 0.03, -2 / 0.03]]
    a[3, 1], a[3, 3], a[4, 3], a[4, 4], a[5, 4], a[5, 5] = 1e5, -1.0, 1.0, -1.0, 1e-3, -1e-3
    measure = measure_of(a)
    assert measure is not None
    times = [0, 1000, 100_000, 10_000_000, 10**9, 10**12]
    motion = FreeMotion(a)
    for column in np.eye(6):
        sizes = [np.linalg.norm(measure @ motion.moment(column, time)) for time in times]
        assert all(after <= before * (1 + 1e-9) for before, after in itertools.pairwise(sizes))
    assert measure_of(np.array([[0.0, 1.0], [0.0, 0.0]])) is None
