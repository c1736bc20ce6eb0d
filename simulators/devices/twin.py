"""What all twins have in common: they hold what their map says, and carry out its commands with their handshake."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

from palpate.instrument.contracts.contract import Command, Condition, Contract, Field, Value
from palpate.simulators.wire.canopen_device import SimulatedNode
from palpate.simulators.wire.device import SimulatedDevice, SimulatedPlace, first_settings


def fulfilled(contract: Contract, condition: Condition, holds: float) -> float:
    """Value of a condition's field that fulfils it, and leaves the bits as they are that do not count."""
    f = contract[condition.field]
    kept = 0 if condition.mask is None else int(f.to_raw(holds)) & ~condition.mask
    return (kept | condition.values[0]) * f.scale + f.offset


class HoldsMap:
    """What the twins of both buses have in common: the texts and the commands of the map of their place's kind."""

    settings: dict[str, float]

    @classmethod
    def at(cls, place: SimulatedPlace) -> Self:
        return cls(place)

    def __init__(self, place: SimulatedPlace) -> None:
        self.kind, self.contract = place.kind, place.kind.contract
        self.texts = {f.name: str(f.default or "") for f in self.contract.fields if f.type == "text"}
        self.texts |= {mark.field: mark.value for mark in self.contract.marks if isinstance(mark.value, str)}

    def given(self, values: Mapping[str, Value]) -> list[Command]:
        """The commands that a write of these values gives."""
        return [
            command
            for name, value in values.items()
            for command in self.contract.commands
            if command.field == name and self._gives(command, value)
        ]

    def _gives(self, command: Command, value: Value) -> bool:
        if isinstance(value, str):
            return command.value == value
        return self.contract.raw(command.field, command.value) == self.contract[command.field].to_raw(value)

    def _carry_out(self, command: Command) -> None:
        """Carry out a command at once, and show the state that says that it is done."""
        self.carry_out(command)
        if command.done is not None:
            held = self.settings[command.done.field]
            self.settings[command.done.field] = fulfilled(self.contract, command.done, held)

    def carry_out(self, command: Command) -> None:
        """Called when a command is carried out."""


class Twin(HoldsMap, SimulatedDevice):
    """The twin of a Modbus device. A subclass per role reads and moves the rig."""

    def __init__(self, place: SimulatedPlace) -> None:
        HoldsMap.__init__(self, place)
        SimulatedDevice.__init__(self, place.clock, place.serial)
        self.reset()

    def reset(self) -> None:
        """Return to the state after power-on."""
        self.settings = first_settings(self.contract) | self._numbered()

    def _numbered(self) -> dict[str, float]:
        """The serial number, where the device has a register for it."""
        name = self.contract.serial
        if not name:
            return {}
        if self.contract[name].type == "text":
            self.texts[name] = self.serial
            return {}
        return {name: float(int("0" + "".join(filter(str.isdigit, self.serial))))}

    def write(self, values: dict[str, float]) -> None:
        """Store what a client writes, and carry out the commands in it. Raises Refused."""
        given = self.given(values)
        for command in given:
            self.check(command)
        super().write(values)
        for command in given:
            self._carry_out(command)
        self.written(values)

    def write_text(self, name: str, text: str) -> None:
        """Store a text that a client writes, and carry out the commands in it. Raises Refused."""
        self.texts[name] = text
        for command in self.given({name: text}):
            self.check(command)
            self._carry_out(command)

    def read_text(self, name: str) -> str:
        return self.texts[name]

    def _carry_out(self, command: Command) -> None:
        super()._carry_out(command)
        if command.done is None and command.clear is None:
            f = self.contract[command.field]
            self.settings[command.field] = float(f.default) if f.type != "text" else 0.0  # the device clears it

    def check(self, command: Command) -> None:
        """Called before a command is carried out. Raises Refused: it cannot be now."""

    def written(self, values: Mapping[str, float]) -> None:
        """Called after a write."""


class CanopenTwin(HoldsMap, SimulatedNode):
    """The twin of a CANopen node. A subclass per role reads and moves the rig."""

    def __init__(self, place: SimulatedPlace) -> None:
        HoldsMap.__init__(self, place)
        self.rig = place.rig
        SimulatedNode.__init__(self, place.clock, place.unit, place.serial)

    def read(self, field: Field) -> Any:
        """Raw value of an object, for the SDO server."""
        return self.texts[field.name] if field.type == "text" else super().read(field)

    def write(self, field: Field, value: float) -> None:
        """Store what a client writes, and carry out the commands in it."""
        super().write(field, value)
        for command in self.given({field.name: value}):
            self._carry_out(command)

    def write_text(self, field: Field, text: str) -> None:
        """Store a text that a client writes, and carry out the commands in it."""
        self.texts[field.name] = text
        for command in self.given({field.name: text}):
            self._carry_out(command)
