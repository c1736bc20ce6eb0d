"""Twins of positioners, which move the probe of the rig: those of makers' devices, by their maps, and that of ours."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from palpate.instrument.bench.role_maps import PositionerMap, PositionerSettings, State, ramp_of, speed_of
from palpate.instrument.contracts.contract import Command, Contract, Field, sdo
from palpate.instrument.contracts.own import POSITIONER
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.devices.twin import CanopenTwin, Twin
from palpate.simulators.wire.device import DEVICE_FAILURE, ILLEGAL_VALUE, Refused, SimulatedDevice, SimulatedPlace

# --- A simulated axis: it speeds up, goes at a constant speed, and slows down --------------------------


class Axis:
    """Position of an axis over time [step]; times are those of the bench's clock [ns]."""

    def __init__(self) -> None:
        self._from = self._to = 0.0
        self._begun_ns = 0
        self._speed = self._up = self._down = math.inf
        self.ends_ns = NEVER

    @property
    def moving(self) -> bool:
        return self.ends_ns != NEVER

    @property
    def goal(self) -> float:
        return self._to

    def put(self, position: float) -> None:
        """Stand at a position, which counts differently from now on."""
        self._from = self._to = position
        self.ends_ns = NEVER

    def go(self, now_ns: int, goal: float, speed: float, up: float, down: float) -> None:
        """Go to `goal` at a speed [step/s], with these accelerations [step/s²]."""
        self._from, self._to, self._begun_ns = self.at(now_ns), goal, now_ns
        distance = abs(self._to - self._from)
        peak = math.sqrt(2 * distance / (1 / up + 1 / down)) if up < math.inf or down < math.inf else math.inf
        self._speed, self._up, self._down = min(speed, peak), up, down
        self.ends_ns = now_ns + round(1e9 * self._duration()) if distance else NEVER

    def _duration(self) -> float:
        v, distance = self._speed, abs(self._to - self._from)
        return distance / v + v / 2 * (1 / self._up + 1 / self._down)

    def at(self, now_ns: int) -> float:
        """Position at a time [step]."""
        if not self.moving:
            return self._to
        passed = 1e-9 * (now_ns - self._begun_ns)
        v, distance, whole = self._speed, abs(self._to - self._from), self._duration()
        if passed >= whole:
            return self._to
        if passed < v / self._up:
            gone = self._up * passed**2 / 2
        elif whole - passed < v / self._down:
            gone = distance - self._down * (whole - passed) ** 2 / 2
        else:
            gone = v * (passed - v / self._up / 2)
        return self._from + math.copysign(gone, self._to - self._from)

    def stop(self, now_ns: int) -> None:
        """Stop where it is."""
        self.put(round(self.at(now_ns)))

    def arrive(self) -> None:
        """Stand at the goal."""
        self.put(self._to)


# -------------------------------------------------------------------------------------------------------
# The state machine of a drive (CiA 402-2): what its controlword asks for, and what its statusword tells

DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOPPING, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x08
OF_THE_STATE = 0x6F  # bits of the statusword that tell the state
RESET = 0x80  # bit of the controlword
STAYING = 5  # the least option code of a quick stop (605Ah) with which a drive stays in that state


class DriveState:
    """State of a drive, as the bits of its statusword.

    Attributes:
        bits: the state.
    """

    def __init__(self) -> None:
        self.bits = DISABLED
        self._last = 0

    @property
    def enabled(self) -> bool:
        return self.bits == ENABLED

    def control(self, word: int, quick_stop: int) -> None:
        """Take a controlword; one that the present state does not know changes nothing.

        Args:
            word: the controlword.
            quick_stop: option code of a quick stop (605Ah): with 5 or more the drive stays in that state, with less it
                is disabled once it stands still.
        """
        rising = word & ~self._last
        self._last = word
        if self.bits == FAULT:
            if rising & RESET:
                self.bits = DISABLED
        elif not word & 0x02:  # disable voltage
            self.bits = DISABLED
        elif not word & 0x04:  # quick stop
            self.bits = QUICK_STOPPING if self.enabled and quick_stop >= STAYING else DISABLED
        elif word & 0x0F == 0x06:  # shutdown
            self.bits = READY if self.bits != QUICK_STOPPING else self.bits
        elif word & 0x0F == 0x07 and self.bits in (READY, ENABLED):  # switch on, disable operation
            self.bits = SWITCHED_ON
        elif word & 0x0F == 0x0F and self.bits in (READY, SWITCHED_ON):  # enable operation
            self.bits = ENABLED

    def fail(self) -> None:
        """Go to the state of a fault, which stays until it is reset."""
        self.bits = FAULT


# --- the twins -----------------------------------------------------------------------------------------

HOMING_SPEED = 5e-3  # m/s [A]
LOST, BEYOND = 0x85, 0x70  # alarms of a master that is gone, and of a target beyond the limits (BLV-R)
MASTER_GONE = 0x8130  # emergency of CiA 301


class Moving:
    """What twins of positioners have in common: an axis that moves the probe, and what stops it."""

    contract: Contract
    clock: VirtualClock
    settings: dict[str, float]
    rig: Any
    _map: PositionerMap
    _stage: PositionerSettings
    speed: float
    _homing = False  # whether it looks for its home
    _offset = 0.0  # position of the probe where the drive counts 0 [step]

    def _put_on(self, place: SimulatedPlace) -> None:
        self._map, self._stage, self.rig = place.kind.table(PositionerMap), place.settings, place.rig
        self._axis = Axis()
        self._homed = False
        self._gone_ns = NEVER  # when its master counts as gone

    def _set_by_a_person(self) -> dict[str, float]:
        """The settings that a person must have made at the device."""
        found = {}
        for name in self._map.requires:
            f = self.contract[name]
            allowed = [self.contract.raw(name, value) * f.scale for value in self._map.required(name)]
            found[name] = self.settings[name] if self.settings[name] in allowed else allowed[0]
        return found

    def _turn(self) -> float:
        steps = self._map.steps_per_turn
        return self.settings[steps] if isinstance(steps, str) else steps

    def _go(self) -> bool:
        """Begin the move that its settings describe; returns whether the target is within its limits."""
        m, held = self._map, self.settings
        goal = held[m.target]
        if m.soft_limits and held[m.soft_limits[0]] != held[m.soft_limits[1]]:
            low, high = (held[name] for name in m.soft_limits)
            if not low <= goal <= high:
                return False
        turn = self._turn()
        speed = speed_of(self.contract[m.speed].unit, turn, held[m.speed])
        up, down = (
            ramp_of(self.contract[name].unit, turn, speed, held[name]) for name in (m.acceleration, m.deceleration)
        )
        self._axis.go(self.clock.now_ns(), goal, speed, up, down)
        return True

    def _find_home(self) -> None:
        speed = HOMING_SPEED / abs(self._stage.metres_per_step)
        self._homed = False
        self._homing = True
        self._axis.go(self.clock.now_ns(), -self._offset, speed, 10 * speed, 10 * speed)
        if not self._axis.moving:
            self._count_from_home()

    def _count_from_home(self) -> None:
        self._homing, self._homed, self._offset = False, True, 0.0
        self._axis.put(0.0)

    def _halt(self) -> None:
        self._homing = False
        self._axis.stop(self.clock.now_ns())
        self._tell_rig()

    def _lose_home(self) -> None:
        """Count from where it stands, as a drive without an absolute scale does when it is switched on."""
        self._offset += self._axis.goal
        self._axis.put(0.0)
        self._homed = False

    def _tell_rig(self) -> None:
        self.rig.set_position((self._axis.goal + self._offset) * self._stage.metres_per_step)

    def next_event_ns(self) -> int:
        return min(self._axis.ends_ns, self._gone_ns)

    def advance(self, start_ns: int, end_ns: int) -> None:
        if end_ns >= self._axis.ends_ns:
            self._axis.arrive()
            self._tell_rig()
            if self._homing:
                self._count_from_home()
        if end_ns >= self._gone_ns:
            self._gone_ns = NEVER
            self._halt()
            self._master_gone()

    def _heard_of_master(self, within: float) -> None:
        """It must be heard of again within this time of the clients' clock [s]; negative: it need not."""
        self._gone_ns = self.clock.now_ns() + round(1e9 * within * self.speed) if within > 0 else NEVER

    def _master_gone(self) -> None:
        """Called when nothing was heard of the master for too long; it has stopped."""


class SimulatedMappedPositioner:
    """The twin of a positioner on the bus of its map."""

    @staticmethod
    def at(place: SimulatedPlace) -> SimulatedModbusPositioner | SimulatedDriveNode:
        return (SimulatedModbusPositioner if place.kind.contract.bus == "modbus" else SimulatedDriveNode)(place)


class SimulatedModbusPositioner(Moving, Twin):
    """The twin of a positioner on Modbus, which a write starts."""

    def __init__(self, place: SimulatedPlace) -> None:
        self._put_on(place)
        self._alarm = 0
        self._on = False
        super().__init__(place)

    def reset(self) -> None:
        """Return to the state after power-on; the axis stops, and the position stays."""
        self._axis.stop(self.clock.now_ns())
        self._alarm, self._on, self._gone_ns = 0, False, NEVER
        super().reset()
        self.settings |= self._set_by_a_person()
        if not self._map.keeps_home:
            self._lose_home()

    def read(self, name: str) -> float:
        m = self._map
        if name == m.position:
            return float(round(self._axis.at(self.clock.now_ns())))
        states = [(state, true) for state, true in self._states() if state.field == name]
        return float(self._word(states)) if states else super().read(name)

    def _states(self) -> Iterator[tuple[State, bool]]:
        """The states that the map knows, and whether the device is in them."""
        m = self._map
        yield m.arrived, not self._axis.moving
        yield m.ready, self._on
        yield m.fine, not self._alarm
        if m.homed:
            yield m.homed, self._homed

    def _word(self, states: list[tuple[State, bool]]) -> int:
        word = 0
        for state, true in states:
            if state.mask is None:
                word = state.values[0] if true else self._alarm
            else:
                word |= state.values[0] if true else state.mask & ~state.values[0]
        return word

    def written(self, values: Mapping[str, float]) -> None:
        m, contract = self._map, self.contract
        if lifetime := values.get(m.lifetime, 0.0):
            self._heard_of_master(1e-3 * lifetime)
        starts = {name: contract.raw(name, value) for name, value in m.with_target.items()}
        if m.target in values and all(
            name in values and contract[name].to_raw(values[name]) == raw for name, raw in starts.items()
        ):
            self._start()
        for name, value in m.idle.items():  # the device clears its trigger
            self.settings[name] = contract.raw(name, value) * contract[name].scale

    def _start(self) -> None:
        if self._alarm or not self._on:
            raise Refused(DEVICE_FAILURE)
        if not self._go():
            self._alarm = BEYOND

    def carry_out(self, command: Command) -> None:
        m = self._map
        if command.name == m.enable:
            self._on = not self._alarm
        elif command.name == m.stop:
            self._halt()
        elif command.name == m.reset:
            self._alarm = 0
        elif command.name == m.find_home[-1] and self._on:
            self._find_home()

    def _master_gone(self) -> None:
        self._alarm = LOST


VOLTAGE, REMOTE, REACHED, SPECIFIC = 0x10, 0x200, 0x400, 0x1000  # bits of the status word that tell no state
NEW = 0x10  # bit of the control word that starts a move
CONTROLWORD, STATUSWORD, QUICK_STOP, MODE, MODE_SHOWN = map(sdo, (0x6040, 0x6041, 0x605A, 0x6060, 0x6061))
PROFILE_POSITION, HOMING = 1, 6  # modes
BRAKES = 2  # 605Ah where the map does not have it: it brakes, and is disabled (CiA 402-2)


class SimulatedDriveNode(Moving, CanopenTwin):
    """The twin of a drive on CANopen, with the state machine and the modes of CiA 402: profile position and homing."""

    def __init__(self, place: SimulatedPlace) -> None:
        self._put_on(place)
        self._names = {f.address: f.name for f in place.kind.contract.fields}
        super().__init__(place)
        place.clock.add(self)

    def reset(self) -> None:
        """Return to the state after power-on; the axis stops, and the position stays."""
        super().reset()
        self.settings |= self._set_by_a_person()
        self._state, self._taken, self._gone_ns = DriveState(), False, NEVER
        self._axis.stop(self.clock.now_ns())
        if not self._map.keeps_home:
            self._lose_home()

    def read(self, field: Field) -> Any:
        if field.address == STATUSWORD:
            return self._word()
        if field.address == MODE_SHOWN:
            return self._holds(MODE)
        if field.name == self._map.position:
            return round(self._axis.at(self.clock.now_ns()))
        homed = self._map.homed
        if homed and field.name == homed.field:
            return homed.values[0] if self._homed else 0
        return super().read(field)

    def _holds(self, address: int, otherwise: int = 0) -> int:
        """What an object holds; `otherwise`: where the map does not have it."""
        name = self._names.get(address)
        return int(self.settings[name]) if name else otherwise

    def _word(self) -> int:
        specific = self._homed if self._holds(MODE) == HOMING else self._taken
        return self._state.bits | VOLTAGE | REMOTE | (not self._axis.moving) * REACHED | specific * SPECIFIC

    def write(self, field: Field, value: float) -> None:
        """Store what a client writes, and follow the control word."""
        before = self._holds(CONTROLWORD)
        super().write(field, value)
        if field.address == CONTROLWORD:
            self._controlled(before, int(value))
        elif field.name == self._map.heartbeat:
            self._gone_ns = NEVER  # it waits from the first heartbeat on

    def _controlled(self, before: int, word: int) -> None:
        was_enabled = self._state.enabled
        self._state.control(word, self._holds(QUICK_STOP, BRAKES))
        if was_enabled and not self._state.enabled:
            self._halt()
        if was_enabled and self._state.enabled and word & ~before & NEW:
            self._begin()
        if not word & NEW:
            self._taken = False

    def _begin(self) -> None:
        if self._holds(MODE) == HOMING:
            self._find_home()
        elif self._holds(MODE) == PROFILE_POSITION and (not self._map.torque or self.settings[self._map.torque]):
            self._taken = self._go()

    def heard(self, node_id: int) -> None:
        """As for every node."""
        watched = int(self.settings[self._map.heartbeat])
        if watched >> 16 == node_id and watched & 0xFFFF:
            self._heard_of_master(1e-3 * (watched & 0xFFFF))

    def _master_gone(self) -> None:
        self._state.fail()
        self.emergency(MASTER_GONE)


# --- ours ----------------------------------------------------------------------------------------------


class SimulatedPositioner(SimulatedDevice):
    """Our micro-positioner, which has what no map tells: it moves at constant speed, and refuses what is out of limits.

    The rig takes the new position when a move has ended.
    """

    contract = POSITIONER

    def __init__(self, clock: VirtualClock, serial: str) -> None:
        super().__init__(clock, serial)
        self._axis = Axis()  # its steps are metres
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
            at_limit = self._position() in (self.settings["limit_low"], self.settings["limit_high"])
            true = {"moving": self._axis.moving, "homed": self._homed, "at_limit": at_limit}
            return sum(true[bit] << place for bit, place in self.contract["status"].bits.items())
        return super().read(name)

    def next_event_ns(self) -> int:
        return self._axis.ends_ns

    def advance(self, start_ns: int, end_ns: int) -> None:
        if end_ns >= self._axis.ends_ns:
            self._axis.arrive()
            self.rig.set_position(self._axis.goal)

    def _position(self) -> float:
        at = self._axis.at(self.clock.now_ns())
        return round(at * 1e6) / 1e6 if self._axis.moving else at

    def _go(self, target: float, speed: float) -> None:
        self._axis.put(self._position())
        self._axis.go(self.clock.now_ns(), target, speed, math.inf, math.inf)
        if not self._axis.moving:
            self.rig.set_position(target)
