"""Driver of the micro-positioner."""

from __future__ import annotations

import math

from palpate.drivers.clock import Clock
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.contracts import positioner
from palpate.instrument.errors import DeviceError, RangeError

POLL = 0.1  # s
CLOSE = 2e-6  # m from the target at which it counts as there


class MicroPositioner(ModbusDevice):
    """The micro-positioner, which moves the probe."""

    contract = positioner.CONTRACT
    orders = frozenset({"target", "speed", "command"})

    def __init__(self, link: ModbusLink, unit: int, clock: Clock) -> None:
        super().__init__(link, unit, clock)
        self._limits = (0.0, 0.0)
        self._target: float | None = None  # position that it was sent to and has reached [m]
        self._together = False

    def connect(self) -> None:
        super().connect()
        if "limit_high" not in self._settings:
            low, high = self.get_many("limit_low", "limit_high")
            self._limits = (low, high)
            self._remember({"limit_low": low, "limit_high": high})

    def position(self) -> float:
        """Present position, counted downwards from home [m]."""
        return self.get("position")

    def _look(self) -> tuple[float, frozenset[str]]:
        """Position [m], and the status bits of the same moment or just before.

        The contract has no field next to these two, so that all such reads would have the same length, and a late reply
        could pass for the next one. Every second time they are therefore read one by one, the status first: if it says
        that nothing moves, the position is final.
        """
        self._together = not self._together
        if self._together:
            position, status = self.get_many("position", "status")
        else:
            status, position = self.get("status"), self.get("position")
        return position, frozenset(self.contract.set_bits("status", status))

    def travel(self) -> float:
        """Upper soft limit [m]."""
        return self._limits[1]

    def home(self, timeout: float = 60.0) -> None:
        """Go to the home position, and wait until it is there. Raises DeviceError: not within `timeout` [s]."""
        self._target = None
        if not self.set(command="home"):
            self._await_start(lambda: self._has_begun(0.0))
        self._wait(0.0, 0.0, timeout)

    def move(self, target: float, speed: float = 1e-3, timeout: float = 60.0) -> None:
        """Go to `target` [m] at `speed` [m/s], and wait until it is there.

        Raises:
            RangeError: the target is outside the soft limits; nothing is sent.
            DeviceError: it is not there within `timeout` [s].
        """
        low, high = self._limits
        if not low <= target <= high:
            raise RangeError(
                f"micro-positioner: target {1e3 * target:g} mm is outside its limits {1e3 * low:g} to {1e3 * high:g} "
                "mm; give one inside"
            )
        distance = abs(target - self.position())
        self._target = None
        if not self.set(target=target, speed=speed, command="move"):
            self._await_start(lambda: self._has_begun(target))
        self._wait(target, distance / speed, timeout)

    def _has_begun(self, target: float) -> bool:
        """Whether it moves, or stands at this position [m]."""
        position, status = self._look()
        return "moving" in status or abs(position - target) <= CLOSE

    def stop(self) -> None:
        """Stop at the present position."""
        self._target = None
        if not self.set(command="stop"):
            self._await_start(lambda: "moving" not in self._look()[1])

    def set_limits(self, low: float, high: float) -> None:
        """Set the soft limits [m]. Raises RangeError: `low` is above `high`; nothing is sent."""
        if not low <= high:
            raise RangeError(
                f"micro-positioner: lower limit {1e3 * low:g} mm is not at or below the upper limit {1e3 * high:g} mm"
            )
        self.set(limit_low=low, limit_high=high)
        self._limits = (low, high)

    def _wait(self, target: float, expected: float, timeout: float) -> None:
        """Wait the `expected` time [s], then poll until it stands; the further it has to go, the less often."""
        waited = min(expected, timeout)
        self.clock.wait(waited)
        polls, before = 1, math.inf
        while True:
            position, status = self._look()
            if "moving" not in status:
                break
            if waited >= timeout:
                self.stop()
                raise DeviceError(
                    f"{self.name}: not at {1e3 * target:g} mm after {timeout:g} s; it was stopped: look for an obstacle"
                )
            ahead = polls * abs(target - position) / (abs(position - before) or math.inf)  # polls, at the present speed
            polls = max(1, min(2 * polls, int(ahead), math.ceil((timeout - waited) / POLL)))
            self.clock.wait(polls * POLL)
            waited += polls * POLL
            before = position
        if abs(position - target) > CLOSE:
            raise DeviceError(f"{self.name}: stands at {1e3 * position:g} mm, was sent to {1e3 * target:g} mm")
        self._target = target

    def differences(self) -> list[str]:
        """As for every device; it must also know its home, and stand at the position that it was sent to."""
        found = super().differences()
        position, status = self._look()
        if "homed" not in status:
            found.append(f"{self.name}: has lost its home")
        if self._target is not None and abs(position - self._target) > CLOSE:
            found.append(f"{self.name}: stands at {1e3 * position:g} mm, was sent to {1e3 * self._target:g} mm")
        return found
