"""Noise at the frequency of the drive, from what a fit of the drive leaves over.

The rms of all residuals is not it: hum lies beside the drive and does it no harm over whole 0.1 s, 1/f noise is
greater at the drive than above it. So the spectrum of the residuals is averaged around the drive, without the mains.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

MAINS = (50.0, 60.0)  # Hz
FEWEST_LINES = 8  # of the spectrum; where a record has fewer, all of its residuals count
LINES = 24  # that are averaged at least, where the record has them
FIRST_LINE = 2  # offset and trend take most of line 1


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """White noise that does to the drive's amplitude what the noise at the drive's frequency does.

    Args:
        sigma: (channels,) standard deviation of a sample.
        correlation: (channels, channels).
        degrees_of_freedom: of `sigma`.
    """

    sigma: Floats
    correlation: Floats
    degrees_of_freedom: int


def noise_at(frequency: float, residuals: Floats, step: float, spent: int) -> Noise:
    """Noise of a sample around a frequency.

    The lines within an octave of the drive are averaged, or the nearest 24 where those are more: 48 degrees of freedom
    or more, and of 1/f noise the mean is 8 % low from 16 cycles on, 15 % low with 10. In shorter records the lines
    reach further up, where there is less of it.

    Args:
        frequency: Hz.
        residuals: (channels, n), of samples `step` s apart; a few that are missing do no harm.
        spent: coefficients of the fit that left the residuals.
    """
    n = residuals.shape[1]
    lines = np.arange(FIRST_LINE, (n + 1) // 2)
    for tone in (frequency, *MAINS):
        lines = lines[np.abs(lines - tone * n * step) >= 1 - 1e-6]
    if lines.size < FEWEST_LINES:
        return Noise(*_moments(residuals, n - spent), n - spent)
    octaves = np.abs(np.log2(lines / (frequency * n * step)))
    near = lines[np.argsort(octaves, kind="stable")[: max(LINES, np.count_nonzero(octaves <= 1))]]
    spectrum = np.fft.rfft(residuals, axis=1)[:, near]
    return Noise(*_moments(np.concatenate([spectrum.real, spectrum.imag], axis=1), n * near.size), 2 * near.size)


def _moments(values: Floats, count: int) -> tuple[Floats, Floats]:
    """Standard deviation of each row and correlation of the rows."""
    norm = np.linalg.norm(values, axis=1, keepdims=True)
    unit = np.divide(values, norm, out=np.zeros_like(values), where=norm > 0)
    correlation: Floats = unit @ unit.T
    np.fill_diagonal(correlation, 1.0)
    return norm[:, 0] / np.sqrt(count), correlation
