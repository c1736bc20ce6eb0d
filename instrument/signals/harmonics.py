"""Total harmonic distortion of a waveform: what a fitted sine leaves at multiples of the drive.

The cycles of a record are laid over each other, so that only what repeats with the drive stays; what they scatter tells
the uncertainty. Orders on which hum lies are left out: it repeats with the drive, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.instrument.errors import EstimateError
from palpate.instrument.signals.estimate import SineFit
from palpate.instrument.signals.noise import MAINS
from palpate.instrument.signals.oscilloscope import sweeps

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
