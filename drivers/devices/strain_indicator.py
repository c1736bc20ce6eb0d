"""Driver of the strain indicator."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.drivers.clock import Clock
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.kinds import IndicatorSettings
from palpate.instrument.contracts import strain_indicator
from palpate.instrument.errors import DeviceError

COMMAND_POLL = 0.01  # s between two polls of a command
COMMAND_POLLS = 100  # greatest number of these polls
DISPLAY = ("status", "decimals", "reading", "reading_float", "updates")  # adjacent fields, read together
UPDATES = 65536  # updates of the display after which their count starts again at 0
COUNTED_NS = 1_000_000_000_000  # ns in which the count grows by less than half of that, so that its order is clear
RENEWAL_NS = 300_000_000  # ns within which the display must have been updated, as it is ten times a second


@dataclass(frozen=True, slots=True)
class IndicatorReading:
    """A reading of the indicator.

    Attributes:
        reading_mV: the reading; NaN while the bridge is open.
        resolution_mV: step of the display.
        stable: whether the reading is stable.
        overload: whether the reading exceeds the full scale.
        bridge_open: whether the bridge is open.
        stale: whether the display was not updated since the last reading, although there was time for it.
    """

    reading_mV: float
    resolution_mV: float
    stable: bool
    overload: bool
    bridge_open: bool
    stale: bool = False

    @property
    def sick(self) -> str:
        """Why no load can be read, even if it is stable; empty: a load can be read."""
        faults = {"bridge open": self.bridge_open, "overload": self.overload, "display not updated": self.stale}
        return ", ".join(fault for fault, raised in faults.items() if raised)

    @property
    def valid(self) -> bool:
        return self.stable and not self.sick and math.isfinite(self.reading_mV)


class StrainIndicator(ModbusDevice):
    """The strain indicator, which reads the load cell."""

    contract = strain_indicator.CONTRACT
    orders = frozenset({"command"})

    def __init__(self, link: ModbusLink, unit: int, clock: Clock) -> None:
        super().__init__(link, unit, clock)
        self._renewed: tuple[int, float] | None = None
        self.gage_factor = math.nan  # until it is configured
        self.resolution_mV = math.nan
        """Step of the display at the last reading [mV]."""

    def identify(self) -> None:
        """As for every device; after a restart of the indicator its count of updates may be lower than before."""
        super().identify()
        self._renewed = None

    def set_up(self, settings: IndicatorSettings, watchdog: float) -> None:
        """As for every device."""
        self.configure(settings.gage_factor, 1e3 * settings.full_scale)

    def sick(self) -> str:
        """As for every device."""
        sick = self.read().sick
        return f"{sick}; check the bridge and its wires" if sick else ""

    def configure(self, gage_factor: float, full_scale_mV: float) -> None:
        """Set the gage factor, and the reading above which overload is flagged [mV]."""
        self.set(gage_factor=gage_factor, full_scale=full_scale_mV)
        self.gage_factor = gage_factor

    def track(self, time_constant: float) -> None:
        """Follow the load through a one-pole filter with this time constant [s]."""
        self.set(filter=time_constant, mode="track")

    def peak_to_peak(self, window: float) -> None:
        """Read the peak-to-peak load over the last `window` [s]."""
        self.set(filter=window, mode="peak_to_peak")

    def read(self) -> IndicatorReading:
        """Read the display. The device holds the reading twice, and both must agree.

        Raises:
            DeviceError: the integer and the floating-point reading differ, or the count of updates is lower than at the
                last reading, so that the reply is an old one.
        """
        values = self._asked(self._fresh)
        if self._renewed is not None and values[-1] == self._renewed[1]:
            values = self._asked(self._fresh)  # it may be the reply to the last read; this one has another length
        status, decimals, integer, floating, updates = values
        bits = self.contract.set_bits("status", status)
        step = self.resolution_mV = 10.0**-decimals
        reading = integer * step
        if "bridge_open" in bits:
            reading = math.nan
        elif not abs(reading - floating) <= step + 1e-6 * abs(reading):
            raise DeviceError(
                f"{self.name}: reading is {reading:g} mV as an integer and {floating:g} mV as a float, so it is not "
                "used; check the indicator's firmware"
            )
        return IndicatorReading(
            reading, step, "stable" in bits, "overload" in bits, "bridge_open" in bits, self._stale(updates)
        )

    def _fresh(self) -> list[float]:
        values = list(map(self._value, DISPLAY, self._read(DISPLAY)))
        if self._renewed is not None and self.clock.now_ns() - self._renewed[0] < COUNTED_NS:
            before, now = self._renewed[1], values[-1]
            if (now - before) % UPDATES > UPDATES / 2:
                self.link.distrust()
                raise DeviceError(
                    f"{self.name}: its display was updated {now:g} times, but {before:g} times at the reading before; "
                    "the reply is late, or the indicator was restarted, so it is not used"
                )
        return values

    def _stale(self, updates: float) -> bool:
        now = self.clock.now_ns()
        if self._renewed is None or updates != self._renewed[1]:
            self._renewed = now, updates
        return now - self._renewed[0] > RENEWAL_NS

    def zero(self) -> None:
        """Take the present reading as zero balance. Raises DeviceError: it is not stable."""
        self._command("zero")

    def clear_zero(self) -> None:
        self._command("clear_zero")

    def tare(self) -> None:
        """Show readings relative to the present one. Raises DeviceError: it is not stable."""
        self._command("tare")

    def clear_tare(self) -> None:
        self._command("clear_tare")

    def _command(self, command: str) -> None:
        if not self.set(command=command):
            self._await_start(lambda: self.contract.choice("command", self.get("command")) != "idle")
        for _ in range(COMMAND_POLLS):
            pending, last, result = self.get_many("command", "last_command", "command_result")
            if self.contract.choice("command", pending) == "idle":
                break
            self.clock.wait(COMMAND_POLL)
        else:
            raise DeviceError(
                f"{self.name}: {command} was not carried out within {COMMAND_POLL * COMMAND_POLLS:g} s; repeat it, or "
                "restart the indicator"
            )
        outcome = self.contract.choice("command_result", result)
        if self.contract.choice("last_command", last) != command or outcome != "done":
            raise DeviceError(f"{self.name}: {command} ended in {outcome}; wait for a stable reading and repeat it")
