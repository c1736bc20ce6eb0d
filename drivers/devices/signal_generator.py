"""Driver of the signal generator."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.drivers.clock import Clock
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.contracts import signal_generator
from palpate.instrument.contracts.contract import Value
from palpate.instrument.contracts.signal_generator import LARGEST_PEAK
from palpate.instrument.errors import BenchError, DeviceError, RangeError


class SignalGenerator(ModbusDevice):
    """The generator counts the writes that it takes. Where there are more than ours, somebody else writes there."""

    contract = signal_generator.CONTRACT

    def __init__(self, link: ModbusLink, unit: int, clock: Clock) -> None:
        super().__init__(link, unit, clock)
        self._least = self._most = 0  # writes that it has taken, if nobody else writes

    def connect(self) -> None:
        """Raises as `identify`."""
        super().connect()
        self._count()

    def _count(self) -> int:
        """How many writes it has taken; from now on ours count from there."""
        self._least = self._most = count = int(self.get("writes"))
        return count

    def _write(self, start: int, registers: list[int], values: Mapping[str, Value]) -> None:
        try:
            super()._write(start, registers, values)
        except BenchError as error:
            if not (isinstance(error, DeviceError) and error.code):  # not refused: it may have been carried out
                self._most += 1
            raise
        self._least += 1
        self._most += 1

    def differences(self) -> list[str]:
        """As of every device; and whether it has taken writes that are not ours, which may have been taken back."""
        found = super().differences()  # first: what is written after it counts already
        least, most = self._least, self._most
        count = self._count()
        if found or least <= count <= most:
            return found
        return [
            f"{self.name}: counts {count} writes, should count {most}: somebody else writes there, or it was off "
            "meanwhile"
        ]

    def restore(self) -> None:
        """As of every device."""
        self._count()
        super().restore()

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
