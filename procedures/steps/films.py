"""The films of a sensor: setting them up, waiting until they have settled, recording and fitting them together."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, nullcontext
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from palpate.drivers.roles import SamplesInPieces, SensorNode
from palpate.instrument.arrays import Floats
from palpate.instrument.bench.kinds import frequency_step
from palpate.instrument.contracts.own import CHANNELS, HEADROOM, LONGEST_WHOLE, place
from palpate.instrument.errors import ConfigError, DeviceError, EstimateError, RangeError
from palpate.instrument.quantity import counted
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.estimate import SineFit, fit_pieces, fit_sine, joined, sine_columns
from palpate.procedures.records.record import StoredDwell
from palpate.procedures.records.record_file import IN_A_FRAME, InPieces

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench
    from palpate.drivers.devices.sensor_node import Recording
    from palpate.procedures.records.record import Recorder

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
LOAD = "load"  # name of the waveform of the load indicator's output; no film can have it


@dataclass(frozen=True, slots=True, eq=False)
class FilmRecord:
    """Recordings of all films at the same times. Films are in the order of the design.

    Attributes:
        rate: sample rate [Hz].
        time: times of the samples (n,) [s].
        voltage: voltages (films, n) [V].
        clipped: whether a sample reached the end of the converter's range (films, n).
        load: the load indicator's output, as if it were one film; None: no channel samples it.
    """

    rate: float
    time: Floats
    voltage: Floats
    clipped: npt.NDArray[np.bool_]
    load: FilmRecord | None = None

    @classmethod
    def joined(cls, pieces: Sequence[FilmRecord]) -> FilmRecord:
        """One record of pieces that follow each other."""
        time, voltage, clipped = (
            np.concatenate(parts, axis=-1)
            for parts in zip(*((each.time, each.voltage, each.clipped) for each in pieces), strict=True)
        )
        loads = [each.load for each in pieces if each.load]
        return cls(pieces[0].rate, time, voltage, clipped, cls.joined(loads) if loads else None)

    @property
    def clips(self) -> npt.NDArray[np.bool_]:
        """Whether a film has a clipped sample (films,)."""
        return np.asarray(self.clipped.any(axis=1))

    @property
    def gaps(self) -> npt.NDArray[np.bool_]:
        """Whether a film has a sample that is not finite (films,)."""
        return np.asarray(~np.isfinite(self.voltage).all(axis=1))

    @property
    def silent(self) -> npt.NDArray[np.bool_]:
        """Whether a film has no finite sample (films,)."""
        return np.asarray(~np.isfinite(self.voltage).any(axis=1))

    def usable(self, clipped: bool) -> tuple[Floats, Floats]:
        """Times and voltages of the samples that are finite in every film, with those that are clipped or without."""
        used = np.isfinite(self.voltage).all(axis=0)
        if not clipped:
            used &= ~self.clipped.any(axis=0)
        return self.time[used], self.voltage[:, used]

    def fit(self, frequency: float, clipped: bool) -> SineFit:
        """Fit by the usable samples."""
        return fit_sine(*self.usable(clipped), frequency)

    @property
    def samples(self) -> int:
        """Number of samples of each film."""
        return self.time.size

    def between(self, samples: int) -> float:
        """Time from the middle of its first so many samples to the middle of its last [s]."""
        return float(self.time[-samples:].mean() - self.time[:samples].mean())

    def waveforms(self, names: Sequence[str]) -> dict[str, tuple[float, np.ndarray]]:
        """Sample rate [Hz] and voltages [V] of each film by its name, and of the load, for the record."""
        films = {name: (self.rate, volts) for name, volts in zip(names, self.voltage, strict=True)}
        return {**films, **(self.load.waveforms([LOAD]) if self.load else {})}

    def first(self, duration: float) -> FilmRecord:
        """The first part of the record, of a duration [s]."""
        return self.part(slice(round(duration * self.rate)))

    def last(self, duration: float) -> FilmRecord:
        """The last part of the record, of a duration [s]."""
        return self.part(slice(-round(duration * self.rate), None))

    def part(self, samples: slice) -> FilmRecord:
        """Some of the samples."""
        load = self.load and self.load.part(samples)
        return FilmRecord(self.rate, self.time[samples], self.voltage[:, samples], self.clipped[:, samples], load)


class LongFilmRecord:
    """Recordings of all films over a long dwell. They stand in the record of the run, and are read from there.

    It does what a `FilmRecord` does, but only a piece of it is in memory at once.

    Attributes:
        rate: sample rate [Hz].
        samples: number of samples of each film.
        clips, gaps, silent: as those of a `FilmRecord` (films,).
        load: as that of a `FilmRecord`.
    """

    def __init__(self, dwell: StoredDwell, names: Sequence[str], load: bool = False) -> None:
        """Begin with no sample, in a dwell that was just begun; `load`: whether it has the load indicator's output."""
        self.load = LongFilmRecord(dwell, [LOAD]) if load else None
        self._dwell, self._names = dwell, names
        self._clipped: dict[int, npt.NDArray[np.bool_]] = {}  # (films, k) of pieces with clipped samples
        self._part: tuple[int, int] | None = None
        self.rate = 0.0
        self.clips, self.gaps, self.silent = (np.full(len(names), value) for value in (False, False, True))

    def add(self, piece: FilmRecord) -> None:
        """Store the next piece. Raises RecordError: it cannot be stored."""
        for at in range(0, piece.samples, IN_A_FRAME):
            part = piece.part(slice(at, at + IN_A_FRAME))
            self._note(part)
            self._dwell.add(part.waveforms(self._names))

    def _note(self, part: FilmRecord) -> None:
        """Keep what the samples that are stored next do not tell themselves."""
        self.rate = part.rate
        self.clips, self.gaps = self.clips | part.clips, self.gaps | part.gaps
        self.silent = self.silent & part.silent
        if part.clipped.any():
            self._clipped[self._dwell.samples] = part.clipped
        if self.load and part.load:
            self.load._note(part.load)

    @property
    def samples(self) -> int:
        first, end = self._ends
        return end - first

    @property
    def _ends(self) -> tuple[int, int]:
        return self._part or (0, self._dwell.samples)

    def first(self, duration: float) -> LongFilmRecord:
        """The first part of the record, of a duration [s]."""
        first, _ = self._ends
        return self._of(first, first + round(duration * self.rate))

    def last(self, duration: float) -> LongFilmRecord:
        """The last part of the record, of a duration [s]."""
        _, end = self._ends
        return self._of(end - round(duration * self.rate), end)

    def _of(self, first: int, end: int) -> LongFilmRecord:
        part = copy(self)
        part._part = first, end
        return part

    def usable(self, clipped: bool) -> tuple[Floats, Floats]:
        """The same as of a `FilmRecord`, all in memory."""
        return joined(self._pieces(clipped))

    def _pieces(self, clipped: bool) -> Iterator[tuple[Floats, Floats]]:
        first, end = self._ends
        for at, stored in self._dwell.pieces():
            if at >= end:
                return
            volts = np.array([stored[name] for name in self._names], dtype=np.float64)
            numbers = np.arange(at, at + volts.shape[1])
            used = (numbers >= first) & (numbers < end) & np.isfinite(volts).all(axis=0)
            if not clipped and at in self._clipped:
                used &= ~self._clipped[at].any(axis=0)
            if used.any():
                yield (numbers[used] + 1) / self.rate, volts[:, used]

    def fit(self, frequency: float, clipped: bool) -> SineFit:
        """Fit by the usable samples."""
        return fit_pieces(lambda: self._pieces(clipped), frequency)

    def between(self, samples: int) -> float:
        """Time from the middle of its first so many samples to the middle of its last [s]."""
        return (self.samples - samples) / self.rate

    def waveforms(self, names: Sequence[str]) -> dict[str, tuple[float, InPieces]]:
        """The waveforms for the record, which has them already."""
        every = [*names, LOAD] if self.load else names
        return {name: (self.rate, InPieces(self._dwell.number, self._dwell.samples)) for name in every}


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


def nodes_for(design: Design, channels: int = CHANNELS, load: int | None = None) -> int:
    """How many sensor nodes of so many channels the films of a design need, and the channel that samples the load."""
    return max(place(channel, channels)[0] for channel in (*(film.channel for film in design.films), load or 1))


def check_nodes(design: Design, nodes: int, channels: int = CHANNELS, load: int | None = None) -> None:
    """Refuse a bench that has fewer sensor nodes of so many channels than `nodes_for` tells. Raises RangeError."""
    needed = nodes_for(design, channels, load)
    if nodes < needed:
        films = f"{len(design.films)} films" + (f" and load_channel {load}" if load else "")
        raise RangeError(
            f"design {design.name!r} has {films} on {counted(needed, 'sensor node')} of {channels} "
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
        load = bench.description.load_channel
        check_nodes(design, len(nodes), channels, load)
        self.bench, self.design, self.frequency = bench, design, frequency
        self._nodes = nodes[: nodes_for(design, channels, load)]
        if several := {type(node) for node in self._nodes} - {type(nodes[0])}:
            raise ConfigError(
                f"films are sampled together by nodes of one kind; the bench has {type(nodes[0]).__name__} and "
                f'{several.pop().__name__}: write role = "sensor_node" below those of one kind in the bench file'
            )
        wired = [film.channel for film in design.films] + ([] if load is None else [load])
        places = [(node - 1, channel) for node, channel in (place(each, channels) for each in wired)]
        self._places, self._load = places[: len(design.films)], places[len(design.films) :]
        self._ranges: dict[int, str] = {}
        ranges = nodes[0].ranges
        self._widest, finest = (choose(ranges, key=ranges.__getitem__) for choose in (max, min))
        self.set_frequency(frequency)
        for number, film in enumerate(design.films):
            fits = HEADROOM * film.sensitivity * largest <= ranges[finest]
            self._set_range(number, finest if fits else self._widest)
        for node, channel in self._load:  # whose noise is larger than its steps there
            self._nodes[node].set_range(channel, self._widest)

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

    def widen(self, record: FilmRecord | LongFilmRecord) -> None:
        """Set the widest range for the films that clipped in a record."""
        for film, clips in enumerate(record.clips):
            if clips and self._ranges[film] != self._widest:
                self._set_range(film, self._widest)

    def acquire(self, duration: float) -> FilmRecord:
        """Record all films for a duration [s]. Raises LinkError, DeviceError."""
        return self._together(self._nodes[0].acquire_with(self._nodes[1:], duration))

    def recorded(self, duration: float, record: Recorder) -> FilmRecord | LongFilmRecord:
        """The same; what is recorded over a long dwell goes into the record of the run while the dwell lasts.

        It is stored once a minute, so that a kill costs no more of a long dwell than it would of a short one.
        """
        if duration <= LONGEST_WHOLE:
            return self.acquire(duration)
        first, others = self._nodes[0], self._nodes[1:]
        found = LongFilmRecord(record.begin_dwell(), self._names, load=bool(self._load))
        held: list[FilmRecord] = []
        with (
            closing(first.pieces_with(others, duration))
            if isinstance(first, SamplesInPieces)
            else nullcontext([first.acquire_with(others, duration)])
        ) as pieces:
            for recordings in pieces:
                held.append(self._together(recordings))
                if sum(piece.samples for piece in held) >= LONGEST_WHOLE * held[0].rate:
                    found.add(FilmRecord.joined(held))
                    held = []
        if held:
            found.add(FilmRecord.joined(held))
        return found

    def _together(self, recordings: Sequence[Recording]) -> FilmRecord:
        load = _taken(recordings, self._load) if self._load else None
        found = replace(_taken(recordings, self._places), load=load)
        waves = found.waveforms(self._names)
        shown = {"films": list(waves), "rate": found.rate, "voltage": np.array([volts for _, volts in waves.values()])}
        self.bench.sampled(self.bench.clock.read_ns, shown)
        return found

    @property
    def _names(self) -> list[str]:
        return [film.name for film in self.design.films]

    def steps(self) -> Floats:
        """Steps of the converter on the ranges that are set (films,) [V]."""
        return np.array([self._nodes[node].resolution(channel) for node, channel in self._places])

    def emergencies(self) -> int:
        """How many emergencies the nodes have sent so far."""
        return sum(len(node.emergencies) for node in self._nodes)

    def fit(self, record: FilmRecord | LongFilmRecord) -> SineFit:
        """Fit a sine to each film, by the samples that are good in every film.

        Where those are too few, all samples that are finite in every film are used.

        Raises:
            DeviceError: a film gives no finite samples.
            EstimateError: there are too few samples for a sine.
        """
        if record.silent.any():
            film = self.design.films[int(record.silent.argmax())]
            raise DeviceError(f"film {film.name!r} on channel {film.channel} gives no finite samples; check its node")
        try:
            return record.fit(self.frequency, clipped=False)
        except EstimateError:
            if not (record.clips.any() or record.gaps.any()):
                raise
            return record.fit(self.frequency, clipped=True)

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


def _taken(recordings: Sequence[Recording], places: Sequence[tuple[int, int]]) -> FilmRecord:
    """What some channels have sampled, each given by its node and its number on it."""
    first = recordings[0]
    voltage, clipped = (
        np.array([getattr(recordings[node], name)[channel - 1] for node, channel in places])
        for name in ("voltage", "saturated")
    )
    return FilmRecord(first.rate, first.time, voltage, clipped)


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
