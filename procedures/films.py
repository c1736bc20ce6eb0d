"""One point at the present load: the films settle, are recorded, fitted and judged; what is flagged is repeated.

films = Films(bench, design, frequency=10.0, largest=4.0)
...                                     # mount, preload, drive
servo.set(3.0)
point = measure(films, servo, 3.0, dwell=1.0, record=record)
point.fit.amplitude, point.flags, film_forces(design, point.fit).force_ratio
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from drivers.bench import Bench
from drivers.sensor_node import SensorNode, acquire
from instrument.contracts.sensor_node import RANGE_VOLTS, RANGES, place
from instrument.design import Design
from instrument.dwell import Dwell
from instrument.errors import DeviceError, EstimateError, RangeError
from instrument.estimate import SineFit, fit_sine
from procedures.policy import ATTEMPTS, carry_out
from procedures.record import Recorder
from procedures.servo import READINGS, LoadServo

SAMPLES_PER_CYCLE = 25
HEADROOM = 1.5
WIDE, SENSITIVE = RANGES
SHORT_RECORD = 0.2  # s, and whole cycles, two or more
SETTLING_LIMIT = 30.0  # s, and ten short records or more
AGREEMENT = 3.0  # standard uncertainties that two short records may differ by
BEND = 0.1  # of a standard uncertainty, that a change of trend may leave in an amplitude
FINEST_CHANGE = 1e-4  # of the amplitude: what is smaller counts as settled [A]
LARGEST_DRIFT = 0.1  # of the load, by the end of the dwell; never finer than two steps of the indicator
CLIPPED, NOT_FINITE, UNSETTLED, FAULT, DRIFTED = "clipped", "not finite", "unsettled", "fault", "drifted"

Floats = npt.NDArray[np.float64]
DwellChoice = Callable[[SineFit], Dwell]


@dataclass(frozen=True, slots=True, eq=False)
class FilmRecord:
    """What all films of a design gave together, in its order.

    time: (n,) s. voltage: (films, n) V. clipped, good: (films, n); a good sample is finite and not clipped.
    """

    rate: float
    time: Floats
    voltage: Floats
    clipped: npt.NDArray[np.bool_]

    @property
    def good(self) -> npt.NDArray[np.bool_]:
        good: npt.NDArray[np.bool_] = np.isfinite(self.voltage) & ~self.clipped
        return good


@dataclass(frozen=True, slots=True, eq=False)
class FilmPoint:
    """The films under one load, as the last attempt has them.

    Attributes:
        load_N, load_u: by the load cell after the dwell, peak to peak; `indicator_mV` is its reading.
        fit: of all films in the design's order, by the good samples alone where they suffice.
        dwell, settling: that the attempt took [s].
        predicted_u: relative standard uncertainty that the dwell was chosen for; None: it was not chosen.
        attempts: how many there were.
        flags: why the last one is not to be used; empty: it is.
        incidents: how often something went wrong on the bench since the point before and was made good.
    """

    load_N: float
    load_u: float
    indicator_mV: float
    fit: SineFit
    record: FilmRecord
    dwell: float
    predicted_u: float | None
    settling: float
    attempts: int
    flags: tuple[str, ...]
    incidents: int = 0

    @property
    def valid(self) -> bool:
        return not self.flags

    def waveforms(self, design: Design) -> dict[str, tuple[float, Floats]]:
        """For the record: rate and samples of each film by its name."""
        return {
            film.name: (self.record.rate, volts) for film, volts in zip(design.films, self.record.voltage, strict=True)
        }


def nodes_for(design: Design) -> int:
    """How many sensor nodes its films fill."""
    return max(place(film.channel)[0] for film in design.films)


def check_nodes(design: Design, nodes: int) -> None:
    """Refuse a bench that has fewer nodes than the films fill. Raises RangeError."""
    if nodes < nodes_for(design):
        raise RangeError(
            f"design {design.name!r} has {len(design.films)} films on {nodes_for(design)} sensor nodes; the bench has "
            f"{nodes}; list them all under [can] in the bench file"
        )


class Films:
    """The films of a design on the nodes of a bench: sample rate, ranges, and recordings of all together."""

    def __init__(self, bench: Bench, design: Design, frequency: float, largest: float) -> None:
        """Set the sample rate, and ranges for forces up to `largest` N, peak.

        Raises:
            RangeError: the bench has too few nodes; nothing is sent.
        """
        check_nodes(design, len(bench.nodes))
        self.bench, self.design, self.frequency = bench, design, frequency
        self._nodes: list[SensorNode] = bench.nodes[: nodes_for(design)]
        self._places = [(node - 1, channel) for node, channel in (place(film.channel) for film in design.films)]
        self._ranges: dict[int, str] = {}
        self.set_frequency(frequency)
        for number, film in enumerate(design.films):
            fits = HEADROOM * film.sensitivity * largest <= RANGE_VOLTS[RANGES[SENSITIVE]]
            self._set_range(number, SENSITIVE if fits else WIDE)

    def set_frequency(self, frequency: float) -> None:
        """The drive's, in Hz: records are of 25 samples a cycle."""
        self.frequency = frequency
        self._nodes[0].set_sample_rate(SAMPLES_PER_CYCLE * frequency)

    def _set_range(self, film: int, range_: str) -> None:
        node, channel = self._places[film]
        self._nodes[node].set_range(channel, range_)
        self._ranges[film] = range_

    def widen(self, record: FilmRecord) -> None:
        """Put the films that clipped on the wide range."""
        for film, clipped in enumerate(record.clipped):
            if clipped.any() and self._ranges[film] != WIDE:
                self._set_range(film, WIDE)

    def acquire(self, duration: float) -> FilmRecord:
        """Record all films for `duration` s. Raises LinkError, DeviceError."""
        recordings = acquire(self._nodes, duration)
        first = recordings[0]
        return FilmRecord(
            first.rate,
            first.time,
            np.array([recordings[node].voltage[channel - 1] for node, channel in self._places]),
            np.array([recordings[node].saturated[channel - 1] for node, channel in self._places]),
        )

    def emergencies(self) -> int:
        """How many the nodes have sent so far."""
        return sum(len(node.emergencies) for node in self._nodes)

    def fit(self, record: FilmRecord) -> SineFit:
        """By the samples that are good in every film; by all that are finite where those are too few.

        Raises:
            DeviceError: a film gives no finite samples.
            EstimateError: too few samples for a sine.
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

    def settle(self, watch: Callable[[], object]) -> tuple[SineFit, float, bool]:
        """Wait until short records agree; `watch` is called between them.

        Two that follow each other must have the same amplitudes within their uncertainty. What still decays shows
        sooner in the trend: where it changes by Δ from one record to the next, T apart, the signal is curved, and over
        whole cycles an amplitude is off by 2 Δ/(T ω²).

        Returns:
            The last short record's fit, the time taken [s], and whether it did settle within the limit.
        """
        cycles = max(2, math.ceil(SHORT_RECORD * self.frequency - 1e-9))
        length = cycles / self.frequency
        began = self.bench.clock.now_ns()
        limit = max(SETTLING_LIMIT, 10 * length)
        before: tuple[int, SineFit] | None = None
        while True:
            start = self.bench.clock.now_ns()
            fit = self.fit(self.acquire(length))
            watch()
            took = self.bench.clock.now_ns() - began
            settled = before is not None and _agree(before[1], fit, 1e-9 * (start - before[0]))
            if settled or took >= 1e9 * limit:
                return fit, 1e-9 * took, settled
            before = start, fit


def measure(
    films: Films,
    servo: LoadServo,
    load: float,
    dwell: float | DwellChoice,
    record: Recorder,
    what: str = "",
) -> FilmPoint:
    """The point at the present load, `load` N peak to peak, which `servo` has set.

    A flagged attempt is rejected, with an event of the record that says why, and repeated: clipped films on the wide
    range, a load that drifted off set anew. After `ATTEMPTS` the last one stands, with its flags.

    Args:
        dwell: s, or how to choose it from the fit of the last short record.
        what: names the point in events.

    Raises:
        SafetyError, DeviceError, LinkError, UnreachableError: the bench could not.
        EstimateError: the dwell gives no estimate.
    """
    named = what or f"{load:g} N"
    for attempt in range(1, ATTEMPTS + 1):
        point = carry_out(
            films.bench,
            named,
            lambda attempt=attempt: _attempt(films, servo, load, dwell, attempt),  # type: ignore[misc]
            again=lambda: servo.set(load),
        )
        if point.valid or attempt == ATTEMPTS:
            break
        record.event(
            "rejected",
            f"{named}, attempt {attempt}: {', '.join(point.flags)}",
            films.bench.clock.now_ns(),
        )
        films.widen(point.record)
        if DRIFTED in point.flags:
            carry_out(films.bench, named, lambda: servo.set(load))
    return replace(point, incidents=films.bench.incidents.new())


def _attempt(films: Films, servo: LoadServo, load: float, dwell: float | DwellChoice, attempt: int) -> FilmPoint:
    short, settling, settled = films.settle(servo.watch)
    heard = films.emergencies()
    duration, predicted_u = (dwell, None) if isinstance(dwell, float) else _chosen(dwell(short))
    record = films.acquire(duration)
    reading = servo.read()
    films.bench.amplifier.check()
    measured, measured_u = servo.calibration.load(reading.reading_mV, READINGS)
    faults = {
        CLIPPED: record.clipped.any(),
        NOT_FINITE: not np.isfinite(record.voltage).all(),
        UNSETTLED: not settled,
        FAULT: films.emergencies() > heard and not record.clipped.any(),
        DRIFTED: not abs(measured - load) <= max(LARGEST_DRIFT * load, 2 * servo.calibration.resolution()),
    }
    return FilmPoint(
        load_N=measured,
        load_u=measured_u,
        indicator_mV=reading.reading_mV,
        fit=films.fit(record),
        record=record,
        dwell=duration,
        predicted_u=predicted_u,
        settling=settling,
        attempts=attempt,
        flags=tuple(flag for flag, raised in faults.items() if raised),
    )


def _chosen(dwell: Dwell) -> tuple[float, float]:
    return dwell.dwell, dwell.u


def _agree(before: SineFit, after: SineFit, gap: float) -> bool:
    """Whether two short records, begun `gap` s apart, are of a settled signal."""
    finest = FINEST_CHANGE * after.amplitude
    step = np.abs(after.amplitude - before.amplitude)
    step_u = np.hypot(before.amplitude_u, after.amplitude_u)
    bend = 2 * np.abs(after.trend - before.trend) / gap / (2 * np.pi * after.frequency) ** 2
    return bool(
        np.all(step <= np.maximum(AGREEMENT * step_u, finest))
        and np.all(bend <= np.maximum(BEND * after.amplitude_u, finest))
    )
