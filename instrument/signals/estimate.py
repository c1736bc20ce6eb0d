"""Amplitude and phase of a sine of known frequency, in all channels at once, with standard uncertainty.

The sine is fitted by least squares with its frequency known (IEEE 1057, three parameters). Two more terms are fitted
with it. One is a linear trend, because a PVDF film is pyroelectric and drifts with temperature [S]. The other is the
mains' hum, because over few cycles the trend would follow the hum and change the fitted drive. Time and signals are
centred and the columns scaled before one QR factorization. Normal equations of the plain columns would square the
condition number and lose the amplitude beneath a large offset. Only for long records, over which the scaled columns are
nearly orthogonal, normal equations of these are summed in pieces (`long_fit`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError, UnknownName
from palpate.instrument.signals.hum import humming, tuned, tuned_to
from palpate.instrument.signals.long_fit import Pieces, RecordInPieces, in_pieces, joined
from palpate.instrument.signals.noise import MAINS, EquivalentNoise, noise_at
from palpate.instrument.signals.noise_parts import short_noise
from palpate.instrument.signals.rapid_noise import RapidNoise, rapid_noise
from palpate.instrument.signals.sine_columns import COEFFICIENTS, WANDER, SineColumns, correlated, sine_columns

Some = TypeVar("Some", float, Floats)

SHORTEST_RECORD = 0.25
"""Shortest record [cycles].

In a shorter one sine and cosine cannot be told from offset and trend: the amplitude scatters by 0.8 of itself, as
trials showed.
"""
FEW_DEGREES = 50.0
"""Degrees of freedom below which noise is known to no better than a tenth of itself.

A record with so few is too short to tell white from 1/f noise. Where noise prevails, its intervals may be a fifth wider
than they need to be.
"""
LONGEST_FACTORED, FEW_SAMPLES = 1 << 17, 1 << 14
"""Most samples of a record in memory, and of one that is read in pieces, for which the columns are factored."""
LEAST_SHARE = 1e-3  # share of an uncertainty; a smaller part of it by noise does not count for the degrees of freedom


@dataclass(frozen=True, slots=True, eq=False)
class SineFit:
    """Fit of a sine in each channel. Where a stack of records was fitted, arrays have one axis more, in front.

    `signal = offset + trend·(t − middle of the record) + amplitude·cos(2π·frequency·t + phase)`

    Args:
        frequency: Hz, as given.
        amplitude: (channels,) V, not negative.
        phase: (channels,) rad, −π to π, at time zero of the record's own time axis.
        offset: (channels,) V, at the middle of the record.
        trend: (channels,) V/s.
        amplitude_u: (channels,) V, standard uncertainty from `noise` and `hum_u`, with `degrees_of_freedom`. It holds
            neither a gain's uncertainty nor pick-up in step with the drive. It is linear, so it holds for amplitudes
            well above it.
        phase_u: (channels,) rad, standard uncertainty from `noise` and `hum_u`; infinite where the amplitude is zero.
        amplitude_bias: (channels,) V, mean error that noise adds to an amplitude, because an amplitude is the length of
            a vector.
        hum_u: (channels,) V, standard uncertainty of an amplitude by hum that was fitted, but whose frequency so short
            a record does not tell.
        rapid: the residuals about a line through each cycle [V] (see `rapid_noise`). Hum that was not fitted is in it.
        noise: (channels,) V, standard deviation of one sample of white noise that has the density of the noise around
            the drive (see `noise_at`).
        correlation: (channels, channels), correlation of the noise.
        degrees_of_freedom: degrees of freedom of `amplitude_u`; (records,) of a stack.
        amplitude_correlation, phase_correlation: (channels, channels), correlations of the errors of `amplitude` and of
            `phase`.
        condition: condition number of the scaled columns; 1 is the least.
        hum: what 1 V of mains hum that was not fitted may add to an amplitude, at its worst phase [V]; 0 where hum was
            fitted.
        most_hum: the same, together with what the wandering frequency of fitted hum may add [V].
        mains: frequencies of the mains as they were fitted [Hz].
        samples: number of samples in each channel.
        rate: samples a second.
    """

    frequency: float
    amplitude: Floats
    phase: Floats
    offset: Floats
    trend: Floats
    amplitude_u: Floats
    phase_u: Floats
    amplitude_bias: Floats
    hum_u: Floats
    rapid: RapidNoise
    noise: Floats
    correlation: Floats
    degrees_of_freedom: float
    amplitude_correlation: Floats
    phase_correlation: Floats
    condition: float
    hum: float
    most_hum: float
    mains: tuple[float, ...]
    samples: int
    rate: float

    @property
    def beside_mains(self) -> bool:
        """Whether the mains turn by less than one turn against the drive in the record."""
        beat = min(abs(self.frequency - mains) for mains in (*MAINS, *self.mains))
        return beat * self.samples < self.rate or any(abs(self.frequency - mains) < WANDER for mains in MAINS)

    @property
    def unbiased(self) -> Floats:
        """`amplitude` (channels,) less `amplitude_bias` [V]."""
        unbiased: Floats = self.amplitude - self.amplitude_bias
        return unbiased


def fit_sine(time: npt.ArrayLike, signals: npt.ArrayLike, frequency: float) -> SineFit:
    """Fit a sine of known frequency, offset, trend and hum to every channel by least squares.

    Args:
        time: (n,) s, increasing; even spacing is not needed.
        signals: (channels, n) V.
        frequency: Hz.

    Raises:
        EstimateError: the shapes do not match, there are fewer than 5 samples, a sample or time is not finite, time
            does not increase, the frequency is not positive or is above half the sample rate (of the median step), the
            record is shorter than a quarter cycle, or the condition number is above 100.
    """
    t = np.asarray(time, dtype=np.float64)
    y = np.asarray(signals, dtype=np.float64)
    _check_samples(t, y)
    step = _check_frequency(t, frequency)
    if t.size > LONGEST_FACTORED:
        return fit_pieces(in_pieces(t, y), frequency)
    basis = sine_columns(t, frequency)
    level = y.mean(axis=-1, keepdims=True)
    basis, scaled = tuned(basis, y - level, basis.solve(y - level))
    fit = _fitted(basis, t, level, y - level, scaled, step)
    return replace(fit, degrees_of_freedom=float(fit.degrees_of_freedom))


def fit_pieces(pieces: Pieces, frequency: float) -> SineFit:
    """The same fit to a record that is read in pieces, again and again, and is never in memory as a whole.

    The noise is the mean of that of segments. Arguments and errors otherwise as `fit_sine`.
    """
    record = RecordInPieces.of(pieces)
    if record.samples <= FEW_SAMPLES:
        return fit_sine(*joined(pieces()), frequency)
    _check_step(record.step, record.last - record.first, frequency)
    basis, scaled = tuned_to(record, *_rated(record, frequency))
    around, rapid = record.noise(basis, scaled)
    fit = _told(basis, record.level, scaled, around, rapid, record.samples, record.step)
    return replace(fit, degrees_of_freedom=float(fit.degrees_of_freedom))


def _rated(record: RecordInPieces, frequency: float) -> tuple[SineColumns, Floats]:
    """Columns with the mains at their rated frequencies, and the coefficients of a fit with them."""
    basis = record.columns(frequency)
    return record.at(basis, basis.mains)


def fit_sines(time: Floats, stack: Floats, frequency: float) -> tuple[SineFit, npt.NDArray[np.bool_]]:
    """Fit each record (channels, n) of a stack (records, channels, n), to the last bit as `fit_sine` fits it alone.

    The records must be finite. Arithmetic depends on neither the number of records nor their places, because numpy and
    BLAS treat the matrices of a stack one by one.

    Returns:
        The fits, and which records they hold for. In the others the mains may have another frequency than the rated
        one, so that each must be fitted alone.

    Raises:
        EstimateError: as in `fit_sine`, for the times and the frequency.
    """
    _check_samples(time, stack[0])
    step = _check_frequency(time, frequency)
    basis = sine_columns(time, frequency)
    level = stack.mean(axis=-1, keepdims=True)
    centred = stack - level
    scaled = basis.solve(centred)
    return _fitted(basis, time, level, centred, scaled, step), ~humming(basis, centred, scaled)


def _fitted(basis: SineColumns, time: Floats, level: Floats, centred: Floats, scaled: Floats, step: float) -> SineFit:
    """Fit of a record (channels, n) or of a stack of them, of which `centred` is what is left about the `level`."""
    residuals, spent = centred - basis.fitted(scaled), basis.scale.size
    around = _noise_around(basis, residuals, step, spent)
    rapid = rapid_noise(time, residuals, 1 / (basis.frequency * step), spent)
    return _told(basis, level[..., 0], scaled, around, rapid, time.size, step)


def _told(
    basis: SineColumns,
    level: Floats,
    scaled: Floats,
    around: EquivalentNoise,
    rapid: RapidNoise,
    samples: int,
    step: float,
) -> SineFit:
    """The fit that coefficients and noise tell. `level`: (..., channels) V, what was taken off the signals."""
    frequency = basis.frequency
    a, b, offset, trend = np.moveaxis(scaled[..., :COEFFICIENTS, :] * basis.scale[:COEFFICIENTS, np.newaxis], -2, 0)
    at_middle = np.arctan2(-b, a)
    along, across = basis.direction(at_middle), basis.direction(at_middle + np.pi / 2)
    amplitude, hum_u = np.hypot(a, b), _wandering(basis, scaled)
    noise_u, across_u = (around.sigma * np.linalg.norm(each, axis=-2) for each in (along, across))
    amplitude_u, turned_u = np.hypot(noise_u, hum_u), np.hypot(across_u, hum_u)
    of_noise, turned_by_noise = (
        np.divide(part, whole, out=np.ones_like(part), where=whole > 0)
        for part, whole in ((noise_u, amplitude_u), (across_u, turned_u))
    )
    turns = math.remainder(frequency * basis.middle, 1.0)
    freedom = np.asarray(around.degrees_of_freedom)[..., np.newaxis] / np.maximum(of_noise, LEAST_SHARE) ** 4
    return SineFit(
        frequency=float(frequency),
        amplitude=amplitude,
        phase=np.remainder(at_middle - 2 * np.pi * turns + np.pi, 2 * np.pi) - np.pi,
        offset=level + offset,
        trend=trend,
        amplitude_u=amplitude_u,
        phase_u=np.divide(turned_u, amplitude, out=np.full_like(amplitude, np.inf), where=amplitude > 0),
        amplitude_bias=amplitude - np.sqrt(np.maximum(amplitude**2 - across_u**2, 0.0)),
        hum_u=hum_u,
        rapid=rapid,
        noise=around.sigma,
        correlation=around.correlation,
        degrees_of_freedom=freedom.min(axis=-1),
        amplitude_correlation=correlated(around.correlation, along, of_noise),
        phase_correlation=correlated(around.correlation, across, turned_by_noise),
        condition=basis.condition,
        hum=basis.hum,
        most_hum=max((basis.hum, *basis.strays)),
        mains=basis.mains,
        samples=samples,
        rate=1 / step,
    )


def _noise_around(basis: SineColumns, residuals: Floats, step: float, spent: int) -> EquivalentNoise:
    found = short_noise(basis, residuals, step)
    if found is not None and found[1].all():
        return found[0]
    longer = noise_at(basis.frequency, residuals, step, spent)
    return longer if found is None else found[0].where(found[1], longer)


def amplitudes(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Amplitudes (channels,) [V] by the fit of `fit_sine`, for thousands of records at the same times.

    Args:
        time: (n,) s.
        signals: (channels, n) V.
        frequency: Hz.

    Raises:
        EstimateError: as in `fit_sine`.
    """
    if time.size > LONGEST_FACTORED:
        return fit_sine(time, signals, frequency).amplitude
    _check_samples(time, signals)
    _check_frequency(time, frequency)
    basis, centred = sine_columns(time, frequency), signals - signals.mean(axis=1, keepdims=True)
    basis, scaled = tuned(basis, centred, basis.solve(centred))
    a, b = scaled[:2] * basis.scale[:2, np.newaxis]
    return np.asarray(np.hypot(a, b), dtype=np.float64)


def amplitude_ratio(fit: SineFit, numerator: int, denominator: int) -> tuple[float, float]:
    """Ratio of the amplitudes of two channels and its standard uncertainty from noise.

    (u_R/R)² = u₁²/A₁² + u₂²/A₂² − 2 r u₁u₂/(A₁A₂), where r is the correlation of the two amplitudes: noise that both
    channels share cancels only as far as they move in phase. In phase over whole cycles this is (2/n)(σ₁²/A₁² + σ₂²/A₂²
    − 2ρσ₁σ₂/(A₁A₂)), the Cramér–Rao bound [S]. The biases of both amplitudes and of their quotient are subtracted.

    Args:
        fit: fit of both channels together.
        numerator, denominator: channel numbers.

    Raises:
        EstimateError: the denominator's amplitude is below three of its standard uncertainties.
    """
    top, bottom = float(fit.unbiased[numerator]), float(fit.unbiased[denominator])
    top_u, bottom_u = float(fit.amplitude_u[numerator]), float(fit.amplitude_u[denominator])
    if not bottom > 3 * bottom_u:
        raise EstimateError(
            f"amplitude of channel {denominator} is {bottom:.3g} V with standard uncertainty {bottom_u:.3g} V, "
            "less than three times that; raise the drive, lengthen the dwell or check the film's connection"
        )
    ratio = top / bottom
    common = float(fit.amplitude_correlation[numerator, denominator]) * top_u * bottom_u
    variance = top_u**2 + (ratio * bottom_u) ** 2 - 2 * ratio * common
    return ratio - quotient_bias(ratio, bottom, bottom_u**2, common), math.sqrt(max(variance, 0.0)) / bottom


def quotient_bias(ratio: Some, bottom: Some, variance: Some, covariance: Some) -> Some:
    """Mean error that noise adds to a quotient, to second order.

    A denominator that is too small has a greater effect than one that is too large by as much.

    Args:
        ratio: numerator over denominator.
        bottom: denominator.
        variance: variance of the denominator.
        covariance: covariance of numerator and denominator.
    """
    return (ratio * variance - covariance) / (bottom * bottom)


def _wandering(basis: SineColumns, scaled: Floats) -> Floats:
    """Standard uncertainty (channels,) [V] of amplitudes by hum that is fitted at the mains' rated frequency alone.

    Every frequency within the wander of the mains is as likely as any other, and so is every phase. So it is the
    greatest leak divided by √3 and √2. Where the mains turn less than once against the drive, the greatest leak counts
    as two standard uncertainties.
    """
    if not basis.strays:
        return np.zeros((*scaled.shape[:-2], scaled.shape[-1]))
    hum, _ = basis.phasors(scaled)
    turns = np.abs(np.array(basis.mains) - basis.frequency) * (basis.time[-1] - basis.time[0])
    typical = np.where(turns < 1, 0.5, 1 / math.sqrt(6)) * basis.strays
    found: Floats = np.linalg.norm(np.abs(hum).swapaxes(-1, -2) * typical, axis=-1)
    return found


def _check_samples(time: Floats, signals: Floats) -> None:
    if time.ndim != 1 or signals.ndim != 2 or signals.shape[1] != time.size or signals.shape[0] == 0:
        raise EstimateError(
            f"time has shape {time.shape} and signals {signals.shape}; they must be (n,) and (channels, n)"
        )
    if time.size <= COEFFICIENTS:
        raise EstimateError(
            f"{time.size} samples cannot give {COEFFICIENTS} coefficients and their uncertainty; "
            f"record at least {COEFFICIENTS + 1}"
        )
    bad = np.count_nonzero(~np.isfinite(signals), axis=1)
    if bad.any():
        counts = ", ".join(f"{bad[i]} in channel {i}" for i in np.flatnonzero(bad))
        raise EstimateError(
            f"of {time.size} samples a channel are not finite: {counts}; leave flagged samples out, with their times"
        )
    if not np.isfinite(time).all():
        raise EstimateError(f"{np.count_nonzero(~np.isfinite(time))} of {time.size} times are not finite")
    back = np.flatnonzero(~(np.diff(time) > 0))
    if back.size:
        i = int(back[0])
        raise EstimateError(
            f"time does not increase: sample {i + 1} at {time[i + 1]!s} s follows {time[i]!s} s; sort the record"
        )


def _check_frequency(time: Floats, frequency: float) -> float:
    """Check a frequency [Hz] against the times (n,) [s]; returns the median step of the times [s]."""
    step = float(np.median(np.diff(time)))
    _check_step(step, float(time[-1] - time[0]), frequency)
    return step


def _check_step(step: float, span: float, frequency: float) -> None:
    if not frequency > 0:
        raise EstimateError(f"frequency {frequency} Hz must be positive; give that of the drive")
    if frequency > 0.5 / step:
        raise EstimateError(
            f"frequency {frequency:g} Hz lies above half the sample rate of {1 / step:g} Hz; sample faster"
        )
    cycles = frequency * (span + step)
    if cycles < SHORTEST_RECORD:
        raise EstimateError(
            f"record of {cycles:.3g} cycles of {frequency:g} Hz is shorter than {SHORTEST_RECORD:g} cycle; "
            f"dwell {1 / frequency:g} s or more"
        )


# --- Estimators of an amplitude, to be compared with each other and with the Cramér–Rao bound ----------
#
# Palpate measures by least squares (`fit_sine`). The others show what a lock-in amplifier, a voltmeter and an
# oscilloscope would have shown. Each has a bias of its own by hum, drift and noise.

Estimator = Callable[[Floats, Floats, float], Floats]
"""Function of time (n,) [s], signals (channels, n) [V] and frequency [Hz] that gives amplitudes (channels,) [V]."""


def boxcar(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Lock-in amplifier that averages over the record without a window. It is exact over whole cycles."""
    return _lock_in(time, signals, frequency, np.ones_like(time))


def hann(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Lock-in amplifier with a Hann window. Other tones hardly change it, but it has half as much noise again."""
    middle = (np.arange(time.size) + 0.5) / time.size
    return _lock_in(time, signals, frequency, np.sin(np.pi * middle) ** 2)


def rms(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Voltmeter, AC coupled: √2 times the rms. Hum, drift and noise make it greater."""
    deviation: Floats = signals.std(axis=1)
    return math.sqrt(2) * deviation


def peak_to_peak(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Oscilloscope: half the difference of greatest and least sample. It grows with noise and record length."""
    extent: Floats = np.ptp(signals, axis=1)
    return extent / 2


LEAST_SQUARES = "least squares"
ESTIMATORS: Mapping[str, Estimator] = {
    LEAST_SQUARES: amplitudes,
    "lock-in boxcar": boxcar,
    "lock-in Hann": hann,
    "RMS": rms,
    "peak to peak": peak_to_peak,
}


def amplitude_ratios(estimator: str, time: Floats, records: Floats, frequency: float) -> Floats:
    """Ratios (repeats,) of the amplitudes of two channels: the first over the second.

    Args:
        estimator: name of one of ESTIMATORS.
        time: (n,) s, times that all records share.
        records: (repeats, 2, n) V.
        frequency: Hz.

    Raises:
        UnknownName: no such estimator.
        EstimateError: a record does not determine a sine, or its second channel is silent.
    """
    if estimator not in ESTIMATORS:
        raise UnknownName("estimator", estimator, ESTIMATORS)
    repeats, _, n = records.shape
    found = ESTIMATORS[estimator](time, records.reshape(2 * repeats, n), frequency).reshape(repeats, 2)
    if not (found[:, 1] > 0).all():
        raise EstimateError(f"{estimator}: the second channel is silent in a record, so there is no ratio")
    ratios: Floats = found[:, 0] / found[:, 1]
    return ratios


def ratio_bound(
    time: Floats, frequency: float, amplitude: Floats, phase: Floats, sigma: Floats, correlation: float = 0.0
) -> float:
    """Cramér–Rao bound of the relative standard uncertainty of a ratio of two amplitudes.

    The noise is white; amplitudes, phases, offsets, trends and hum are unknown. Over many whole cycles the bound in
    phase is √((2/n)(σ₁²/A₁² + σ₂²/A₂² − 2ρσ₁σ₂/(A₁A₂))). Over one cycle, trend and hum make it up to 1.6 times as
    large.

    Args:
        time: (n,) s.
        frequency: Hz.
        amplitude: (2,) V.
        phase: (2,) rad, at time zero.
        sigma: (2,) V, standard deviation of the noise of one sample.
        correlation: correlation of the two channels' noise in one sample.

    Raises:
        EstimateError: the times do not determine the sine.
    """
    basis = sine_columns(time, frequency)
    direction = basis.direction(phase + 2 * np.pi * frequency * basis.middle) * (sigma / amplitude)
    together = correlation * float(direction[:, 0] @ direction[:, 1])
    return math.sqrt(max(float((direction**2).sum()) - 2 * together, 0.0))


def _lock_in(time: Floats, signals: Floats, frequency: float, window: Floats) -> Floats:
    weights = window / window.sum() * np.exp(-2j * np.pi * frequency * time)
    found: Floats = 2 * np.abs((signals - signals.mean(axis=1, keepdims=True)) @ weights)
    return found
