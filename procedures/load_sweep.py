"""Load-set sweep (thesis 5.4.1): each sample under each load, film voltages to forces to force ratio."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from drivers.bench import Bench
from drivers.sensor_node import Recording
from instrument.calibration import LoadCellCalibration
from instrument.contracts import signal_generator
from instrument.design import FILM_KINDS, Design
from instrument.errors import EstimateError, RangeError, UnreachableError
from instrument.estimate import amplitude_ratio, fit_sine
from instrument.quantity import parse, show
from instrument.sample import get_sample
from procedures.record import Recorder
from procedures.servo import LoadServo, check_zero, preload

PROCEDURE = "sweep-loads"
PRELOAD_MARGIN = 1.2  # of half the largest load, so that contact is never lost
SAMPLES_PER_CYCLE = 25
FREQUENCIES = (0.5, 100.0)  # Hz
FREQUENCY_STEP = signal_generator.CONTRACT["frequency"].scale  # Hz
LARGEST_DWELL = 3600.0  # s
LARGEST_COUNT = 1000  # loads
SMALLEST_LOAD = 2.0  # steps of the indicator
LARGEST_DRIFT = 0.1  # of the load, by the end of the dwell; never finer than two steps of the indicator
SETTLING = 5.0  # s, five time constants of the charge amplifier
SENSITIVE_RANGE, WIDE_RANGE = "500 mV", "5 V"
RANGES_V = {SENSITIVE_RANGE: 0.5, WIDE_RANGE: 5.0}
HEADROOM = 1.5

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, slots=True)
class SweepSettings:
    """What to sweep: names of samples, loads in N peak to peak, dwell in s, frequency in Hz."""

    samples: tuple[str, ...]
    loads: tuple[float, ...]
    dwell: float
    frequency: float


@dataclass(frozen=True, slots=True)
class LoadPoint:
    """One load set. Forces and voltages are peak to peak; `force_ratio_u` is a standard uncertainty.

    Not `valid`: a film was over-ranged, the node reported a fault, or the load drifted off during the dwell.
    """

    sample: str
    load_N: float
    indicator_mV: float
    load_measured_N: float
    load_measured_u: float
    voltage_rigid_V: float
    voltage_total_V: float
    force_rigid_N: float
    force_total_N: float
    force_ratio: float
    force_ratio_u: float
    noise_u: float
    condition: float
    valid: bool


@dataclass(frozen=True, slots=True)
class SampleMean:
    """Mean over the valid load sets of a sample, beside the thesis' own mean (None where it has none)."""

    sample: str
    force_ratio: float | None
    force_ratio_u: float | None
    valid_points: int
    thesis_force_ratio: float | None


@dataclass(frozen=True, slots=True)
class SweepResult:
    points: list[LoadPoint]
    samples: list[SampleMean]
    softness_order: list[str]

    def summary(self) -> dict[str, Any]:
        """The result without its points, for the record."""
        return {"samples": [asdict(s) for s in self.samples], "softness_order": self.softness_order}


def parse_loads(text: str) -> tuple[float, ...]:
    """Loads in N from "1.5 N:4 N:0.5 N" (first, last, step; the last is included) or "1.5 N, 2 N".

    Raises:
        QuantityError: not a force. RangeError: empty, not positive, not increasing, or over 1000 loads.
    """
    parts = text.split(":")
    if len(parts) == 3:
        first, last, step = (parse(part, "N") for part in parts)
        if not (step > 0 and last >= first):
            raise RangeError(f"loads {text!r}: give first:last:step with last >= first and step > 0")
        steps = (last - first) / step * (1 + 1e-12) + 1e-9
        if not steps < LARGEST_COUNT:
            raise RangeError(f"loads {text!r}: more than {LARGEST_COUNT} loads; take a larger step")
        loads = tuple(round(first + i * step, 12) for i in range(math.floor(steps) + 1))
    elif len(parts) == 1:
        loads = tuple(parse(part, "N") for part in text.split(","))
    else:
        raise RangeError(f"loads {text!r}: give first:last:step, such as '1.5 N:4 N:0.5 N', or a list with commas")
    if not all(load > 0 for load in loads) or list(loads) != sorted(set(loads)):
        raise RangeError(f"loads {text!r}: loads must be above zero, increasing and distinct")
    return loads


def preload_for(loads: Sequence[float]) -> float:
    """Static force in N under which the largest load, N peak to peak, never lifts the probe."""
    return PRELOAD_MARGIN * max(loads) / 2


def check(settings: SweepSettings, design: Design, force_limit: float) -> None:
    """Refuse what cannot be done, before any device is spoken to.

    Raises:
        RangeError: a load beyond the force limit in N, a frequency or dwell that gives no estimate, a sensor of
            several teeth.
        UnknownName: an unknown sample.
    """
    if {film.name for film in design.films} != set(FILM_KINDS):
        raise RangeError(
            f"design {design.name!r} has {len(design.teeth)} teeth; a load sweep measures"
            " one tooth; take a design with the films 'rigid' and 'total', such as 'single'"
        )
    for sample in settings.samples:
        get_sample(sample)
    largest = max(settings.loads)
    peak = preload_for(settings.loads) + largest / 2
    if peak > force_limit:
        most = force_limit / (0.5 + PRELOAD_MARGIN / 2)
        raise RangeError(
            f"load {largest:g} N peak to peak takes a peak force of {peak:.3g} N with its preload, above the bench's "
            f"force limit of {force_limit:g} N; loads up to {most:.3g} N are possible"
        )
    if not FREQUENCIES[0] <= settings.frequency <= FREQUENCIES[1]:
        raise RangeError(f"frequency {settings.frequency:g} Hz is outside {FREQUENCIES[0]:g} to {FREQUENCIES[1]:g} Hz")
    steps = round(settings.frequency / FREQUENCY_STEP)
    if abs(settings.frequency - steps * FREQUENCY_STEP) > 1e-6 * FREQUENCY_STEP:
        raise RangeError(
            f"frequency {settings.frequency:.10g} Hz lies between the generator's steps of {FREQUENCY_STEP:g} Hz; "
            f"take {steps * FREQUENCY_STEP:.10g} Hz"
        )
    if not 0 < settings.dwell <= LARGEST_DWELL:
        raise RangeError(f"dwell {settings.dwell:g} s is outside 0 to {LARGEST_DWELL:g} s")
    rate = SAMPLES_PER_CYCLE * settings.frequency
    time = np.arange(round(settings.dwell * rate)) / rate
    try:
        fit_sine(time, np.sin(2 * np.pi * settings.frequency * time)[np.newaxis], settings.frequency)
    except EstimateError as error:
        raise RangeError(f"dwell {settings.dwell:g} s at {settings.frequency:g} Hz: {error}") from None


def run(
    bench: Bench,
    design: Design,
    calibration: LoadCellCalibration,
    settings: SweepSettings,
    record: Recorder,
    progress: Progress,
) -> SweepResult:
    """Sweep all loads over all samples. Each point is durable before `progress` hears of it.

    Raises:
        RangeError, UnknownName: as `check`; the outputs have stayed off.
        UnreachableError: a load too small for the indicator; the outputs have stayed off.
        UnreachableError, SafetyError, LinkError, DeviceError: the bench could not; points stay on disk.
    """
    check(settings, design, bench.force_limit)
    smallest = SMALLEST_LOAD * calibration.resolution()
    if min(settings.loads) < smallest:
        raise UnreachableError(
            f"load {min(settings.loads):g} N peak to peak is below {SMALLEST_LOAD:g} steps of the strain indicator; "
            f"ask for {show(smallest, 'N', 3)} or more"
        )
    total = len(settings.samples) * len(settings.loads)
    points: list[LoadPoint] = []
    _configure(bench, design, settings)
    bench.positioner.home()
    check_zero(bench, calibration)
    for name in settings.samples:
        sample = get_sample(name)
        progress(len(points), total, f"mount sample {name}")
        bench.rest()
        bench.positioner.home()
        bench.operator.mount(sample)
        preloaded = preload(bench, calibration, preload_for(settings.loads))
        bench.drive()
        servo = LoadServo(bench, calibration, settings.frequency, preloaded)
        for load in settings.loads:
            progress(len(points), total, f"sample {name}, {show(load, 'N')}")
            servo.set(load)
            point, recording = _measure(bench, servo, design, calibration, settings, name, load)
            waveforms = {film.name: (recording.rate, recording.voltage[film.channel - 1]) for film in design.films}
            record.point(asdict(point), waveforms, bench.clock.now_ns())
            points.append(point)
            progress(len(points), total, f"sample {name}, {show(load, 'N')}")
    bench.rest()
    bench.positioner.home()
    return evaluate(points, design)


def _configure(bench: Bench, design: Design, settings: SweepSettings) -> None:
    node = bench.nodes[0]
    node.set_sample_rate(SAMPLES_PER_CYCLE * settings.frequency)
    for film in design.films:
        peak = film.sensitivity * (preload_for(settings.loads) + max(settings.loads) / 2)
        range_ = SENSITIVE_RANGE if HEADROOM * peak <= RANGES_V[SENSITIVE_RANGE] else WIDE_RANGE
        node.set_range(film.channel, range_)


def _measure(
    bench: Bench,
    servo: LoadServo,
    design: Design,
    calibration: LoadCellCalibration,
    settings: SweepSettings,
    sample: str,
    load: float,
) -> tuple[LoadPoint, Recording]:
    node = bench.nodes[0]
    servo.hold(SETTLING)
    heard = len(node.emergencies)
    recording = node.acquire(settings.dwell)
    reading = servo.read()
    bench.amplifier.check()
    films = [design.film("rigid"), design.film("total")]
    channels = [film.channel - 1 for film in films]
    voltage, saturated = recording.voltage[channels], bool(recording.saturated[channels].any())
    fit = fit_sine(recording.time, voltage, settings.frequency)
    try:
        ratio, noise_u = amplitude_ratio(fit, 0, 1)
    except EstimateError:
        film, signal, signal_u = films[1], float(fit.amplitude[1]), float(fit.amplitude_u[1])
        raise EstimateError(
            f"{node.name}: film {film.name!r} on channel {film.channel} gives {show(signal, 'V')} with standard "
            f"uncertainty {show(signal_u, 'V')}, too little for a ratio; check its connection"
        ) from None
    peak_to_peak = 2 * fit.amplitude
    forces = [float(v) / film.sensitivity for v, film in zip(peak_to_peak, films, strict=True)]
    to_force = films[1].sensitivity / films[0].sensitivity
    force_ratio = ratio * to_force
    measured, measured_u = calibration.load(reading.reading_mV)
    point = LoadPoint(
        sample=sample,
        load_N=load,
        indicator_mV=reading.reading_mV,
        load_measured_N=measured,
        load_measured_u=measured_u,
        voltage_rigid_V=float(peak_to_peak[0]),
        voltage_total_V=float(peak_to_peak[1]),
        force_rigid_N=forces[0],
        force_total_N=forces[1],
        force_ratio=force_ratio,
        force_ratio_u=math.hypot(noise_u * to_force, design.ratio_scatter * force_ratio),
        noise_u=noise_u * to_force,
        condition=fit.condition,
        valid=not saturated
        and len(node.emergencies) == heard
        and abs(measured - load) <= max(LARGEST_DRIFT * load, 2 * calibration.resolution()),
    )
    return point, recording


def evaluate(points: Sequence[LoadPoint], design: Design) -> SweepResult:
    """Mean ratio of each sample over its valid load sets, and the samples from hard to soft.

    The gains scatter anew with each load set, so the uncertainties of the points are independent.
    """
    means = []
    for name in dict.fromkeys(point.sample for point in points):
        valid = [point for point in points if point.sample == name and point.valid]
        n = len(valid)
        means.append(
            SampleMean(
                sample=name,
                force_ratio=math.fsum(p.force_ratio for p in valid) / n if n else None,
                force_ratio_u=math.sqrt(math.fsum(p.force_ratio_u**2 for p in valid)) / n if n else None,
                valid_points=n,
                thesis_force_ratio=design.thesis_force_ratio.get(name),
            )
        )
    known = [(mean.force_ratio, mean.sample) for mean in means if mean.force_ratio is not None]
    return SweepResult(list(points), means, [sample for _, sample in sorted(known, reverse=True)])
