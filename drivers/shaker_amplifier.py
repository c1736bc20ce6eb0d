"""Driver of the shaker amplifier."""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.modbus_device import ModbusDevice
from instrument.contracts import shaker_amplifier
from instrument.errors import SafetyError

HOTTEST = 85.0  # degC; it trips at 90


@dataclass(frozen=True, slots=True)
class AmplifierState:
    """Output current A rms, output voltage V rms, heat sink temperature °C, faults now and latched."""

    current: float
    voltage: float
    temperature: float
    faults: frozenset[str]
    faults_latched: frozenset[str]
    enabled: bool


class ShakerAmplifier(ModbusDevice):
    contract = shaker_amplifier.CONTRACT

    def configure(self, gain: float, current_limit: float, watchdog: float) -> None:
        """Set the voltage gain V/V, the peak current A at which it trips, and the watchdog time-out s."""
        self.set(gain=gain, current_limit=current_limit)
        self.set(watchdog=watchdog)

    def enable(self) -> None:
        """Switch the output stage on. Raises DeviceError while a fault is latched."""
        self.set(enable="on")

    def disable(self) -> None:
        """Switch the output stage off."""
        self.set(enable="off")

    def clear_faults(self) -> None:
        """Clear latched faults whose cause is gone."""
        self.set(clear_faults=1)

    def read(self) -> AmplifierState:
        """Currents, temperature and faults; this read also feeds the watchdog."""
        current, voltage, temperature, faults, latched, status = self.get_many(
            "output_current", "output_voltage", "temperature", "faults", "faults_latched", "status"
        )
        return AmplifierState(
            current,
            voltage,
            temperature,
            self.contract.set_bits("faults", faults),
            self.contract.set_bits("faults_latched", latched),
            "enabled" in self.contract.set_bits("status", status),
        )

    def check(self) -> AmplifierState:
        """As `read`.

        Raises:
            SafetyError: a fault is latched, and the output is off; or the current limit is passed, or the heat sink is
                within 5 K of the temperature at which the device trips.
        """
        state = self.read()
        if state.faults_latched:
            raise SafetyError(
                f"{self.name}: tripped on {', '.join(sorted(state.faults_latched))}; the output is off. "
                "Remove the cause, then clear the faults"
            )
        limit = float(self._settings.get("current_limit", math.inf))
        if state.temperature > HOTTEST or math.sqrt(2) * state.current > limit:
            raise SafetyError(
                f"{self.name}: heat sink at {state.temperature:g} degC, {math.sqrt(2) * state.current:.3g} A peak; "
                f"limits are {HOTTEST:g} degC and {limit:g} A. Outputs go off; let it cool, or ask for smaller loads"
            )
        return state
