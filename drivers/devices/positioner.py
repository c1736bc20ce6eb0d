"""Drivers of positioners, which move the probe: that of makers' devices, by their maps, and that of ours."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from palpate.drivers.clock import Clock
from palpate.drivers.devices.either_bus import EitherBus
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.role_maps import (
    PositionerMap,
    PositionerSettings,
    State,
    ramp_value,
    speed_of,
    speed_value,
)
from palpate.instrument.contracts.contract import Value
from palpate.instrument.contracts.own import POSITIONER
from palpate.instrument.errors import BenchError, DeviceError, RangeError

POLL = 0.02  # s
WATCH = 1.0  # s without renewal after which a device that can do so stops a move
RENEWAL = WATCH / 4  # longest time between two looks at a move [s]
SLACK = 5.0  # s that a move may take longer than twice the expected time
NEAR = 1e-5  # m from its target at which a move has arrived
UNWATCHED = -1.0  # lifetime that ends the watch
MASTER = 127  # node id under which this program sends its heartbeat


class MappedPositioner(EitherBus):
    """A positioner of a maker.

    A target is written with its speed in one request where the device takes it so, and a command starts the move where
    a write does not. Until the device stands at its target, its master's life is renewed, if it has a watch for that.
    Whatever ends a move before, also Ctrl-C, stops the motor.
    """

    _map: PositionerMap
    _stage: PositionerSettings
    _turn = math.nan  # steps of a turn

    def connect(self) -> None:
        """As for every device. Raises DeviceError also where a person must set it otherwise."""
        assert self.kind is not None
        self._map = self.kind.table(PositionerMap)
        self._target: float | None = None  # position that it was sent to and has reached [m]
        self._knows_home = False  # of a device that does not tell
        m = self._map
        self.orders: frozenset[str] = self.orders | {m.target, m.speed, *m.with_target, m.lifetime, m.heartbeat}
        super().connect()
        self._check_required()
        self._turn = self.get(m.steps_per_turn) if isinstance(m.steps_per_turn, str) else m.steps_per_turn
        if not self._turn > 0:
            raise DeviceError(
                f"{self.name}: {m.steps_per_turn} is {self._turn:g}; set the steps of a turn", device=self.name
            )

    def _check_required(self) -> None:
        """Raises DeviceError: a person must set something otherwise at the device."""
        for name in self._map.requires:
            wanted, field, found = self._map.required(name), self.contract[name], self.held(name)
            if not math.isfinite(found) or field.to_raw(found) not in [self.contract.raw(name, v) for v in wanted]:
                shown = " or ".join(f"{each:g}" if isinstance(each, float) else each for each in wanted)
                raise DeviceError(
                    f"{self.name}: {name} is {self.contract.choice(name, found)}, must be {shown} ({field.meaning}); "
                    "set it at the device",
                    device=self.name,
                )

    def set_up(self, settings: Any, watchdog: float) -> None:
        """Write the travel limits and the settings of moves, and switch the motor on. Raises LinkError, DeviceError."""
        self._stage = settings
        m = self._map
        together = m.together(self.contract)
        holds: dict[str, Value] = dict(m.holds)
        if m.soft_limits:
            holds |= dict(zip(m.soft_limits, sorted((0.0, float(self._steps(settings.travel)))), strict=True))
        holds |= {name: value for name, value in self._moving(1.0).items() if name not in together}
        for name, value in holds.items():
            self.give(**{name: value})
        self._get_ready()

    def _steps(self, position: float) -> int:
        return round(position / self._stage.metres_per_step)

    def _moving(self, speed: float) -> dict[str, Value]:
        """Accelerations and torque of a move at a speed [step/s]."""
        m, settings = self._map, self._stage
        acceleration = settings.acceleration / abs(settings.metres_per_step)
        values: dict[str, Value] = {
            name: ramp_value(self.contract[name].unit, self._turn, speed, acceleration)
            for name in (m.acceleration, m.deceleration)
        }
        return {**values, **({m.torque: 100 * settings.torque} if m.torque else {})}

    def _get_ready(self) -> None:
        """Reset an alarm, and switch the motor on. Raises DeviceError: an alarm stays, or it does not go on."""
        self._reset_alarm()
        if not self._is(self._map.ready):
            self.command(self._map.enable)

    def _reset_alarm(self) -> None:
        if not self._is(self._map.fine):
            self.command(self._map.reset)

    def _is(self, state: State) -> bool:
        return self._holds(state, self.held(state.field))

    def _holds(self, state: State, found: float) -> bool:
        return state.condition.holds(self.contract[state.field].to_raw(found) if math.isfinite(found) else found)

    @property
    def _homed(self) -> bool:
        return self._is(self._map.homed) if self._map.homed else self._knows_home

    def position(self) -> float:
        """Present position, counted downwards from home [m]."""
        return self.get(self._map.position) * self._stage.metres_per_step

    def travel(self) -> float:
        """The lowest position to which it may go [m]."""
        return float(self._stage.travel)

    def home(self) -> None:
        """Go to 0, and wait until it is there; look for the home position first if the device has lost it."""
        self._get_ready()
        if not self._homed:
            self._check_required()
            self._target = None
            try:
                for command in self._map.find_home:
                    self.command(command)
            except BaseException:
                self._stop_anyhow()
                raise
            self._knows_home = True
        self.move(0.0)

    def move(self, target: float, speed: float = 1e-3) -> None:
        """Go to `target` [m] at `speed` [m/s], and wait until it is there.

        Raises:
            RangeError: the target is outside the travel, or the device cannot go so fast or so slowly; nothing is sent.
            DeviceError: it has lost its home, has an alarm, or is not there in time; it was stopped.
            LinkError: it does not answer; it was told to stop.
        """
        if not 0 <= target <= self.travel():
            raise RangeError(
                f"{self.name}: target {1e3 * target:g} mm is outside its travel of 0 to {1e3 * self.travel():g} mm; "
                "give one inside"
            )
        if not (math.isfinite(speed) and speed > 0):
            raise RangeError(f"{self.name}: speed {speed:g} m/s; give one above 0")
        values, expected = self._move(abs(target - self.position()), target, speed)
        if not self._homed:
            raise DeviceError(f"{self.name}: has lost its home; move it home first", device=self.name)
        self._get_ready()
        self._target = None
        try:
            self._begin(values)
            self._wait(target, expected, values)
            self._end_watch(values)
        except BaseException:
            self._stop_anyhow()
            with suppress(BenchError):
                self._end_watch(values)
            raise
        self._target = target

    def _move(self, distance: float, target: float, speed: float) -> tuple[dict[str, Value], float]:
        """What is written in order to move, and the time that it takes [s]. Raises RangeError: it cannot be written."""
        m, stage, field = self._map, self._stage, self.contract[self._map.speed]
        asked = speed_value(field.unit, self._turn, speed / abs(stage.metres_per_step))
        if self.contract.raw(m.speed, asked) <= 0:
            raise RangeError(
                f"{self.name}: speed {1e3 * speed:g} mm/s is {asked:.3g} {field.unit}, which it cannot go; give more"
            )
        rounded = speed_of(field.unit, self._turn, field.to_raw(asked) * field.scale)  # as the device takes it
        values: dict[str, Value] = {m.target: self._steps(target), m.speed: asked, **m.with_target}
        moving = self._moving(rounded)
        values |= {name: value for name, value in moving.items() if name in m.together(self.contract)}
        if m.lifetime:
            values[m.lifetime] = 1e3 * WATCH
        for name, value in values.items():
            self.contract.raw(name, value)
        going = rounded * abs(stage.metres_per_step)
        return values, distance / going + going / stage.acceleration

    def _begin(self, values: Mapping[str, Value]) -> None:
        if self._map.heartbeat:
            self.give(**{self._map.heartbeat: MASTER << 16 | round(1e3 * WATCH)})
            self._renew(values)
        self.give(**values)
        for command in self._map.start:
            self.command(command)

    def _renew(self, values: Mapping[str, Value], lifetime: float = 1e3 * WATCH) -> None:
        """Tell the device that this program is there, for another lifetime [ms]."""
        m = self._map
        if m.lifetime:
            self.give(**{**values, **m.idle, m.lifetime: lifetime})
        elif m.heartbeat:
            link: Any = self.link
            link.beat(MASTER)

    def _end_watch(self, values: Mapping[str, Value]) -> None:
        """Let the device go on when it hears nothing of this program any more."""
        if self._map.heartbeat:
            self.give(**{self._map.heartbeat: 0})
        elif self._map.lifetime:
            self._renew(values, UNWATCHED)

    def _wait(self, target: float, expected: float, values: Mapping[str, Value]) -> None:
        """Look at the move until it has arrived, as late as it is expected [s]. Raises DeviceError."""
        begun = self.clock.now_ns()
        longest = 2 * expected + SLACK
        while True:
            passed = 1e-9 * (self.clock.now_ns() - begun)
            self.clock.wait(min(max(expected - passed, POLL), RENEWAL))
            position, arrived = self.look()
            if arrived and abs(position - target) <= NEAR:
                return
            if passed > longest:
                raise DeviceError(
                    f"{self.name}: stands at {1e3 * position:g} mm after {passed:.3g} s, was sent to {1e3 * target:g} "
                    "mm; it was stopped: look for an obstacle",
                    device=self.name,
                )
            self._renew(values)

    def look(self) -> tuple[float, bool]:
        """Position [m], and whether the device says that it has arrived. Raises DeviceError: it has an alarm."""
        m = self._map
        states = tuple(dict.fromkeys((m.arrived.field, m.fine.field)))
        found = dict(zip(states, self.get_many(*states), strict=True))
        if not self._holds(m.fine, found[m.fine.field]):
            raise DeviceError(self._alarm(found[m.fine.field]), device=self.name)
        return self.position(), self._holds(m.arrived, found[m.arrived.field])

    def _alarm(self, found: float) -> str:
        return f"{self.name}: has an alarm ({self._map.fine.field} = 0x{int(found):X}); see its manual"

    def stop(self) -> None:
        """Stop at the present position."""
        self._target = None
        self.command(self._map.stop)

    def _stop_anyhow(self) -> None:
        """Stop, and go on where that fails, because another error is told already."""
        with suppress(BenchError):
            self.stop()

    def differences(self) -> list[str]:
        """As for every device; it must also be without an alarm, know its home, and stand where it was sent to."""
        found = super().differences()
        if found:
            self._knows_home = False  # it may have been without power
        state = self.held(self._map.fine.field)
        if not self._holds(self._map.fine, state):
            found.append(self._alarm(state))
        if self._target is not None and not self._homed:
            found.append(f"{self.name}: has lost its home")
        if self._target is not None and abs((position := self.position()) - self._target) > NEAR:
            found.append(f"{self.name}: stands at {1e3 * position:g} mm, was sent to {1e3 * self._target:g} mm")
        return found

    def restore(self) -> None:
        """As for every device; an alarm is reset, and the motor is switched on. A lost home is left to `home`."""
        self._reset_alarm()
        if not self._homed:
            self._target = None
        super().restore()
        self._get_ready()


# --- ours ----------------------------------------------------------------------------------------------

PACE = 0.1  # s between two looks at a move
CLOSE = 2e-6  # m from the target at which it counts as there


class MicroPositioner(ModbusDevice):
    """Our micro-positioner, which a map does not describe: its limits lie in the device, and it has no alarms.

    So it is asked other questions than a maker's drive, at other times.
    """

    contract = POSITIONER
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

    def look(self) -> tuple[float, frozenset[str]]:
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
        position, status = self.look()
        return "moving" in status or abs(position - target) <= CLOSE

    def stop(self) -> None:
        """Stop at the present position."""
        self._target = None
        if not self.set(command="stop"):
            self._await_start(lambda: "moving" not in self.look()[1])

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
            position, status = self.look()
            if "moving" not in status:
                break
            if waited >= timeout:
                self.stop()
                raise DeviceError(
                    f"{self.name}: not at {1e3 * target:g} mm after {timeout:g} s; it was stopped: look for an obstacle"
                )
            ahead = polls * abs(target - position) / (abs(position - before) or math.inf)  # polls, at the present speed
            polls = max(1, min(2 * polls, int(ahead), math.ceil((timeout - waited) / PACE)))
            self.clock.wait(polls * PACE)
            waited += polls * PACE
            before = position
        if abs(position - target) > CLOSE:
            raise DeviceError(f"{self.name}: stands at {1e3 * position:g} mm, was sent to {1e3 * target:g} mm")
        self._target = target

    def differences(self) -> list[str]:
        """As for every device; it must also know its home, and stand at the position that it was sent to."""
        found = super().differences()
        position, status = self.look()
        if "homed" not in status:
            found.append(f"{self.name}: has lost its home")
        if self._target is not None and abs(position - self._target) > CLOSE:
            found.append(f"{self.name}: stands at {1e3 * position:g} mm, was sent to {1e3 * self._target:g} mm")
        return found
