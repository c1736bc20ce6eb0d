"""Noise at the frequency of the drive, from the residuals of a fit of the drive.

The rms of all residuals would be wrong: hum beside the drive does no harm over whole steps of 0.1 s, and 1/f noise is
greater at the drive than above it. So a density white + 1/f is fitted to the spectrum of the residuals, without the
mains and the drive's harmonics. Where the spectrum has another shape, the lines around the drive are averaged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

MAINS = (50.0, 60.0)  # Hz
FEWEST_LINES = 8  # least number of lines of the spectrum; in a record with fewer, all residuals count
LINES = 24  # least number of lines that are averaged, if the record has as many
FIRST_LINE = 2  # offset and trend take most of line 1
SHAPE_LINES = 96  # a spectrum of fewer lines has no shape to fit
HARMONICS_FROM = 8  # number of cycles from which leaving out the harmonics costs at most an eighth of the lines
BANDS = 12  # number of bands of equal frequency ratio; the fit is to their means, and must hold in each
SURE = 1e-4  # chance that a spectrum of the fitted shape is rejected
SCORINGS, SETTLED = 8, 1e-4  # greatest number of steps, and the relative change that ends them


@dataclass(frozen=True, slots=True, eq=False)
class EquivalentNoise:
    """White noise that has the same effect on the drive's amplitude as the real noise.

    Args:
        sigma: (channels,) standard deviation of a sample, in the signals' unit.
        correlation: (channels, channels), correlation of the channels' noise.
        degrees_of_freedom: degrees of freedom of `sigma`.
    """

    sigma: Floats
    correlation: Floats
    degrees_of_freedom: float


def noise_at(frequency: float, residuals: Floats, step: float, spent: int) -> EquivalentNoise:
    """White noise that has the effect of the real noise at a frequency.

    Where the record has 96 lines and the fitted shape holds in every channel, the fit is used: over 40 cycles of 25
        samples the power is known to 5 %. Otherwise the lines within an octave of the drive are averaged, or the
        nearest 24 where those are more. The mean of 1/f noise is then 8 % too low from 16 cycles on and 15 % too low
        with 10; in shorter records the lines reach to higher frequencies, where 1/f noise is less.

    Args:
        frequency: frequency of the drive [Hz].
        residuals: (channels, n), residuals of the fit; a few missing samples do no harm.
        step: time between samples [s].
        spent: number of coefficients of the fit.
    """
    n = residuals.shape[1]
    cycles = frequency * n * step
    lines = np.arange(FIRST_LINE, (n + 1) // 2)
    harmonics = int(lines.size // cycles) + 1 if cycles >= HARMONICS_FROM else 1
    for tone in (*(cycles * np.arange(1, harmonics + 1)), *(mains * n * step for mains in MAINS)):
        lines = lines[np.abs(lines - tone) >= 1 - 1e-6]
    if lines.size < FEWEST_LINES:
        return EquivalentNoise(*moments(residuals, n - spent), n - spent)
    spectrum = np.fft.rfft(residuals, axis=1)[:, lines] / np.sqrt(n)
    if lines.size >= SHAPE_LINES:
        fitted = _shaped(spectrum, cycles / lines)
        if fitted is not None:
            return fitted
    octaves = np.abs(np.log2(lines / cycles))
    near = np.argsort(octaves, kind="stable")[: max(LINES, np.count_nonzero(octaves <= 1))]
    around = spectrum[:, near]
    return EquivalentNoise(*moments(np.concatenate([around.real, around.imag], axis=1), near.size), 2 * near.size)


def _shaped(spectrum: Floats, pink: Floats) -> EquivalentNoise | None:
    """Noise by the most likely density white + 1/f (Whittle); None: the spectrum of a channel has another shape.

    Args:
        spectrum: (channels, lines), complex; the mean of the squares is the density.
        pink: (lines,) falling density of 1/f noise, 1 at the drive.
    """
    edges = np.geomspace(pink[0], pink[-1], BANDS + 1)[:-1]
    first = np.unique(np.searchsorted(-pink, -edges))
    lines = np.diff(first, append=pink.size)
    power = np.add.reduceat(spectrum.real**2 + spectrum.imag**2, first, axis=1) / lines
    if not (power > 0).all():
        return None
    slope = np.add.reduceat(pink, first) / lines
    white, rising = _whittle(power, slope, lines)
    density = white[:, np.newaxis] + rising[:, np.newaxis] * slope
    if not _holds(power / density, lines):
        return None
    whitened = spectrum / np.sqrt(white[:, np.newaxis] + rising[:, np.newaxis] * pink)
    correlation = moments(np.concatenate([whitened.real, whitened.imag], axis=1), pink.size)[1]
    a, b, c = ((lines / density**2) @ slope**order for order in range(3))
    variance = (a - 2 * b + c) / (a * c - b**2) / (white + rising) ** 2
    # A drive far below the first line is out of the data's reach: the density there is practically unknown.
    return EquivalentNoise(np.sqrt(white + rising), correlation, max(int(2 / variance.mean()), 1))


def _whittle(power: Floats, slope: Floats, lines: Floats) -> tuple[Floats, Floats]:
    """Power (channels,) of white noise and of 1/f noise, neither negative, by Fisher scoring.

    The power of a line is its density times half a chi-squared of two degrees of freedom.

    Args:
        power: (channels, bands), mean power in each band.
        slope: (bands,) mean density of 1/f noise in each band, 1 at the drive.
        lines: (bands,) number of lines in each band.
    """
    flat, steep = power @ lines / lines.sum(), (power / slope) @ lines / lines.sum()
    white, rising = flat, np.zeros(len(power))
    for _ in range(SCORINGS):
        before = white + rising
        weight = lines / (white[:, np.newaxis] + rising[:, np.newaxis] * slope) ** 2
        a, b, c = (weight @ slope**order for order in range(3))
        d, e = (weight * power).sum(axis=1), (weight * power) @ slope
        free_white, free_rising = (c * d - b * e) / (a * c - b**2), (a * e - b * d) / (a * c - b**2)
        white = np.where(free_rising <= 0, flat, np.where(free_white <= 0, 0.0, free_white))
        rising = np.where(free_rising <= 0, 0.0, np.where(free_white <= 0, steep, free_rising))
        if (np.abs(white + rising - before) <= SETTLED * before).all():
            break
    return white, rising


def _holds(relative: Floats, lines: Floats) -> bool:
    """Whether power over fitted density (channels, bands) differs from 1 in no band by more than chance explains.

    The mean of a band has a chi-squared distribution; its cube root is nearly normal (Wilson and Hilferty).
    """
    from scipy.special import chdtri

    ninth = 1 / (9 * lines)
    off = ((np.cbrt(relative) - (1 - ninth)) ** 2 / ninth).sum(axis=1)
    return bool(off.max() <= chdtri(lines.size, SURE / len(relative)))


def moments(values: Floats, count: int) -> tuple[Floats, Floats]:
    """Standard deviation of each row, with `count` degrees of freedom, and correlation of the rows."""
    norm = np.linalg.norm(values, axis=1, keepdims=True)
    unit = np.divide(values, norm, out=np.zeros_like(values), where=norm > 0)
    correlation: Floats = unit @ unit.T
    np.fill_diagonal(correlation, 1.0)
    return norm[:, 0] / np.sqrt(count), correlation
