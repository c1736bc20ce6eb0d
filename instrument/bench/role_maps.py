"""What of a map serves each role: a model of the table `[role.ROLE]` for each role that a maker's device can fill."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, Field, model_validator

from palpate.instrument.config import Config, Positive
from palpate.instrument.contracts.contract import Condition, Contract, sdo
from palpate.instrument.contracts.field import Field as ContractField
from palpate.instrument.quantity import Hertz, Metres

# --- the base ------------------------------------------------------------------------------------------


class RoleMap(Config):
    """A table `[role.ROLE]`: which fields and commands of the map serve the role.

    A subclass has a key for each need of its role. The generic driver and simulator find the checked table at
    `DeviceKind.table`.
    """

    generic_driver: ClassVar[str]  # "module:Class", a `palpate.drivers.devices.device.Device`
    generic_simulator: ClassVar[str | None] = None  # "module:Class"; None: simulated benches cannot have it
    settings: ClassVar[type[Config] | None] = None  # keys of its section in a bench file; None: it has none

    def wrong(self, contract: Contract) -> list[str]:
        """What the contract lacks that this table names, each with key, value and what is valid; empty: it fits."""
        raise NotImplementedError

    def limits(self, contract: Contract) -> Mapping[str, Any]:
        """Attributes of `DeviceKind` that follow from the map: `channels`, `frequency_step`, `travel`, `cannot`."""
        return {}


# --- speeds and accelerations of drives ----------------------------------------------------------------


SPEEDS = ("step/s", "r/min")
RATES = {
    "step/s2": "step/s",
    "r/min/s": "r/min",
}  # units of an acceleration, each with that of the speed which is gained in a second
TIMES = ("ms", "ms/1000 r/min")  # what it takes to gain the speed of a move, or to gain `CHANGE`
RAMPS = (*RATES, *TIMES)
MINUTE = 60.0  # s
CHANGE = 1000.0  # r/min


def speed_of(unit: str, steps_per_turn: float, value: float) -> float:
    """Speed of a value of a field [step/s]."""
    return value if unit == "step/s" else value * steps_per_turn / MINUTE


def speed_value(unit: str, steps_per_turn: float, speed: float) -> float:
    """Value of a field for a speed [step/s]."""
    return speed if unit == "step/s" else speed * MINUTE / steps_per_turn


def ramp_of(unit: str, steps_per_turn: float, speed: float, value: float) -> float:
    """Acceleration of a value of a field [step/s²], in a move at a speed [step/s]; infinite for a time of 0."""
    if unit in RATES:
        return speed_of(RATES[unit], steps_per_turn, value)
    return _gained(unit, steps_per_turn, speed) / value if value else math.inf


def ramp_value(unit: str, steps_per_turn: float, speed: float, acceleration: float) -> float:
    """Value of a field for an acceleration [step/s²], in a move at a speed [step/s]."""
    if unit in RATES:
        return speed_value(RATES[unit], steps_per_turn, acceleration)
    return _gained(unit, steps_per_turn, speed) / acceleration


def _gained(unit: str, steps_per_turn: float, speed: float) -> float:
    """Product of an acceleration [step/s²] and its value in a unit of `TIMES`: the speed that is gained, × 1000."""
    return 1e3 * speed if unit == "ms" else speed_of("r/min", steps_per_turn, 1e3 * CHANGE)


# --- a source that holds one value ---------------------------------------------------------------------


class BiasMap(RoleMap):
    """The table `[role.bias]`.

    Attributes:
        level: field of the value that it holds.
        actual: field of the value that it measures at its output; "": it measures none.
        ready: command without which it takes no value; "": there is none.
        on: command that switches its output on; "": the output is always on.
        off: command that switches its output off; "": a level of zero must do.
        set_up: values that some fields must have before.
        no_sine: why it cannot be the exciter.
    """

    generic_driver: ClassVar[str] = "palpate.drivers.devices.bias:MappedBias"
    generic_simulator: ClassVar[str | None] = "palpate.simulators.devices.bias:SimulatedMappedBias"

    level: str
    actual: str = ""
    ready: str = ""
    on: str = ""
    off: str = ""
    set_up: dict[str, float | str] = Field(default_factory=dict)
    no_sine: Annotated[str, Field(min_length=1)]

    def wrong(self, contract: Contract) -> list[str]:
        """What the contract lacks that this table names, each with key, value and what is valid; empty: it fits."""
        fields = {f.name: f for f in contract.fields if f.type != "text"}
        written = [name for name, f in fields.items() if f.access == "rw"]
        commands = [command.name for command in contract.commands]
        found = [
            f"{key}: {name!r} is no number field that can be written and read; valid: {', '.join(written) or 'none'}"
            for key, name in (("level", self.level), *(("set_up", name) for name in self.set_up))
            if name not in written
        ]
        if self.actual and (self.actual not in fields or fields[self.actual].access == "wo"):
            found.append(f"actual = {self.actual!r} is no number field that can be read; valid: {', '.join(fields)}")
        found += [
            f"{key} = {name!r} is no command; valid: {', '.join(commands) or 'none'}"
            for key, name in (("ready", self.ready), ("on", self.on), ("off", self.off))
            if name and name not in commands
        ]
        if bool(self.on) != bool(self.off):
            found.append("on and off: give both, or none")
        return found

    def limits(self, contract: Contract) -> Mapping[str, Any]:
        """Attributes of `DeviceKind` that follow from the map."""
        return {"cannot": {"exciter": self.no_sine}}


# --- an exciter whose sine is a stream of set-points ---------------------------------------------------


ARRIVAL = 255  # transmission type of process data that take effect when they arrive
WATCHDOG = "watchdog"  # field of the time for which the heartbeat of this program may be missing


class ExciterSettings(Config):
    """Settings of a drive that shakes the stack.

    Attributes:
        full_scale: peak of the effort at an amplitude of 10 V, as a share of the drive's rated effort. It is the limit
            of the effort, too.
    """

    full_scale: Annotated[
        float,
        Field(ge=1e-3, le=1, strict=True, description="the share of its rated effort that 10 V stand for, as 0.5"),
    ]


class ExciterMap(RoleMap):
    """The table `[role.exciter]` of a drive without a sine of its own.

    Attributes:
        stream: process data that hold one set-point, in percent of the rated effort.
        fastest: shortest time between two set-points [s].
        set_up: values that some fields must have before it drives, such as the mode of operation.
        enable: command that switches its output on, whose `done` says when it is on.
        disable: command that switches its output off.
        reset: command that clears a fault.
        fault: field and bit that say that it has a fault.
        error: field of the number of its last fault.
        lost: that number, if the fault is that this program was no longer heard.
    """

    generic_driver: ClassVar[str] = "palpate.drivers.devices.exciter:StreamedExciter"
    generic_simulator: ClassVar[str | None] = "palpate.simulators.devices.exciter:SimulatedStreamedExciter"
    settings: ClassVar[type[Config] | None] = ExciterSettings

    stream: str
    fastest: Annotated[float, Field(ge=1e-4, le=1, strict=True)]
    set_up: dict[str, float | str] = Field(default_factory=dict)
    enable: str
    disable: str
    reset: str
    fault: tuple[str, str]
    error: str
    lost: Annotated[int, Field(ge=0, strict=True)]

    def wrong(self, contract: Contract) -> list[str]:
        """What the contract lacks that this table names, each with key, value and what is valid; empty: it fits."""
        taken = {pdo.name: pdo for pdo in contract.receives}
        commands = {command.name: command for command in contract.commands}
        fields = {f.name: f for f in contract.fields}
        found = []
        pdo = taken.get(self.stream)
        if pdo is None:
            found.append(f"stream = {self.stream!r} is no process data it takes; valid: {', '.join(taken) or 'none'}")
        elif len(pdo.fields) != 1 or fields[pdo.fields[0]].unit != "%" or pdo.transmission != ARRIVAL:
            found.append(
                f"stream = {self.stream!r} must hold one field in %, and be taken when it arrives (transmission = "
                f"{ARRIVAL}), because SYNC belongs to the sensor nodes"
            )
        for key, name in (("enable", self.enable), ("disable", self.disable), ("reset", self.reset)):
            if name not in commands:
                found.append(f"{key} = {name!r} is no command; valid: {', '.join(commands) or 'none'}")
            elif commands[name].done is None:
                found.append(f"{key} = {name!r} does not tell when it is done; give its `done`")
        field, bit = self.fault
        bits = fields[field].bits if field in fields else {}
        if bit not in bits:
            found.append(f"fault = {[field, bit]} is no bit of a field; valid bits of it: {', '.join(bits) or 'none'}")
        for key, name in (("error", self.error), *(("set_up", name) for name in self.set_up)):
            if name not in fields:
                found.append(f"{key}: {name!r} is no field; valid: {', '.join(fields)}")
        if WATCHDOG not in fields or fields[WATCHDOG].access != "rw" or fields[WATCHDOG].index != 0x1016:
            found.append(
                f"a drive that goes on with its last set-point needs a dead-man: a field {WATCHDOG!r} of 1016h that "
                "can be written"
            )
        return found


# --- a load indicator ----------------------------------------------------------------------------------


NOT = "not "  # before a bit: it says the opposite


def says(bits: Collection[str], which: str) -> bool:
    """Whether bits that are set say what a map asks for: "BIT" or "not BIT"."""
    return (which.removeprefix(NOT) in bits) != which.startswith(NOT)


class LowPass(Config):
    """A low-pass filter: its cut-off frequency (3 dB) [Hz], and its order."""

    corner: Annotated[float, Field(gt=0, strict=True)]
    order: Annotated[int, Field(ge=1, le=8, strict=True)] = 1

    def passes(self, frequency: float) -> float:
        """The share of a sine of a frequency [Hz] that passes, if the filter is a Butterworth filter."""
        return 1 / math.sqrt(1 + (frequency / self.corner) ** (2 * self.order))


class FilterTable(Config):
    """The field that sets the filter of the readings, and the low-pass for each of its raw values.

    They hold while the fields in `needs` read these raw values.
    """

    field: str
    needs: dict[str, int] = Field(default_factory=dict)
    levels: Annotated[dict[Annotated[str, Field(pattern="^[0-9]+$")], LowPass], Field(min_length=1)]


class LoadIndicatorSettings(Config):
    """Settings of a load indicator of a maker.

    Attributes:
        span: what the load cell gives for one unit of the display, by its data sheet [mV].
        gage_factor: gage factor for which `span` holds; a calibration holds only for this one.
        filter: raw value to which the filter is set; None: it stays as it is.
        bandwidth: cut-off frequency of the readings, as set at the device, where no field tells it [Hz].
        rate: readings in a second, as set at the device, if that differs from the map's [1/s].
        resolution: step of the display, in its unit, where no field tells it.
    """

    span: Annotated[
        float,
        Field(
            ge=1e-6,
            le=1e6,
            strict=True,
            description="the mV of the load cell for one unit of the display, as 10.306",
        ),
    ]
    gage_factor: Annotated[float, Field(ge=0.5, le=20, strict=True)] = 8.98  # [T]
    filter: Annotated[int, Field(ge=0, strict=True)] | None = None
    bandwidth: Annotated[Hertz, Field(ge=0.01, le=1e5)] | None = None
    rate: Annotated[Hertz, Field(ge=0.01, le=1e5)] | None = None
    resolution: Annotated[float, Field(ge=1e-6, le=1e6, strict=True)] | None = None


class LoadIndicatorMap(RoleMap):
    """The table `[role.load_indicator]`.

    Attributes:
        reading: field of the load, net of tare.
        gross: field of the load with the tare in it; "": there is none.
        status: field whose bits tell of the reading; "": there is none.
        stable: its bit that says that the reading is stable, or "not BIT" for one that says that it moves; "":
            stability is told by repeated readings.
        faults: its bits that say that there is no load to read, each with what it means; "not BIT" for one that says
            that there is a load.
        peak_to_peak: field of the greatest less the least reading since these were cleared; "": there is none.
        greatest, least: fields of the greatest and the least reading since they were cleared; "": there are none.
        clear: command that clears the extremes; needed where a field of extremes is named.
        tare, clear_tare: commands that take the present load as the tare, and take the tare off; "": there are none.
        step: field of the display's step, as a number in the unit of `reading`; "": see `steps`.
        steps: for each raw value of `step`, the display's step, if it is a code.
        filter: the field that sets the filter; None: no field does.
        rate: readings in a second [1/s].
    """

    generic_driver: ClassVar[str] = "palpate.drivers.devices.load_indicator:MappedLoadIndicator"
    generic_simulator: ClassVar[str | None] = "palpate.simulators.devices.load_indicator:SimulatedMappedLoadIndicator"
    settings: ClassVar[type[Config] | None] = LoadIndicatorSettings

    reading: str
    gross: str = ""
    status: str = ""
    stable: str = ""
    faults: dict[str, str] = Field(default_factory=dict)
    peak_to_peak: str = ""
    greatest: str = ""
    least: str = ""
    clear: str = ""
    tare: str = ""
    clear_tare: str = ""
    step: str = ""
    steps: dict[str, Positive] = Field(default_factory=dict)
    filter: FilterTable | None = None
    rate: Annotated[float, Field(gt=0, strict=True)]

    @property
    def extremes(self) -> tuple[str, ...]:
        """The fields that the device's own peak-to-peak reading is made of; empty: it has none."""
        if self.peak_to_peak:
            return (self.peak_to_peak,)
        return (self.greatest, self.least) if self.greatest and self.least else ()

    def wrong(self, contract: Contract) -> list[str]:
        """What the contract lacks that this table names, each with key, value and what is valid; empty: it fits."""
        readable = [f.name for f in contract.fields if f.access != "wo" and f.type != "text"]
        fields = ("reading", "gross", "status", "peak_to_peak", "greatest", "least", "step")
        given = {key: getattr(self, key) for key in fields}
        if self.filter is not None:
            given |= {"filter.field": self.filter.field} | {f"filter.needs.{name}": name for name in self.filter.needs}
        found = [
            f"{key} = {name!r} is no field that can be read; valid: {', '.join(readable)}"
            for key, name in given.items()
            if name and name not in readable
        ]
        commands = [command.name for command in contract.commands]
        found += [
            f"{key} = {name!r} is no command; valid: {', '.join(commands) or 'none'}"
            for key, name in (("clear", self.clear), ("tare", self.tare), ("clear_tare", self.clear_tare))
            if name and name not in commands
        ]
        if found:
            return found
        bits = contract[self.status].bits if self.status else {}
        found += [
            f"{bit!r} is no bit of status = {self.status!r}; valid: {', '.join(bits) or 'none'}"
            for bit in (*filter(None, (self.stable,)), *self.faults)
            if bit.removeprefix(NOT) not in bits
        ]
        units = {contract[name].unit for name in (self.reading, *self.extremes)}
        if len(units) > 1:
            found.append(f"the readings are in {' and '.join(sorted(units))}; they must be in one unit")
        if bool(self.greatest) != bool(self.least):
            found.append("greatest and least: give both, or none")
        if self.extremes and not self.clear:
            found.append(f"clear: {', '.join(self.extremes)} must be cleared by a command; name it, or leave them out")
        if self.filter is not None and contract[self.filter.field].access != "rw":
            found.append(f"filter.field = {self.filter.field!r} cannot be written; its access must be 'rw'")
        return found


# --- a positioner --------------------------------------------------------------------------------------


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


# --- a sensor node -------------------------------------------------------------------------------------


SYNC_COB_ID, SYNC_PERIOD = sdo(0x1005), sdo(0x1006)  # CiA 301
VOLTS = {"V": 1.0, "mV": 1e-3}  # units in which a node may tell volts itself
INTEGERS = ("int8", "int16", "int24", "int32", "uint8", "uint16", "uint24", "uint32")


class NodeSettings(Config):
    """The keys of such a node in a bench file.

    Attributes:
        volts_per_unit: what one unit of its readings stands for, or one count if they have no unit [V]; None: its
            readings are in V or mV.
        sync_node: node id of the node on its bus that sends SYNC; None: it sends SYNC itself.
    """

    volts_per_unit: Annotated[float, Field(ge=1e-9, le=1e3, strict=True)] | None = None
    sync_node: Annotated[int, Field(ge=1, le=127, strict=True)] | None = None


class SensorNodeMap(RoleMap):
    """The table `[role.sensor_node]`.

    Attributes:
        channels: the fields of its channels, from channel 1 on. Each is an integer, and in one of the PDOs that the
            node sends; a reading at the end of its range counts as saturated.
        sends_sync: whether the node can send SYNC (1005h and 1006h).
        fastest: greatest number of samples a second.
        status: a field with choices of which `ok` says that readings are good; None: there is none.
    """

    generic_driver: ClassVar[str] = "palpate.drivers.devices.sensor_node:MappedNode"
    generic_simulator: ClassVar[str | None] = "palpate.simulators.devices.sensor_node:SimulatedMappedNode"
    settings: ClassVar[type[Config] | None] = NodeSettings

    channels: Annotated[tuple[str, ...], Field(min_length=1, max_length=64)]
    sends_sync: bool = False
    fastest: Annotated[float, Field(gt=0, le=1e5, strict=True)] = 1000.0
    status: str | None = None

    def wrong(self, contract: Contract) -> list[str]:
        if contract.bus != "canopen":
            return ["channels: a node that samples at SYNC is on CANopen; this device is on Modbus"]
        sent = [name for pdo in contract.pdos for name in pdo.fields]
        able = [name for name in dict.fromkeys(sent) if contract[name].type in INTEGERS]
        valid = ", ".join(able) or "none"
        problems = [f"channels: {name!r} is no integer that a PDO sends; valid: {valid}" for name in self.channels
                    if name not in able]  # fmt: skip
        if twice := {name for name in self.channels if self.channels.count(name) > 1 or sent.count(name) > 1}:
            problems.append(f"channels: {', '.join(sorted(twice))} would come twice at each SYNC; name each once")
        if not problems and len({contract[name].unit for name in self.channels}) > 1:
            problems.append("channels: they have several units; a node has one `volts_per_unit` for all")
        problems += [
            f"channels: PDO {pdo.name} has transmission = {pdo.transmission}; give 1, so that it answers every SYNC"
            for pdo in contract.pdos
            if (pdo.index or pdo.fixed) and pdo.transmission != 1 and set(pdo.fields) & {*self.channels}
        ]
        writable = {f.address for f in contract.fields if f.access == "rw"}
        if self.sends_sync and not {SYNC_COB_ID, SYNC_PERIOD} <= writable:
            problems.append("sends_sync: needs fields at 1005:0 and 1006:0 that can be written")
        if self.status is not None and not (contract.has(self.status) and "ok" in contract[self.status].choices):
            problems.append(f"status: {self.status!r} is no field with a choice `ok`")
        return problems

    def limits(self, contract: Contract) -> Mapping[str, Any]:
        return {"channels": len(self.channels)}


def raw_limits(f: ContractField, step: float) -> tuple[int, int]:
    """Least and greatest raw value of a channel: its limits, or else those of its type, alike for either sign."""
    bits = 8 * f.size
    low, high = (1 - (1 << bits - 1), (1 << bits - 1) - 1) if f.type.startswith("int") else (0, (1 << bits) - 1)
    least, most = (f.minimum, f.maximum) if step > 0 else (f.maximum, f.minimum)
    return (
        low if least is None else max(low, round((least - f.offset) / step)),
        high if most is None else min(high, round((most - f.offset) / step)),
    )


# --- all of them, by role ------------------------------------------------------------------------------

ROLE_MAPS: dict[str, type[RoleMap]] = {  # by role
    "bias": BiasMap,
    "exciter": ExciterMap,
    "load_indicator": LoadIndicatorMap,
    "positioner": PositionerMap,
    "sensor_node": SensorNodeMap,
}
