"""A twin holds what its map says, and keeps the handshake of its commands."""

from __future__ import annotations

import struct
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from pymodbus.constants import ExcCodes

from palpate.instrument.contracts.declaration import Command, Condition, Manners, Mark
from palpate.instrument.contracts.field import Field, Scaling
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.positioner import (
    DISABLED,
    ENABLED,
    FAULT,
    QUICK_STOPPING,
    READY,
    RESET,
    SWITCHED_ON,
    DriveState,
)
from palpate.simulators.devices.twin import Twin
from palpate.simulators.wire.device import Refused, Registers, SimulatedDevice, SimulatedPlace
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


# --- registers in ranges -----------------------------------------------------------------------------

ADDRESS, VALUE, FUNCTION = ExcCodes.ILLEGAL_ADDRESS, ExcCodes.ILLEGAL_VALUE, ExcCodes.ILLEGAL_FUNCTION
RANGES = modbus_contract(
    Field("remote", 402, "bool", "remote control", table="coil", access="rw"),
    Field("output", 403, "bool", "output", table="coil", access="rw"),
    Field("alarm", 402, "bool", "alarm", table="discrete"),
    Field("weight", 7, "uint32", "weight", "N", sign=("status", "negative"), scaling=Scaling("decimals"),
          table="input", words="little"),
    Field("status", 6, "uint16", "status", bits={"negative": 7}, table="input"),
    Field("decimals", 9, "uint16", "decimals", table="input"),
    Field("unit", 20, "uint16", "unit", part=(8, 8), choices={"kg": 0, "N": 5}, access="rw"),
    Field("polarity", 20, "uint16", "polarity", part=(0, 8), access="rw", maximum=1, minimum=0),
    Field("command", 21, "uint16", "command", access="wo", function=6),
    Field("position", 22, "int32", "position", access="rw", function=16),
    known_by="nothing",
    manners=Manners(most_read=3, most_written=2),
)  # fmt: skip


class Ranged(SimulatedDevice):
    contract = RANGES


@pytest.fixture
def ranged() -> Ranged:
    return Ranged(VirtualClock(), "1")


def test_functions_are_those_of_its_tables(ranged: Ranged) -> None:
    assert Registers(ranged).functions == {1, 2, 3, 4, 5, 15, 6, 16}  # no 43: it has no identity object


@pytest.mark.parametrize(
    ("function", "address", "count", "answer"),
    [
        (1, 402, 2, [True, False]),
        (2, 402, 1, [False]),
        (4, 6, 1, [0x80]),
        (4, 7, 2, [0x04D2, 0]),  # 12.34 N with two decimals; low word first
        (4, 6, 3, [0x80, 0x04D2, 0]),
        (4, 8, 1, [0]),  # half a value can be read
        (3, 20, 1, [0x0501]),
        (3, 7, 1, ADDRESS),  # it is an input register
        (4, 6, 4, VALUE),  # more than it gives in one reply
        (4, 10, 1, ADDRESS),
        (3, 20, 2, [0x0501, 0]),  # a register between others may be for writing only
        (1, 402, 3, ADDRESS),
    ],
)
def test_a_range_is_read(ranged: Ranged, function: int, address: int, count: int, answer: Any) -> None:
    ranged.settings |= {"remote": 1, "weight": -12.34, "status": 0x80, "decimals": 2, "unit": 5, "polarity": 1}
    found = Registers(ranged).read(function, address, count)
    assert (list(struct.unpack(f">{count}H", found)) if isinstance(found, bytes) else found) == answer


@pytest.mark.parametrize(
    ("function", "address", "values", "refused", "held"),
    [
        (5, 402, [True], None, {"remote": 1}),
        (15, 402, [True, True], None, {"remote": 1, "output": 1}),
        (6, 20, [0x0501], None, {"unit": 5, "polarity": 1}),
        (16, 20, [0x0500], None, {"unit": 5, "polarity": 0}),
        (16, 20, [0x0101], VALUE, {"unit": 0}),  # no choice
        (6, 21, [7], None, {"command": 7}),
        (16, 21, [7], FUNCTION, {"command": 0}),
        (16, 22, [0xFFFF, 0xFFFE], None, {"position": -2}),
        (6, 22, [1], FUNCTION, {"position": 0}),
        (16, 22, [1], VALUE, {"position": 0}),  # half of a value
        (16, 21, [1, 2, 3], VALUE, {"command": 0}),  # more than it takes at once
        (16, 30, [1], ADDRESS, {}),
    ],
)
def test_a_range_is_written(
    ranged: Ranged, function: int, address: int, values: Any, refused: ExcCodes | None, held: dict[str, float]
) -> None:
    assert Registers(ranged).write(function, address, values) == refused
    assert {name: ranged.settings[name] for name in held} == held


# --- states of a drive -------------------------------------------------------------------------------


def after(*words: int, option: int = 2) -> int:
    """State of a drive after these controlwords."""
    state = DriveState()
    for word in words:
        state.control(word, option)
    return state.bits


@pytest.mark.parametrize(
    ("words", "ends"),
    [
        ((0x06,), READY),
        ((0x06, 0x07), SWITCHED_ON),
        ((0x06, 0x07, 0x0F), ENABLED),
        ((0x0F,), DISABLED),  # it must be ready first
        ((0x07,), DISABLED),
        ((0x06, 0x07, 0x0F, 0x07), SWITCHED_ON),
        ((0x06, 0x07, 0x0F, 0x06), READY),
        ((0x06, 0x07, 0x0F, 0x00), DISABLED),
    ],
)
def test_a_drive_goes_from_state_to_state_in_their_order(words: tuple[int, ...], ends: int) -> None:
    assert after(*words) == ends


@pytest.mark.parametrize(("option", "ends"), [(-3, DISABLED), (1, DISABLED), (2, DISABLED), (5, QUICK_STOPPING)])
def test_a_quick_stop_ends_in_the_state_of_its_option_code(option: int, ends: int) -> None:
    assert after(0x06, 0x07, 0x0F, 0x02, option=option) == ends
    assert after(0x06, 0x07, 0x0F, 0x02, 0x06, option=option) == (READY if ends == DISABLED else QUICK_STOPPING)
    assert after(0x06, 0x02, option=option) == DISABLED  # nothing moves that could be braked


def test_a_fault_stays_until_a_rising_reset() -> None:
    state = DriveState()
    state.control(RESET, 2)
    state.fail()
    for word, bits in ((RESET, FAULT), (0x06, FAULT), (RESET, DISABLED)):
        state.control(word, 2)
        assert state.bits == bits
