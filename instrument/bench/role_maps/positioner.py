"""What of a map serves a positioner, and the settings of such a device in a bench file."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import AfterValidator, Field, model_validator

from palpate.instrument.bench.role_maps.role_map import RoleMap
from palpate.instrument.bench.role_maps.steps import RAMPS, SPEEDS
from palpate.instrument.config import Config
from palpate.instrument.contracts.contract import Condition, Contract
from palpate.instrument.quantity import Metres

SHORTEST, LONGEST = 1e-12, 1e-3  # m that a step can be
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]


def _a_step(value: float) -> float:
    if not SHORTEST <= abs(value) <= LONGEST:
        raise ValueError(
            f"{value:g} m for a step is not within {SHORTEST:g} to {LONGEST:g} m; give the lead of the screw, divided "
            "by the steps of a turn"
        )
    return value


class PositionerSettings(Config):
    """Settings of a positioner that a map describes: what the maker of the drive cannot know of the stage.

    Attributes:
        metres_per_step: lead of the screw by the drive's steps of a turn [m]; negative if the steps count upwards.
        travel: lowest position to which the probe may go, counted downwards from home [m].
        acceleration: acceleration of moves [m/s²].
        torque: greatest torque, as a share of the motor's rated one.
    """

    metres_per_step: Annotated[
        Number, AfterValidator(_a_step), Field(description="the lead of the screw by the steps of a turn in m, as 5e-7")
    ]
    travel: Metres = Field(ge=1e-4, le=1, description='the lowest position, downwards from home, as "50 mm"')
    acceleration: float = Field(default=0.02, ge=1e-6, le=10, strict=True)
    torque: float = Field(default=0.5, ge=1e-3, le=1, strict=True)


class State(Config):
    """A state of the device: see `Condition`."""

    field: str
    values: tuple[int, ...] = Field(min_length=1)
    mask: int | None = None

    @property
    def condition(self) -> Condition:
        return Condition(self.field, self.values, self.mask)


class PositionerMap(RoleMap):
    """The table `[role.positioner]`.

    What must be written together with the target (`manners.together`) is written with each move, else when the bench
    opens.

    Attributes:
        position: field with the present position [step].
        target: field that takes the position to go to [step].
        speed: field of the speed of a move, whose unit is one of `SPEEDS`.
        acceleration: field of the acceleration of a move, or of the time that it takes; its unit is one of `RAMPS`.
        deceleration: the same when it slows down.
        torque: field of the greatest torque [%]; "": it has none.
        steps_per_turn: the steps of a turn, or the field that tells them.
        with_target: what else is written with each target, and so that the move starts, if a write starts it.
        holds: settings that the role needs.
        requires: settings that a person must have made at the device: a value, or one of several. With others it is
            refused when the bench opens, and before it looks for its home.
        soft_limits: fields of the lowest and the highest position in the device's own counting [step].
        start: commands that start a move after its target was written.
        enable: command that switches the motor on.
        stop: command that stops a move.
        find_home: commands that look for the home position.
        reset: command that resets an alarm.
        arrived: state in which it stands at its target.
        ready: state in which the motor is on.
        fine: state without an alarm.
        homed: state in which it knows its home; None: it does not tell.
        keeps_home: whether it still knows its home after a power cycle.
        lifetime: field of the time after which it stops a move that was not renewed [ms], written with the target.
        idle: what is written in place of some of `with_target` so that a move is renewed, and none starts.
        heartbeat: field of the node whose heartbeat it waits for and of the time after which it stops (1016h).
    """

    generic_driver: ClassVar[str] = "palpate.drivers.devices.positioner:MappedPositioner"
    generic_simulator: ClassVar[str | None] = "palpate.simulators.devices.positioner:SimulatedMappedPositioner"
    settings: ClassVar[type[Config] | None] = PositionerSettings

    position: str
    target: str
    speed: str
    acceleration: str
    deceleration: str
    torque: str = ""
    steps_per_turn: str | Annotated[float, Field(strict=True, gt=0)]
    with_target: dict[str, Number | str] = Field(default_factory=dict)
    holds: dict[str, Number | str] = Field(default_factory=dict)
    requires: dict[str, Number | str | tuple[Number | str, ...]] = Field(default_factory=dict)
    soft_limits: tuple[str, str] | None = None
    start: tuple[str, ...] = ()
    enable: str
    stop: str
    find_home: tuple[str, ...] = Field(min_length=1)
    reset: str
    arrived: State
    ready: State
    fine: State
    homed: State | None = None
    keeps_home: bool = False
    lifetime: str = ""
    idle: dict[str, Number | str] = Field(default_factory=dict)
    heartbeat: str = ""

    @model_validator(mode="after")
    def _one_watch(self) -> PositionerMap:
        if self.lifetime and self.heartbeat:
            raise ValueError("lifetime and heartbeat: give the one by which the device watches its master")
        if bool(self.lifetime) != bool(self.idle):
            raise ValueError("idle: needed with a lifetime, and only with one")
        return self

    def required(self, name: str) -> tuple[float | str, ...]:
        """The values of which a setting must have one."""
        wanted = self.requires[name]
        return wanted if isinstance(wanted, tuple) else (wanted,)

    def together(self, contract: Contract) -> frozenset[str]:
        """The fields that are written in one request with the target."""
        runs = (run for run in contract.manners.together if self.target in run)
        return frozenset(next(runs, (self.target,)))

    def wrong(self, contract: Contract) -> list[str]:
        """As for every role."""
        found = [*self._wrong_fields(contract), *self._wrong_commands(contract)]
        return found or [*self._wrong_units(contract), *self._wrong_writes(contract)]

    def _wrong_fields(self, contract: Contract) -> list[str]:
        states = {"arrived": self.arrived, "ready": self.ready, "fine": self.fine, "homed": self.homed}
        read = {"position": self.position} | {key: state.field for key, state in states.items() if state}
        if isinstance(self.steps_per_turn, str):
            read["steps_per_turn"] = self.steps_per_turn
        read |= {f"requires.{name}": name for name in self.requires}
        keys = ("target", "speed", "acceleration", "deceleration", "torque", "lifetime", "heartbeat")
        written = {key: getattr(self, key) for key in keys if getattr(self, key)}
        written |= {f"{key}.{name}": name for key in ("with_target", "holds", "idle") for name in getattr(self, key)}
        written |= dict(zip(("soft_limits.0", "soft_limits.1"), self.soft_limits or (), strict=False))
        found = []
        for named, wrong, what in ((read, "wo", "read"), (written, "ro", "written")):
            able = [f.name for f in contract.fields if f.access != wrong and f.type != "text"]
            found += [
                f"{key}: {name!r} is no field that can be {what}; valid: {', '.join(able)}"
                for key, name in named.items()
                if name not in able
            ]
        return found

    def _wrong_commands(self, contract: Contract) -> list[str]:
        valid = [command.name for command in contract.commands]
        named = (*self.start, self.enable, self.stop, *self.find_home, self.reset)
        return [f"{name!r} is no command; valid: {', '.join(valid)}" for name in named if name not in valid]

    def _wrong_units(self, contract: Contract) -> list[str]:
        wanted: list[tuple[str, tuple[str, ...]]]
        wanted = [(name, ("step",)) for name in (self.position, self.target, *(self.soft_limits or ()))]
        wanted += [(self.speed, SPEEDS), (self.acceleration, RAMPS), (self.deceleration, RAMPS)]
        wanted += [(name, (unit,)) for name, unit in ((self.torque, "%"), (self.lifetime, "ms")) if name]
        return [
            f"{name}: its unit is {contract[name].unit!r}; valid: {', '.join(units)}"
            for name, units in wanted
            if contract[name].unit not in units
        ]

    def _wrong_writes(self, contract: Contract) -> list[str]:
        whole = self.together(contract)
        given = {self.target, self.speed, *self.with_target, *self._carried(contract)}
        found = [f"with_target: {name} is written with the target; give its value" for name in sorted(whole - given)]
        for name in (self.acceleration, self.deceleration):
            if contract[name].unit == "ms" and name not in whole:
                found.append(f"{name}: is a time, which depends on the speed; it must be written with the target")
        if contract.bus == "modbus" and not given >= {self.target, self.speed} <= whole:
            found.append(f"speed: {self.speed} is not written in one request with the target")
        return found

    def _carried(self, contract: Contract) -> set[str]:
        """Fields of moves that are in one request with the target."""
        fields = {self.acceleration, self.deceleration, self.torque, self.lifetime}
        return fields & self.together(contract)
