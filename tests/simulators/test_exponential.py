"""exp(A t) to the last digit, whatever the poles: beside another library's 50 digits."""

from __future__ import annotations

import itertools
from dataclasses import replace
from random import Random

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects.pyroelectric import Pyroelectric
from palpate.simulators.linear.crossing import measure_of
from palpate.simulators.linear.free_motion import BLOCK, Doublings, FreeMotion, exponential
from palpate.simulators.rig import Rig
from tests.simulators import linear_matrices, rigs
from tests.simulators.linear_matrices import APART, chain, question, worst

GOAL = 1e-13


def hold(a: Floats, elapsed_ns: int) -> None:
    """Elements of exp(A t) as doublings give them, and as products of these do."""
    exact = linear_matrices.exponential(a, elapsed_ns)
    bound = linear_matrices.exponential(np.abs(a), elapsed_ns)
    unit = np.array([elapsed_ns])
    decayed = np.array([FreeMotion(a).decay(column, unit)[:, 0] for column in np.eye(len(a))]).T
    assert worst(decayed, exact, bound) <= GOAL


@pytest.mark.parametrize("apart", APART[::3] + APART[-1:])
def test_poles_that_nearly_coincide_keep_the_digits_of_those_that_do(apart: float) -> None:
    a = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0 * (1 + apart), 0.0], [1.0, 1.0, -10.0]])
    hold(a, 1_000_000_007)


def test_scipy_loses_them() -> None:
    a = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0000000000000002, 0.0], [1.0, 1.0, -10.0]])
    assert abs(scipy.linalg.expm(a)[1, 0] / exponential(a)[1, 0] - 1) > 0.01
    assert exponential(a)[1, 0] == pytest.approx(np.exp(-1), rel=3e-16)


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
    exact = linear_matrices.exponential(a, 2**bit)
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


@pytest.mark.parametrize("apart", [2.3e-16, 1e-15, 1e-10])
def test_films_that_warm_up_as_fast_as_their_amplifiers_forget_are_as_where_both_are_one_second(apart: float) -> None:
    thesis = rigs.scene("charge_amplifier")
    times = np.arange(1, 4000) * rigs.MS
    voltages = []
    for settling in (1.0, 1.0 + apart):
        effects = {**thesis.effects, "pyroelectric": Pyroelectric.model_validate({"settling": f"{settling!r} s"})}
        rig = Rig(replace(thesis, effects=effects), VirtualClock())
        rigs.pressed(rig, "2", rigs.BALANCE + 2e-3, 1.0)  # contact is kept: what moves freely does so for long
        voltages.append(rig.film_voltages(times, rigs.MS))
    off = np.abs(voltages[1] - voltages[0]).max(axis=1)
    assert (off <= (1e-13 + apart) * np.abs(voltages[0]).max(axis=1)).all()
