"""Search for the mains' true frequency where hum shows in a record, and the fit of the record at that frequency.

The fitted slopes tell how far off the mains are (a step of Gauss and Newton). That step converges if the mains are off
by less than half a turn over the record. If they may be off by more, frequencies around the rated one are tried first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.signals.noise import MAINS
from palpate.instrument.signals.sine_columns import COEFFICIENTS, SineColumns, columns_at

SEEN = 5.0  # number of an amplitude's standard deviations above which hum is seen; smaller hum does no harm
SURE = 3.0  # number of a frequency's standard uncertainties; mains that are farther off are tuned
CENTRED = 0.05  # rad at the ends of the record; the slopes absorb a phase error this small
FARTHEST = 0.5  # greatest deviation of the mains' frequency by EN 50160 [Hz]
STEPS = 8
LONG = 2.0  # s; in a longer record 0.25 Hz are more than half a turn
BLOCK = 0.5  # s of a record that the search averages
ROUND_OFF = 1e-12  # of a signal
PADDED = 4  # number of frequencies that are tried for each block


class RecordWithHum(Protocol):
    """A record (channels, n) as the search sees it, whether it is in memory or not."""

    def at(self, basis: SineColumns, mains: Sequence[float]) -> tuple[SineColumns, Floats]:
        """Columns with the mains at other frequencies [Hz], and the coefficients of a fit with them."""

    def deviation(self, basis: SineColumns, scaled: Floats) -> Floats:
        """Standard deviation (channels,) [V] of a fitted amplitude by the residuals of the record."""

    def demodulated(self, basis: SineColumns, scaled: Floats) -> tuple[Floats, Sequence[Floats]]:
        """What is left without the drive: its standard deviation in an amplitude, and its hum over time.

        The hum is (channels, blocks), complex, for each of the mains: the mean over each `BLOCK`, times blocks.
        """


class _InMemory:
    """Records (..., channels, n) in memory, centred."""

    def __init__(self, signals: Floats) -> None:
        self._signals = signals

    def at(self, basis: SineColumns, mains: Sequence[float]) -> tuple[SineColumns, Floats]:
        found = columns_at(basis, mains)
        return found, found.solve(self._signals)

    def deviation(self, basis: SineColumns, scaled: Floats) -> Floats:
        left = self._signals - basis.fitted(scaled)
        return deviation((left**2).sum(axis=-1), basis.time.size, basis.scale.size, self._largest())

    def demodulated(self, basis: SineColumns, scaled: Floats) -> tuple[Floats, Sequence[Floats]]:
        left, time = self._signals - basis.fitted(scaled[:COEFFICIENTS]), basis.time
        edges = np.searchsorted(time, np.arange(time[0], time[-1], BLOCK))
        turned = [
            np.add.reduceat(left * np.exp(-2j * np.pi * mains * time), edges, axis=1) * (2 / time.size)
            for mains in basis.mains
        ]
        return above_round_off(left.std(axis=1) * np.sqrt(2 / time.size), self._largest()), turned

    def _largest(self) -> Floats:
        largest: Floats = np.abs(self._signals).max(axis=-1, initial=0.0)
        return largest


def tuned(basis: SineColumns, signals: Floats, scaled: Floats) -> tuple[SineColumns, Floats]:
    """Columns with the mains at their true frequency, and the coefficients of a fit with them.

    Where no hum shows, both are returned as they were given.

    Args:
        basis: columns with the mains at their rated frequency.
        signals: (channels, n) V, centred.
        scaled: coefficients of the signals by `basis`.
    """
    return tuned_to(_InMemory(signals), basis, scaled)


def tuned_to(record: RecordWithHum, basis: SineColumns, scaled: Floats) -> tuple[SineColumns, Floats]:
    """The same for any record."""
    if not (basis.mains and basis.slopes):
        return basis, scaled
    rated = tuple(min(MAINS, key=lambda each: abs(each - own)) for own in basis.mains)
    if basis.time[-1] - basis.time[0] > LONG:
        basis, scaled = _searched(record, basis, scaled)
    given = basis, scaled
    for _ in range(STEPS):
        off = _off(record, basis, scaled)
        if not off.any():
            break
        found = [own + float(step) for own, step in zip(basis.mains, off, strict=True)]
        if any(abs(own - each) > FARTHEST for own, each in zip(found, rated, strict=True)):
            return given
        basis, scaled = record.at(basis, found)
    return basis, scaled


def humming(basis: SineColumns, signals: Floats, scaled: Floats) -> npt.NDArray[np.bool_]:
    """In which records of a stack (..., channels, n) `tuned` may find other frequencies of the mains."""
    if not (basis.mains and basis.slopes):
        return np.zeros(signals.shape[:-2], bool)
    if basis.time[-1] - basis.time[0] > LONG:
        return np.ones(signals.shape[:-2], bool)
    return np.asarray(_off(_InMemory(signals), basis, scaled).any(axis=-1))


def _off(record: RecordWithHum, basis: SineColumns, scaled: Floats) -> Floats:
    """Difference (..., mains) [Hz] of the mains from the frequency of their columns; 0: no difference can be told."""
    hum, slope = basis.phasors(scaled)
    deviation = record.deviation(basis, scaled)[..., np.newaxis, :]
    power = (np.abs(hum / deviation) ** 2).sum(axis=-1)
    shown = power > SEEN**2 * scaled.shape[-1]
    half = basis.time[-1]
    # hum (1 + i δ t) turns by δ; all channels share the frequency of the mains.
    turned = ((slope / deviation) * (hum / deviation).conj()).imag.sum(axis=-1)
    rate = np.divide(turned, power, out=np.zeros_like(power), where=shown)
    turned_u = np.sqrt(np.divide(3.0, power, out=np.zeros_like(power), where=shown)) / half
    needed = shown & (np.abs(rate) * half > CENTRED) & (np.abs(rate) > SURE * turned_u)
    return np.where(needed, rate / (2 * np.pi), 0.0)


def deviation(squares: Floats, samples: int, columns: int, largest: Floats) -> Floats:
    """Standard deviation (..., channels) [V] of a fitted amplitude.

    Args:
        squares: sum of the squares of the residuals (..., channels) [V²].
        samples, columns: numbers of samples and of columns.
        largest: greatest absolute value of each signal (..., channels) [V].
    """
    return above_round_off(np.sqrt(2 * squares / max(samples - columns, 1) / samples), largest)


def above_round_off(deviation: Floats, largest: Floats) -> Floats:
    """The deviation, at least that of round-off: the residuals of a record without noise are no hum."""
    least = np.where(largest > 0, ROUND_OFF * largest, 1.0)
    found: Floats = np.maximum(deviation, least)
    return found


def _searched(record: RecordWithHum, basis: SineColumns, scaled: Floats) -> tuple[SineColumns, Floats]:
    """Columns and coefficients with each of the mains at the frequency of greatest power, where that is hum."""
    deviation, hums = record.demodulated(basis, scaled)
    found = []
    for mains, turned in zip(basis.mains, hums, strict=True):
        size = PADDED * turned.shape[1]
        power = ((np.abs(np.fft.fft(turned, size, axis=1)) / deviation[:, np.newaxis]) ** 2).sum(axis=0)
        off = np.fft.fftfreq(size, BLOCK)
        power[np.abs(off) > FARTHEST] = 0.0
        most = int(power.argmax())
        found.append(mains + (float(off[most]) if power[most] > SEEN**2 * len(turned) else 0.0))
    return (basis, scaled) if tuple(found) == basis.mains else record.at(basis, found)
