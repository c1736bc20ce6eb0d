"""Load-set sweep (thesis 5.4.1): each sample under each load, film voltages to forces to force ratio."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from drivers.bench import Bench
from instrument.calibration import LoadCellCalibration
from instrument.contracts import signal_generator
from instrument.design import Design
from instrument.errors import EstimateError, RangeError, UnreachableError
from instrument.estimate import fit_sine
from instrument.film_forces import ToothPoint, film_forces
from instrument.quantity import parse, show
from instrument.sample import get_sample
from procedures.films import SAMPLES_PER_CYCLE, FilmPoint, Films, check_nodes, measure
from procedures.record import Recorder
from procedures.servo import LoadServo, check_zero, preload

PROCEDURE = "sweep-loads"
PRELOAD_MARGIN = 1.2  # of half the largest load, so that contact is never lost
FREQUENCIES = (0.5, 100.0)  # Hz
FREQUENCY_STEP = signal_generator.CONTRACT["frequency"].scale  # Hz
LARGEST_DWELL = 3600.0  # s
LARGEST_COUNT = 1000  # loads
SMALLEST_LOAD = 2.0  # steps of the indicator

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

    Of a sensor of several teeth voltages and forces are sums, the ratio is the sensor's (`film_forces`), and `teeth`
    has each tooth's own. Not `valid`: after the last of its `attempts` it is flagged still; `flags` say why.
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
    dwell_s: float = math.nan
    settling_s: float = math.nan
    attempts: int = 1
    flags: tuple[str, ...] = ()
    teeth: tuple[ToothPoint, ...] = ()


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


def check(settings: SweepSettings, design: Design, force_limit: float, nodes: int) -> None:
    """Refuse what cannot be done, before any device is spoken to.

    Raises:
        RangeError: a load beyond the force limit in N, a frequency or dwell that gives no estimate, a sensor whose
            films the bench's sensor nodes cannot take.
        UnknownName: an unknown sample.
    """
    check_nodes(design, nodes)
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
    check(settings, design, bench.force_limit, len(bench.nodes))
    smallest = SMALLEST_LOAD * calibration.resolution()
    if min(settings.loads) < smallest:
        raise UnreachableError(
            f"load {min(settings.loads):g} N peak to peak is below {SMALLEST_LOAD:g} steps of the strain indicator; "
            f"ask for {show(smallest, 'N', 3)} or more"
        )
    total = len(settings.samples) * len(settings.loads)
    points: list[LoadPoint] = []
    films = Films(bench, design, settings.frequency, preload_for(settings.loads) + max(settings.loads) / 2)
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
            what = f"sample {name}, {show(load, 'N')}"
            measured = measure(films, servo, load, settings.dwell, record, what)
            point = _point(design, name, load, measured)
            record.point(asdict(point), measured.waveforms(design), bench.clock.now_ns())
            points.append(point)
            progress(len(points), total, f"sample {name}, {show(load, 'N')}")
    bench.rest()
    bench.positioner.home()
    return evaluate(points, design)


def _point(design: Design, sample: str, load: float, measured: FilmPoint) -> LoadPoint:
    forces = film_forces(design, measured.fit)
    return LoadPoint(
        sample=sample,
        load_N=load,
        indicator_mV=measured.indicator_mV,
        load_measured_N=measured.load_N,
        load_measured_u=measured.load_u,
        voltage_rigid_V=forces.voltage_rigid_V,
        voltage_total_V=forces.voltage_total_V,
        force_rigid_N=forces.force_rigid_N,
        force_total_N=forces.force_total_N,
        force_ratio=forces.force_ratio,
        force_ratio_u=forces.force_ratio_u,
        noise_u=forces.noise_u,
        condition=measured.fit.condition,
        valid=measured.valid,
        dwell_s=measured.dwell,
        settling_s=measured.settling,
        attempts=measured.attempts,
        flags=measured.flags,
        teeth=forces.teeth if len(forces.teeth) > 1 else (),
    )


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
