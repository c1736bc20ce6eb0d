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
    """Our signal generator, which a map does not describe: it counts the writes that it takes.

    If there are more than this driver has sent, another program writes to it.
    """

    contract = signal_generator.CONTRACT

    def __init__(self, link: ModbusLink, unit: int, clock: Clock) -> None:
        super().__init__(link, unit, clock)
        self._least = self._most = 0  # bounds of its count of writes, if no other program writes

    def connect(self) -> None:
        """As for every device; the count of writes starts here. Raises as `identify` does."""
        super().connect()
        self._count()

    def _count(self) -> int:
        """Read its count of writes, from which this driver counts on."""
        self._least = self._most = count = int(self.get("writes"))
        return count

    def _write(self, start: int, registers: list[int], values: Mapping[str, Value]) -> bool:
        try:
            confirmed = super()._write(start, registers, values)
        except BenchError as error:
            if not (isinstance(error, DeviceError) and error.code):  # no refusal: the write may have been carried out
                self._most += 1
            raise
        self._most += 1
        if not confirmed:  # the value alone does not tell whether it was taken, if it is as before
            self._await_start(lambda: self.get("writes") >= self._most)
        self._least += 1
        return confirmed

    def differences(self) -> list[str]:
        """As for every device; also another program's writes, whose changes may have been taken back."""
        found = super().differences()  # before the count is read, so that no later write is missed
        least, most = self._least, self._most
        count = self._count()
        if found or least <= count <= most:
            return found
        return [
            f"{self.name}: counts {count} writes instead of {most}: another program writes to it, or it was switched "
            "off meanwhile"
        ]

    def restore(self) -> None:
        """As for every device."""
        self._count()
        super().restore()

    def sine(self, frequency: float, amplitude: float, offset: float = 0.0) -> None:
        """Set a sine of `frequency` [Hz], peak `amplitude` [V] and `offset` [V] in one write, with a continuous phase.

        Raises:
            RangeError: the frequency is outside 0 to 20 kHz, the amplitude outside 0 to 10 V, or amplitude + |offset|
                above 10 V; nothing is sent.
        """
        if amplitude + abs(offset) > LARGEST_PEAK:
            raise RangeError(
                f"signal generator: amplitude {amplitude:g} V + |offset| {abs(offset):g} V is above {LARGEST_PEAK:g} V;"
                " lower one of them"
            )
        self.set(frequency=frequency, amplitude=amplitude, offset=offset, waveform="sine")

    def output(self, on: bool) -> None:
        """Close or open the output relay."""
        self.set(output="on" if on else "off")

    def read(self) -> tuple[float, float, float]:
        """Frequency [Hz], amplitude [V] and offset [V], as the device holds them."""
        frequency, amplitude, offset = self.get_many("frequency", "amplitude", "offset")
        return frequency, amplitude, offset
