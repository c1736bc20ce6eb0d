"""Simulated shaker amplifier: gain, trip at the current limit, heat, and a communication watchdog."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from instrument.contracts import shaker_amplifier
from instrument.contracts.shaker_amplifier import FAULTS
from simulators.clock import NEVER, VirtualClock
from simulators.device import DEVICE_FAILURE, Refused, SimulatedDevice
from simulators.lti import Periodic

AMBIENT = 25.0  # degC [A]
THERMAL_RESISTANCE = 2.0  # K/W of the power in the coil [A]
THERMAL_TIME = 300.0  # s [A]
HOT = 90.0  # degC at which it trips [A]


class ShakerAmplifier(SimulatedDevice):
    """`source` gives the input voltage, `changed` is called when the output may have changed."""

    contract = shaker_amplifier.CONTRACT

    def __init__(
        self,
        clock: VirtualClock,
        serial: str,
        source: Callable[[], Periodic],
        changed: Callable[[], None],
        coil_resistance: float,
    ) -> None:
        super().__init__(clock, serial)
        self._source = source
        self._changed = changed
        self._resistance = coil_resistance
        self._last_request_ns = 0
        self._latched = 0
        self._temperature = AMBIENT
        self._temperature_ns = 0

    def voltage(self) -> Periodic:
        """Output voltage."""
        return self._source().scaled(self.settings["gain"] if self.settings["enable"] else 0.0)

    def input_changed(self) -> None:
        """The input or a setting has changed: heat up to here, then trip where the current is too high."""
        self._heat(self.clock.now_ns())
        voltage = self.voltage()
        peak = (abs(voltage.mean) + float(np.abs(voltage.amplitude).sum())) / self._resistance
        if not peak <= self.settings["current_limit"]:
            self._trip("over_current")
        self._changed()

    def write(self, values: dict[str, float]) -> None:
        if values.get("enable") and self._latched:
            raise Refused(DEVICE_FAILURE)
        if values.get("clear_faults"):
            self._latched = self._present()
        self.settings.update({**values, "clear_faults": 0.0})
        self.input_changed()

    def read(self, name: str) -> float:
        voltage = self.voltage()
        rms = math.sqrt(voltage.mean**2 + float((np.abs(voltage.amplitude) ** 2).sum()) / 2)
        match name:
            case "output_current":
                return rms / self._resistance
            case "output_voltage":
                return rms
            case "temperature":
                self._heat(self.clock.now_ns())
                return self._temperature
            case "faults":
                return self._present()
            case "faults_latched":
                return self._latched
            case "status":
                return self.settings["enable"]  # bit 0
        return super().read(name)

    def requested(self) -> None:
        self._last_request_ns = self.clock.now_ns()

    def next_event_ns(self) -> int:
        if not self.settings["enable"]:
            return NEVER
        return max(min(self._watchdog_ns(), self._hot_ns()), self.clock.now_ns() + 1)

    def advance(self, start_ns: int, end_ns: int) -> None:
        self._heat(end_ns)
        if self.settings["enable"] and (end_ns >= self._watchdog_ns() or self._temperature >= HOT):
            self._trip("watchdog" if end_ns >= self._watchdog_ns() else "over_temperature")
            self._changed()

    def _watchdog_ns(self) -> int:
        """When the watchdog drops the output unless a request comes."""
        timeout = self.settings["watchdog"]
        return self._last_request_ns + round(timeout * 1e9) if timeout else NEVER

    def _hot_ns(self) -> int:
        """When the heat sink reaches its limit if nothing changes."""
        target = self._final_temperature()
        if target <= HOT or self._temperature >= HOT:
            return NEVER
        delay = THERMAL_TIME * math.log((target - self._temperature) / (target - HOT))
        return self._temperature_ns + math.ceil(delay * 1e9)

    def _present(self) -> int:
        return 1 << FAULTS["over_temperature"] if self._temperature >= HOT else 0

    def _trip(self, fault: str) -> None:
        self._latched |= 1 << FAULTS[fault]
        self.settings["enable"] = 0.0

    def _heat(self, now_ns: int) -> None:
        target = self._final_temperature()
        elapsed = 1e-9 * (now_ns - self._temperature_ns)
        self._temperature = target + (self._temperature - target) * math.exp(-elapsed / THERMAL_TIME)
        self._temperature_ns = now_ns

    def _final_temperature(self) -> float:
        return AMBIENT + THERMAL_RESISTANCE * self._resistance * self.read("output_current") ** 2
