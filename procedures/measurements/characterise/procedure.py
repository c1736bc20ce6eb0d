"""What a sensor can do: noise, sensitivity, resolution, linearity, hysteresis, range, drift, place (thesis 2.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from palpate.drivers.bench import Bench
from palpate.drivers.roles import SensorNode
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.console.progress import Progress
from palpate.procedures.measurements.characterise.characteristics import (
    HOLDING,
    LEAST_DRIFT_POINTS,
    LEAST_LOADS,
    LOADING,
    UNLOADING,
    CharacteriseResult,
    FilmsPoint,
    evaluate,
)
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.begin import Points, begin
from palpate.procedures.steps.checks import check_force, check_frequency, check_time, preload_for
from palpate.procedures.steps.film_point import FilmPoint, measure
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import LoadServo, finish, press

PROCEDURE = "characterise"
LARGEST_DRIFT_TIME = 86_400.0  # s
DRIFT_POINTS = 10


@dataclass(frozen=True, slots=True)
class CharacteriseSettings:
    """Sample, loads in N peak to peak up and then down, dwell in s, frequency in Hz; how long drift is watched [s]."""

    sample: str
    loads: tuple[float, ...]
    dwell: float
    frequency: float
    drift_time: float


def check(settings: CharacteriseSettings, design: Design, force_limit: float, nodes: int) -> None:
    """Refuse what cannot be done, before any device is spoken to.

    Raises:
        RangeError: too few loads for a line, a load beyond the force limit in N, a frequency, dwell or drift time that
            gives no estimate, a sensor whose films the bench's sensor nodes cannot take.
        UnknownName: an unknown sample.
    """
    get_sample(settings.sample)
    check_nodes(design, nodes)
    if len(settings.loads) < LEAST_LOADS:
        raise RangeError(f"{len(settings.loads)} loads do not give a line with its scatter; give {LEAST_LOADS} or more")
    check_force(settings.loads, force_limit)
    check_frequency(settings.frequency)
    check_time(settings.dwell, settings.frequency)
    least = LEAST_DRIFT_POINTS * settings.dwell
    if not least <= settings.drift_time <= LARGEST_DRIFT_TIME:
        raise RangeError(
            f"drift time {settings.drift_time:g} s is outside {least:g} s, {LEAST_DRIFT_POINTS} dwells, to"
            f" {LARGEST_DRIFT_TIME:g} s; give one inside"
        )


def run(
    bench: Bench,
    design: Design,
    calibration: LoadCellCalibration,
    settings: CharacteriseSettings,
    record: Recorder,
    progress: Progress,
) -> CharacteriseResult:
    """Loads up, loads down, then one load for a while. Each point is durable before `progress` hears of it.

    Raises:
        RangeError, UnknownName: as `check`, or a load outside the calibrated range; the outputs have stayed off.
        UnreachableError, SafetyError, LinkError, DeviceError: the bench could not; points stay on disk.
        EstimateError: too few points are valid.
    """
    check(settings, design, bench.force_limit, len(bench.all(SensorNode)))
    films = begin(bench, design, calibration, settings.loads, settings.frequency, (settings.sample,))
    preloaded = press(bench, calibration, get_sample(settings.sample), preload_for(settings.loads))
    servo = LoadServo(bench, calibration, settings.frequency, preloaded)
    middle = settings.loads[len(settings.loads) // 2]
    pause = settings.drift_time / DRIFT_POINTS
    steps = [
        *((LOADING, load) for load in settings.loads),
        *((UNLOADING, load) for load in settings.loads[::-1]),
        *((HOLDING, middle) for _ in range(DRIFT_POINTS + 1)),
    ]
    points = Points[FilmsPoint](films, record, progress, len(steps))
    held_ns = 0
    for direction, load in steps:
        what = f"{direction}, {show(load, 'N')}"
        points.tell(what)
        if direction != HOLDING or not held_ns:
            carry_out(bench, what, partial(servo.set, load))
        if direction == HOLDING:
            if held_ns:
                bench.clock.wait(max(0.0, pause - settings.dwell))
            held_ns = held_ns or bench.clock.now_ns()
        measured = measure(films, servo, load, settings.dwell, record, what, compare=False)
        point = _point(direction, load, 1e-9 * (bench.clock.now_ns() - held_ns) if held_ns else 0.0, measured)
        points.keep(point, measured, what)
    finish(bench, calibration)
    return evaluate(points.taken, design, calibration, settings.dwell, bench.force_limit)


def _point(direction: str, load: float, time: float, measured: FilmPoint) -> FilmsPoint:
    fit = measured.fit
    return FilmsPoint(
        direction=direction,
        time_s=time,
        load_N=load,
        load_measured_N=measured.load_N,
        load_measured_u=measured.load_u,
        voltages_V=tuple(float(v) for v in 2 * fit.amplitude),
        voltages_u=tuple(float(u) for u in 2 * fit.amplitude_u),
        noise_V=tuple(float(v) for v in fit.residual),
        noise_peak_V=tuple(float(v) for v in fit.residual_peak),
        samples=fit.samples,
        valid=measured.valid,
        flags=measured.flags,
        attempts=measured.attempts,
        incidents=measured.incidents,
    )
