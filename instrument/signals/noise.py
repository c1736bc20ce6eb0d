"""Noise at the frequency of the drive, from the residuals of a fit of the drive.

The rms of all residuals would be wrong: hum beside the drive does no harm over whole steps of 0.1 s, and 1/f noise is
greater at the drive than above it. So a density white + 1/f is fitted to the spectrum of the residuals, without the
mains and the drive's harmonics. Where the spectrum has another shape, the lines around the drive are averaged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Complexes, Floats

# --- noise at the frequency of the drive ---------------------------------------------------------------


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
        sigma: (..., channels) standard deviation of a sample, in the signals' unit.
        correlation: (..., channels, channels), correlation of the channels' noise.
        degrees_of_freedom: (...,), degrees of freedom of `sigma`.
    """

    sigma: Floats
    correlation: Floats
    degrees_of_freedom: Floats

    def where(self, chosen: npt.NDArray[np.bool_], other: EquivalentNoise) -> EquivalentNoise:
        """This noise for the chosen records of a stack, and the other one for the rest."""
        return EquivalentNoise(
            np.where(chosen[..., np.newaxis], self.sigma, other.sigma),
            np.where(chosen[..., np.newaxis, np.newaxis], self.correlation, other.correlation),
            np.where(chosen, self.degrees_of_freedom, other.degrees_of_freedom),
        )


def noise_at(frequency: float, residuals: Floats, step: float, spent: int) -> EquivalentNoise:
    """White noise that has the effect of the real noise at a frequency.

    Where the record has 96 lines and the fitted shape holds in every channel, the fit is used: over 40 cycles of 25
        samples the power is known to 5 %. Otherwise the lines within an octave of the drive are averaged, or the
        nearest 24 where those are more. The mean of 1/f noise is then 8 % too low from 16 cycles on and 15 % too low
        with 10; in shorter records the lines reach to higher frequencies, where 1/f noise is less.

    Args:
        frequency: frequency of the drive [Hz].
        residuals: (..., channels, n), residuals of the fit; a few missing samples do no harm.
        step: time between samples [s].
        spent: number of coefficients of the fit.
    """
    n = residuals.shape[-1]
    cycles = frequency * n * step
    lines = np.arange(FIRST_LINE, (n + 1) // 2)
    harmonics = int(lines.size // cycles) + 1 if cycles >= HARMONICS_FROM else 1
    for tone in (*(cycles * np.arange(1, harmonics + 1)), *(mains * n * step for mains in MAINS)):
        lines = lines[np.abs(lines - tone) >= 1 - 1e-6]
    if lines.size < FEWEST_LINES:
        return _known_by(residuals, n - spent, n - spent)
    spectrum = _picked(np.fft.rfft(residuals, axis=-1), lines) / np.sqrt(n)
    fitted, holds = None, np.zeros(residuals.shape[:-2], bool)
    if lines.size >= SHAPE_LINES:
        fitted, holds = _shaped(spectrum, cycles / lines)
        if holds.all():
            return fitted
    octaves = np.abs(np.log2(lines / cycles))
    near = np.argsort(octaves, kind="stable")[: max(LINES, np.count_nonzero(octaves <= 1))]
    around = _picked(spectrum, near)
    averaged = _known_by(np.concatenate([around.real, around.imag], axis=-1), near.size, 2 * near.size)
    return averaged if fitted is None else fitted.where(holds, averaged)


def _known_by(values: Floats, count: int, degrees_of_freedom: int) -> EquivalentNoise:
    sigma, correlation = moments(values, count)
    return EquivalentNoise(sigma, correlation, np.full(values.shape[:-2], float(degrees_of_freedom)))


def _picked(spectrum: Complexes, lines: npt.NDArray[np.int64]) -> Complexes:
    """Some lines (..., channels, lines) of a spectrum, with the channels of each line side by side in memory.

    By their order in memory numpy sums them in the same order in one record and in a stack.
    """
    return np.take(spectrum.swapaxes(-1, -2), lines, axis=-2).swapaxes(-1, -2)


def _shaped(spectrum: Complexes, pink: Floats) -> tuple[EquivalentNoise, npt.NDArray[np.bool_]]:
    """Noise by the most likely density white + 1/f (Whittle), and in which records every channel has that shape.

    Args:
        spectrum: (..., channels, lines), complex; the mean of the squares is the density.
        pink: (lines,) falling density of 1/f noise, 1 at the drive.
    """
    edges = np.geomspace(pink[0], pink[-1], BANDS + 1)[:-1]
    first = np.unique(np.searchsorted(-pink, -edges))
    lines = np.diff(first, append=pink.size)
    power = np.add.reduceat(spectrum.real**2 + spectrum.imag**2, first, axis=-1) / lines
    sound = np.asarray((power > 0).all(axis=(-2, -1)))
    power = np.where(sound[..., np.newaxis, np.newaxis], power, 1.0)
    slope = np.add.reduceat(pink, first) / lines
    white, rising = whittle(power, slope, lines)
    density = white[..., np.newaxis] + rising[..., np.newaxis] * slope
    whitened = spectrum / np.sqrt(white[..., np.newaxis] + rising[..., np.newaxis] * pink)
    correlation = moments(np.concatenate([whitened.real, whitened.imag], axis=-1), pink.size)[1]
    a, b, c = ((lines / density**2) @ slope**order for order in range(3))
    variance = (a - 2 * b + c) / (a * c - b**2) / (white + rising) ** 2
    # A drive far below the first line is out of the data's reach: the density there is practically unknown.
    freedom = np.maximum(np.trunc(2 / variance.mean(axis=-1)), 1.0)
    return EquivalentNoise(np.sqrt(white + rising), correlation, freedom), sound & _holds(power / density, lines)


def whittle(power: Floats, slope: Floats, lines: Floats) -> tuple[Floats, Floats]:
    """Power (..., channels) of white noise and of 1/f noise, neither negative, by Fisher scoring.

    The power of a line is its density times half a chi-squared of two degrees of freedom. The channels of a record
    are scored together, until all of them have settled.

    Args:
        power: (..., channels, bands), mean power in each band.
        slope: (bands,) mean density of 1/f noise in each band, 1 at the drive.
        lines: (bands,) number of lines in each band.
    """
    flat, steep = power @ lines / lines.sum(), (power / slope) @ lines / lines.sum()
    white, rising = flat, np.zeros(flat.shape)
    moving = np.ones((*flat.shape[:-1], 1), bool)
    for _ in range(SCORINGS):
        before = white + rising
        weight = lines / (white[..., np.newaxis] + rising[..., np.newaxis] * slope) ** 2
        a, b, c = (weight @ slope**order for order in range(3))
        d, e = (weight * power).sum(axis=-1), (weight * power) @ slope
        free_white, free_rising = (c * d - b * e) / (a * c - b**2), (a * e - b * d) / (a * c - b**2)
        next_white = np.where(free_rising <= 0, flat, np.where(free_white <= 0, 0.0, free_white))
        next_rising = np.where(free_rising <= 0, 0.0, np.where(free_white <= 0, steep, free_rising))
        white, rising = np.where(moving, next_white, white), np.where(moving, next_rising, rising)
        moving = moving & ~(np.abs(white + rising - before) <= SETTLED * before).all(axis=-1, keepdims=True)
        if not moving.any():
            break
    return white, rising


def _holds(relative: Floats, lines: Floats) -> npt.NDArray[np.bool_]:
    """Whether power over fitted density (..., channels, bands) differs from 1 in no band by more than chance explains.

    The mean of a band has a chi-squared distribution; its cube root is nearly normal (Wilson and Hilferty).
    """
    from scipy.special import chdtri

    ninth = 1 / (9 * lines)
    off = ((np.cbrt(relative) - (1 - ninth)) ** 2 / ninth).sum(axis=-1)
    return np.asarray(off.max(axis=-1) <= chdtri(lines.size, SURE / relative.shape[-2]))


def moments(values: Floats, count: int) -> tuple[Floats, Floats]:
    """Standard deviation of each row (..., rows, n), with `count` degrees of freedom, and correlation of the rows."""
    norm = np.linalg.norm(values, axis=-1, keepdims=True)
    unit = np.divide(values, norm, out=np.zeros_like(values), where=norm > 0)
    correlation: Floats = unit @ unit.swapaxes(-1, -2)
    fill_diagonal(correlation)
    return norm[..., 0] / np.sqrt(count), correlation


def fill_diagonal(correlation: Floats) -> None:
    """Make each channel's correlation with itself 1, in a matrix or a stack of them."""
    each = np.arange(correlation.shape[-1])
    correlation[..., each, each] = 1.0


# --- random noise without drift ------------------------------------------------------------------------

# After a change of load a film's offset still decays by some 100 µV while it is recorded. A straight trend over the
# whole record leaves the bend of that decay in the residuals, where it would count as noise. So noise is what is left
# about a straight line through each cycle.


FEWEST = 8  # samples for a line, which takes two of their degrees of freedom
HELD = 4  # places of a cycle that the line and the fitted drive hold where each cycle is like the others


@dataclass(frozen=True, slots=True, eq=False)
class RapidNoise:
    """What is left of each channel's signal about lines.

    Args:
        rms: (..., channels) root mean square.
        rms_u: (..., channels) standard uncertainty of `rms`, with `degrees_of_freedom`.
        greatest: (..., channels) greatest absolute value.
        degrees_of_freedom: degrees of freedom of `rms_u`.
    """

    rms: Floats
    rms_u: Floats
    greatest: Floats
    degrees_of_freedom: float


def rapid_noise(time: Floats, residuals: Floats, cycle: float, spent: int) -> RapidNoise:
    """Noise about a line through each cycle.

    Where an offset stands still within a step of the converter, rounding repeats with each cycle. Then the samples at
    one place in the cycle are all alike, and only places are independent. So the uncertainty comes from the mean
    squares at each place: they differ by chance if noise is random, and by more if rounding repeats. How much squares
    scatter by chance tell the cycles: 2 mean² if noise is normal, less if it is rounding. What is beyond that repeats.

    A record of fewer than two cycles has the one line of its trend, and its samples count as independent. Samples after
    the last whole cycle do not count.

    Args:
        time: (n,) s.
        residuals: (..., channels, n), residuals of a fit with offset and trend.
        cycle: samples in a cycle.
        spent: number of coefficients of the fit, with offset and trend.
    """
    length = max(round(cycle), FEWEST)
    count = time.size // length
    if count < 2:
        freedom = time.size - spent
        rms = np.sqrt((residuals**2).sum(axis=-1) / freedom)
        return RapidNoise(rms, rms / math.sqrt(2 * freedom), np.abs(residuals).max(axis=-1), math.inf)
    return Cycles.of(time, residuals, length).noise(spent)


@dataclass(frozen=True, slots=True, eq=False)
class Cycles:
    """What is left about the line of each cycle, over some whole cycles of a record.

    Attributes:
        count: number of cycles.
        total: (..., channels) sum of the squares of what is left.
        at_place: (..., channels, length) mean square at each place of a cycle.
        scatter: (..., channels, length) variance of the squares at each place.
        greatest: (..., channels) greatest absolute value.
    """

    count: int
    total: Floats
    at_place: Floats
    scatter: Floats
    greatest: Floats

    @classmethod
    def of(cls, time: Floats, residuals: Floats, length: int) -> Cycles:
        """Those of a record or of a part of it; samples after the last whole cycle of this length do not count."""
        count = time.size // length
        used = count * length
        at = time[:used].reshape(count, length)
        at = at - at.mean(axis=1, keepdims=True)
        square = (at**2).sum(axis=1)
        left = residuals[..., :used].reshape(*residuals.shape[:-1], count, length)
        left = left - left.mean(axis=-1, keepdims=True)
        slope = (left * at).sum(axis=-1) / square
        left = left - slope[..., np.newaxis] * at
        free = 1 - 1 / length - at**2 / square[:, np.newaxis]  # of each sample, beside the line of its cycle
        squares = left**2 / free
        return cls(
            count,
            (left**2).sum(axis=(-2, -1)),
            squares.mean(axis=-2),
            squares.var(axis=-2, ddof=1),
            np.abs(left).max(axis=(-2, -1)),
        )

    def __add__(self, other: Cycles) -> Cycles:
        """The cycles of two parts together; each part has two or more."""
        count, apart = self.count + other.count, other.at_place - self.at_place
        within = (self.count - 1) * self.scatter + (other.count - 1) * other.scatter
        return Cycles(
            count,
            self.total + other.total,
            self.at_place + apart * (other.count / count),
            (within + apart**2 * (self.count * other.count / count)) / (count - 1),
            np.maximum(self.greatest, other.greatest),
        )

    def noise(self, spent: int) -> RapidNoise:
        """The noise. `spent`: number of coefficients of the fit, with offset and trend."""
        count, length = self.count, self.at_place.shape[-1]
        used = count * length
        freedom = used - 2 * count - (spent - 2)  # the lines hold offset and trend
        rms = np.sqrt(self.total / freedom)
        mean, by_chance = self.at_place.mean(axis=-1), self.scatter.mean(axis=-1)
        independent = np.maximum(2 * freedom * mean**2 + used * (by_chance - 2 * mean**2), 0.0) / freedom**2
        repeated = (self.at_place.var(axis=-1, ddof=1) - by_chance / count) / (length - HELD)
        mean_u = np.sqrt(np.maximum(independent + repeated, 0.0))
        half = np.divide(mean_u, 2 * mean, out=np.zeros_like(mean), where=mean > 0)  # a root has half the relative u
        return RapidNoise(rms, half * rms, self.greatest, length - HELD - 1)


def of_greatest(samples: int) -> float:
    """Relative standard deviation of the greatest absolute value of so many samples of normal noise.

    It is that of the limit, a Gumbel distribution of mode m and scale 1/s (Cramér 1946, 28.6): 4 % low at 250 samples.
    """
    log = math.log(2 * samples)
    s = math.sqrt(2 * log)
    m = s - (math.log(log) + math.log(4 * math.pi)) / (2 * s)
    return math.pi / math.sqrt(6) / (s * m + np.euler_gamma)
