"""The sine fit: exact where it can be, as good as the Cramér–Rao bound where not, beside others, on long records."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from random import Random

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError, UnknownName
from palpate.instrument.signals import estimate
from palpate.instrument.signals.estimate import (
    CONDITION_LIMIT,
    ESTIMATORS,
    LEAST_SQUARES,
    SEGMENT,
    SineFit,
    amplitude_ratios,
    amplitudes,
    fit_pieces,
    fit_sine,
    ratio_bound,
)
from tests.chance import amplitude_ratio
from tests.shares import first_of

FREQUENCY = 10.0
RATE = 1000.0
REPEATS = 2500


def times(cycles: float, start: float = 0.0) -> Floats:
    return start + np.arange(round(cycles * RATE / FREQUENCY)) / RATE


def unsure(cycles: float) -> float:
    """By how much a record that cannot tell white from 1/f noise overstates the power of white noise at most."""
    return 1.1 if cycles >= 10 else 1.7


def tone(time: Floats, amplitude: float = 1.0, phase: float = 0.0) -> Floats:
    return amplitude * np.cos(2 * np.pi * FREQUENCY * time + phase)


def columns(time: Floats) -> Floats:
    """Cosine, sine, offset and trend as anybody would write them down."""
    angle = 2 * np.pi * FREQUENCY * time
    return np.stack([np.cos(angle), np.sin(angle), np.ones_like(time), time], axis=1)


def cramer_rao(time: Floats, sigma: Floats, amplitude: Floats, phase: float) -> float:
    """Cramér–Rao bound of u_R/R for independent noise: both amplitudes, offset and trend unknown."""
    design = columns(time - time.mean())
    covariance = np.linalg.inv(design.T @ design)[:2, :2]
    at_mean = 2 * np.pi * FREQUENCY * time.mean() + phase
    gradient = np.array([math.cos(at_mean), -math.sin(at_mean)])
    return math.sqrt(float(gradient @ covariance @ gradient) * float(((sigma / amplitude) ** 2).sum()))


def ratios(
    time: Floats, sigma: Floats, amplitude: Floats, phase: Floats, correlation: float = 0.0
) -> tuple[Floats, Floats]:
    """(REPEATS,) ratios and their uncertainties, from pairs of channels with fresh noise; 20 pairs a fit."""
    pairs = 20
    rng = np.random.default_rng(19)
    clean = np.stack([tone(time, amplitude[i], phase[i]) for i in (0, 1)])
    found: list[tuple[float, float]] = []
    for _ in range(REPEATS // pairs):
        first, other = rng.normal(size=(2, pairs, time.size))
        second = correlation * first + math.sqrt(1 - correlation**2) * other
        noise = np.stack([first, second], axis=1) * sigma[:, np.newaxis]
        fit = fit_sine(time, (clean + noise).reshape(2 * pairs, time.size), FREQUENCY)
        found += [amplitude_ratio(fit, 2 * i, 2 * i + 1) for i in range(pairs)]
    values, uncertainties = np.array(found).T
    return values, uncertainties


@pytest.mark.parametrize("seed", range(8))
def test_amplitude_phase_offset_and_trend_are_recovered(seed: int) -> None:
    draw = Random(seed)
    phase = draw.choice([-math.pi, 0.0, draw.uniform(-math.pi, math.pi)])
    offset, trend, start = (draw.uniform(-100.0, 100.0) for _ in range(3))
    time = times(draw.choice([1.0, 20.0, draw.uniform(1.0, 20.0)]), start)
    middle = 0.5 * (time[0] + time[-1])
    first = tone(time, 0.3, phase) + offset + trend * (time - middle)
    fit = fit_sine(time, np.stack([first, tone(time, 2.0, 1.0)]), FREQUENCY)
    assert fit.amplitude == pytest.approx([0.3, 2.0], abs=1e-9)
    assert np.remainder(fit.phase - [phase, 1.0] + math.pi, 2 * math.pi) == pytest.approx([math.pi] * 2, abs=1e-8)
    assert np.all(np.abs(fit.phase) <= math.pi)
    assert fit.offset == pytest.approx([offset, 0.0], abs=1e-9)
    assert fit.trend == pytest.approx([trend, 0.0], abs=1e-7)
    assert fit.samples == time.size


@pytest.mark.parametrize(("factor", "phase"), [(1e-9, -math.pi), (0.37, 1.3), (1e9, math.pi)])
def test_a_change_of_unit_scales_the_amplitudes_and_nothing_else(factor: float, phase: float) -> None:
    time = times(2.3)
    noise = np.random.default_rng(3).normal(scale=0.1, size=(2, time.size))
    signals = np.stack([tone(time, 1.0, phase), 5 + tone(time, 0.2)]) + noise
    plain, scaled = fit_sine(time, signals, FREQUENCY), fit_sine(time, factor * signals, FREQUENCY)
    for name in ("amplitude", "amplitude_u", "offset", "trend", "noise"):
        assert getattr(scaled, name) == pytest.approx(factor * getattr(plain, name), rel=1e-9), name
    assert scaled.rapid.rms == pytest.approx(factor * plain.rapid.rms, rel=1e-9)
    assert np.exp(1j * scaled.phase) == pytest.approx(np.exp(1j * plain.phase), abs=1e-9)
    assert scaled.correlation == pytest.approx(plain.correlation, abs=1e-9)
    assert scaled.condition == plain.condition


def test_dropped_samples_leave_the_estimate_unbiased() -> None:
    time = np.concatenate([times(2), times(3, start=60.0)])
    fit = fit_sine(time, [tone(time, 0.7, 0.4) + 3], FREQUENCY)
    assert fit.amplitude[0] == pytest.approx(0.7, abs=1e-12)
    assert fit.phase[0] == pytest.approx(0.4, abs=1e-12)


def test_eight_uneven_samples_state_the_spread_that_they_have() -> None:
    time = np.array([0.0, 0.003, 0.01, 0.018, 0.025, 0.06, 0.11, 0.19])
    noise = np.random.default_rng(4).normal(scale=1e-3, size=(400, time.size))
    fit = fit_sine(time, tone(time, 1.0, 0.7) + noise, FREQUENCY)
    assert np.mean(fit.rapid.rms**2) == pytest.approx(1e-6, rel=0.1)
    assert np.mean(fit.amplitude_u**2) == pytest.approx(fit.amplitude.var(), rel=0.15)


@pytest.mark.parametrize(("relative", "cycles"), first_of([(0.3, 1.25), (0.03, 1.0), (0.003, 10.0)]))
def test_the_ratio_reaches_the_cramer_rao_bound_and_says_so(relative: float, cycles: float) -> None:
    time, amplitude, phase = times(cycles), np.array([0.3, 1.0]), 0.8
    sigma = relative * amplitude
    values, uncertainties = ratios(time, sigma, amplitude, np.array([phase, phase]))
    bound = 0.3 * cramer_rao(time, sigma, amplitude, phase)
    assert values.var() <= 1.1 * bound**2
    assert 0.9 * values.var() <= np.mean(uncertainties**2) <= unsure(cycles) * values.var()


def test_the_ratio_is_biased_by_less_than_a_tenth_of_its_uncertainty() -> None:
    amplitude = np.array([0.3, 1.0])
    values, uncertainties = ratios(times(10), 0.03 * amplitude, amplitude, np.array([0.2, 0.2]))
    assert abs(values.mean() - 0.3) < 0.1 * uncertainties.mean()


def test_a_weak_numerator_is_not_taken_for_more_than_it_is() -> None:
    """An amplitude is a length: noise of a third of it makes it 5.7 % longer in the mean."""
    time = times(10)
    sigma = np.array([0.01, 1e-3]) / math.sqrt(2 / time.size)
    values, _ = ratios(time, sigma, np.array([0.03, 1.0]), np.array([0.2, 0.2]))
    assert values.mean() == pytest.approx(0.03, abs=3 * values.std() / math.sqrt(REPEATS))


@pytest.mark.parametrize(("phase", "cycles"), first_of([(0.8, 1.0), (0.0, 1.25), (0.8, 10.0)]))
def test_noise_common_to_both_channels_cancels_as_far_as_they_move_together(phase: float, cycles: float) -> None:
    amplitude = np.array([1.0, 1.0])
    values, uncertainties = ratios(times(cycles), 0.03 * amplitude, amplitude, np.array([0.0, phase]), correlation=0.95)
    assert 0.95 * values.std() <= uncertainties.mean() <= unsure(cycles) ** 0.5 * values.std()


def test_a_late_short_record_on_an_offset_of_1e8_survives_where_normal_equations_lose_it() -> None:
    time = times(0.4, start=1e4)
    signal = tone(time, 1.0, 0.5) + 1e8
    fit = fit_sine(time, [signal], FREQUENCY)
    assert fit.amplitude[0] == pytest.approx(1.0, abs=1e-6)
    assert fit.phase[0] == pytest.approx(0.5, abs=1e-6)
    plain = columns(time)
    naive = np.linalg.lstsq(plain.T @ plain, plain.T @ signal, rcond=0)[0]
    assert abs(math.hypot(naive[0], naive[1]) - 1.0) > 1.0


def test_a_noiseless_and_a_dead_channel_have_a_defined_correlation() -> None:
    time = times(2)
    fit = fit_sine(time, np.stack([np.zeros_like(time), tone(time)]), FREQUENCY)
    assert fit.correlation == pytest.approx(np.eye(2))
    assert fit.amplitude[0] == fit.amplitude_u[0] == fit.rapid.rms[0] == 0.0


def test_a_third_of_a_cycle_is_accepted_with_its_price_in_the_uncertainty() -> None:
    short, whole = times(0.3), times(1)
    rng = np.random.default_rng(5)
    phase = -2 * math.pi * FREQUENCY * float(short.mean()) + math.pi / 2  # all sine: the worst case
    fits = [
        fit_sine(short, tone(short, 1.0, phase) + rng.normal(scale=1e-4, size=(40, short.size)), FREQUENCY)
        for _ in range(50)
    ]
    assert fits[0].condition < CONDITION_LIMIT
    spread = float(np.concatenate([fit.amplitude for fit in fits]).std())
    stated = float(np.concatenate([fit.amplitude_u for fit in fits]).mean())
    assert 0.9 * spread <= stated <= unsure(0.3) ** 0.5 * spread
    assert stated > 30 * 1e-4 * math.sqrt(2 / whole.size)


def test_samples_that_are_not_finite_are_counted_by_channel() -> None:
    signals = np.stack([tone(times(1))] * 3)
    signals[1, [3, 4, 9]] = np.nan
    signals[2, 7] = np.inf
    with pytest.raises(EstimateError, match=r"of 100 samples a channel are not finite: 3 in channel 1, 1 in channel 2"):
        fit_sine(times(1), signals, FREQUENCY)


@pytest.mark.parametrize(
    ("time", "signals", "frequency", "message"),
    [
        (np.arange(4) / 40, np.zeros((1, 4)), 10.0, "4 samples cannot give 4 coefficients .* at least 5"),
        (times(1), np.zeros((1, 99)), 10.0, r"time has shape \(100,\) and signals \(1, 99\)"),
        (times(1), np.zeros(100), 10.0, r"signals \(100,\); they must be \(n,\) and \(channels, n\)"),
        (times(1), np.zeros((0, 100)), 10.0, r"signals \(0, 100\)"),
        (np.zeros((1, 10)), np.zeros((2, 10)), 10.0, r"time has shape \(1, 10\)"),
        (times(1)[::-1], np.zeros((1, 100)), 10.0, "sample 1 at 0.098 s follows 0.099 s; sort"),
        (np.repeat(times(0.5), 2), np.zeros((1, 100)), 10.0, "sample 1 at 0.0 s follows 0.0 s"),
        (np.append(times(1)[:-1], np.nan), np.zeros((1, 100)), 10.0, "1 of 100 times are not finite"),
        (times(1), np.zeros((1, 100)), 501.0, "501 Hz lies above half the sample rate of 1000 Hz"),
        (times(1), np.zeros((1, 100)), 0.0, r"frequency 0\.0 Hz must be positive"),
        (times(1), np.zeros((1, 100)), -10.0, r"frequency -10\.0 Hz must be positive"),
        (times(1), np.zeros((1, 100)), math.nan, "frequency nan Hz must be positive"),
        (times(1), np.zeros((1, 100)), math.inf, "inf Hz lies above half the sample rate"),
        (times(0.26), [tone(times(0.26))], 10.0, r"condition number 1\d\d, limit 100; record a whole cycle"),
        (np.arange(100) / 20, np.ones((1, 100)), 10.0, "condition number"),  # a cosine at its zeros
    ],
)
def test_a_record_that_does_not_determine_the_sine_is_refused(
    time: Floats, signals: Floats, frequency: float, message: str
) -> None:
    with pytest.raises(EstimateError, match=message):
        fit_sine(time, signals, frequency)


# --- Estimators side by side: what each is right about, and how far each is off where it is not --------

SLOW_RATE = 250.0
AMPLITUDE, PHASE = np.array([0.3, 1.0]), np.array([0.7, 0.7])
BIASED = ("RMS", "peak to peak")


def slow_times(duration: float) -> Floats:
    return np.arange(round(duration * SLOW_RATE)) / SLOW_RATE


def clean(time: Floats) -> Floats:
    return AMPLITUDE[:, np.newaxis] * np.cos(2 * np.pi * FREQUENCY * time + PHASE[:, np.newaxis])


def noisy(time: Floats, relative: float, repeats: int = 2000) -> Floats:
    noise = np.random.default_rng(5).normal(size=(repeats, 2, time.size))
    return clean(time) + relative * AMPLITUDE[:, np.newaxis] * noise


@pytest.mark.parametrize("name", ESTIMATORS)
def test_over_whole_cycles_without_noise_all_agree(name: str) -> None:
    time = slow_times(1.0)
    found = amplitude_ratios(name, time, clean(time)[np.newaxis], FREQUENCY)
    assert found == pytest.approx([0.3], rel=1e-12)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_efficiencies_at_ten_cycles_are_those_that_theory_says(name: str) -> None:
    """Theory says, over the bound: 1 but for the trend, 2/3 by a Hann window, 1 by the rms, nearly 0 by peaks."""
    time, relative = slow_times(1.0), 0.03
    ratios = amplitude_ratios(name, time, noisy(time, relative), FREQUENCY)
    bound = 0.3 * ratio_bound(time, FREQUENCY, AMPLITUDE, PHASE, relative * AMPLITUDE)
    expected = {LEAST_SQUARES: 1.0, "lock-in boxcar": 1.0, "lock-in Hann": 2 / 3, "RMS": 1.0, "peak to peak": 0.06}
    assert bound**2 / ratios.var() == pytest.approx(expected[name], rel=0.1, abs=0.03)


def test_a_boxcar_is_off_where_cycles_are_not_whole_and_least_squares_is_not() -> None:
    time = slow_times(0.125)
    off = {name: abs(float(f(time, clean(time), FREQUENCY)[1]) - 1) for name, f in ESTIMATORS.items()}
    assert off[LEAST_SQUARES] < 1e-12
    assert off["lock-in boxcar"] > 0.05


@pytest.mark.parametrize("name", ESTIMATORS)
def test_hum_harms_those_that_take_all_for_signal(name: str) -> None:
    time = slow_times(1.0)
    records = clean(time) + 0.3 * np.sin(2 * np.pi * 50 * time)
    found = float(amplitude_ratios(name, time, records[np.newaxis], FREQUENCY)[0])
    if name in BIASED:
        assert found > 1.3 * 0.3
    else:
        assert found == pytest.approx(0.3, rel=1e-3)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_noise_biases_what_counts_it_as_signal(name: str) -> None:
    time = slow_times(1.0)
    records = clean(time) + 0.1 * np.random.default_rng(6).normal(size=(500, 2, time.size))
    bias = float(amplitude_ratios(name, time, records, FREQUENCY).mean()) / 0.3 - 1
    assert bias > 0.05 if name in BIASED else abs(bias) < 0.01


def test_the_bound_is_the_textbooks_over_many_cycles_and_more_over_one() -> None:
    sigma, rho = np.array([0.01, 0.05]), 0.6
    relative = sigma / AMPLITUDE

    def textbook(time: Floats) -> float:
        return math.sqrt(2 / time.size * float((relative**2).sum() - 2 * rho * relative.prod()))

    long, short = slow_times(10.0), slow_times(0.1)
    assert ratio_bound(long, FREQUENCY, AMPLITUDE, PHASE, sigma, rho) == pytest.approx(textbook(long), rel=1e-3)
    costs = [
        ratio_bound(short, FREQUENCY, AMPLITUDE, np.full(2, phase), sigma, rho) / textbook(short)
        for phase in np.linspace(0, math.pi, 40)
    ]
    assert min(costs) == pytest.approx(1.0, abs=0.01) and max(costs) == pytest.approx(1.6, abs=0.1)


def test_the_bound_is_what_the_fit_says_of_itself() -> None:
    time = slow_times(0.5)
    records = noisy(time, 0.03, repeats=1)[0]
    fit = fit_sine(time, records, FREQUENCY)
    bound = ratio_bound(time, FREQUENCY, fit.amplitude, fit.phase, fit.noise)
    assert bound == pytest.approx(float(np.hypot(*(fit.amplitude_u / fit.amplitude))), rel=1e-12)


def test_many_records_at_once_are_fitted_as_each_alone() -> None:
    time = slow_times(0.7)
    records = noisy(time, 0.1, repeats=3).reshape(6, time.size) + 1e3
    alone = [float(fit_sine(time, record[np.newaxis], FREQUENCY).amplitude[0]) for record in records]
    assert amplitudes(time, records, FREQUENCY) == pytest.approx(alone, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "records", "error", "message"),
    [
        (
            "lock-in han",
            np.ones((1, 2, 250)),
            UnknownName,
            "estimator 'lock-in han' .did you mean 'lock-in Hann'",
        ),
        ("RMS", np.zeros((1, 2, 250)), EstimateError, "second channel is silent"),
        (LEAST_SQUARES, np.ones((1, 2, 6)), EstimateError, r"shorter than 0\.25 cycle"),
    ],
)
def test_what_is_unknown_or_silent_is_refused(name: str, records: Floats, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        amplitude_ratios(name, slow_times(1.0)[: records.shape[2]], records, FREQUENCY)


# --- A long record is fitted by sums over its pieces; the same samples give the same fit by one factorization

COUNT, LONG = 40_000, 30_000  # samples; what counts as long here, so that the factorization is quick


def record(frequency: float, hum: float) -> tuple[Floats, Floats]:
    """Times (n,) and signals (2, n) on a great offset, with a trend, and hum beside the mains' rated frequency."""
    t = np.arange(1, COUNT + 1) / RATE
    noise = 1e-3 * np.random.default_rng(5).standard_normal((2, COUNT))
    drive = np.outer([0.3, 1e-3], np.cos(2 * np.pi * frequency * t + 0.4))
    return t, 2.0 + 1e-4 * t + drive + hum * np.cos(2 * np.pi * 50.013 * t + 1) + noise


def fitted(
    t: Floats,
    y: Floats,
    frequency: float,
    longest: int,
    monkeypatch: pytest.MonkeyPatch,
) -> SineFit:
    """The fit if so many samples are the most that are factored at once."""
    with monkeypatch.context() as patched:
        patched.setattr(estimate, "LONGEST_FACTORED", longest)
        return fit_sine(t, y, frequency)


@pytest.mark.parametrize(
    ("frequency", "hum", "mains"),
    [
        (10.0, 0.0, (50.0, 60.0)),
        (10.0, 0.02, (50.013, 60.0)),
        (50.0, 0.02, (60.0,)),  # the columns of 50 Hz are those of the drive
        (0.03, 0.0, (50.0, 60.0)),  # 1.2 cycles
    ],
)
def test_sums_give_the_fit_that_one_factorization_gives(
    frequency: float, hum: float, mains: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    t, y = record(frequency, hum)
    kept = np.ones(COUNT, bool)
    kept[20_000:20_100] = False  # bad samples that were left out
    by_sums, by_qr = (fitted(t[kept], y[:, kept], frequency, longest, monkeypatch) for longest in (LONG, COUNT))
    assert by_sums.mains == pytest.approx(mains, abs=1e-4)
    assert by_sums.mains == pytest.approx(by_qr.mains, rel=1e-12)
    for name in ("amplitude", "phase", "offset", "trend", "amplitude_u", "phase_u", "noise", "hum", "most_hum"):
        assert getattr(by_sums, name) == pytest.approx(getattr(by_qr, name), rel=1e-11, abs=1e-14), name
    assert by_sums.condition == pytest.approx(by_qr.condition)
    assert by_sums.rapid.rms == pytest.approx(by_qr.rapid.rms, rel=1e-12)
    assert by_sums.degrees_of_freedom == by_qr.degrees_of_freedom


def test_times_that_do_not_determine_a_sine_are_refused_for_a_long_record_too(monkeypatch: pytest.MonkeyPatch) -> None:
    t, y = record(10.0, 0.0)
    said = []
    for longest in (LONG, COUNT):
        with pytest.raises(
            EstimateError, match=r"do not determine a sine of 500 Hz: condition number [\d.e+]+, limit 100;"
        ) as refused:
            fitted(t, y, 499.99999, longest, monkeypatch)
        said.append(str(refused.value).partition(":")[0])
    assert said[0] == said[1]


# --- a record that is read in pieces, whose noise is told by segments ----------------------------------


def in_parts(t: Floats, y: Floats, size: int) -> Callable[[], Iterator[tuple[Floats, Floats]]]:
    return lambda: ((t[at : at + size], y[:, at : at + size]) for at in range(0, t.size, size))


def test_a_record_in_pieces_has_the_fit_of_the_whole_and_the_noise_of_its_segments() -> None:
    count = 5 * SEGMENT + 1234
    t = np.arange(1, count + 1) / 250.0
    rng = np.random.default_rng(6)
    drift = 1e-7 * np.cumsum(rng.standard_normal((2, count)), axis=1)
    noise = np.linalg.cholesky([[1.0, 0.6], [0.6, 1.0]]) @ rng.standard_normal((2, count))
    hum = 1e-3 * np.cos(2 * np.pi * 50.01 * t)
    y = 1 + np.outer([0.3, 0.2], np.cos(2 * np.pi * 10 * t + 0.4)) + 1e-3 * noise + drift + hum
    pieces, whole = fit_pieces(in_parts(t, y, 1250), 10.0), fit_sine(t, y, 10.0)
    other = fit_pieces(in_parts(t, y, 15_000), 10.0)
    for name in ("amplitude", "phase", "offset", "mains", "noise", "amplitude_u", "degrees_of_freedom"):
        assert getattr(pieces, name) == pytest.approx(getattr(other, name), rel=1e-12), name
        assert getattr(pieces, name) == pytest.approx(getattr(whole, name), rel=1e-12), name
    assert pieces.noise == pytest.approx([1e-3, 1e-3], rel=4 / np.sqrt(2 * pieces.degrees_of_freedom))
    assert pieces.correlation[0, 1] == pytest.approx(0.6, abs=0.01)
    assert 0.9 * count < pieces.degrees_of_freedom < 1.1 * count
    assert pieces.rapid.rms == pytest.approx([1e-3, 1e-3], rel=0.01)


def test_a_record_of_few_samples_in_pieces_is_fitted_as_if_it_were_in_memory() -> None:
    t, y = record(10.0, 0.0)
    t, y = t[:5000], y[:, :5000]
    found, expected = fit_pieces(in_parts(t, y, 999), 10.0), fit_sine(t, y, 10.0)
    assert repr(found) == repr(expected)


@pytest.mark.parametrize(
    ("first", "wrong", "frequency", "message"),
    [
        (30_000, 0.0, 10.0, "time does not increase after 30 s; sort the record"),
        (COUNT, np.inf, 10.0, "a sample after 20 s is not finite"),
        (COUNT, 0.0, 501.0, "above half the sample rate"),
    ],
)
def test_a_record_in_pieces_must_increase_in_time_and_be_finite(
    first: int, wrong: float, frequency: float, message: str
) -> None:
    t, y = record(10.0, 0.0)
    t[first:], y[1, 25_000] = t[: COUNT - first], wrong
    with pytest.raises(EstimateError, match=message):
        fit_pieces(in_parts(t, y, 10_000), frequency)


@pytest.mark.parametrize("frequency", [49.99, 60.005])
def test_beside_the_mains_a_record_in_pieces_leaks_as_much_hum_as_one_in_memory(
    frequency: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    t, y = record(frequency, 0.0)
    pieces, whole = fit_pieces(in_parts(t, y, 7000), frequency), fitted(t, y, frequency, COUNT, monkeypatch)
    assert pieces.mains == whole.mains
    assert whole.most_hum > 0
    for name in ("hum", "most_hum", "hum_u", "amplitude"):
        assert getattr(pieces, name) == pytest.approx(getattr(whole, name), rel=1e-9), name


def test_a_slow_bend_of_a_record_in_pieces_does_not_count_as_noise() -> None:
    t = np.arange(1, 5 * SEGMENT + 1) / 250.0
    noise = 1e-3 * np.random.default_rng(8).standard_normal((1, t.size))
    straight, bent = (
        fit_pieces(in_parts(t, 0.1 * np.cos(20 * np.pi * t) + bend * (t / t[-1]) ** 2 + noise, 5000), 10.0)
        for bend in (0.0, 0.2)
    )
    assert bent.noise == pytest.approx(straight.noise, rel=1e-3)
