"""Hard cases of simulation, each with the naive method beside it, shown failing, and the shipped one holding.

Cases that other files hold with their naive method: phase after 1e9 samples (test_periodic), nearly parallel modes
(test_free_motion), short dips (test_path), short records, near saturation, times (test_hard_estimates), large offsets
(test_estimate, test_calibration).
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.instrument.contracts.own import SENSOR_NODE, STRAIN_INDICATOR
from palpate.instrument.errors import EstimateError, RangeError
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.signals.estimate import fit_sine
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects.charge_amplifier import ChargeAmplifier
from palpate.simulators.effects.crosstalk import Crosstalk
from palpate.simulators.linear import bouc_wen
from palpate.simulators.linear.integrators import first_order_hold
from palpate.simulators.linear.lti import StateSpace, first_order_low_pass, gain
from palpate.simulators.linear.path import Path
from palpate.simulators.linear.periodic import HERTZ, SECOND, Periodic, constant
from palpate.simulators.physics.chain import Armature, Limits, MeasuringChain, Plays, SpringStack, Touch
from palpate.simulators.randomness import Stream

MS = 1_000_000


def sine(amplitude: float = 1.0, frequency: int = 10 * HERTZ, mean: float = 0.0) -> Periodic:
    return Periodic(mean, frequency, 0, 0, np.array([1]), np.array([-1j * amplitude]))


def step_response(system: StateSpace, times: np.ndarray) -> Floats:
    trace = system.drive((sine(0.0, mean=1.0),)).trace((system.c, system.d), 0, np.zeros(system.order))
    return trace.at(times)[0]


# --- clocks and counters -------------------------------------------------------------------------------


def test_a_clock_of_floats_stands_still_where_integer_nanoseconds_go_on() -> None:
    step = np.float32(1e-3)
    assert np.float32(32_768) + step == np.float32(32_768)
    clock = VirtualClock()
    clock.wait(30 * 86_400.0)
    for _ in range(1000):
        clock.wait(1e-3)
    assert clock.now_ns() == (30 * 86_400 + 1) * SECOND


def test_a_counter_in_single_precision_sticks_where_the_node_counts_on() -> None:
    sticks = 2**24
    assert np.float32(sticks) + np.float32(1) == np.float32(sticks)
    contract = SENSOR_NODE
    for count in (sticks, sticks + 1, 2**32 - 1):
        assert contract.decode("sample_counter", count.to_bytes(4, "little")) == count


def test_a_load_that_a_16_bit_register_turns_negative_is_carried_as_it_is() -> None:
    assert np.array(40_000).astype(np.int16) == -25_536  # 40 N in mN
    contract = STRAIN_INDICATOR
    field = next(f.name for f in contract.fields if f.type == "float32" and f.name.startswith("reading"))
    assert contract.decode(field, contract.encode(field, 40.0)) == 40.0


# --- filters -------------------------------------------------------------------------------------------


def test_a_slow_pole_in_single_precision_settles_short_where_the_closed_form_settles() -> None:
    """tau = 1000 s at 10 kHz."""
    a = np.float32(math.exp(-1e-4 / 1000.0))
    for settled in (np.float32(0.9), np.float32(0.76)):  # from here on nothing moves towards 1
        following = np.float32(a * settled) + np.float32(np.float32(1) - a)
        assert not following > settled
    times = np.array([1000, 5000, 40_000]) * SECOND
    exact = -np.expm1(-1e-9 * times / 1000.0)
    assert np.abs(step_response(first_order_low_pass(1000.0), times) - exact).max() < 1e-14


def test_a_butterworth_filter_as_one_polynomial_explodes_where_its_poles_one_by_one_hold() -> None:
    """Fourth order, 0.1 Hz at 10 kHz: the step settles at 1."""
    numerator, denominator = scipy.signal.butter(4, 0.1, fs=10_000)
    naive = scipy.signal.lfilter(numerator, denominator, np.ones(600_000))
    assert abs(naive[-1] - 1) > 0.5
    w = 2 * math.pi * 0.1
    pairs = []
    for angle in (math.pi / 8, 3 * math.pi / 8):
        a = np.array([[0.0, 1.0], [-(w**2), -2 * w * math.cos(angle)]])
        pairs.append(StateSpace(a, np.array([[0.0], [w**2]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))))
    shipped = step_response(pairs[0].then(pairs[1]), np.array([120 * SECOND]))
    assert abs(shipped[0] - 1) < 1e-11


def test_the_trapezoid_rings_on_a_microsecond_where_the_closed_form_is_there_at_once() -> None:
    """A step on RC = 1 us at 10 kHz."""
    z, naive = -1e-4 / 1e-6, 0.0
    swings = []
    for _ in range(5):
        naive = ((1 + z / 2) * naive - z) / (1 - z / 2)
        swings.append(naive - 1)
    assert min(abs(swing) for swing in swings) > 0.8
    assert swings[0] * swings[1] < 0
    assert np.abs(step_response(first_order_low_pass(1e-6), np.arange(1, 6) * 100_000) - 1).max() < 1e-15


def test_differences_of_exponentials_of_nearly_nothing_keep_their_digits() -> None:
    """tau = 1e4 s at 10 kHz: z = -1e-8, and the ramp's weight is 1/2 + z/6."""
    z = -1e-8
    assert np.float32(1) - np.exp(np.float32(z)) == 0
    assert abs((math.exp(z) - 1 - z) / z**2 / 0.5 - 1) > 0.1
    _, before, after = first_order_hold(np.array([z], complex))
    assert after[0].real == pytest.approx(0.5 + z / 6, rel=1e-14)
    assert before[0].real == pytest.approx(0.5 + z / 3, rel=1e-14)


# --- blocks --------------------------------------------------------------------------------------------


def test_noise_seeded_anew_in_each_block_repeats_where_a_counter_goes_on() -> None:
    naive = np.concatenate([np.random.default_rng(1).normal(size=100) for _ in range(20)])
    assert np.corrcoef(naive[:-100], naive[100:])[0, 1] > 0.999
    stream = Stream(1, "white_noise")
    counted = np.concatenate([stream.normal(first, 100) for first in range(0, 2000, 100)])
    assert abs(np.corrcoef(counted[:-100], counted[100:])[0, 1]) < 0.1


def test_a_phase_that_starts_anew_in_each_block_jumps_where_ours_goes_on() -> None:
    drive, times = sine(frequency=9_965_244_293), np.arange(0, 3000) * MS
    naive = np.concatenate([np.sin(2 * np.pi * 9.965244293 * 1e-3 * np.arange(1000)) for _ in range(3)])
    exact = np.sin(2 * np.pi * 9.965244293 * 1e-9 * times)
    assert np.abs(naive - exact).max() > 0.02
    blocks = np.concatenate([drive.at(times[i : i + 1000]) for i in range(0, 3000, 1000)])
    assert np.abs(blocks - exact).max() < 1e-12


# --- numbers that are none -----------------------------------------------------------------------------


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_what_is_not_finite_is_refused_where_comparisons_let_it_pass(wrong: float) -> None:
    assert not math.nan > 5.0  # "over the limit?" - "no"
    with np.errstate(invalid="ignore"):
        assert np.isnan(scipy.signal.lfilter([0.1], [1, -0.9], [1.0, math.nan, *np.ones(500)])[-1])  # for ever
    with pytest.raises(ValueError, match="is not a quantity"):
        ChargeAmplifier.model_validate({"time_constant": f"{wrong} s"})
    with pytest.raises(RangeError):
        SENSOR_NODE.encode("sync_period", wrong)
    with pytest.raises(EstimateError, match="1 in channel 0"):
        fit_sine(np.arange(100) * 1e-3, np.append(np.ones(99), wrong)[np.newaxis], 10.0)


# --- mechanics -----------------------------------------------------------------------------------------


def chain_path(plays: Plays, limits: Limits, volts: float, *, moving: bool) -> tuple[MeasuringChain, Path]:
    armature = Armature(4.0, 3.5, 1000.0)
    if moving:
        armature = Armature(4.0, 3.5, 1000.0, 1e-4, 0.03, 2.0)
    films = gain(np.array([[1.0, 0.0, 1.0, 0.0]]))
    stack = SpringStack(120.0, 380.0, 0.4).elastic()
    chain = MeasuringChain(armature, limits, stack, 4e-3, plays, films, [gain(np.eye(1))], np.zeros(1), 0.1, 0.0)
    mode = chain.mode(Touch(drag=(0,) * chain.plays))
    drive = sine(volts)
    return chain, Path((drive, constant(1.0, drive), drive.derivative()), mode, 0, np.zeros(mode.system.order))


def test_a_stop_of_1e6_newtons_a_metre_throws_a_fixed_step_out_of_the_room_and_the_armature_back() -> None:
    """Against Runge-Kutta at 1 ms; that ours is right to 1e-8 is shown in test_chain."""

    def slope(t: float, z: Floats) -> Floats:
        i, x, v = z
        stop = 1e6 * (x - math.copysign(1e-3, x)) if abs(x) > 1e-3 else 0.0
        pressed = 500 * max(x + 4e-3, 0.0)
        rate = (3 * math.sin(20 * math.pi * t) - 3.5 * i - 4 * v) / 1e-4
        return np.array([rate, v, (4 * i - 2 * v - 1000 * x - pressed - stop) / 0.03])

    z, h = np.zeros(3), 1e-3
    with np.errstate(all="ignore"):
        for n in range(30):
            k1 = slope(n * h, z)
            k2 = slope((n + 0.5) * h, z + h / 2 * k1)
            k3 = slope((n + 0.5) * h, z + h / 2 * k2)
            z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + slope((n + 1) * h, z + h * k3))
    assert not abs(z[1]) < 1.0  # m
    chain, path = chain_path(Plays(False, (), ()), Limits(stop=1e-3), 3.0, moving=True)
    x = path.outputs(np.arange(0, 200) * MS, slice(chain.displacement, chain.displacement + 1))[0]
    assert np.abs(x).max() < 1.05e-3


def test_plays_at_100_samples_a_cycle_are_those_of_any_rate_where_their_rates_summed_are_not() -> None:
    """z' = x' while dragged, by Euler at 100 steps a cycle, drifts past the operator's own values."""
    radius = 0.05
    plays = Plays(False, (radius,), (1.0,))
    _, path = chain_path(plays, Limits(), 2.0, moving=False)
    coarse = path.outputs(np.arange(0, 300) * MS, slice(0, 1))[0]
    _, again = chain_path(plays, Limits(), 2.0, moving=False)
    fine = again.outputs(np.arange(0, 300 * 200) * (MS // 200), slice(0, 1))[0]
    assert fine[::200].tobytes() == coarse.tobytes()
    t = np.arange(0, 300) * 1e-3
    x = 120 * (4e-3 + (4 / 3.5 * 2 * np.sin(20 * np.pi * t) - 500 * 4e-3) / 1500)
    rate = np.gradient(x, t)
    z, naive = x[0] - radius, [x[0] - radius]
    for k in range(299):
        dragged = abs(x[k] - z) >= radius and rate[k] * (x[k] - z) > 0
        z += 1e-3 * rate[k] if dragged else 0.0
        naive.append(z)
    assert np.abs(coarse - (x + naive)).max() > 0.05 * radius
    assert np.abs((coarse - x) - x).max() <= radius * (1 + 1e-8)


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


def test_exactly_at_resonance_the_amplitude_is_the_quality_factor_where_the_trapezoid_is_beside_it() -> None:
    """Q = 1e5 at 10 Hz: 200 steps a cycle detune the trapezoid by 800 bandwidths and more."""
    w, quality = 20 * math.pi, 1e5
    a = np.array([[0.0, 1.0], [-(w**2), -w / quality]])
    system = StateSpace(a, np.array([[0.0], [w**2]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    assert abs(system.transfer(10.0)[0, 0]) == pytest.approx(quality, rel=1e-9)
    h = 0.1 / 200
    s = 2 / h * 1j * math.tan(w * h / 2)  # what the trapezoid takes for i w
    assert abs(w**2 / (s**2 + s * w / quality + w**2)) < 0.2 * quality
    # From rest, after a hundredth of its time to settle: the envelope 1 - exp(-w t / 2 Q).
    times = 31 * SECOND + np.arange(0, 100) * MS
    x = system.drive((sine(),)).trace((system.c, system.d), 0, np.zeros(2)).at(times)[0]
    envelope = quality * -math.expm1(-w * 31.05 / (2 * quality))
    assert np.abs(x).max() == pytest.approx(envelope, rel=3e-3)


def test_forces_come_back_from_crosstalk_that_a_matrix_without_limit_makes_singular() -> None:
    """Twenty films that all hear each other by 99.9999999999 % cannot be told apart; ours stay dominant."""
    forces = np.linspace(0.5, 3.0, 20)
    naive = np.full((20, 20), 1 - 1e-12) + 1e-12 * np.eye(20)
    heard = (naive @ forces).astype(np.float32)  # single precision on the wire
    assert np.abs(np.linalg.solve(naive, heard) - forces).max() > 1.0
    design = get_design("array")
    films = np.array([film.sensitivity for film in design.films])
    matrix = Crosstalk(compliant=0.24).matrix(design, Stream(1, "crosstalk"), 0)
    forces = np.linspace(0.5, 3.0, len(films))
    heard = (matrix @ (films * forces)).astype(np.float32)
    assert np.abs(np.linalg.solve(matrix, heard) / films - forces).max() < 1e-4
    with pytest.raises(ValueError, match=r"0\.24"):
        Crosstalk(compliant=0.3)
