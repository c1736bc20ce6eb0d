"""Linear systems and the periodic drives that act on them, in closed form."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats, Times
from palpate.simulators.linear import bouc_wen
from palpate.simulators.linear.lti import StateSpace, first_order_high_pass, first_order_low_pass
from palpate.simulators.linear.periodic import CYCLE, HERTZ, Periodic
from tests.simulators.linear_systems import DAY, SECOND, output, random_system, rich, sine

BLOCKS = (1, 7, 333, 1000)
SUSPENDED = StateSpace(
    np.array([[-3.0, 1.0], [-5000.0, -2.0]]), np.array([[0.0], [70.0]]), np.array([[1.0, 0.1]]), np.array([[0.2]])
)


def in_blocks(times: Times, size: int) -> list[Times]:
    return [times[i : i + size] for i in range(0, len(times), size)]


# --- the closed form against stepping ------------------------------------------------------------------


def test_at_0_hz_the_state_settles_to_a_constant() -> None:
    held = Periodic(1.0, 0, 0, CYCLE // 4, np.array([1]), np.array([-2j]))  # 1 + 2 sin(90 degrees)
    low = output(first_order_low_pass(0.1), held, np.zeros(1), np.array([0, 10 * SECOND]))
    assert low == pytest.approx([0.0, 3.0], abs=1e-12)
    high = output(first_order_high_pass(0.1), held, np.zeros(1), np.array([0, 10 * SECOND]))
    assert high == pytest.approx([3.0, 0.0], abs=1e-12)


# --- systems put together ------------------------------------------------------------------------------


def integrated(slope: Callable[[float, Floats], Floats], x0: Floats, times: Times) -> Floats:
    """States (s, n) at times in ns from an integrator that knows no matrices."""
    done = scipy.integrate.solve_ivp(
        slope, (0, 1e-9 * times[-1]), x0, method="DOP853", t_eval=1e-9 * times, rtol=1e-11, atol=1e-12
    )
    return np.asarray(done.y)


def test_systems_in_series_side_by_side_and_added_are_their_equations_written_out() -> None:
    first, second = random_system(1, 3, inputs=2, outputs=2), random_system(2, 2, inputs=2, outputs=2)
    drives = (rich(3, start_ns=0), rich(2, frequency=4 * HERTZ, start_ns=0))
    x0, y0 = np.array([1.0, -2.0, 0.5]), np.array([0.3, -0.7])
    times = np.arange(0, 400_000_000, 7_000_003)
    u = np.array([drive.at(times) for drive in drives])

    def given(t: float) -> Floats:
        turns = [drive.start_phase / CYCLE + drive.frequency / HERTZ * t for drive in drives]
        waves = [
            (drive.amplitude * np.exp(2j * np.pi * drive.order * turn)).real.sum()
            for drive, turn in zip(drives, turns, strict=True)
        ]
        return np.array([drive.mean + wave for drive, wave in zip(drives, waves, strict=True)])

    def both(series: bool) -> tuple[Floats, Floats]:
        def slope(t: float, z: Floats) -> Floats:
            x, y = z[:3], z[3:]
            now = given(t)
            passed = first.c @ x + first.d @ now if series else now
            return np.concatenate([first.a @ x + first.b @ now, second.a @ y + second.b @ passed])

        z = integrated(slope, np.concatenate([x0, y0]), times)
        return z[:3], z[3:]

    def closed(system: StateSpace, drives: tuple[Periodic, ...]) -> Floats:
        return system.drive(drives).trace((system.c, system.d), 0, np.concatenate([x0, y0])).at(times)

    x, y = both(series=True)
    middle = first.c @ x + first.d @ u
    assert np.abs(closed(first.then(second), drives) - (second.c @ y + second.d @ middle)).max() < 1e-7
    x, y = both(series=False)
    mine, its = first.c @ x + first.d @ u, second.c @ y + second.d @ u
    assert np.abs(closed(first.plus(second), drives) - (mine + its)).max() < 1e-7
    assert np.abs(closed(first.beside(second), (*drives, *drives)) - np.vstack([mine, its])).max() < 1e-7


def test_the_transfer_is_what_is_left_of_a_sine_when_the_transient_is_gone() -> None:
    system = random_system(3, 4, inputs=1, outputs=3)
    times = 6 * SECOND + np.arange(0, SECOND, 10_000_019)
    x = integrated(lambda t, x: system.a @ x + system.b[:, 0] * math.sin(14 * math.pi * t), np.zeros(4), times)
    t = 1e-9 * times
    outputs = system.c @ x + system.d @ np.sin(14 * np.pi * t)[np.newaxis]
    phasors = system.transfer(7.0)[:, 0]
    assert np.abs(outputs - (phasors[:, np.newaxis] * np.exp(14j * np.pi * t)).imag).max() < 1e-8


def test_some_of_the_states_are_the_same_without_those_that_only_listen() -> None:
    speaker, listener = random_system(4, 3), first_order_low_pass(0.7)
    whole, x0 = speaker.then(listener), np.array([1.0, 2.0, 3.0, 4.0])
    times = rich(3).start_ns + np.arange(0, SECOND, 9_999_991)
    alone = whole.part([0, 1, 2]).drive((rich(3),)).state(rich(3).start_ns, x0[:3], times)
    together = whole.drive((rich(3),)).state(rich(3).start_ns, x0, times)
    assert np.abs(together[:3] - alone).max() < 1e-12 * np.abs(alone).max()


def test_inputs_of_one_frequency_that_were_started_at_other_moments_are_not_taken_for_one() -> None:
    system = StateSpace(np.array([[-20.0]]), np.array([[20.0, 20.0]]), np.array([[1.0]]), np.zeros((1, 2)))
    early, late = sine(start_ns=0), sine(start_ns=25_000_000)  # a quarter of a period apart
    times = 50_000_000 + np.arange(0, SECOND, 3_333_333)
    x0 = np.zeros(1)
    both = system.drive((early, late)).trace((system.c, system.d), 50_000_000, x0).at(times)[0]
    one = first_order_low_pass(0.05)
    single = [one.drive((drive,)).trace((one.c, one.d), 50_000_000, x0).at(times)[0] for drive in (early, late)]
    assert np.abs(both - sum(single)).max() < 1e-12
    assert np.abs(both - 2 * single[0]).max() > 0.1


# --- blocks --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", BLOCKS)
def test_on_a_grid_any_block_size_gives_the_same_bytes_and_the_values_of_single_times(size: int) -> None:
    # Modes from microseconds to hours, a pair that rings, and times that the grid does not share with the start.
    system = SUSPENDED.plus(first_order_low_pass(1e4)).plus(first_order_high_pass(1e-6)).plus(first_order_low_pass(0.3))
    drive, step = rich(3), 1_000_000
    trace = system.drive((drive,)).trace((system.c, system.d), drive.start_ns, np.arange(1.0, 6.0))
    times = drive.start_ns + 123_456 + step * np.arange(3000)
    whole = trace.at(times, step)
    pieces = [trace.at(piece, step) for piece in in_blocks(times, size)]
    assert np.concatenate(pieces, axis=1).tobytes() == whole.tobytes()
    assert np.abs(whole - trace.at(times)).max() < 1e-13 * np.abs(whole).max()


# --- the operator by Bouc and Wen ----------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.5, 0.7, 1.0])
def test_a_bouc_wen_operator_follows_its_equation_at_any_step_where_euler_runs_away(share: float) -> None:
    """100 steps a cycle; against an integrator where the operator is soft, against its own finer steps where not."""

    def slope(t: float, z: Floats) -> Floats:
        v = 20 * np.pi * np.cos(20 * np.pi * t)
        return np.asarray(8.0 * (v - share * abs(v) * z - (1 - share) * v * np.abs(z)))

    times = np.arange(0, 101) * 1e-3
    x = np.sin(20 * np.pi * times)
    solved = [0.0]
    for start, end in itertools.pairwise((0.0, 0.025, 0.075, 0.1)):  # where the sine turns
        inside = times[(times > start + 1e-9) & (times < end + 1e-9)]
        part = scipy.integrate.solve_ivp(
            slope, (start, end + 1e-9), [solved[-1]], "DOP853", inside, rtol=1e-10, atol=1e-12, max_step=5e-4
        )
        solved += list(part.y[0])
    assert np.abs(bouc_wen.exact(x, 8.0, share) - solved).max() < 1e-8
    fine = np.sin(20 * np.pi * np.arange(0, 10_001) * 1e-5)
    stiff = bouc_wen.exact(x, 100.0, share)
    assert np.abs(stiff - bouc_wen.exact(fine, 100.0, share)[::100]).max() < 1e-12
    assert 0.99 < np.abs(stiff).max() <= 1
    assert not np.abs(bouc_wen.explicit_euler(np.tile(x[:-1], 10), 100.0, share)[-1000:]).max() < 10


# --- drives ------------------------------------------------------------------------------------------


def exact_phase(drive: Periodic, time_ns: int) -> int:
    """In integers without a bound."""
    return (drive.start_phase + drive.frequency * (time_ns - drive.start_ns)) % CYCLE


def test_the_phase_is_exact_for_30_days_at_any_frequency_of_the_generator() -> None:
    for start in [0, 17, 86_399 * SECOND + 1]:
        for frequency in [0, 1, 333, 9_965_244_293, 10 * HERTZ, 1_234_567_890_123, 20_000 * HERTZ]:
            drive = Periodic(0.0, frequency, start, CYCLE - 1, np.array([1]), np.ones(1, complex))
            near = np.arange(-3, 4)
            times = np.concatenate([start + near, start + SECOND + near, start + 30 * DAY + near])
            assert drive.phase(times).tolist() == [exact_phase(drive, int(t)) for t in times]
            grid = start + 30 * DAY + 999_999 * np.arange(2500)
            assert drive.phase(grid, 999_999).tolist() == [exact_phase(drive, int(t)) for t in grid]


def test_a_drive_counted_from_a_later_moment_is_the_same_bytes() -> None:
    drive = rich(25)
    times = 10 * DAY + np.arange(0, SECOND, 7_654_321)
    assert drive.restarted(9 * DAY + 1).at(times).tobytes() == drive.at(times).tobytes()


def test_scaling_scales_the_whole_function() -> None:
    drive, times = rich(5), np.arange(2 * SECOND, 3 * SECOND, 13_000_001)
    assert np.allclose(drive.scaled(-2.5, offset=7.0).at(times), 7.0 - 2.5 * drive.at(times), rtol=0, atol=1e-14)
