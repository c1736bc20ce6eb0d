"""Simulated strain indicator: reads the rig's load cell through a filter or a peak detector."""

from __future__ import annotations

import math
from typing import Self

from palpate.instrument.contracts import strain_indicator
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.rig.rig import Rig, RigLoadCell
from palpate.simulators.wire.device import DEVICE_BUSY, Refused, SimulatedDevice, SimulatedPlace

UPDATE_NS = 100_000_000  # ns between two updates of the display [A]
DETECTOR_RATE = 2400  # Hz, sample rate of the peak detector [A]
DETECTOR_NS = 1_000_000_000 // DETECTOR_RATE  # ns between two samples of the peak detector
SETTLING = 7  # time constants of the filter after which a reading counts as stable [A]
COMMAND_NS = 50_000_000  # ns that a command takes [A]


class SimulatedStrainIndicator(SimulatedDevice):
    """The strain indicator, with the load cell of the rig."""

    contract = strain_indicator.CONTRACT
    readings = ("reading", "reading_float", "updates")

    @classmethod
    def at(cls, place: SimulatedPlace) -> Self:
        return cls(place.clock, place.serial, place.rig)

    def __init__(self, clock: VirtualClock, serial: str, rig: Rig) -> None:
        super().__init__(clock, serial)
        self._rig = rig
        self._cell = RigLoadCell(rig)
        self._set_at_ns = 0
        self._zero = 0.0
        self._tare = 0.0
        self._command = 0
        self._command_due_ns = NEVER
        self._looked_at: tuple[object, ...] = ()
        self._force = 0.0

    def write(self, values: dict[str, float]) -> None:
        if "command" in values:
            if self._command and values["command"]:
                raise Refused(DEVICE_BUSY)
            self._command = int(values["command"])
            self._command_due_ns = self.clock.now_ns() + COMMAND_NS if self._command else NEVER
        if "filter" in values or "mode" in values:
            self._set_at_ns = self.clock.now_ns()
        self.settings.update(values)
        if "filter" in values:
            self._rig.set_bridge_filter(values["filter"])

    def reset(self) -> None:
        self._command, self._command_due_ns = 0, NEVER
        self._zero = self._tare = 0.0
        super().reset()

    def next_event_ns(self) -> int:
        return self._command_due_ns

    def advance(self, start_ns: int, end_ns: int) -> None:
        if end_ns >= self._command_due_ns:
            self._carry_out()

    def read(self, name: str) -> float:
        match name:
            case "command":
                return self._command
            case "updates":
                return self.clock.now_ns() // UPDATE_NS % 65536
            case "decimals":
                return self._cell.decimals
            case "reading":
                return round(self._net() * 10.0**self._cell.decimals)
            case "reading_float":
                return self._net()
            case "status":
                bits = self.contract["status"].bits
                overload = not (abs(self._gross()) <= self.settings["full_scale"])
                return float(
                    (self._stable() << bits["stable"])
                    | (overload << bits["overload"])
                    | ((self._tare != 0) << bits["net"])
                )
        return super().read(name)

    def _net(self) -> float:
        return self._gross() - self._zero - self._tare

    def _gross(self) -> float:
        """Reading before zero and tare [mV], of the last update of the display."""
        update = self.clock.now_ns() // UPDATE_NS
        return self._cell.shown(self._cell.signal(self._detected(), self.settings["gage_factor"]), update)

    def _detected(self) -> float:
        """The detected load [N], found once for all registers that are read at the same moment."""
        moment = (self.clock.now_ns(), self._rig.changes, self.settings["mode"], self.settings["filter"])
        if moment != self._looked_at:
            self._looked_at, self._force = moment, self._load()
        return self._force

    def _load(self) -> float:
        now = self.clock.now_ns()
        if self.contract.choice("mode", self.settings["mode"]) == "track":
            return self._cell.crept(self._rig.filtered_cell_force(now), now)
        count = max(2, math.ceil(self.settings["filter"] * DETECTOR_RATE))
        force = self._cell.forces(now, count, DETECTOR_NS)
        return float(force.max() - force.min())

    def _stable(self) -> bool:
        """Whether the filter has settled since the last change, or the peak detector's window lies after it."""
        track = self.contract.choice("mode", self.settings["mode"]) == "track"
        needed = round(self.settings["filter"] * (SETTLING if track else 1) * 1e9)
        return min(self._rig.settled_for_ns(), self.clock.now_ns() - self._set_at_ns) >= needed

    def _carry_out(self) -> None:
        """Carry out the pending command, and set the command register back to idle."""
        name = self.contract.choice("command", self._command)
        result = "done"
        if name in ("zero", "tare") and not self._stable():
            result = "refused_unstable"
        elif name == "zero":
            self._zero = self._gross()
        elif name == "clear_zero":
            self._zero = 0.0
        elif name == "tare":
            self._tare = self._gross() - self._zero
        elif name == "clear_tare":
            self._tare = 0.0
        self.settings["last_command"] = self._command
        self.settings["command_result"] = self.contract["command_result"].choices[result]
        self._command, self._command_due_ns = 0, NEVER
