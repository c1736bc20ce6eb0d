"""Film calibration against the load cell (thesis 5.4, A3.1): each tooth pressed alone, over loads and frequencies."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.drivers.bench import Bench
from palpate.instrument.calibration.films import FEWEST, FilmCalibration, FilmReading, calibrate_films
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import DeviceError, RangeError
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.estimate import SineFit
from palpate.procedures.engine.progress import Progress
from palpate.procedures.measurements.load_cell.procedure import LONGEST_VALIDITY
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.begin import begin
from palpate.procedures.steps.checks import check_force, check_frequency, check_time, preload_for
from palpate.procedures.steps.film_point import measure
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import LoadServo, finish, lower, withdraw

PROCEDURE = "calibrate-films"


@dataclass(frozen=True, slots=True)
class FilmSettings:
    """What to press with: loads in N peak to peak, frequencies in Hz, dwell in s.

    `extrapolate` lets loads pass that lie outside the load cell's calibrated range.
    """

    loads: tuple[float, ...]
    frequencies: tuple[float, ...]
    dwell: float
    valid_days: int
    extrapolate: bool = False


@dataclass(frozen=True, slots=True)
class FilmResult:
    calibration: FilmCalibration
    points: list[dict[str, Any]]

    def summary(self) -> dict[str, Any]:
        """Under its public names: all of the calibration but where it comes from."""
        found = self.calibration.model_dump()
        return {name: found[name] for name in ("films", "covariance", "crosstalk", "crosstalk_u", "frequencies_Hz",
                                               "gain", "least_N", "greatest_N", "load_cell", "expires")}  # fmt: skip


def check(settings: FilmSettings, design: Design, force_limit: float, nodes: int) -> None:
    """Refuse what gives no calibration, before any device is spoken to.

    Raises:
        RangeError: fewer than three loads, a load beyond the force limit in N, a frequency or dwell that gives no
            estimate, frequencies that repeat, a validity that is none, too few sensor nodes.
    """
    check_nodes(design, nodes)
    if len(settings.loads) < FEWEST:
        raise RangeError(f"{len(settings.loads)} loads cannot show linearity and scatter; use at least {FEWEST}")
    check_force(settings.loads, force_limit)
    if not settings.frequencies or len(set(settings.frequencies)) < len(settings.frequencies):
        raise RangeError(f"frequencies {settings.frequencies} Hz must be distinct, one at least")
    for frequency in settings.frequencies:
        check_frequency(frequency)
        check_time(settings.dwell, frequency)
    if not 1 <= settings.valid_days <= LONGEST_VALIDITY:
        raise RangeError(f"{settings.valid_days} days are outside 1 to {LONGEST_VALIDITY}")


def run(
    bench: Bench,
    design: Design,
    calibration: LoadCellCalibration,
    settings: FilmSettings,
    record: Recorder,
    progress: Progress,
    created: datetime,
) -> FilmResult:
    """Press each tooth alone with every load at every frequency. Each point is durable before `progress` hears of it.

    Raises:
        RangeError: as `check`, or a load beyond the load cell's calibration; the outputs have stayed off.
        UnreachableError: a load too small for the indicator; the outputs have stayed off.
        DeviceError: a point stayed flagged; points stay on disk.
        UnreachableError, SafetyError, LinkError, EstimateError: the bench could not; points stay on disk.
    """
    check(settings, design, bench.force_limit, len(bench.nodes))
    films = begin(bench, design, calibration, settings.loads, settings.frequencies[0], extrapolate=settings.extrapolate)
    total = len(design.teeth) * len(settings.frequencies) * len(settings.loads)
    points: list[dict[str, Any]] = []
    readings: list[FilmReading] = []
    for tooth in range(len(design.teeth)):
        progress(len(points), total, f"press tooth {tooth + 1}")
        withdraw(bench)
        bench.operator.press_tooth(tooth)
        preloaded = lower(bench, calibration, preload_for(settings.loads), f"tooth {tooth + 1}")
        for frequency in settings.frequencies:
            films.set_frequency(frequency)
            servo = LoadServo(bench, calibration, frequency, preloaded)
            for load in settings.loads:
                what = f"tooth {tooth + 1}, {frequency:g} Hz, {load:g} N"
                progress(len(points), total, what)
                carry_out(bench, what, partial(servo.set, load))
                measured = measure(films, servo, load, settings.dwell, record, what, compare=False)
                voltage = _voltages(design, tooth, measured.fit)
                point = {
                    "tooth": tooth + 1,
                    "frequency_Hz": frequency,
                    "load_N": load,
                    "indicator_mV": measured.indicator_mV,
                    "load_measured_N": measured.load_N,
                    "load_measured_u": measured.load_u,
                    "extrapolated": not calibration.covers(load),
                    "voltages_V": voltage.tolist(),
                    "voltages_u": (2 * measured.fit.amplitude_u).tolist(),
                    "valid": measured.valid,
                    "flags": list(measured.flags),
                }
                record.point(point, measured.waveforms(design), bench.clock.now_ns())
                points.append(point)
                progress(len(points), total, what)
                if not measured.valid:
                    raise DeviceError(f"{what}: {', '.join(measured.flags)}; repair that and calibrate again")
                readings.append(FilmReading(tooth, frequency, load, measured.load_N, measured.load_u, voltage))
    finish(bench, calibration)
    found = calibrate_films(
        design,
        readings,
        calibration,
        {
            "device": bench.nodes[0].serial or "unknown",
            "simulated": bench.simulated,
            "source": record.folder.name,
            "created": created.isoformat(timespec="seconds"),
            "expires": (created + timedelta(days=settings.valid_days)).date().isoformat(),
        },
    )
    return FilmResult(found, points)


def _voltages(design: Design, tooth: int, fit: SineFit) -> npt.NDArray[np.float64]:
    """(films,) V, peak to peak; of films that the tooth is not theirs the part in phase with its own, with its sign.

    An amplitude is never negative: noise alone would pass for crosstalk.
    """
    own = np.array([tooth in film.teeth for film in design.films])
    part = np.cos(fit.phase - fit.phase[np.argmax(own)])
    return 2 * fit.amplitude * np.where(own, 1.0, part)
