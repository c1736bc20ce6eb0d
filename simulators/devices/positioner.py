"""Simulated micro-positioner: moves at constant speed."""

from __future__ import annotations

from typing import Self

from palpate.instrument.contracts import positioner
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.rig.rig import Rig
from palpate.simulators.wire.device import ILLEGAL_VALUE, Refused, SimulatedDevice, SimulatedPlace

HOMING_SPEED = 5e-3  # m/s [A]


class SimulatedPositioner(SimulatedDevice):
    """The micro-positioner. The rig takes the new position when a move has ended."""

    contract = positioner.CONTRACT

    @classmethod
    def at(cls, place: SimulatedPlace) -> Self:
        return cls(place.clock, place.serial, place.rig)

    def __init__(self, clock: VirtualClock, serial: str, rig: Rig) -> None:
        super().__init__(clock, serial)
        self._rig = rig
        self._from = self._to = 0.0
        self._start_ns = self._end_ns = 0
        self._moving = False
        self._homed = True

    def write(self, values: dict[str, float]) -> None:
        new = {**self.settings, **values}
        if not new["limit_low"] <= new["limit_high"]:
            raise Refused(ILLEGAL_VALUE)
        command = self.contract.choice("command", values.get("command", 0.0))
        if command == "move" and not new["limit_low"] <= new["target"] <= new["limit_high"]:
            raise Refused(ILLEGAL_VALUE)
        self.settings = {**new, "command": 0.0}
        match command:
            case "move":
                self._go(new["target"], new["speed"])
            case "home":
                self._go(0.0, HOMING_SPEED)
                self._homed = True
            case "stop":
                self._go(self._position(), new["speed"])

    def reset(self) -> None:
        """Power-on keeps the position, which has an absolute scale, but clears the homed bit."""
        self.write({"command": self.contract["command"].choices["stop"]})
        super().reset()
        self._homed = False

    def read(self, name: str) -> float:
        if name == "position":
            return self._position()
        if name == "status":
            bits = self.contract["status"].bits
            at_limit = self._position() in (self.settings["limit_low"], self.settings["limit_high"])
            return (self._moving << bits["moving"]) | (self._homed << bits["homed"]) | (at_limit << bits["at_limit"])
        return super().read(name)

    def next_event_ns(self) -> int:
        return self._end_ns if self._moving else NEVER

    def advance(self, start_ns: int, end_ns: int) -> None:
        if self._moving and end_ns >= self._end_ns:
            self._arrive()

    def _position(self) -> float:
        if not self._moving:
            return self._to
        done = (self.clock.now_ns() - self._start_ns) / (self._end_ns - self._start_ns)
        return round((self._from + done * (self._to - self._from)) * 1e6) / 1e6

    def _go(self, target: float, speed: float) -> None:
        self._from, self._to = self._position(), target
        self._start_ns = self.clock.now_ns()
        self._end_ns = self._start_ns + round(abs(self._to - self._from) / speed * 1e9)
        self._moving = self._end_ns > self._start_ns
        if not self._moving:
            self._arrive()

    def _arrive(self) -> None:
        self._moving = False
        self._rig.set_position(self._to)
