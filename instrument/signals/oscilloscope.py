"""What an oscilloscope shows of a recorded waveform: its reading from peak to peak, and how much it is distorted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError, RangeError
from palpate.instrument.signals.estimate import SineFit
from palpate.instrument.signals.noise import MAINS

# --- readings of an oscilloscope -----------------------------------------------------------------------

#     Oscilloscope(averages=8).read(rate, volts, frequency).peak_to_peak
#
# The thesis reads load and films so (D in Figure 5.1); it names neither the instrument nor the number of averages, and
# prints 0.01 mV of 58 mV, which is finer than a step of 8 bits. The reading is no estimate of the sine: noise, hum,
# drift and harmonics are in it (`estimate.fit_sine` leaves them out).


SCALES = (1.0, 2.0, 5.0, 10.0)  # units a division, times a power of ten
LARGEST_SLIP = 0.5  # of a sample, from the first cycle of a record to its last
FEWEST_SAMPLES = 16  # of a cycle: the parabola through three of them then misses a crest by less than 0.1 % [M]


@dataclass(frozen=True, slots=True)
class ScopeReading:
    """A reading in the unit of the waveform.

    Attributes:
        u: standard uncertainty, from what sweeps scatter and from the steps; without the gain, which nothing tells.
        step: one step of the screen.
    """

    peak_to_peak: float
    u: float
    step: float


@dataclass(frozen=True, slots=True)
class Oscilloscope:
    """An oscilloscope that the drive triggers, AC-coupled; a sweep is one cycle, on the finest scale that shows it.

    Attributes:
        bits: of its converter; 8 are usual [A].
        divisions: height of the screen; 8 are usual [A].
        averages: number of sweeps of which it shows the mean.
    """

    bits: int = 8
    divisions: int = 8
    averages: int = 1

    def __post_init__(self) -> None:
        for name, least, most in (("bits", 1, 24), ("divisions", 1, 100), ("averages", 1, 1_000_000)):
            if not least <= getattr(self, name) <= most:
                raise RangeError(f"oscilloscope: {name} {getattr(self, name)} is not {least} to {most}; correct it")

    def read(self, rate: float, signal: npt.ArrayLike, frequency: float) -> ScopeReading:
        """The reading of a waveform (n,) that was sampled at a rate [Hz], under a drive of a frequency [Hz].

        Raises:
            EstimateError: as in `sweeps`, or the record has fewer sweeps than are averaged, or only one.
        """
        traces = sweeps(rate, signal, frequency)
        if len(traces) < max(self.averages, 2):
            raise EstimateError(
                f"the record has {len(traces)} whole cycles of {frequency:g} Hz, and an oscilloscope that averages"
                f" {self.averages} needs {max(self.averages, 2)}; dwell longer"
            )
        traces = traces - traces.mean()
        scatter = float(np.sqrt(traces.var(axis=0, ddof=1).mean()))
        step = self._scale(2 * float(np.abs(traces).max())) * self.divisions / 2**self.bits
        shown = (np.round(traces[: self.averages] / step) * step).mean(axis=0)
        u = math.hypot(math.sqrt(2 / self.averages) * scatter, step / math.sqrt(6))
        return ScopeReading(_crest(shown) + _crest(-shown), u, step)

    def _scale(self, height: float) -> float:
        """Finest scale, in units a division, of which the screen shows that height."""
        needed = max(height, np.finfo(float).tiny) / self.divisions
        power = 10.0 ** math.floor(math.log10(needed))
        return next((power * scale for scale in SCALES if power * scale >= needed), 10 * power)


def sweeps(rate: float, signal: npt.ArrayLike, frequency: float) -> Floats:
    """The whole cycles of a waveform (n,), each alike sampled: (cycles, samples of a cycle).

    Raises:
        EstimateError: it is not finite, has no whole cycle of 16 samples or more, or cycles are not sampled alike.
    """
    volts = np.asarray(signal, dtype=np.float64)
    if volts.ndim != 1 or not np.isfinite(volts).all():
        raise EstimateError(f"a waveform of shape {volts.shape} must be (n,) and finite; leave flagged samples out")
    samples = rate / frequency if frequency > 0 else 0.0
    length = round(samples)
    if length < FEWEST_SAMPLES or (cycles := volts.size // length) < 1:
        raise EstimateError(
            f"{volts.size} samples at {rate:g} Hz hold no cycle of {frequency:g} Hz of {FEWEST_SAMPLES} samples or"
            " more; sample faster or dwell longer"
        )
    if abs(samples - length) * cycles > LARGEST_SLIP:
        raise EstimateError(f"{samples:g} samples a cycle are not a whole number; sample at {length * frequency:g} Hz")
    return volts[: cycles * length].reshape(cycles, length)


def _crest(trace: Floats) -> float:
    """Greatest value of a cycle, by the parabola through its greatest sample and both neighbours."""
    at = int(trace.argmax())
    before, top, after = (float(trace[(at + shift) % trace.size]) for shift in (-1, 0, 1))
    bend = 2 * top - before - after
    return top + ((after - before) ** 2 / (8 * bend) if bend > 0 else 0.0)


# --- harmonics -----------------------------------------------------------------------------------------

# Total harmonic distortion: what a fitted sine leaves at multiples of the drive. The cycles of a record are laid over
# each other, so that only what repeats with the drive stays; what they scatter tells the uncertainty. Orders on which
# hum lies are left out: it repeats with the drive, too.

HIGHEST = 7  # order of the highest harmonic that counts; a bend gives the second, a limit the third and fifth [A]
FEWEST = 3  # cycles, below which their scatter tells nothing


@dataclass(frozen=True, slots=True)
class Distortion:
    """Total harmonic distortion: root of the sum of squares of the harmonics' amplitudes, over that of the drive.

    Attributes:
        value: with the bias by noise subtracted.
        u: standard uncertainty by what cycles scatter.
        by_noise: probability that noise alone gives so much.
    """

    value: float
    u: float
    by_noise: float


def distortion(fit: SineFit, channel: int, signal: npt.ArrayLike) -> Distortion:
    """Distortion of the waveform (n,) of a channel that was fitted.

    Raises:
        EstimateError: as in `sweeps`; there are fewer than three cycles, hum lies on every harmonic, or no drive.
    """
    volts = np.asarray(signal, dtype=np.float64)
    cycles = sweeps(fit.rate, volts - fit.trend[channel] * np.arange(volts.size) / fit.rate, fit.frequency)
    number, length = cycles.shape
    line = fit.frequency / number  # distance of two lines of the spectrum
    orders = [
        order
        for order in range(2, HIGHEST + 1)
        if all(abs(math.remainder(order * fit.frequency, mains)) >= line for mains in (*MAINS, *fit.mains))
    ]
    if number < FEWEST or not orders or not fit.amplitude[channel] > 0:
        raise EstimateError(
            f"{number} cycles of {fit.frequency:g} Hz and {fit.amplitude[channel]:.3g} V, with harmonics {orders} off"
            f" the mains, tell no distortion; it needs {FEWEST} cycles, a harmonic and a drive"
        )
    from scipy.special import fdtrc

    phasors = 2 / length * np.fft.rfft(cycles, axis=1)[:, orders]
    mean = phasors.mean(axis=0)
    # Variance of the real and of the imaginary part of a mean phasor. Each adds to its square.
    variance = float((np.abs(phasors - mean) ** 2).mean()) / (2 * (number - 1))
    parts, total = 2 * len(orders), float((np.abs(mean) ** 2).sum())
    square = max(total - parts * variance, 0.0)
    square_u = math.sqrt(4 * variance * square + 2 * parts * variance**2)
    value, drive = math.sqrt(square), float(fit.amplitude[channel])
    by_noise = float(fdtrc(parts, parts * (number - 1), total / parts / max(variance, np.finfo(float).tiny)))
    return Distortion(value / drive, (math.sqrt(square + square_u) - value) / drive, by_noise)
