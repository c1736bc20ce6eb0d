"""Transitions: exact to the nanosecond, none missed, none depending on who looks when, none looked for twice."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.errors import UnreachableError
from palpate.simulators.linear import path as path_module
from palpate.simulators.linear.crossing import NEVER, CrossingWatch
from palpate.simulators.linear.cycle import Guard, Mode
from palpate.simulators.linear.lti import StateSpace, first_order_low_pass
from palpate.simulators.linear.path import Path
from palpate.simulators.linear.periodic import CYCLE, HERTZ, SECOND, Periodic

MS = 1_000_000
DAY = 86_400 * SECOND


def sine(amplitude: float = 1.0, mean: float = 0.0, frequency: int = 10 * HERTZ) -> Periodic:
    return Periodic(mean, frequency, 0, 0, np.array([1]), np.array([-1j * amplitude]))


def failure(system: StateSpace, drive: Periodic, state: Floats) -> int:
    """The time when the one output falls below zero."""
    watch, time_ns, failed = CrossingWatch(system.drive((drive,)), (system.c, system.d)), 0, None
    while failed is None and time_ns < NEVER:
        last = time_ns
        time_ns, failed = watch.first_failure(time_ns, system.drive((drive,)).state(0, state, np.array([last]))[:, 0])
    return time_ns


def gain(factor: float) -> StateSpace:
    return StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[factor]]))


# --- the first failure ---------------------------------------------------------------------------------


@pytest.mark.parametrize("frequency", [1, HERTZ // 1000, 10 * HERTZ, 20_000 * HERTZ])
def test_a_sine_crosses_at_the_nanosecond_of_the_arcsine(frequency: int) -> None:
    turns = 0.5 + math.asin(0.3) / (2 * math.pi)
    exact = turns * CYCLE / frequency
    assert failure(gain(1.0), sine(1.0, 0.3, frequency), np.zeros(0)) == pytest.approx(exact, abs=1 + 1e-12 * exact)


@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9, 1e-11])
def test_a_dip_far_shorter_than_any_look_is_found(depth: float) -> None:
    """A dip of depth 1e-11 lasts 142 ns of a tenth of a second; it begins an arccosine before three quarters."""
    drive = sine(1.0, 1 - depth)
    exact = 1e8 * (0.75 - math.acos(1 - depth) / (2 * math.pi))
    assert failure(gain(1.0), drive, np.zeros(0)) == pytest.approx(exact, abs=2)
    if depth < 1e-8:
        assert (drive.at(np.arange(1, 1000) * 100_003) > 0).all()  # a thousand looks see nothing


@pytest.mark.parametrize("height", [1e-11, 1e-6, 0.0])
def test_what_stays_above_zero_is_never_said_to_fail_however_near_it_comes(height: float) -> None:
    assert failure(gain(1.0), sine(1.0, 1 + height), np.zeros(0)) == NEVER


def test_a_dip_of_a_microsecond_in_a_transient_of_minutes_is_found() -> None:
    """1 - 3 exp(-t / us) + 2.5 exp(-t / 3 us), and a mode of 100 s that nearly hides it."""
    taus, weights = np.array([1e-6, 3e-6, 100.0]), np.array([3.0, -4.4, 1.0])
    system = StateSpace(np.diag(-1 / taus), np.zeros((3, 1)), weights[np.newaxis], np.zeros((1, 1)))
    drive = Periodic(0.0, 10 * HERTZ, 0, 0, np.zeros(0, int), np.zeros(0, complex))
    brute = next(t for t in range(5000) if weights @ np.exp(-1e-9 * t / taus) < 0)
    assert failure(system, drive, np.ones(3)) == brute


@pytest.mark.parametrize("seed", range(8))
def test_no_failure_is_missed_in_random_sums_of_harmonics_and_modes(seed: int) -> None:
    """Against a grid of 200 000 points over three periods, and the nanosecond before and after."""
    draw = np.random.default_rng(seed)
    count = int(draw.integers(1, 6))
    k = np.sort(draw.choice(np.arange(1, 14), count, replace=False))
    drive = Periodic(
        0.0, 10 * HERTZ, 0, int(draw.integers(CYCLE)), k, draw.normal(size=count) + 1j * draw.normal(size=count)
    )
    rate, turn = -(10.0 ** draw.uniform(-1, 5)), 10.0 ** draw.uniform(0, 4)
    slow = -(10.0 ** draw.uniform(-1, 2))
    a = np.array([[rate, turn, 0.0], [-turn, rate, 0.0], [0.0, 0.0, slow]])
    c = draw.normal(size=(1, 3))
    x0 = draw.normal(size=3) * 2
    lowest = float(drive.at(np.arange(0, 100_000_000, 50_021)).min())
    drive = drive.scaled(1.0, -lowest * draw.uniform(0.9, 1.1) + 1e-4)

    def value(times: Times) -> Floats:
        t = 1e-9 * times
        ringing = (x0[0] + 1j * x0[1]) * np.exp((rate - 1j * turn) * t)
        return np.asarray(c[0] @ np.array([ringing.real, ringing.imag, x0[2] * np.exp(slow * t)]) + drive.at(times))

    if value(np.array([0]))[0] < 0:
        x0 = -x0
    found = failure(StateSpace(a, np.zeros((3, 1)), c, np.ones((1, 1))), drive, x0)
    grid = np.arange(0, 300_000_000, 1_499)
    below = np.flatnonzero(value(grid) < 0)
    if found < grid[-1]:
        assert len(below) == 0 or found <= grid[below[0]]
        near = value(found + np.array([-1, 0]))
        assert near[1] < 1e-12 and (found == 0 or near[0] > -1e-11)
    else:
        assert len(below) == 0


# --- piecewise linear systems against an integrator with events ----------------------------------------


def bouncer(mass: float = 0.03, stiffness: float = 1e6, damping: float = 20.0) -> tuple[Mode, Mode]:
    """x'' = (u - c x' - k x - wall) / m, with a wall beyond x = 1 mm. Outputs: x."""

    def matrices(wall: float) -> StateSpace:
        a = np.array([[0.0, 1.0], [-(3000.0 + wall) / mass, -damping / mass]])
        b = np.array([[0.0, 0.0], [1 / mass, wall * 1e-3 / mass]])
        return StateSpace(a, b, np.array([[1.0, 0.0]]), np.zeros((1, 2)))

    free: Mode
    walled: Mode
    row = np.array([[1.0, 0.0]])
    free = Mode("free", matrices(0.0), (Guard((-row, np.array([[0.0, 1e-3]])), lambda: walled),))
    walled = Mode("wall", matrices(stiffness), (Guard((row, np.array([[0.0, -1e-3]])), lambda: free),))
    return free, walled


def driven(mode: Mode, drive: Periodic, state: Floats) -> Path:
    one = Periodic(1.0, drive.frequency, 0, drive.start_phase, drive.order[:0], drive.amplitude[:0])
    return Path((drive, one), mode, 0, state)


@pytest.mark.slow
def test_modes_that_are_parallel_are_followed_without_them() -> None:
    """Critically damped in the air: its modes are one."""
    damping = 2 * math.sqrt(3000.0 * 0.03)
    free, _ = bouncer(stiffness=5e4, damping=damping)
    assert free.system.motion.modes is None
    path = driven(free, sine(8.0), np.zeros(2))

    def slope(t: float, z: Floats) -> list[float]:
        wall = 5e4 * max(z[0] - 1e-3, 0.0)
        return [z[1], (8 * math.sin(20 * math.pi * t) - damping * z[1] - 3000 * z[0] - wall) / 0.03]

    times = np.arange(0, 120, 3) * MS
    done = scipy.integrate.solve_ivp(
        slope, (0, 0.12), np.zeros(2), method="DOP853", t_eval=1e-9 * times, rtol=1e-12, atol=1e-15, max_step=1e-4
    )
    assert np.abs(path.outputs(times, slice(0, 1))[0] - done.y[0]).max() < 1e-8 * np.abs(done.y[0]).max()
    assert len(path.modes_until(120 * MS)) > 2


def test_a_chain_that_never_comes_to_rest_between_its_modes_is_a_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path_module, "MOST", 500)
    here: Mode
    there: Mode
    system = StateSpace(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), np.zeros((1, 2)))
    below = (np.zeros((1, 0)), np.array([[0.0, -1.0]]))
    here = Mode("here", system, (Guard(below, lambda: there),))
    there = Mode("there", system, (Guard(below, lambda: here),))
    with pytest.raises(UnreachableError, match=r"more than 500 times in one period .* from .*here to .*here"):
        driven(here, sine(), np.zeros(0)).outputs(np.array([0]), slice(0, 1))


# --- looking does not change anything ------------------------------------------------------------------


def listening(drive: Periodic, tau: float = 300.0) -> Path:
    """The bouncer, and a slow filter that listens to it. Outputs: x, the filter."""
    first, second = bouncer(stiffness=1e4)
    modes: dict[str, Mode] = {}
    for mode in (first, second):
        by_both = StateSpace(mode.system.a, mode.system.b, np.array([[1.0, 0.0], [1.0, 0.0]]), np.zeros((2, 2)))
        filtered = gain(1.0).beside(first_order_low_pass(tau))
        row, inputs = mode.guards[0].row
        other = "wall" if mode.touch == "free" else "free"
        guard = Guard((np.hstack([row, np.zeros((1, 1))]), inputs), lambda other=other: modes[other])
        modes[mode.touch] = Mode(mode.touch, by_both.then(filtered), (guard,))
    return driven(modes["free"], drive, np.zeros(3))


@pytest.mark.parametrize("frequency", [10 * HERTZ, 25 * HERTZ, 9_965_244_293])
def test_blocks_of_any_size_and_order_are_the_same_bytes_even_across_the_beginning_of_the_recurrence(
    frequency: int,
) -> None:
    drive = sine(8.0, frequency=frequency)
    times = np.arange(0, 1000) * 1_000_003
    whole = listening(drive).outputs(times, slice(0, 2))
    for size in (1, 7, 333, 1000):
        path, some = listening(drive), times[: 400 * size]
        blocks = [path.outputs(some[i : i + size], slice(0, 2)) for i in range(0, len(some), size)]
        assert np.concatenate(blocks, axis=1).tobytes() == whole[:, : len(some)].tobytes(), size
    late = listening(drive)
    late.outputs(times[-1:], slice(0, 2))
    assert late.outputs(times[:50], slice(0, 2)).tobytes() == whole[:, :50].tobytes()


def test_a_block_longer_than_what_is_kept_is_as_good_as_its_pieces() -> None:
    drive = sine(8.0, frequency=9_965_244_293)  # never repeats: followed all the way
    times = np.arange(0, 13 * SECOND, 19_999_991)
    whole = listening(drive).outputs(times, slice(0, 2))
    path = listening(drive)
    pieces = [path.outputs(times[i : i + 100], slice(0, 2)) for i in range(0, len(times), 100)]
    assert np.concatenate(pieces, axis=1).tobytes() == whole.tobytes()


# --- what recurs ---------------------------------------------------------------------------------------


def searches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Counts the searches for a failure."""
    count = [0]
    searched = CrossingWatch.first_failure

    def counted(self: CrossingWatch, start_ns: int, state: Floats) -> tuple[int, int | None]:
        count[0] += 1
        return searched(self, start_ns, state)

    monkeypatch.setattr(CrossingWatch, "first_failure", counted)
    return count


@pytest.mark.parametrize("frequency", [10 * HERTZ, 7 * HERTZ, 9_965_244_293])
def test_what_recurs_is_what_following_every_transition_gives(frequency: int, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = sine(8.0, frequency=frequency)
    times = 4 * SECOND + np.arange(0, SECOND, 999_983)
    recurring = listening(drive)
    quick = recurring.outputs(times, slice(0, 2))
    assert recurring.cycle is not None
    monkeypatch.setattr(path_module, "recurrence", lambda *_: None)
    followed = listening(drive)
    slow = followed.outputs(times, slice(0, 2))
    assert followed.cycle is None
    assert (np.abs(quick - slow).max(axis=1) < 1e-10 * np.abs(slow).max(axis=1)).all()
    touches = [[mode.touch for mode in path.modes_until(5 * SECOND)] for path in (recurring, followed)]
    assert touches[0] == touches[1]


@pytest.mark.parametrize("end_ns", [0, 250 * MS, 5 * SECOND])
def test_modes_are_met_as_they_are_asked_for(end_ns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    drive, count = sine(8.0), searches(monkeypatch)
    modes = listening(drive).modes_met(end_ns)
    assert (next(modes).touch, count) == ("free", [1])
    met, all_modes = [mode.touch for mode in modes], listening(drive)
    all_modes.outputs(np.array([end_ns]), slice(0, 1))
    cycle = all_modes.cycle if end_ns == 5 * SECOND else None
    border = end_ns if cycle is None else cycle.start_ns - 1
    begun = [stay.mode.touch for stay in all_modes.stretches if stay.start_ns <= border]
    repeated = [mode.touch for mode in cycle.modes(cycle.start_ns, cycle.start_ns + SECOND // 5)] if cycle else []
    assert ["free", *met] == begun + repeated


@pytest.mark.parametrize("frequency", [10 * HERTZ, 9_965_244_293])
def test_thirty_days_of_transitions_are_reached_at_once_and_what_listens_goes_on_settling(
    frequency: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The filter's mean follows exp(-t / tau) to the mean of x, through 26 million periods."""
    tau, count = 1e5, searches(monkeypatch)
    path = listening(sine(8.0, frequency=frequency), tau)
    cycle = np.round(np.arange(5000) / 5000 * CYCLE / frequency).astype(np.int64)
    periods = {day: (day * DAY + 10 * SECOND) * frequency // CYCLE for day in (0, 1, 5, 30)}
    begins = {day: -(-number * CYCLE // frequency) for day, number in periods.items()}
    mean = {day: path.outputs(begin + cycle, slice(0, 2)).mean(axis=1) for day, begin in begins.items()}
    assert count[0] < 300
    x = mean[0][0]
    for day, means in mean.items():
        assert means[0] == pytest.approx(x, rel=1e-9 if frequency == 10 * HERTZ else 1e-6)  # begun within a nanosecond
        assert means[1] == pytest.approx(x * -math.expm1(-(day * 86_400 + 10.05) / tau), rel=2e-2 if day == 0 else 1e-5)


@pytest.mark.parametrize("frequency", [0, HERTZ // 1000])
def test_a_drive_that_hardly_moves_is_followed_too(frequency: int) -> None:
    """8 N held against the spring alone would be 2.7 mm: the wall stands at 1 mm."""
    path = driven(bouncer()[0], Periodic(0.0, frequency, 0, CYCLE // 4, np.array([1]), np.array([-8j])), np.zeros(2))
    x = path.outputs(np.array([0, 2 * SECOND]), slice(0, 1))[0]
    assert x[1] == pytest.approx((8.0 + 1e6 * 1e-3) / (3000 + 1e6), rel=1e-4 if frequency else 1e-12)
    if frequency:  # half a period later it hangs as far down as the spring lets it, without a wall
        assert path.outputs(np.array([500 * SECOND]), slice(0, 1))[0, 0] == pytest.approx(-8 / 3000, rel=1e-6)
