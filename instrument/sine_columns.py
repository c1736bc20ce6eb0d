"""What a record is fitted with: the drive's cosine and sine, an offset, a trend, and the mains where they show.

Hum is no stranger to the drive: over one cycle the trend takes it up, and the drive's sine makes good for the trend, so
that 1 V of 50 Hz adds up to 0.34 V to a drive of 10 Hz (0.04 V over two cycles, 0.001 V over ten). Columns of its own
cost 9 % of variance over one cycle, 0.2 % over two. They are left out where they could not be told from the drive:
50 Hz beside 48 Hz for 0.1 s, and for any time 60 Hz sampled at 62.5 Hz beside 2.5 Hz.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from instrument.errors import EstimateError
from instrument.noise import MAINS

Floats = npt.NDArray[np.float64]

COEFFICIENTS = 4  # cosine, sine, offset, trend
CONDITION_LIMIT = 100.0
"""Largest condition number that is accepted; one cycle has 3.1, 0.3 cycle 68, a quarter cycle 113.

At the limit the amplitude can be about 50 times as uncertain as from a whole number of cycles (√(2σ²/n)).
"""
HUM_CONDITION = 5.0  # largest with columns of the mains: they cost six times the variance at most
SAMPLES_PER_COLUMN = 2  # at least, with columns of the mains
REMEMBERED, LONGEST_REMEMBERED = 8, 10_000  # records, and samples of one: procedures fit at the same times again
SHOWN = 1e-12  # V of 1 V of hum; what is smaller is round-off


@dataclass(frozen=True, slots=True, eq=False)
class SineColumns:
    """Columns about the middle of a record (n, 4 and two for each of the `mains`), scaled, and their QR factors."""

    time: Floats
    columns: Floats
    scale: Floats
    q: Floats
    r: Floats
    middle: float
    condition: float
    mains: tuple[float, ...]

    def solve(self, signals: Floats) -> Floats:
        """Coefficients (columns, channels) of the scaled columns, by least squares."""
        return np.asarray(np.linalg.solve(self.r, self.q.T @ signals.T), dtype=np.float64)

    def direction(self, phase: Floats) -> Floats:
        """What white noise does to amplitudes (channels,) of these phases at the middle: (columns, channels).

        A length is the standard deviation over that of a sample; products of two give their covariance.
        """
        gradient = np.stack([np.cos(phase), -np.sin(phase)]) * self.scale[:2, np.newaxis]
        found: Floats = np.linalg.inv(self.r).T[:, :2] @ gradient
        return found

    def hum(self) -> float:
        """What 1 V of hum at any of the mains may add to an amplitude, at its worst phase [V]."""
        left = [mains for mains in MAINS if mains not in self.mains]
        added = [self.solve(_pair(self.time, mains).T)[:2] * self.scale[:2, np.newaxis] for mains in left]
        most = max((float(np.linalg.norm(each, 2)) for each in added), default=0.0)
        return most if most > SHOWN else 0.0


def sine_columns(time: Floats, frequency: float) -> SineColumns:
    """The columns of a fit at times (n,) [s] that were checked, with those of the mains that can be told apart.

    Raises:
        EstimateError: the times do not determine the sine.
    """
    if time.size > LONGEST_REMEMBERED:
        return _columns(time, frequency)
    return _remembered(time.tobytes(), frequency)


@lru_cache(REMEMBERED)
def _remembered(time: bytes, frequency: float) -> SineColumns:
    return _columns(np.frombuffer(time), frequency)


def _columns(time: Floats, frequency: float) -> SineColumns:
    for mains in (MAINS, *((each,) for each in MAINS)):
        if time.size >= SAMPLES_PER_COLUMN * (COEFFICIENTS + 2 * len(mains)):
            basis = _factored(time, frequency, mains)
            if basis.condition <= HUM_CONDITION:
                return basis
    basis = _factored(time, frequency, ())
    if not basis.condition <= CONDITION_LIMIT:
        raise EstimateError(
            f"{time.size} samples over {time[-1] - time[0]:.4g} s do not determine a sine of {frequency:g} Hz:"
            f" condition number {basis.condition:.3g}, limit {CONDITION_LIMIT:g}; record a whole cycle or more, away"
            " from half the sample rate"
        )
    return basis


def _factored(time: Floats, frequency: float, mains: Sequence[float]) -> SineColumns:
    middle = 0.5 * (time[0] + time[-1])
    centred = time - middle
    # The factors give each column an rms near 1 for many cycles. They are fixed: a column scaled by its
    # own norm would hide a cosine sampled at its zeros.
    pairs = [_pair(centred, each) for each in (frequency, *mains)]
    scale = np.array([math.sqrt(2), math.sqrt(2), 1.0, math.sqrt(3) / centred[-1], *[math.sqrt(2)] * 2 * len(mains)])
    straight = np.stack([np.ones_like(centred), centred], axis=1)
    columns = np.concatenate([pairs[0], straight, *pairs[1:]], axis=1) * scale
    q, r = np.linalg.qr(columns)
    return SineColumns(centred, columns, scale, q, r, float(middle), float(np.linalg.cond(r)), tuple(mains))


def _pair(time: Floats, frequency: float) -> Floats:
    """Cosine and sine, (n, 2)."""
    angle = 2 * np.pi * frequency * time
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
