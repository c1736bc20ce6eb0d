"""Load-cell calibration with dead weights (thesis 5.2, Table 5.1; runs and positions after ISO 376)."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime, timedelta
from itertools import pairwise
from typing import Any

import numpy as np

from palpate.drivers.bench import Bench
from palpate.instrument.calibration.classification import Run
from palpate.instrument.calibration.load_budget import load_budget
from palpate.instrument.calibration.load_cell import STANDARD_GRAVITY, LoadCellCalibration, calibrate_load_cell
from palpate.instrument.errors import DeviceError, RangeError
from palpate.instrument.quantity import show
from palpate.instrument.uncertainty.budget import Budget
from palpate.procedures.engine.progress import Progress
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import steady

PROCEDURE = "calibrate-load-cell"
LOADS = tuple(1e-3 * m * STANDARD_GRAVITY for m in range(140, 741, 100))  # N, Table 5.1
REPEATS = 10
FILTER = 0.1  # s
SETTLING = 1.0  # s
INTERVAL = 0.1  # s, the display is renewed ten times a second
CREEP_TIMES = (30.0, 300.0)  # s after the weight is on, ISO 376
RECOVERY = 300.0  # s without load before that, so that the creep of the runs is gone
RETURN_STEPS, RETURN_OF_SPAN = 1.5, 0.01  # that the zero may move by in a run [A]; ISO 376 allows classes 0.1 %
LONGEST_VALIDITY = 791  # days: 26 months, ISO 376


@dataclass(frozen=True, slots=True)
class LoadCellSettings:
    """What to put on the cell.

    Args:
        loads: N, increasing.
        runs: up and down, in each position.
        positions: of the cell about its axis [degrees].
        degree: of the curve; None: 2 where an F-test finds it better than 1.
        creep: whether to watch the greatest load for 300 s.
        valid_days: until the calibration expires.
    """

    loads: tuple[float, ...] = LOADS
    runs: int = 1
    positions: tuple[float, ...] = (0.0,)
    degree: int | None = None
    creep: bool = False
    valid_days: int = 365


@dataclass(frozen=True, slots=True)
class LoadCellResult:
    calibration: LoadCellCalibration
    points: list[dict[str, Any]]

    def summary(self) -> dict[str, Any]:
        """Results under their public names. What has no unit is a fraction, linearity and reversibility of the span."""
        c = self.calibration
        return {
            "sensitivity_mV_per_N": c.sensitivity_mV_per_N,
            "sensitivity_u": c.sensitivity_u,
            "zero_mV": c.zero_mV,
            "zero_u": c.zero_u,
            "curvature_mV_per_N2": c.curvature.mV_per_N2 if c.curvature else None,
            "curvature_u": c.curvature.u if c.curvature else None,
            "least_N": c.least_N,
            "greatest_N": c.greatest_N,
            "linearity": c.linearity,
            "reversibility": c.reversibility,
            "reversibility_of_reading": c.reversibility_of_reading,
            "repeatability": c.repeatability,
            "reproducibility": c.reproducibility,
            "interpolation": c.interpolation,
            "zero_return": c.zero_return,
            "creep": c.creep,
            "resolution": c.resolution_mV,
            "resolution_N": c.resolution(),
            "lower_limit_factor_N": c.lower_limit_factor_N,
            "astm_e74": c.astm_e74.model_dump(),
            "iso_376": c.iso_376.model_dump(),
            "expires": c.expires,
        }

    def budgets(self) -> tuple[Budget, ...]:
        """Of the least load, that in the middle, and the greatest."""
        c = self.calibration
        return tuple(load_budget(c, load) for load in (c.least_N, 0.5 * (c.least_N + c.greatest_N), c.greatest_N))


def check(settings: LoadCellSettings, force_limit: float) -> None:
    """Refuse what gives no calibration, before any device is spoken to.

    Raises:
        RangeError: a weight that is not above zero or above the force limit in N; loads that do not increase, or too
            few for the curve; no run; positions that repeat or lie outside 0 to 360 degrees; a validity that ISO 376
            does not know.
    """
    loads = settings.loads
    if bad := [load for load in loads if not 0 < load <= force_limit]:
        raise RangeError(
            f"load {bad[0]:g} N is not above 0 and up to the bench's force limit of {force_limit:g} N; "
            "take other weights"
        )
    if any(later <= load for load, later in pairwise(loads)):
        raise RangeError(
            f"loads {', '.join(f'{load:g}' for load in loads)} N must increase, each once; put them in order"
        )
    least = (settings.degree or 1) + 2
    if len(loads) < least:
        raise RangeError(
            f"{len(loads)} loads cannot give a curve of degree {settings.degree or 1} and its uncertainty; "
            f"use at least {least}"
        )
    if settings.runs < 1:
        raise RangeError(f"{settings.runs} runs give no reading; take 1 or more")
    positions = settings.positions
    if not positions or len(set(positions)) < len(positions) or not all(0 <= p < 360 for p in positions):
        raise RangeError(f"positions {positions} must be distinct, from 0 to below 360 degrees, such as 0, 120, 240")
    if not 1 <= settings.valid_days <= LONGEST_VALIDITY:
        raise RangeError(f"{settings.valid_days} days are outside 1 to {LONGEST_VALIDITY}, the 26 months of ISO 376")


def run(
    bench: Bench, settings: LoadCellSettings, record: Recorder, progress: Progress, created: datetime
) -> LoadCellResult:
    """Put the weights on one after the other and take them off again, as often as asked for; fit the curve.

    Args:
        created: date and time for the calibration.

    Raises:
        RangeError: as `check`.
        DeviceError: a reading is not stable, overloaded, or the bridge is open.
        EstimateError: the readings give no line. LinkError: a device is gone. Points stay on disk.
    """
    check(settings, bench.force_limit)
    bench.rest()
    bench.positioner.home()
    bench.indicator.clear_tare()
    bench.indicator.track(FILTER)
    resolution_mV = bench.indicator.read().resolution_mV
    series = _Series(bench, settings, record, progress, resolution_mV)
    runs = []
    for position in settings.positions:
        if len(settings.positions) > 1:
            bench.operator.turn_load_cell(position)
        runs += [series.run(position, number) for number in range(1, settings.runs + 1)]
    creep_mV = series.creep() if settings.creep else None
    calibration = calibrate_load_cell(
        settings.loads,
        runs,
        resolution_mV,
        degree=settings.degree,
        creep_mV=creep_mV,
        gage_factor=bench.named(bench.indicator).settings.gage_factor,
        device=bench.indicator.serial or "unknown",
        simulated=bench.simulated,
        source=record.folder.name,
        created=created.isoformat(timespec="seconds"),
        expires=(created + timedelta(days=settings.valid_days)).date().isoformat(),
    )
    return LoadCellResult(calibration, series.points)


@dataclass(slots=True)
class _Series:
    """Readings, one after the other, each on disk before the next."""

    bench: Bench
    settings: LoadCellSettings
    record: Recorder
    progress: Progress
    resolution_mV: float
    points: list[dict[str, Any]] = field(default_factory=list)

    def run(self, position: float, number: int) -> Run:
        loads = self.settings.loads
        self.bench.operator.place_weight(0.0)
        before = self._settled(position, number, "zero_before", 0.0)
        loading = [self._placed(position, number, "loading", load) for load in loads]
        unloading = [self._placed(position, number, "unloading", load) for load in reversed(loads)]
        self.bench.operator.place_weight(0.0)
        after = self._settled(position, number, "zero_after", 0.0)
        self._check_return(before, after, loading[-1] - before)
        displays = [p["readings_mV"] for p in self.points[-2 * len(loads) - 1 : -1]]
        scatter = float(np.sqrt(np.var(displays, axis=1, ddof=1).mean()))
        return Run(position, np.array(loading), np.array(unloading[::-1]), before, after, REPEATS, scatter)

    def _check_return(self, before: float, after: float, span: float) -> None:
        """The zero after a run, mV, must be that before it. Raises DeviceError: the bridge drifts."""
        allowed = RETURN_STEPS * self.resolution_mV + RETURN_OF_SPAN * abs(span)
        if not abs(after - before) <= allowed:
            name = self.bench.indicator.name
            raise DeviceError(
                f"{name}: the zero went from {before:.4g} to {after:.4g} mV in a run, more than {allowed:.2g} mV; let "
                "cell and indicator warm up, look for loose wires, and calibrate again",
                device=name,
            )

    def creep(self) -> float:
        """Change of the reading in mV under the greatest load from 30 s to 300 s; the weights come off after it."""
        load, clock = self.settings.loads[-1], self.bench.clock
        position = self.settings.positions[-1]
        clock.wait(RECOVERY)
        self.bench.operator.place_weight(load / STANDARD_GRAVITY)
        start = clock.now_ns()
        readings = []
        for time in CREEP_TIMES:
            clock.wait(time - (clock.now_ns() - start) * 1e-9)
            readings.append(self._point(position, self.settings.runs, f"creep_{time:.0f}_s", load))
        self.bench.operator.place_weight(0.0)
        return readings[1] - readings[0]

    def _placed(self, position: float, number: int, direction: str, load: float) -> float:
        self.progress(len(self.points), self._total(), f"{direction}, {1e3 * load / STANDARD_GRAVITY:.0f} gf")
        self.bench.operator.place_weight(load / STANDARD_GRAVITY)
        return self._settled(position, number, direction, load)

    def _settled(self, position: float, number: int, direction: str, load: float) -> float:
        self.bench.clock.wait(SETTLING)
        return self._point(position, number, direction, load)

    def _point(self, position: float, number: int, direction: str, load: float) -> float:
        values = carry_out(
            self.bench,
            f"{direction}, {show(load, 'N')}",
            lambda: _read(self.bench),
            again=lambda: self.bench.clock.wait(SETTLING),
        )
        point = {
            "position_deg": position,
            "run": number,
            "direction": direction,
            "load_gf": round(1e3 * load / STANDARD_GRAVITY, 6),
            "load_N": load,
            "reading_mV": sum(values) / len(values),
            "readings_mV": values,
            "incidents": self.bench.incidents.new(),
        }
        self.record.point(point, {}, self.bench.clock.now_ns())
        self.points.append(point)
        self.progress(len(self.points), self._total(), f"{direction}, {point['load_gf']:g} gf")
        return sum(values) / len(values)

    def _total(self) -> int:
        runs = self.settings.runs * len(self.settings.positions)
        return runs * (2 * len(self.settings.loads) + 2) + len(CREEP_TIMES) * self.settings.creep


def _read(bench: Bench) -> list[float]:
    values = []
    for number in range(REPEATS):
        if number:
            bench.clock.wait(INTERVAL)
        reading = steady(bench)
        if not reading.valid:
            name = bench.indicator.name
            raise DeviceError(
                f"{name}: {reading.sick or 'not stable'}; check the cell and wait until the weight rests", device=name
            )
        values.append(reading.reading_mV)
    return values
