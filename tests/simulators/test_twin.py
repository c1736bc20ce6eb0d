"""A twin holds what its map says, and keeps the handshake of its commands."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.instrument.contracts.declaration import Command, Condition, Mark
from palpate.instrument.contracts.field import Field
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.twin import Twin
from palpate.simulators.wire.device import Refused, SimulatedPlace
from tests.contracts import modbus_contract

CONTRACT = modbus_contract(
    Field("kind", 0, "uint16", "kind"),
    Field("name", 1, "text", "name", length=4),
    Field("number", 3, "uint16", "serial number"),
    Field("unit", 4, "uint16", "unit", choices={"kg": 0, "N": 5}),
    Field("load", 5, "int16", "load", "N", unit_in="unit"),
    Field("order", 6, "uint16", "order", access="rw", choices={"none": 0, "start": 1, "tare": 2}),
    Field("status", 7, "uint16", "status", bits={"ready": 3, "warm": 0}),
    known_by="marks",
    marks=(Mark("kind", 7), Mark("name", "TH")),
    serial="number",
    commands=(
        Command("start", "order", "start", done=Condition("status", (0x8,), 0x8), clear="none"),
        Command("tare", "order", "tare"),
    ),
)


class Thing(Twin):
    def __init__(self, place: SimulatedPlace) -> None:
        self.done: list[str] = []
        super().__init__(place)

    def check(self, command: Command) -> None:
        if command.name == "tare" and not self.settings["status"]:
            raise Refused(4)

    def carry_out(self, command: Command) -> None:
        self.done.append(command.name)


@pytest.fixture
def thing() -> Thing:
    rig: Any = None
    kind: Any = SimpleNamespace(contract=CONTRACT)
    return Thing.at(SimulatedPlace(VirtualClock(), rig, 1, "SIM-TH-0003", None, kind, lambda _role: None))


def test_it_begins_with_its_marks_its_number_and_the_units_that_are_expected(thing: Thing) -> None:
    assert {name: thing.settings[name] for name in ("kind", "number", "unit")} == {"kind": 7, "number": 3, "unit": 5}
    assert thing.read_text("name") == "TH"


def test_a_command_is_carried_out_and_its_state_is_shown(thing: Thing) -> None:
    thing.settings["status"] = 1.0
    thing.write({"order": 1.0})
    assert thing.done == ["start"]
    assert thing.settings["status"] == 0x9  # the bits that do not count stay
    assert thing.settings["order"] == 1.0  # until the client clears it
    thing.write({"order": 0.0})
    thing.write({"order": 2.0})
    assert thing.done == ["start", "tare"]
    assert thing.settings["order"] == 0.0  # the device clears it by itself


def test_a_command_that_is_refused_changes_nothing(thing: Thing) -> None:
    with pytest.raises(Refused):
        thing.write({"order": 2.0})
    assert thing.done == []
    assert thing.settings["order"] == 0.0


def test_a_condition_on_the_whole_register_replaces_it(thing: Thing) -> None:
    thing.contract = replace(CONTRACT, commands=(Command("start", "order", 1, done=Condition("status", (8,))),))
    thing.settings["status"] = 1.0
    thing.write({"order": 1.0})
    assert thing.settings["status"] == 8
