"""What drivers on Modbus share: who answers, which requests are sent, and what is done about failures."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest

from palpate.drivers.devices.modbus_device import companions, reading, widened, write
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import Command, Condition, Manners
from palpate.instrument.contracts.field import Field, Scaling
from palpate.instrument.errors import ConfigError, DeviceError, IdentityError, LinkError, LinkTimeout, UsageError
from tests.contracts import modbus_contract
from tests.drivers.fake_links import Oven, changing, oven

# --- who answers ---------------------------------------------------------------------------------------


def test_a_device_whose_name_is_no_text_is_refused_as_another() -> None:
    driver, link = oven()
    link.objects[1] = "OV\udce4"  # the byte E4h, which is no UTF-8
    with pytest.raises(IdentityError, match=r"identifies itself as Acme OVä 1\.2, the contract"):
        driver.identify()


def test_a_device_that_gives_the_extended_objects_alone_is_asked_for_the_others() -> None:
    driver, link = oven()
    mandatory, regular, extended = {k: link.objects[k] for k in (0, 1)}, {2: link.objects[2]}, {0x80: "SN7"}
    answer = link.read_device_information

    def by_category(*, read_code: int, **rest: int) -> Any:
        link.objects = {1: mandatory, 2: regular, 3: extended}[read_code]
        return answer(read_code=read_code, **rest)

    link.read_device_information = by_category
    driver.identify()
    assert driver.serial == "SN7"


def test_another_serial_number_than_before_is_another_device() -> None:
    driver, link = oven()
    driver.identify()  # it had none
    link.objects[0x80] = "SN7"
    driver.identify()
    for serial, shown in (("SN8", "SN8"), ("", "none")):
        link.objects[0x80] = serial
        with pytest.raises(
            IdentityError, match=f"has serial number {shown}, had SN7 before; put the first one back, or run again"
        ):
            driver.identify()
    assert driver.serial == "SN7"


# --- reading -------------------------------------------------------------------------------------------


def test_fields_are_given_in_the_order_asked_for_and_read_in_one_request_where_they_stand_together() -> None:
    driver, link = oven(warmth=21.5, setpoint=-10.0, heater="on")
    assert driver.get_many("warmth", "heater", "setpoint") == [21.5, 1.0, -10.0]
    assert link.asked == [("read_registers", 0x10, 3, 7), ("read_registers", 0x20, 1, 7)]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"function_code": 4}, "answered function 4 with 2 registers where function 3 with 2 was asked"),
        ({"registers": [1]}, "answered function 3 with 1 registers where function 3 with 2 was asked"),
        ({"registers": [1, 2, 3]}, "answered function 3 with 3 registers where function 3 with 2 was asked"),
    ],
)
def test_a_reply_to_another_question_is_not_used(change: dict[str, Any], message: str) -> None:
    driver, link = oven()
    link.replied = changing(change)
    with pytest.raises(DeviceError, match=f"{message}; the reply is not used"):
        driver.get("setpoint")


@pytest.mark.parametrize(
    ("serial", "counts"),
    [
        (True, [2, 3, 2, 3, 1, 1]),  # the last has nothing beside it
        (False, [2, 2, 2, 2, 1, 1]),
    ],
)
def test_reads_that_follow_each_other_on_a_serial_line_differ_in_length(serial: bool, counts: list[int]) -> None:
    driver, link = oven(serial=serial, setpoint=25.0, heater="on", warmth=30.0)
    assert [driver.get("setpoint") for _ in range(4)] == [25.0] * 4
    assert [driver.get("warmth") for _ in range(2)] == [30.0] * 2
    assert [asked[2] for asked in link.asked] == counts


def test_a_text_is_read_whole_or_told() -> None:
    driver, link = oven(label="Öl")
    assert driver.get_text("label") == "Öl"
    link.words[0x30] = 0xFFFF
    with pytest.raises(DeviceError, match=r"^oven at rack unit 7: label holds no text \(.*\); write it anew$"):
        driver.get_text("label")


# --- writing -------------------------------------------------------------------------------------------


def test_fields_that_stand_together_are_written_in_one_request_by_their_addresses() -> None:
    driver, link = oven()
    driver.set(heater="on", setpoint=6553.7)
    assert link.asked == [("write_registers", 0x10, [1, 1, 1], 7)]
    driver.set(label="ab")
    assert link.asked[1:] == [("write_registers", 0x30, [0x6162, 0], 7)]


@pytest.mark.parametrize("change", [{"function_code": 6}, {"address": 0x11}, {"count": 1}])
def test_a_write_that_is_confirmed_otherwise_is_uncertain(change: dict[str, Any]) -> None:
    driver, link = oven()
    link.replied = changing(change)
    with pytest.raises(
        DeviceError,
        match=re.escape("did not confirm setpoint = 30 degC (-10 to 10000), heater = on (off, on); the setting is unc"),
    ):
        driver.set(setpoint=30, heater="on")


# --- what is not confirmed -----------------------------------------------------------------------------


def attended(**held: Any) -> tuple[Oven, Any, list[str]]:
    driver, link = oven(**held)
    noticed = list[str]()
    driver.read_attempts, driver.noticed = 2, noticed.append
    return driver, link, noticed


@pytest.mark.parametrize("setting", [{"heater": "on"}, {"setpoint": 30.0}, {"label": "ab"}])
def test_a_setting_that_is_not_confirmed_is_read_back_on_an_attended_bench(setting: dict[str, Any]) -> None:
    driver, link, noticed = attended()
    link.late = [LinkTimeout("no answer")]
    driver.set(**setting)
    assert [asked[0] for asked in link.asked] == ["write_registers", "read_registers"]
    assert noticed == ["no answer; read back, it was carried out"]


@pytest.mark.parametrize("order", [{"program": 3}, {"start": 3}, {"heater": "on", "program": 3}])
def test_an_order_that_is_not_confirmed_is_never_read_back(order: dict[str, Any]) -> None:
    """Its register reads as it was written, whether the order was carried out or not."""
    driver, link, noticed = attended()
    link.late = [LinkTimeout("no answer")]
    with pytest.raises(LinkTimeout):
        driver.set(**order)
    assert (len(link.asked), noticed) == (1, [])


def test_a_setting_that_may_have_been_carried_out_is_remembered_and_a_refused_one_is_not() -> None:
    driver, link, _ = attended()
    for failure, differences in ((DeviceError("no"), 0), (LinkTimeout("no answer"), 1)):
        link.failures = [failure]
        with pytest.raises(type(failure)):
            driver.set(heater="on")
        assert len(driver.differences()) == differences


def test_a_setting_that_reads_back_in_part_was_not_carried_out() -> None:
    driver, link, noticed = attended()
    link.late = [LinkTimeout("no answer")]
    link.written = lambda: link.put(heater="off")
    with pytest.raises(LinkTimeout):
        driver.set(setpoint=30, heater="on")
    assert noticed == []


# --- questions, orders and broken devices ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("attempts", "failing", "answered"), [(1, 0, True), (1, 1, False), (2, 1, True), (2, 2, False)]
)
def test_a_question_is_asked_as_often_as_is_allowed(attempts: int, failing: int, answered: bool) -> None:
    driver, link = oven(warmth=21.5)
    noticed = list[str]()
    driver.read_attempts, driver.noticed = attempts, noticed.append
    link.failures = [LinkTimeout(f"silent {count}") for count in range(failing)]
    if answered:
        assert driver.get("warmth") == 21.5
    else:
        with pytest.raises(LinkTimeout, match=f"silent {failing - 1}") as caught:
            driver.get("warmth")
        assert caught.value.device == driver.name
    assert len(link.asked) == failing + answered
    assert noticed == [f"silent {count}; asked again" for count in range(min(failing, attempts - 1))]


def test_a_device_that_is_broken_is_neither_asked_nor_told() -> None:
    driver, link, noticed = attended()
    driver.broken = "oven: smokes"
    for use in (lambda: driver.get("warmth"), lambda: driver.set(heater="on"), lambda: driver.set(start=1)):
        with pytest.raises(DeviceError, match=r"^oven: smokes; it is not used any more in this run$") as caught:
            use()
        assert caught.value.device == driver.name
    assert (link.asked, noticed) == ([], [])


def test_a_device_that_breaks_while_it_is_being_asked_is_not_asked_again() -> None:
    driver, link, _ = attended()

    def breaks(_reply: Any) -> Any:
        driver.broken = "oven: smokes"
        raise LinkTimeout("silent")

    link.replied = breaks
    for use in (lambda: driver.get("warmth"), lambda: driver.set(heater="on")):
        driver.broken = ""
        with pytest.raises(LinkTimeout, match="silent"):
            use()
    assert len(link.asked) == 2


def test_after_what_was_asked_or_told_the_watchdog_is_thought_of_and_not_after_a_failure() -> None:
    driver, link = oven()
    thought = list[int]()
    driver.afterwards = lambda: thought.append(len(link.asked))
    driver.get("warmth")
    driver.set(heater="on")
    link.failures = [LinkError("lost")]
    with pytest.raises(LinkError):
        driver.get("warmth")
    assert thought == [1, 2]


# --- settings that were lost ---------------------------------------------------------------------------


def test_each_setting_that_differs_is_told_with_both_values_and_no_other() -> None:
    driver, link = oven()
    driver.set(setpoint=30.0, heater="on")
    driver.set(program=3)
    link.put(setpoint=-20.0, program=5)  # beyond its limits, as after a loss of power
    assert driver.differences() == ["oven at rack unit 7: setpoint is -20, was set to 30.0"]
    link.put(heater="off")
    assert driver.differences()[1:] == ["oven at rack unit 7: heater is 0, was set to on"]
    link.put(setpoint=30.0, heater="on")
    assert driver.differences() == []


def test_what_differs_is_written_again_one_by_one_and_looked_at_and_told_where_the_device_does_not_take_it() -> None:
    driver, link = oven()
    driver.set(setpoint=30.0, heater="on")
    link.asked.clear()
    link.put(heater="off")
    driver.restore()
    assert link.writes() == [(0x12, [1])]
    assert [asked[0] for asked in link.asked] == ["read_registers", "write_registers", "read_registers"]
    link.put(setpoint=0.0, heater="off")
    link.written = lambda: link.put(setpoint=0.0, heater="off")
    with pytest.raises(
        DeviceError,
        match=r"setpoint is 0, was set to 30\.0; oven at rack unit 7: heater is 0, was set to on: it does not take its",
    ):
        driver.restore()


# --- which requests ------------------------------------------------------------------------------------


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


def test_fields_are_read_together_but_where_a_reply_ends_or_registers_are_missing() -> None:
    (request,) = reading(OVEN, ("heat", "setpoint")).requests
    assert (request.start, request.count, request.places) == (0x10, 8, [slice(14, 16), slice(0, 4)])
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
