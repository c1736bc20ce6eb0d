"""The closed form of a linear chain, against stepping, and its phase, against arithmetic that forgets."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import expm

from simulators.lti import (
    CYCLE,
    HERTZ,
    Floats,
    Periodic,
    StateSpace,
    first_order_high_pass,
    first_order_low_pass,
)

Times = npt.NDArray[np.int64]
SECOND = 1_000_000_000
DAY = 86_400 * SECOND
BLOCKS = (1, 7, 333, 1000)
SUSPENDED = StateSpace(
    np.array([[-3.0, 1.0], [-5000.0, -2.0]]), np.array([[0.0], [70.0]]), np.array([[1.0, 0.1]]), np.array([[0.2]])
)


def sine(amplitude: float = 1.0, frequency: int = 10 * HERTZ, mean: float = 0.0, start_ns: int = 0) -> Periodic:
    return Periodic(mean, frequency, start_ns, 0, np.array([1]), np.array([-1j * amplitude]))


def rich(harmonics: int, frequency: int = 9_999_000_001, start_ns: int = 1_234_567) -> Periodic:
    """A drive with many harmonics of no particular phase."""
    k = np.arange(1, harmonics + 1)
    return Periodic(0.3, frequency, start_ns, 123_456_789_012_345_678, k, np.exp(1j * k**2) / k)


def output(system: StateSpace, drive: Periodic, x0: Floats, times: Times) -> Floats:
    """Outputs (n,) of a system with one input and one output from state `x0` at the drive's start."""
    return system.drive((drive,)).trace((system.c, system.d), drive.start_ns, x0).at(times)[0]


def in_blocks(times: Times, size: int) -> list[Times]:
    return [times[i : i + size] for i in range(0, len(times), size)]


# --- phase ---------------------------------------------------------------------------------------------


def exact_phase(drive: Periodic, time_ns: int) -> int:
    """In integers without a bound."""
    return (drive.start_phase + drive.frequency * (time_ns - drive.start_ns)) % CYCLE


@pytest.mark.parametrize("frequency", [0, 1, 333, 9_965_244_293, 10 * HERTZ, 1_234_567_890_123, 20_000 * HERTZ])
@pytest.mark.parametrize("start", [0, 17, 86_399 * SECOND + 1])
def test_the_phase_is_exact_for_30_days_at_any_frequency_of_the_generator(frequency: int, start: int) -> None:
    drive = Periodic(0.0, frequency, start, CYCLE - 1, np.array([1]), np.ones(1, complex))
    near = np.arange(-3, 4)
    times = np.concatenate([start + near, start + SECOND + near, start + 30 * DAY + near])
    assert drive.phase(times).tolist() == [exact_phase(drive, int(t)) for t in times]


def summed(step: np.floating, count: int) -> float:
    """What `total += step` gives after `count` times, rounding each time.

    Between two powers of two the rounded increment is the same every time, so whole binades are done at once.
    """
    kind = type(step)
    total, left = kind(0), count
    while left:
        increment = kind(total + step) - total
        if increment == 0:
            return float(total)
        binade = kind(2.0 ** math.floor(math.log2(total))) * kind(2) if total else step
        jump = min(left, max(1, math.floor(Fraction(float(binade - total)) / Fraction(float(increment))) - 1))
        total = kind(float(total) + jump * float(increment)) if jump > 1 else kind(total + step)
        left -= jump
    return float(total)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_the_summing_of_this_test_is_what_a_loop_does(kind: type[np.floating]) -> None:
    step = kind(2 * math.pi * 10e-3)
    looped = np.add.accumulate(np.full(300_000, step, kind), dtype=kind)
    for count in (1, 2, 3, 1000, 99_999, 300_000):
        assert summed(step, count) == looped[count - 1]


def test_after_1e9_samples_the_phase_is_exact_where_floating_point_sums_are_lost() -> None:
    samples, step_ns = 10**9, 1_000_037  # 1 kHz by a quartz that is 37 ppm off
    drive = sine(frequency=9_973_000_000)
    truth = exact_phase(drive, samples * step_ns)
    assert drive.phase(np.array([samples * step_ns]))[0] == truth

    radians = 2 * math.pi * 9.973 * 1e-9 * step_ns
    single = summed(np.float32(radians), samples)
    assert single < 0.05 * radians * samples  # it stands still once a step is less than half a digit
    double = summed(np.float64(radians), samples) / (2 * math.pi) - truth / CYCLE
    assert 360 * abs(double - round(double)) > 1.0  # degrees


def test_the_value_after_30_days_is_good_to_rounding_where_single_precision_time_is_noise() -> None:
    drive = sine(frequency=10_007_000_000, start_ns=5)
    times = 30 * DAY + np.arange(0, SECOND, 999_983)
    truth = np.array([math.sin(2 * math.pi * exact_phase(drive, int(t)) / CYCLE) for t in times])
    assert np.abs(drive.at(times) - truth).max() < 1e-15
    single = np.float32(2 * math.pi * 10.007) * ((times - 5) * 1e-9).astype(np.float32)
    assert np.abs(np.sin(single) - truth).max() > 1.0


def test_a_drive_counted_from_a_later_moment_is_the_same_bytes() -> None:
    drive = rich(25)
    times = 10 * DAY + np.arange(0, SECOND, 7_654_321)
    assert drive.restarted(9 * DAY + 1).at(times).tobytes() == drive.at(times).tobytes()


def test_scaling_scales_the_whole_function() -> None:
    drive, times = rich(5), np.arange(2 * SECOND, 3 * SECOND, 13_000_001)
    assert np.allclose(drive.scaled(-2.5, offset=7.0).at(times), 7.0 - 2.5 * drive.at(times), rtol=0, atol=1e-14)


# --- the closed form against stepping ------------------------------------------------------------------


def stepped(system: StateSpace, drive: Periodic, x0: Floats, step_ns: int, count: int) -> Floats:
    """Outputs at `count` steps after the drive's start.

    The matrix exponential of the system together with the oscillators that drive it: exact for any step.
    """
    s, k = system.order, len(drive.order)
    augmented = np.zeros((s + 2 * k + 1,) * 2)
    augmented[:s, :s] = system.a
    augmented[:s, -1] = system.b[:, 0] * drive.mean
    z0 = np.zeros(len(augmented))
    z0[:s], z0[-1] = x0, 1.0
    start = np.exp(2j * np.pi * drive.order * drive.start_phase / CYCLE) * drive.amplitude
    for i in range(k):
        w, at = 2 * np.pi / HERTZ * drive.frequency * drive.order[i], s + 2 * i
        augmented[at : at + 2, at : at + 2] = [[0, -w], [w, 0]]
        augmented[:s, at] = system.b[:, 0]
        z0[at : at + 2] = start[i].real, start[i].imag
    propagator = expm(augmented * 1e-9 * step_ns)
    outputs = np.empty(count)
    for n in range(count):
        z0 = propagator @ z0
        outputs[n] = system.c[0] @ z0[:s] + system.d[0, 0] * (drive.mean + z0[s:-1:2].sum())
    return outputs


@pytest.mark.parametrize("tau", [1e-6, 1e-3, 1.0, 1e4])
@pytest.mark.parametrize("make", [first_order_high_pass, first_order_low_pass])
@pytest.mark.parametrize("harmonics", [1, 13])
def test_a_first_order_closed_form_equals_exact_stepping(tau: float, make: type, harmonics: int) -> None:
    system, drive, x0, step = make(tau), rich(harmonics), np.array([2.0]), 1_000_003
    times = drive.start_ns + step * np.arange(1, 1501)
    assert np.abs(output(system, drive, x0, times) - stepped(system, drive, x0, step, 1500)).max() < 1e-10


def test_a_ringing_second_order_closed_form_equals_exact_stepping() -> None:
    drive, x0, step = rich(5), np.array([0.5, -3.0]), 500_009
    times = drive.start_ns + step * np.arange(1, 4001)
    assert np.abs(output(SUSPENDED, drive, x0, times) - stepped(SUSPENDED, drive, x0, step, 4000)).max() < 1e-9


def test_at_0_hz_the_state_settles_to_a_constant() -> None:
    held = Periodic(1.0, 0, 0, CYCLE // 4, np.array([1]), np.array([-2j]))  # 1 + 2 sin(90 degrees)
    low = output(first_order_low_pass(0.1), held, np.zeros(1), np.array([0, 10 * SECOND]))
    assert low == pytest.approx([0.0, 3.0], abs=1e-12)
    high = output(first_order_high_pass(0.1), held, np.zeros(1), np.array([0, 10 * SECOND]))
    assert high == pytest.approx([3.0, 0.0], abs=1e-12)


def test_explicit_euler_explodes_on_a_microsecond_where_the_closed_form_does_not() -> None:
    tau, step = 1e-6, 1e-4
    euler = 0.0
    for _ in range(8):
        euler += step / tau * (1.0 - euler)
    assert abs(euler) > 1e15
    x = output(first_order_low_pass(tau), sine(0.0, mean=1.0), np.zeros(1), np.arange(1, 9) * 100_000)
    assert np.abs(x - 1.0).max() < 1e-15


def test_a_held_input_is_not_exact_where_the_closed_form_is() -> None:
    tau, step_ns, count = 1.0, 1_000_000, 1000
    drive, system = sine(), first_order_high_pass(tau)
    times = np.arange(1, count + 1) * step_ns
    a, x, held = math.exp(-1e-9 * step_ns / tau), 0.0, np.empty(count)
    u = drive.at(np.arange(count + 1) * step_ns)
    for n in range(count):
        x = a * x + (1 - a) * u[n]
        held[n] = u[n + 1] - x
    exact = stepped(system, drive, np.zeros(1), step_ns, count)
    assert 3e-4 < np.abs(held - exact).max() < 1e-3
    assert np.abs(output(system, drive, np.zeros(1), times) - exact).max() < 1e-12


# --- blocks --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("harmonics", [1, 2, 13, 40])
@pytest.mark.parametrize("size", BLOCKS)
def test_blocks_of_any_size_give_the_same_bytes(harmonics: int, size: int) -> None:
    drive = rich(harmonics)
    times = drive.start_ns + np.arange(150 if size == 1 else 1100) * 999_983
    pieces = in_blocks(times, size)
    whole = drive.at(times)
    assert b"".join(drive.at(piece).tobytes() for piece in pieces) == whole.tobytes()
    for system in (first_order_high_pass(0.3), SUSPENDED):
        x0 = np.linspace(1.0, 2.0, system.order)
        whole = output(system, drive, x0, times)
        assert b"".join(output(system, drive, x0, piece).tobytes() for piece in pieces) == whole.tobytes()
