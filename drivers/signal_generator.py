"""Driver of the signal generator."""

from __future__ import annotations

from drivers.modbus_device import ModbusDevice
from instrument.contracts import signal_generator
from instrument.contracts.signal_generator import LARGEST_PEAK
from instrument.errors import RangeError


class SignalGenerator(ModbusDevice):
    contract = signal_generator.CONTRACT

    def sine(self, frequency: float, amplitude: float, offset: float = 0.0) -> None:
        """Set a sine of `frequency` Hz, peak `amplitude` V and `offset` V at once; the phase runs on.

        Raises:
            RangeError: outside 0 to 20 kHz, 0 to 10 V, or amplitude + |offset| above 10 V.
        """
        self.waveform("sine", frequency, amplitude, offset)

    def waveform(self, shape: str, frequency: float, amplitude: float, offset: float = 0.0) -> None:
        """As `sine`, with `shape` one of sine, square, triangle."""
        if amplitude + abs(offset) > LARGEST_PEAK:
            raise RangeError(
                f"signal generator: amplitude {amplitude:g} V + |offset| {abs(offset):g} V is above {LARGEST_PEAK:g} V"
            )
        self.set(frequency=frequency, amplitude=amplitude, offset=offset, waveform=shape)

    def output(self, on: bool) -> None:
        """Close or open the output relay."""
        self.set(output="on" if on else "off")

    def reset_phase(self) -> None:
        """Restart the waveform at zero phase."""
        self.set(phase_reset=1)

    def read(self) -> tuple[float, float, float]:
        """Frequency Hz, amplitude V and offset V as the device holds them."""
        frequency, amplitude, offset = self.get_many("frequency", "amplitude", "offset")
        return frequency, amplitude, offset
