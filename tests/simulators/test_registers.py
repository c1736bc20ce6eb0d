"""A simulated Modbus device serves whatever its contract says: tables, functions, orders, parts, limits."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from pymodbus.constants import ExcCodes

from palpate.instrument.contracts.declaration import Manners
from palpate.instrument.contracts.field import Field, Scaling
from palpate.simulators.clock import VirtualClock
from palpate.simulators.wire.device import Registers, SimulatedDevice
from tests.contracts import modbus_contract

ADDRESS, VALUE, FUNCTION = ExcCodes.ILLEGAL_ADDRESS, ExcCodes.ILLEGAL_VALUE, ExcCodes.ILLEGAL_FUNCTION
CONTRACT = modbus_contract(
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


class Thing(SimulatedDevice):
    contract = CONTRACT


@pytest.fixture
def thing() -> Thing:
    return Thing(VirtualClock(), "1")


def test_functions_are_those_of_its_tables(thing: Thing) -> None:
    assert Registers(thing).functions == {1, 2, 3, 4, 5, 15, 6, 16}  # no 43: it has no identity object


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
def test_a_range_is_read(thing: Thing, function: int, address: int, count: int, answer: Any) -> None:
    thing.settings |= {"remote": 1, "weight": -12.34, "status": 0x80, "decimals": 2, "unit": 5, "polarity": 1}
    found = Registers(thing).read(function, address, count)
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
    thing: Thing, function: int, address: int, values: Any, refused: ExcCodes | None, held: dict[str, float]
) -> None:
    assert Registers(thing).write(function, address, values) == refused
    assert {name: thing.settings[name] for name in held} == held
