"""What of a map serves an exciter whose sine is a stream of set-points, and the settings of such a device."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from palpate.instrument.bench.role_maps.role_map import RoleMap
from palpate.instrument.config import Config
from palpate.instrument.contracts.contract import Contract

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
