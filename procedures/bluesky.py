"""Devices of a bench as bluesky wants them: they meet its protocols by their shape, nothing of it is imported.

An example, with a sample pressed on the sensor:

    films = FilmSignals(Films(bench, design, 10.0, 4.0), dwell=0.5)
    load = Load(bench, LoadServo(bench, calibration, 10.0, press(bench, calibration, sample, 3.0)))
    RunEngine()(bluesky.plans.scan([films], load, 1.5, 4.0, 6))

Each does what it is asked for before it returns, so that a status is done as it is made. Errors are the bench's own.
Time stamps are of the bench's clock [s]: of a simulated bench they are the same each time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

from palpate.drivers.bench import Bench
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.procedures.steps.films import Films
from palpate.procedures.steps.servo import LoadServo


class Done:
    """Status of what has been done."""

    done = True
    success = True

    def exception(self, timeout: float | None = 0.0) -> None:
        """There was none: it would have been raised."""

    def add_callback(self, callback: Callable[[Done], None]) -> None:
        callback(self)


class _Readable:
    """Numbers of the bench by name, each with its unit."""

    parent: ClassVar[None] = None

    def __init__(self, name: str, bench: Bench, units: dict[str, str]) -> None:
        self.name = name
        self._bench = bench
        self._units = units

    def describe(self) -> dict[str, dict[str, Any]]:
        source = f"palpate:{self._bench.description.name}"
        shown = {"source": source, "dtype": "number", "shape": []}
        return {name: {**shown, "units": unit} for name, unit in self._units.items()}

    def _reading(self, *values: float) -> dict[str, dict[str, float]]:
        now = 1e-9 * self._bench.clock.now_ns()
        return {name: {"value": value, "timestamp": now} for name, value in zip(self._units, values, strict=True)}


class DeviceSetting(_Readable):
    """A field of a Modbus device of the bench, which can be set.

    Such as `DeviceSetting(bench, bench.device("signal_generator"), "frequency")`.
    """

    def __init__(self, bench: Bench, device: ModbusDevice, field: str) -> None:
        name = f"{device.contract.name}_{field}"
        super().__init__(name, bench, {name: device.contract[field].unit})
        self._device, self._field = device, field

    def set(self, value: float) -> Done:
        """Raises as `ModbusDevice.set`."""
        self._device.set(**{self._field: value})
        return Done()

    def read(self) -> dict[str, dict[str, float]]:
        return self._reading(self._device.get(self._field))


class MovableLoad(_Readable):
    """The load on the sensor, peak to peak, by the load cell. Movable."""

    def __init__(self, bench: Bench, servo: LoadServo) -> None:
        super().__init__("load", bench, {"load": "N"})
        self._servo = servo
        self._measured = 0.0

    def set(self, value: float) -> Done:
        """Raises as `LoadServo.set`."""
        self._measured = self._servo.set(value)
        return Done()

    def read(self) -> dict[str, dict[str, float]]:
        return self._reading(self._measured)


class FilmSignals(_Readable):
    """The films' voltages, peak to peak, over `dwell` s at the drive's frequency. Triggerable."""

    def __init__(self, films: Films, dwell: float) -> None:
        super().__init__("films", films.bench, {f"films_{film.name}": "V" for film in films.design.films})
        self._films, self._dwell = films, dwell
        self._signals: list[float] = []

    def trigger(self) -> Done:
        """Raises as `Films.acquire`, `Films.fit`."""
        fit = self._films.fit(self._films.acquire(self._dwell))
        self._signals = [float(signal) for signal in 2 * fit.amplitude]
        return Done()

    def read(self) -> dict[str, dict[str, float]]:
        return self._reading(*self._signals)
