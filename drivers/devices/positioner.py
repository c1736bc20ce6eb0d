"""Driver of the micro-positioner."""

from __future__ import annotations

import math

from palpate.drivers.clock import Clock
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.contracts import positioner
from palpate.instrument.errors import DeviceError, RangeError

POLL = 0.1  # s


class Positioner(ModbusDevice):
    contract = positioner.CONTRACT
    orders = frozenset({"target", "speed", "command"})

    def __init__(self, link: ModbusLink, unit: int, clock: Clock) -> None:
        super().__init__(link, unit, clock)
        self._limits = (0.0, 0.0)
        self._target: float | None = None  # where it was sent and came to stand
        self._together = False

    def connect(self) -> None:
        super().connect()
        if "limit_high" not in self._settings:
            low, high = self.get_many("limit_low", "limit_high")
            self._limits = (low, high)
            self._remember({"limit_low": low, "limit_high": high})

    def position(self) -> float:
        """Present position in m, counted downwards from home."""
        return self.get("position")

    def _look(self) -> tuple[float, frozenset[str]]:
        """Position in m, and what the status says of it or of a moment before.

        Both stand alone in the contract, so that looks would be alike in length and a late reply could pass for the
        next look. Every second time they are therefore asked for one by one, the status first: where it says that
        nothing moves, the position is the last one.
        """
        self._together = not self._together
        if self._together:
            position, status = self.get_many("position", "status")
        else:
            status, position = self.get("status"), self.get("position")
        return position, frozenset(self.contract.set_bits("status", status))

    def travel(self) -> float:
        """Upper soft limit in m."""
        return self._limits[1]

    def home(self, timeout: float = 60.0) -> None:
        """Go to the home position and wait for it."""
        self._target = None
        self.set(command="home")
        self._wait(0.0, 0.0, timeout)

    def move(self, target: float, speed: float = 1e-3, timeout: float = 60.0) -> None:
        """Go to `target` m at `speed` m/s and wait for it.

        Raises:
            RangeError: outside the soft limits; nothing is sent.
            DeviceError: not there within `timeout` s.
        """
        low, high = self._limits
        if not low <= target <= high:
            raise RangeError(
                f"micro-positioner: target {1e3 * target:g} mm is outside its limits {1e3 * low:g} to {1e3 * high:g} mm"
            )
        distance = abs(target - self.position())
        self._target = None
        self.set(target=target, speed=speed, command="move")
        self._wait(target, distance / speed, timeout)

    def stop(self) -> None:
        """Stop where it is."""
        self._target = None
        self.set(command="stop")

    def set_limits(self, low: float, high: float) -> None:
        """Set the soft limits in m. Raises RangeError where `low` is above `high`; nothing is sent."""
        if not low <= high:
            raise RangeError(
                f"micro-positioner: lower limit {1e3 * low:g} mm is not at or below the upper limit {1e3 * high:g} mm"
            )
        self.set(limit_low=low, limit_high=high)
        self._limits = (low, high)

    def _wait(self, target: float, expected: float, timeout: float) -> None:
        """Wait the `expected` s, then poll until it stands, less and less often as long as it has far to go."""
        waited = min(expected, timeout)
        self.clock.wait(waited)
        polls, before = 1, math.inf
        while True:
            position, status = self._look()
            if "moving" not in status:
                break
            if waited >= timeout:
                self.stop()
                raise DeviceError(f"{self.name}: not at {1e3 * target:g} mm after {timeout:g} s; stopped")
            ahead = polls * abs(target - position) / (abs(position - before) or math.inf)  # polls, at the present speed
            polls = max(1, min(2 * polls, int(ahead), math.ceil((timeout - waited) / POLL)))
            self.clock.wait(polls * POLL)
            waited += polls * POLL
            before = position
        if abs(position - target) > 2e-6:
            raise DeviceError(f"{self.name}: stands at {1e3 * position:g} mm, was sent to {1e3 * target:g} mm")
        self._target = target

    def differences(self) -> list[str]:
        """As of every device; it must know its home, too, and stand where it was sent."""
        found = super().differences()
        position, status = self._look()
        if "homed" not in status:
            found.append(f"{self.name}: has lost its home")
        if self._target is not None and abs(position - self._target) > 2e-6:
            found.append(f"{self.name}: stands at {1e3 * position:g} mm, was sent to {1e3 * self._target:g} mm")
        return found
