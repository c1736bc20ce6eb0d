"""The closed form of a linear chain, against stepping, and its phase, against arithmetic that forgets."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from simulators.linear.lti import Floats, StateSpace, first_order_high_pass, first_order_low_pass
from simulators.linear.periodic import CYCLE, HERTZ, Periodic

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
    grid = start + 30 * DAY + 999_999 * np.arange(2500)
    assert drive.phase(grid, 999_999).tolist() == [exact_phase(drive, int(t)) for t in grid]


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


# --- systems put together ------------------------------------------------------------------------------


def random_system(seed: int, order: int, inputs: int = 1, outputs: int = 1) -> StateSpace:
    """A stable one of no structure."""
    draw = np.random.default_rng(seed)
    a = draw.normal(size=(order, order)) * 30
    a -= (np.linalg.eigvals(a).real.max() + 5) * np.eye(order)
    shapes = ((order, inputs), (outputs, order), (outputs, inputs))
    b, c, d = (draw.normal(size=shape) for shape in shapes)
    return StateSpace(a, b, c, d)


def integrated(slope: Callable[[float, Floats], Floats], x0: Floats, times: Times) -> Floats:
    """States (s, n) at times in ns from an integrator that knows no matrices."""
    done = solve_ivp(slope, (0, 1e-9 * times[-1]), x0, method="DOP853", t_eval=1e-9 * times, rtol=1e-11, atol=1e-12)
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


# --- modes that are no modes, and rates that are far apart ----------------------------------------------


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


@pytest.mark.parametrize("apart", [0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2])
def test_rates_that_nearly_coincide_lose_no_digits_where_their_modes_lose_all(apart: float) -> None:
    """x[0] = (exp(p t) - exp(q t)) / (p - q) from a one in state 1, with the difference taken exactly."""
    p, q = -7.0, -7.0 * (1 + apart)
    system = StateSpace(np.array([[p, 1.0], [0.0, q]]), np.zeros((2, 1)), np.eye(2), np.zeros((2, 1)))
    times = np.array([1, 1000, 123_456_789, SECOND])
    t = 1e-9 * times
    half = (p - q) * t / 2
    exact = t * np.exp((p + q) * t / 2) * np.where(half > 0, np.sinh(half) / np.where(half > 0, half, 1), 1.0)
    assert np.abs(system.motion.free(np.array([0.0, 1.0]), times)[0] - exact).max() < 1e-10 * exact.max()
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
    exact = np.array([expm(a * 1e-9 * t) @ x0 for t in times]).T
    assert (np.abs(system.motion.free(x0, times) - exact).max(axis=1) < 1e-11 * np.abs(exact).max(axis=1)).all()


def test_a_state_that_only_integrates_gives_the_integral() -> None:
    """x'' = u of a cosine from rest: (1 - cos w t) / w^2."""
    system = StateSpace(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), np.eye(2)[:1], np.zeros((1, 1)))
    drive = Periodic(0.0, 10 * HERTZ, 0, 0, np.array([1]), np.array([1.0 + 0j]))
    times, w = np.arange(0, 2 * SECOND, 7_654_321), 20 * math.pi
    exact = (1 - np.cos(w * 1e-9 * times)) / w**2
    assert np.abs(output(system, drive, np.zeros(2), times) - exact).max() < 1e-12 * exact.max()


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
    """From a one in the first state, the last by partial fractions."""
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


# --- blocks --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("harmonics", [1, 13])
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
