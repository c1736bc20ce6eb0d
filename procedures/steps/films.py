"""The films of a sensor: setting them up, waiting until they have settled, recording and fitting them together."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from palpate.drivers.roles import SensorNode
from palpate.instrument.bench.kinds import frequency_step
from palpate.instrument.contracts.sensor_node import CHANNELS, HEADROOM, place
from palpate.instrument.errors import ConfigError, DeviceError, EstimateError, RangeError
from palpate.instrument.quantity import counted
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.estimate import SineFit, fit_sine
from palpate.instrument.signals.sine_columns import sine_columns

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench

SAMPLES_PER_CYCLE = 25
SHORT_RECORD = 0.2  # s, rounded up to whole cycles, two at least
NOISE_BENDS = 10.0  # standard deviations of a bend that white noise feigns; 1/f noise feigns three times as much
LONGER_RECORD = 1.0  # s, rounded up to whole cycles: used where short records do not show what would spoil the dwell
SETTLING_LIMIT = 30.0  # s, or ten records if they take longer
AGREEMENT = 3.0  # standard uncertainties that two short records may differ by
BEND = 0.1  # error that a bend may leave in an amplitude, as a part of its standard uncertainty
LONGEST_BENT = 10_000  # samples; in longer records a decay is a small part of the record
FINEST_CHANGE = 1e-4  # of the amplitude; a smaller change counts as settled [A]
FINER_CHANGE = 1e-6  # the same where longer records are compared
CHARGE_AMPLIFIER = 1.0  # s, time constant with which offsets decay [A]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FilmRecord:
    """Recordings of all films at the same times. Films are in the order of the design.

    Attributes:
        rate: sample rate [Hz].
        time: times of the samples (n,) [s].
        voltage: voltages (films, n) [V].
        clipped: whether a sample reached the end of the converter's range (films, n).
    """

    rate: float
    time: Floats
    voltage: Floats
    clipped: npt.NDArray[np.bool_]

    @property
    def good(self) -> npt.NDArray[np.bool_]:
        """Whether a sample is finite and not clipped (films, n)."""
        good: npt.NDArray[np.bool_] = np.isfinite(self.voltage) & ~self.clipped
        return good

    def first(self, duration: float) -> FilmRecord:
        """The first part of the record, of a duration [s]."""
        n = round(duration * self.rate)
        return FilmRecord(self.rate, self.time[:n], self.voltage[:, :n], self.clipped[:, :n])

    def last(self, duration: float) -> FilmRecord:
        """The last part of the record, of a duration [s]."""
        n = round(duration * self.rate)
        return FilmRecord(self.rate, self.time[-n:], self.voltage[:, -n:], self.clipped[:, -n:])


def short_length(frequency: float) -> float:
    """Length of a short record, by which films are seen to settle, at a frequency [Hz]: whole cycles [s]."""
    return max(2, math.ceil(SHORT_RECORD * frequency - 1e-9)) / frequency


def settling_length(frequency: float, dwell: float | None = None) -> float:
    """Length of the records that are compared before a dwell [s] at a frequency [Hz], in whole cycles [s].

    Noise in a record looks like a bend. Short records serve where the error from that is less than twice what a bend
    may leave in an amplitude; else longer ones are needed.
    """
    short = short_length(frequency)
    if dwell is None:
        return short
    if _bend_noise(frequency, dwell, short) <= 2 * BEND * min(1.0, math.sqrt(short / dwell)):
        return short
    return max(short, math.ceil(LONGER_RECORD * frequency - 1e-9) / frequency)


def _bend_noise(frequency: float, dwell: float, length: float) -> float:
    """Error of an amplitude from white noise that records of a length [s] show as a bend, over its uncertainty."""
    return math.sqrt(12) * bend_leak(frequency, dwell) / length**2


@functools.lru_cache(maxsize=256)
def bend_leak(frequency: float, dwell: float | None) -> float:
    """Error of an amplitude from a signal that bends by 1 V/s² when a dwell [s] begins [V].

    The larger of two errors is returned: of a bend that stays, over whole cycles, and of one that decays with the time
    constant of the charge amplifiers.
    """
    whole = 2 / (2 * math.pi * frequency) ** 2
    rate = SAMPLES_PER_CYCLE * frequency
    if dwell is None or dwell * rate > LONGEST_BENT:
        return whole
    basis = sine_columns(np.arange(round(dwell * rate)) / rate, frequency)
    decaying = CHARGE_AMPLIFIER**2 * np.exp((basis.time[0] - basis.time) / CHARGE_AMPLIFIER)
    return max(whole, float(np.linalg.norm(basis.weights() @ decaying)))


def nodes_for(design: Design, channels: int = CHANNELS) -> int:
    """How many sensor nodes of so many channels the films of a design need."""
    return max(place(film.channel, channels)[0] for film in design.films)


def check_nodes(design: Design, nodes: int, channels: int = CHANNELS) -> None:
    """Refuse a bench that has fewer sensor nodes of so many channels than the films need. Raises RangeError."""
    needed = nodes_for(design, channels)
    if nodes < needed:
        raise RangeError(
            f"design {design.name!r} has {len(design.films)} films on {counted(needed, 'sensor node')} of {channels} "
            f"channels; the bench has {nodes}; list them all in the bench file"
        )


class Films:
    """The films of a sensor on the nodes of a bench, with one sample rate, a range each, and common recordings."""

    def __init__(self, bench: Bench, design: Design, frequency: float, largest: float) -> None:
        """Set the sample rate and the ranges.

        Args:
            bench: the open bench.
            design: design of the sensor.
            frequency: frequency of the drive [Hz].
            largest: largest force on the sensor [N].

        Raises:
            RangeError: the bench has too few sensor nodes; nothing has been sent.
            ConfigError: the nodes are of several kinds; nothing has been sent.
        """
        nodes = bench.all(SensorNode)
        channels = bench.named(nodes[0]).kind.channels if nodes else CHANNELS
        check_nodes(design, len(nodes), channels)
        self.bench, self.design, self.frequency = bench, design, frequency
        self._nodes = nodes[: nodes_for(design, channels)]
        if several := {type(node) for node in self._nodes} - {type(nodes[0])}:
            raise ConfigError(
                f"films are sampled together by nodes of one kind; the bench has {type(nodes[0]).__name__} and "
                f'{several.pop().__name__}: write role = "sensor_node" below those of one kind in the bench file'
            )
        self._places = [
            (node - 1, channel) for node, channel in (place(film.channel, channels) for film in design.films)
        ]
        self._ranges: dict[int, str] = {}
        ranges = nodes[0].ranges
        self._widest, finest = (choose(ranges, key=ranges.__getitem__) for choose in (max, min))
        self.set_frequency(frequency)
        for number, film in enumerate(design.films):
            fits = HEADROOM * film.sensitivity * largest <= ranges[finest]
            self._set_range(number, finest if fits else self._widest)

    @property
    def frequency_step(self) -> float:
        """Step to which the bench rounds the drive's frequency [Hz]; 0: its kinds do not say."""
        return frequency_step(self.bench.description.kind_in) or 0.0

    def set_frequency(self, frequency: float) -> None:
        """Set the frequency of the drive [Hz]. The nodes then take 25 samples a cycle."""
        self.frequency = frequency
        self._nodes[0].set_sample_rate(SAMPLES_PER_CYCLE * frequency)

    def _set_range(self, film: int, range_: str) -> None:
        node, channel = self._places[film]
        self._nodes[node].set_range(channel, range_)
        self._ranges[film] = range_

    def widen(self, record: FilmRecord) -> None:
        """Set the widest range for the films that clipped in a record."""
        for film, clipped in enumerate(record.clipped):
            if clipped.any() and self._ranges[film] != self._widest:
                self._set_range(film, self._widest)

    def acquire(self, duration: float) -> FilmRecord:
        """Record all films for a duration [s]. Raises LinkError, DeviceError."""
        recordings = self._nodes[0].acquire_with(self._nodes[1:], duration)
        first = recordings[0]
        voltage = np.array([recordings[node].voltage[channel - 1] for node, channel in self._places])
        shown = {"films": [film.name for film in self.design.films], "rate": first.rate, "voltage": voltage}
        self.bench.sampled(self.bench.clock.read_ns, shown)
        clipped = np.array([recordings[node].saturated[channel - 1] for node, channel in self._places])
        return FilmRecord(first.rate, first.time, voltage, clipped)

    def steps(self) -> Floats:
        """Steps of the converter on the ranges that are set (films,) [V]."""
        return np.array([self._nodes[node].resolution(channel) for node, channel in self._places])

    def emergencies(self) -> int:
        """How many emergencies the nodes have sent so far."""
        return sum(len(node.emergencies) for node in self._nodes)

    def fit(self, record: FilmRecord) -> SineFit:
        """Fit a sine to each film, by the samples that are good in every film.

        Where those are too few, all samples that are finite in every film are used.

        Raises:
            DeviceError: a film gives no finite samples.
            EstimateError: there are too few samples for a sine.
        """
        good, finite = record.good.all(axis=0), np.isfinite(record.voltage).all(axis=0)
        if not finite.any():
            dead = next(i for i, volts in enumerate(record.voltage) if not np.isfinite(volts).any())
            film = self.design.films[dead]
            raise DeviceError(f"film {film.name!r} on channel {film.channel} gives no finite samples; check its node")
        try:
            return fit_sine(record.time[good], record.voltage[:, good], self.frequency)
        except EstimateError:
            if good.all():
                raise
            return fit_sine(record.time[finite], record.voltage[:, finite], self.frequency)

    def settle(self, watch: Callable[[], object], dwell: float | None = None) -> tuple[SineFit, float, bool]:
        """Wait until two successive records agree.

        They must have the same amplitudes within their uncertainty. A decay shows sooner in the trend: if the trend
        changes by Δ between two records that begin T apart, the signal is curved, and an amplitude over whole cycles is
        wrong by 2 Δ/(T ω²), over ten seconds or broken cycles by up to ten times as much. That error must be small
        beside the uncertainty of the dwell that follows.

        Args:
            watch: is called after each record, and raises where the bench must stop.
            dwell: length of the record that follows [s]; None: it is of whole cycles.

        Returns:
            The fit of the last record, the time that it took [s], and whether the films settled within the limit.
        """
        length = settling_length(self.frequency, dwell)
        began = self.bench.clock.now_ns()
        limit = max(SETTLING_LIMIT, 10 * length)
        bent = bend_leak(self.frequency, dwell)
        allowed, finest = BEND, FINEST_CHANGE
        if dwell is not None and length > short_length(self.frequency):
            seen = NOISE_BENDS * _bend_noise(self.frequency, dwell, length)
            allowed, finest = max(BEND * math.sqrt(length / dwell), seen), FINER_CHANGE
        before: tuple[int, SineFit] | None = None
        while True:
            start = self.bench.clock.now_ns()
            fit = self.fit(self.acquire(length))
            watch()
            took = self.bench.clock.now_ns() - began
            settled = before is not None and _agree(before[1], fit, 1e-9 * (start - before[0]), bent, allowed, finest)
            if settled or took >= 1e9 * limit:
                return fit, 1e-9 * took, settled
            before = start, fit


def _agree(before: SineFit, after: SineFit, gap: float, bent: float, allowed: float, finest: float) -> bool:
    """Whether two records show a settled signal.

    Args:
        before: fit of the first record.
        after: fit of the second record.
        gap: time between the beginnings of the records [s].
        bent: error of an amplitude by a bend, as `bend_leak` returns it.
        allowed: error that a bend may leave in an amplitude, as a part of its uncertainty.
        finest: error by a bend that does not count, as a part of the amplitude.
    """
    step = np.abs(after.amplitude - before.amplitude)
    step_u = np.hypot(before.amplitude_u, after.amplitude_u)
    bend = bent * np.abs(after.trend - before.trend) / gap
    return bool(
        np.all(step <= np.maximum(AGREEMENT * step_u, FINEST_CHANGE * after.amplitude))
        and np.all(bend <= np.maximum(allowed * after.amplitude_u, finest * after.amplitude))
    )
