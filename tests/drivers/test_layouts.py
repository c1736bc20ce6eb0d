"""Which requests read and write some fields: as few as the device allows, and never a sign of another moment."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from palpate.drivers.devices.modbus_device import companions, reading, widened, write
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import Command, Condition, Manners
from palpate.instrument.contracts.field import Field, Scaling
from palpate.instrument.errors import ConfigError, UsageError
from tests.contracts import modbus_contract

OVEN = modbus_contract(
    Field("setpoint", 0x10, "int32", "asked for", access="rw"),
    Field("heater", 0x12, "uint16", "heater", access="rw"),
    Field("name", 0x13, "text", "name", access="rw", default="", length=6),
    Field("status", 0x16, "uint16", "status"),
    Field("heat", 0x17, "int16", "heat"),
    Field("order", 0x18, "uint16", "order", access="wo"),
    Field("hours", 0x1A, "uint32", "hours"),
)


def asked(thing: Contract, *names: str) -> list[tuple[int, int, int, tuple[str, ...]]]:
    return [(each.function, each.start, each.count, each.names) for each in reading(thing, names).requests]


def test_fields_that_are_read_together_lie_in_the_bytes_where_their_registers_are() -> None:
    (request,) = reading(OVEN, ("heat", "setpoint")).requests
    assert (request.start, request.count, request.places) == (0x10, 8, [slice(14, 16), slice(0, 4)])


@pytest.mark.parametrize(
    ("names", "wide"),
    [
        (("setpoint",), ("setpoint", "heater")),
        (("heater",), ("heater", "setpoint")),  # a text behind it
        (("status",), ("status", "heat")),
        (("status", "heat"), ("status", "heat")),  # a text before, an order behind
        (("hours",), ("hours",)),  # an order before, a gap behind
    ],
)
def test_a_read_is_widened_by_a_number_that_stands_beside_it(names: tuple[str, ...], wide: tuple[str, ...]) -> None:
    """It is not widened by a text, by an order, which nobody can read, or over a gap."""
    assert widened(OVEN, names) == wide


def test_of_two_numbers_beside_a_field_one_is_read_with_it_but_none_of_a_handshake_or_of_another_table() -> None:
    fields = tuple(Field(name, address, "uint16", name, access="rw") for address, name in enumerate("abc"))
    assert widened(modbus_contract(*fields), ("b",)) == ("b", "c")
    waits = Command("go", "a", 1, done=Condition("c", (1,)))
    assert widened(modbus_contract(*fields, commands=(waits,)), ("b",)) == ("b", "a")
    elsewhere = replace(fields[2], table="input", access="ro")
    assert widened(modbus_contract(*fields[:2], elsewhere), ("b",)) == ("b", "a")
    assert widened(modbus_contract(*fields, manners=Manners(most_read=1)), ("b",)) == ("b",)


def test_tables_are_read_apart_each_with_its_function() -> None:
    thing = modbus_contract(
        Field("on", 5, "bool", "on", table="coil"),
        Field("closed", 5, "bool", "closed", table="discrete"),
        Field("set", 5, "uint16", "set"),
        Field("is", 5, "uint16", "is", table="input"),
    )
    assert asked(thing, "is", "on", "set", "closed") == [
        (1, 5, 1, ("on",)), (2, 5, 1, ("closed",)), (3, 5, 1, ("set",)), (4, 5, 1, ("is",)),
    ]  # fmt: skip


def test_a_read_is_divided_where_a_reply_ends_or_registers_are_missing() -> None:
    a, b, c = (Field(name, at, "uint32", name) for name, at in (("a", 0), ("b", 2), ("c", 6)))
    assert asked(modbus_contract(a, b, c), "c", "a", "b") == [(3, 0, 4, ("a", "b")), (3, 6, 2, ("c",))]
    order = Field("order", 4, "uint32", "order", access="wo")
    assert asked(modbus_contract(a, b, order, c), "c", "a", "b") == [(3, 0, 8, ("c", "a", "b"))]
    small = modbus_contract(a, b, c, manners=Manners(most_read=3))
    assert asked(small, "a", "b") == [(3, 0, 2, ("a",)), (3, 2, 2, ("b",))]


STATUS = Field("status", 6, "uint16", "status", bits={"negative": 7})
WEIGHT = Field("weight", 7, "uint32", "weight", "N", sign=("status", "negative"), scaling=Scaling("decimals"))
DECIMALS = Field("decimals", 13, "uint16", "decimals")
BETWEEN = Field("between", 9, "uint64", "between")


def test_a_sign_is_read_in_the_same_request_and_a_scale_where_there_is_room() -> None:
    plan = reading(modbus_contract(STATUS, WEIGHT, BETWEEN, DECIMALS), ("weight",))
    assert ([(r.start, r.count) for r in plan.requests], plan.along, plan.apart) == (
        [(6, 8)], ("decimals", "status"), (),
    )  # fmt: skip
    plan = reading(modbus_contract(STATUS, WEIGHT, DECIMALS), ("weight",))
    assert (plan.along, plan.apart) == (("status",), ("decimals",))  # registers of nobody are in between
    plan = reading(modbus_contract(STATUS, WEIGHT, BETWEEN, DECIMALS, manners=Manners(most_read=4)), ("weight",))
    assert ([(r.start, r.count) for r in plan.requests], plan.along, plan.apart) == (
        [(6, 3)], ("status",), ("decimals",),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("status", "more"),
    [
        (replace(STATUS, table="input"), {}),
        (STATUS, {"manners": Manners(most_read=2)}),
        (replace(STATUS, address=4), {}),
    ],
)
def test_a_sign_of_another_moment_is_refused_where_it_is_declared(status: Field, more: Any) -> None:
    with pytest.raises(ConfigError, match="weight: its sign is in status, which one request cannot read with it"):
        modbus_contract(status, WEIGHT, DECIMALS, **more)


# --- writes --------------------------------------------------------------------------------------------


def test_runs_and_parts_of_a_register_are_written_whole_or_not() -> None:
    fields = (
        Field("mode", 0, "uint16", "mode", access="rw"),
        Field("place", 1, "int32", "place", access="rw", words="little"),
        Field("unit", 4, "uint16", "unit", access="rw", part=(8, 8)),
        Field("pole", 4, "uint16", "pole", access="rw", part=(0, 8)),
    )
    thing = modbus_contract(*fields, manners=Manners(together=(("mode", "place"),)))
    with pytest.raises(UsageError, match="place cannot be written without mode, which the device takes in the same"):
        write(thing, ("place",))
    with pytest.raises(UsageError, match="unit cannot be written without pole"):
        write(thing, ("unit",))
    assert companions(thing, "unit") == {"unit", "pole"}
    plan = write(thing, ("pole", "unit"))
    assert (plan.start, plan.count) == (4, 1)
    assert plan.content([thing.encode(name, 5) for name in plan.names]) == [0x0505]


@pytest.mark.parametrize(
    ("function", "names", "message"),
    [
        (6, ("a", "b"), "one request of the device writes 1"),
        (16, ("a", "b", "c"), "one request of the device writes 2"),
    ],
)
def test_more_than_the_device_takes_at_once_is_refused(function: int, names: tuple[str, ...], message: str) -> None:
    fields = (Field(name, at, "uint16", name, access="rw", function=function) for at, name in enumerate("abc"))
    with pytest.raises(UsageError, match=message):
        write(modbus_contract(*fields, manners=Manners(most_written=2)), names)


def test_coils_are_written_one_by_one_or_together() -> None:
    thing = modbus_contract(*(Field(n, at, "bool", n, access="rw", table="coil") for at, n in enumerate("ab")))
    assert [write(thing, names).function for names in (("a",), ("a", "b"))] == [5, 15]
    assert write(thing, ("b", "a")).content([b"\1", b"\0"]) == [True, False]
