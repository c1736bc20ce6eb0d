"""What drivers on Modbus share: who answers, and what is asked and told in one request."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest

from palpate.instrument.errors import DeviceError, IdentityError
from tests.drivers.registers import oven

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


def changing(change: dict[str, Any]) -> Callable[[Any], Any]:
    """Replies with other attributes."""

    def changed(reply: Any) -> Any:
        for name, value in change.items():
            setattr(reply, name, value)
        return reply

    return changed


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
