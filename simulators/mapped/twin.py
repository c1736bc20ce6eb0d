"""What all twins have in common: they hold what their map says, and carry out its commands with their handshake."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

from palpate.instrument.contracts.contract import Command, Condition, Contract, Field
from palpate.simulators.wire.canopen_device import SimulatedNode
from palpate.simulators.wire.device import SimulatedDevice, SimulatedPlace


def first_settings(contract: Contract) -> dict[str, float]:
    """The numbers that a device holds at power-on: its defaults, its marks, and the units that the map expects."""
    settings = {f.name: float(f.default) for f in contract.fields if f.type != "text"}
    settings |= {mark.field: float(mark.value) for mark in contract.marks if not isinstance(mark.value, str)}
    for f in contract.fields:
        if f.unit_in:
            settings[f.unit_in] = float(contract[f.unit_in].choices[f.unit])
    return settings


def fulfilled(contract: Contract, condition: Condition, holds: float) -> float:
    """Value of a condition's field that fulfils it, and leaves the bits as they are that do not count."""
    f = contract[condition.field]
    kept = 0 if condition.mask is None else int(f.to_raw(holds)) & ~condition.mask
    return (kept | condition.values[0]) * f.scale + f.offset


class Orders:
    """Recognises the commands of a contract in what is written, and keeps their handshake.

    A command is carried out at once: its code stays in its register until it is cleared, as its map says.
    """

    def __init__(self, contract: Contract) -> None:
        self._contract = contract
        self._by_field: dict[str, list[Command]] = {}
        for command in contract.commands:
            self._by_field.setdefault(command.field, []).append(command)

    def given(self, values: Mapping[str, float]) -> list[Command]:
        """The commands that a write of these values gives."""
        return [
            command
            for name, value in values.items()
            for command in self._by_field.get(name, ())
            if self._contract.raw(name, command.value) == self._contract[name].to_raw(value)
        ]

    def text(self, name: str, text: str) -> list[Command]:
        """The commands that a write of a text gives."""
        return [command for command in self._by_field.get(name, ()) if command.value == text]


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
        self._orders = Orders(self.contract)

    def _carry_out(self, command: Command) -> None:
        """Carry out a command, and show the state that says that it is done."""
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
        given = self._orders.given(values)
        for command in given:
            self.check(command)
        super().write(values)
        for command in given:
            self._carry_out(command)
        self.written(values)

    def write_text(self, name: str, text: str) -> None:
        """Store a text that a client writes, and carry out the commands in it. Raises Refused."""
        self.texts[name] = text
        for command in self._orders.text(name, text):
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

    def reset(self) -> None:
        """Return to the state after power-on."""
        self.settings = first_settings(self.contract)
        if self.contract.serial:
            self.settings[self.contract.serial] = float(self._serial)
        self.process_data.reset()

    def read(self, field: Field) -> Any:
        """Raw value of an object, for the SDO server."""
        return self.texts[field.name] if field.type == "text" else super().read(field)

    def write(self, field: Field, value: float) -> None:
        """Store what a client writes, and carry out the commands in it."""
        super().write(field, value)
        for command in self._orders.given({field.name: value}):
            self._carry_out(command)

    def write_text(self, field: Field, text: str) -> None:
        """Store a text that a client writes, and carry out the commands in it."""
        self.texts[field.name] = text
        for command in self._orders.text(field.name, text):
            self._carry_out(command)
