"""Twins of load indicators, which read the rig's load cell: those of makers' devices, by their maps, and of ours."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.bench.role_maps import NOT, LoadIndicatorMap, LowPass
from palpate.instrument.contracts.contract import Command
from palpate.instrument.contracts.own import STRAIN_INDICATOR
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.devices.twin import Twin
from palpate.simulators.rig import Rig, RigLoadCell
from palpate.simulators.wire.device import DEVICE_BUSY, Refused, SimulatedDevice, SimulatedPlace

SETTLING = 2.0  # periods of its cut-off frequency after which a filter has forgotten what was before
LONGEST_NS = 10_000_000_000  # ns of the past that are looked at
STILL_NS = 300_000_000  # ns in which a load must not move more than a step in order to be stable [A]
STEP, SHIPPED_DECIMALS = 1, 3  # step of a new display in its last decimal, and number of its decimals [A]


@lru_cache(16)
def _response(order: int, corner: float, rate: float, size: int) -> npt.NDArray[np.complex128]:
    """Response of a Butterworth filter for samples at a rate [1/s], at the frequencies of so many samples (n,).

    It is made from the analogue filter by the bilinear transform, which keeps the cut-off frequency.
    """
    frequencies = np.fft.rfftfreq(size, 1 / rate)[:-1]
    s = 1j * np.tan(math.pi * frequencies / rate) / math.tan(math.pi * min(corner / rate, 0.45))
    poles = np.exp(0.5j * math.pi * (2 * np.arange(order) + order + 1) / order)
    response = 1 / np.prod(s[:, np.newaxis] - poles, axis=1) * np.prod(-poles).real
    return np.append(response, 0.0)  # at half the rate nothing passes


def low_passed(force: Floats, low_pass: LowPass, rate: float) -> Floats:
    """Samples (n,) at a rate [1/s] behind a filter that was at rest at the first of them."""
    size = 2 * len(force)  # the second half takes up what the filter still gives after the end
    response = _response(low_pass.order, low_pass.corner, rate, size)
    passed = np.fft.irfft(np.fft.rfft(force - force[0], size) * response, size)
    found: Floats = passed[: len(force)] + force[0]
    return found


class SimulatedMappedLoadIndicator(Twin):
    """A load indicator, with the fields and commands that its map names for the role."""

    readings: tuple[str, ...] = ("reading",)  # type: ignore[misc]  # that it has some; those of a device are its map's

    def __init__(self, place: SimulatedPlace) -> None:
        self.rig = place.rig
        self._cell = RigLoadCell(place.rig)
        role = place.kind.table(LoadIndicatorMap)
        self._role, self._own = role, place.settings
        self.rig.gage_factor = self._own.gage_factor
        rate = self._own.rate or role.rate
        self._step_ns = round(1e9 / rate)
        self._rate = 1e9 / self._step_ns
        self._recent = math.ceil(STILL_NS / self._step_ns)
        extremes = (role.peak_to_peak, role.greatest, role.least)
        self.readings = tuple(name for name in (role.reading, *extremes) if name)
        self._looked_at: tuple[Any, ...] = ()
        super().__init__(place)

    def reset(self) -> None:
        """As for every device; the tare is off, and the extremes are cleared."""
        super().reset()
        for f in self.contract.fields:
            if f.scaling is not None and f.scaling.by == "decimals":
                self.settings[f.scaling.told_by] = SHIPPED_DECIMALS
        role = self._role
        if role.step:
            coded = sorted((step, float(code)) for code, step in role.steps.items())
            finest = next((code for step, code in coded if step >= 10.0**-SHIPPED_DECIMALS * (1 - 1e-9)), 0.0)
            self.settings[role.step] = finest if coded else STEP * self.contract.step(role.step, self.settings)
        self._tare = 0.0
        self._clear()

    def read(self, name: str) -> float:
        """Present physical value of a field, in the contract's unit."""
        role = self._role
        if name == role.status:
            return self._status()
        if name in (role.reading, role.gross):
            return self._rounded(self._gross() - (self._tare if name == role.reading else 0.0))
        if name in (role.peak_to_peak, role.greatest, role.least):
            low, high = self._found()
            return self._rounded({role.peak_to_peak: high - low, role.greatest: high}.get(name, low))
        return super().read(name)

    def carry_out(self, command: Command) -> None:
        """Called when a command is carried out."""
        role = self._role
        if command.name == role.clear:
            self._clear()
        elif command.name == role.clear_tare:
            self._tare = 0.0
        elif command.name == role.tare:
            self._tare = self._gross()

    # --- what it shows ---------------------------------------------------------------------------------

    @property
    def _step(self) -> float:
        """Step of the display, in its unit."""
        role = self._role
        if not role.step:
            return float(self._own.resolution or 10.0**-SHIPPED_DECIMALS)
        shown = self.settings[role.step]
        step: float = role.steps[f"{shown:g}"] if role.steps else shown
        return step

    def _rounded(self, value: float) -> float:
        return round(value / self._step) * self._step

    def _gross(self) -> float:
        """The load in the unit of the display, as it was at the last reading that the device made."""
        now = self.clock.now_ns() // self._step_ns
        force = self._cell.crept(float(self._filtered(now, self._recent)[-1]), now * self._step_ns)
        return self._shown(force, now)

    def _shown(self, force: float, update: int) -> float:
        signal = self._cell.signal(force, self._own.gage_factor) + self.added_mV(update * self._step_ns)
        return self._cell.given(signal, update) / float(self._own.span)

    def added_mV(self, time_ns: int) -> float:
        """What a fault adds to the signal of the bridge at a time [mV]; nothing without one."""
        return 0.0

    def _status(self) -> float:
        """The status word: signs of loads, and whether the load is stable."""
        role = self._role
        bits = self.contract[role.status].bits
        word = 0
        states = {role.stable: self._still()} if role.stable else {}
        for which, true in (states | dict.fromkeys(role.faults, False)).items():
            if true != which.startswith(NOT):
                word |= 1 << bits[which.removeprefix(NOT)]
        for f in self.contract.fields:
            if f.sign and f.sign[0] == role.status and self.read(f.name) < 0:
                word |= 1 << bits[f.sign[1]]
        return float(word)

    def _still(self) -> bool:
        now = self.clock.now_ns() // self._step_ns
        force = self._filtered(now, self._recent)
        moved = self._cell.signal(float(np.ptp(force)), self._own.gage_factor) / self._own.span
        return bool(moved <= self._step)

    # --- the past --------------------------------------------------------------------------------------

    def _clear(self) -> None:
        """From now on look for extremes anew."""
        self._since = self.clock.now_ns() // self._step_ns + 1
        self._extremes: tuple[float, float] | None = None

    def _found(self) -> tuple[float, float]:
        """The least and the greatest reading since they were cleared, in the unit of the display.

        Of a longer time than 10 s without a look at them the last 10 s count [A].
        """
        now = self.clock.now_ns() // self._step_ns
        if now >= self._since:
            count = min(now - self._since + 1, LONGEST_NS // self._step_ns)
            force = self._filtered(now, count)
            places = (int(force.argmin()), int(force.argmax()))
            low, high = (self._shown(float(force[at]), now - count + 1 + at) for at in places)
            if self._extremes is not None:
                low, high = min(low, self._extremes[0]), max(high, self._extremes[1])
            self._extremes, self._since = (low, high), now + 1
        if self._extremes is None:
            load = self._gross()
            return load, load
        return self._extremes

    @property
    def _low_pass(self) -> LowPass:
        """The filter that is set."""
        table = self._role.filter
        if table is None:
            return LowPass(corner=self._own.bandwidth or self._rate)
        level = f"{self.settings[table.field]:g}"
        return table.levels.get(level) or min(table.levels.values(), key=lambda each: each.corner)

    def _filtered(self, last: int, count: int) -> Floats:
        """The last `count` readings of the force up to that number, behind the filter (count,) [N].

        There are fewer where the bench was not there yet.
        """
        low_pass = self._low_pass
        moment = (last, count, self.rig.changes, low_pass)
        if moment != self._looked_at[:-1]:
            before = math.ceil(SETTLING * self._rate / low_pass.corner)
            total = max(min(count + before, LONGEST_NS // self._step_ns, last + 1), 1)
            force = self._cell.forces(last * self._step_ns, total, self._step_ns)
            self._looked_at = (*moment, low_passed(force, low_pass, self._rate)[-count:])
        found: Floats = self._looked_at[-1]
        return found


# --- ours ----------------------------------------------------------------------------------------------

UPDATE_NS = 100_000_000  # ns between two updates of the display [A]
DETECTOR_RATE = 2400  # Hz, sample rate of the peak detector [A]
DETECTOR_NS = 1_000_000_000 // DETECTOR_RATE  # ns between two samples of the peak detector
SETTLED = 7  # time constants of the filter after which a reading counts as stable [A]
COMMAND_NS = 50_000_000  # ns that a command takes [A]


class SimulatedStrainIndicator(SimulatedDevice):
    """Our strain indicator, which has what no map tells: a peak detector over a window, and commands that take time."""

    contract = STRAIN_INDICATOR
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
        if "gage_factor" in values:
            self._rig.gage_factor = values["gage_factor"]

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
        needed = round(self.settings["filter"] * (SETTLED if track else 1) * 1e9)
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
