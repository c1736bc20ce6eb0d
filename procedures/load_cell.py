"""Load-cell calibration with dead weights (thesis 5.2, Table 5.1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.bench import Bench
from instrument.calibration import STANDARD_GRAVITY, LoadCellCalibration, calibrate_load_cell
from instrument.errors import DeviceError
from procedures.record import Recorder

PROCEDURE = "calibrate-load-cell"
MASSES = tuple(1e-3 * m for m in range(140, 741, 100))  # kg, Table 5.1
REPEATS = 10
FILTER = 0.1  # s
SETTLING = 1.0  # s
INTERVAL = 0.1  # s, the display is renewed ten times a second

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, slots=True)
class LoadCellResult:
    calibration: LoadCellCalibration
    points: list[dict[str, Any]]

    def summary(self) -> dict[str, Any]:
        """Results under their public names. linearity and reversibility are fractions of the span."""
        c = self.calibration
        return {
            "sensitivity_mV_per_N": c.sensitivity_mV_per_N,
            "sensitivity_u": c.sensitivity_u,
            "zero_mV": c.zero_mV,
            "zero_u": c.zero_u,
            "linearity": c.linearity,
            "reversibility": c.reversibility,
            "resolution": c.resolution_mV,
            "resolution_N": c.resolution(),
        }


def run(bench: Bench, record: Recorder, progress: Progress, created: str) -> LoadCellResult:
    """Put the weights on one after the other and take them off again; fit the line.

    Args:
        created: date and time for the calibration, ISO 8601.

    Raises:
        DeviceError: a reading is not stable, overloaded, or the bridge is open.
        EstimateError: the readings give no line. LinkError: a device is gone. Points stay on disk.
    """
    bench.rest()
    bench.positioner.home()
    bench.indicator.clear_tare()
    bench.indicator.track(FILTER)
    readings: dict[str, list[list[float]]] = {"loading": [], "unloading": []}
    points: list[dict[str, Any]] = []
    total = 2 * len(MASSES)
    resolution_mV = bench.indicator.read().resolution_mV
    for direction, masses in (("loading", MASSES), ("unloading", MASSES[::-1])):
        for mass in masses:
            what = f"{direction}, {1e3 * mass:.0f} gf"
            progress(len(points), total, what)
            bench.operator.place_weight(mass)
            bench.clock.wait(SETTLING)
            values = _read(bench)
            readings[direction].append(values)
            point = {
                "direction": direction,
                "load_gf": round(1e3 * mass, 6),
                "load_N": mass * STANDARD_GRAVITY,
                "reading_mV": sum(values) / len(values),
                "readings_mV": values,
            }
            record.point(point, {}, bench.clock.now_ns())
            points.append(point)
            progress(len(points), total, what)
    bench.operator.place_weight(0.0)
    calibration = calibrate_load_cell(
        [mass * STANDARD_GRAVITY for mass in MASSES],
        readings["loading"],
        readings["unloading"][::-1],
        resolution_mV,
        device=bench.indicator.serial or "unknown",
        simulated=bench.simulated,
        source=record.folder.name,
        created=created,
    )
    return LoadCellResult(calibration, points)


def _read(bench: Bench) -> list[float]:
    values = []
    for number in range(REPEATS):
        if number:
            bench.clock.wait(INTERVAL)
        reading = bench.indicator.read()
        if not reading.valid:
            state = "bridge open" if reading.bridge_open else "overload" if reading.overload else "not stable"
            raise DeviceError(f"{bench.indicator.name}: {state}; check the cell and wait until the weight rests")
        values.append(reading.reading_mV)
    return values
