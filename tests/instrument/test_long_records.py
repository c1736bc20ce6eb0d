"""A long record is fitted by sums over its pieces; the same samples give the same fit by one factorization."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from palpate.instrument.errors import EstimateError
from palpate.instrument.signals import estimate
from palpate.instrument.signals.estimate import (
    SEGMENT,
    SineFit,
    fit_pieces,
    fit_sine,
)

RATE = 1000.0  # Hz
COUNT, LONG = 40_000, 30_000  # samples; what counts as long here, so that the factorization is quick

Floats = np.ndarray


def record(frequency: float, hum: float) -> tuple[Floats, Floats]:
    """Times (n,) and signals (2, n) on a great offset, with a trend, and hum beside the mains' rated frequency."""
    t = np.arange(1, COUNT + 1) / RATE
    noise = 1e-3 * np.random.default_rng(5).standard_normal((2, COUNT))
    drive = np.outer([0.3, 1e-3], np.cos(2 * np.pi * frequency * t + 0.4))
    return t, 2.0 + 1e-4 * t + drive + hum * np.cos(2 * np.pi * 50.013 * t + 1) + noise


def fitted(t: Floats, y: Floats, frequency: float, longest: int, monkeypatch: pytest.MonkeyPatch) -> SineFit:
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


# --- a record that is read in pieces, whose noise is told by segments ------------------------------------


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


def test_a_record_in_pieces_must_increase_in_time_and_be_finite() -> None:
    t, y = record(10.0, 0.0)
    back = np.concatenate([t[:30_000], t[:10_000]])
    with pytest.raises(EstimateError, match="time does not increase after 30 s; sort the record"):
        fit_pieces(in_parts(back, y, 10_000), 10.0)
    y[1, 25_000] = np.inf
    with pytest.raises(EstimateError, match="a sample after 20 s is not finite"):
        fit_pieces(in_parts(t, y, 10_000), 10.0)
    with pytest.raises(EstimateError, match="above half the sample rate"):
        fit_pieces(in_parts(t, np.ones((2, t.size)), 10_000), 501.0)


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
