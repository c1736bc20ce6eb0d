"""What a driver does for devices on Modbus that can be bought: functions, scales and signs, wear, handshakes, marks."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import pytest

from palpate.drivers.devices.device import MOST, WITHIN
from palpate.instrument.contracts.declaration import Mark
from palpate.instrument.contracts.field import Field
from palpate.instrument.errors import DeviceError, IdentityError, UsageError
from tests.drivers.makers_thing import FIELDS, THING, made

# --- functions -----------------------------------------------------------------------------------------


def test_each_table_is_read_and_written_with_its_function() -> None:
    device, link, _ = made(closed=1, heat=21.5)
    assert device.get_many("closed", "heat", "output", "level") == [1.0, 21.5, 0.0, 0.0]
    device.set(output="on")
    device.set(level=3)
    device.set(mode=1, place=-2)
    assert [asked[0] for asked in link.asked] == [
        "read_coils", "read_discrete", "read_registers", "read_inputs", "write_coil", "write_register",
        "write_registers",
    ]  # fmt: skip
    assert [link.held(name) for name in ("output", "level", "mode", "place")] == [1.0, 3.0, 1.0, -2.0]
    assert all((timing["gap"], timing["responds"]) == (0.005, 0.0) for timing in link.timing)


@pytest.mark.parametrize(
    ("values", "change"),
    [
        ({"output": "on"}, {"bits": [False]}),
        ({"output": "on"}, {"address": 9}),
        ({"level": 3}, {"registers": [4]}),
        ({"level": 3}, {"function_code": 16}),
    ],
)
def test_a_confirmation_of_something_else_is_none(values: dict[str, Any], change: dict[str, Any]) -> None:
    device, link, _ = made()

    def changed(reply: Any) -> Any:
        for name, value in change.items():
            setattr(reply, name, value)
        return reply

    link.replied = changed
    with pytest.raises(DeviceError, match=f"did not confirm {next(iter(values))} = "):
        device.set(**values)


@pytest.mark.parametrize("bits", [[True], [True] * 16, []])
def test_a_reply_with_another_number_of_bits_is_not_used(bits: list[bool]) -> None:
    device, link, _ = made()
    link.replied = lambda reply: [setattr(reply, "bits", bits), reply][1]
    with pytest.raises(DeviceError, match=f"answered function 1 with {len(bits)} bits where function 1 with 8"):
        device.get("output")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mode": 1}, "mode cannot be written without place"),
        ({"unit": "N"}, "unit cannot be written without polarity"),
        ({"level": 1, "span": 2}, "not adjacent"),
    ],
)
def test_what_one_request_cannot_write_is_refused_before_anything_is_sent(values: dict[str, Any], message: str) -> None:
    device, link, _ = made()
    with pytest.raises(UsageError, match=message):
        device.set(**values)
    assert link.asked == []


def test_lost_settings_are_restored_whole() -> None:
    device, link, _ = made()
    device.set(mode=1, place=9)
    device.set(unit="N", polarity="unipolar")
    link.put(place=0, polarity="bipolar")
    assert [text.split(": ")[1] for text in device.differences()] == [
        "place is 0, was set to 9", "polarity is 0, was set to unipolar",
    ]  # fmt: skip
    link.asked.clear()
    device.restore()
    assert link.writes() == [(30, [1, 0, 9]), (14, [0x0501])]


# --- scale, sign, unit, no reading ---------------------------------------------------------------------


@pytest.mark.parametrize(("status", "value"), [(0x0800, 12.34), (0x0880, -12.34)])
def test_a_weight_is_read_with_its_sign_and_its_decimals_in_one_request(status: int, value: float) -> None:
    device, link, _ = made(status=status, gross=12.34)
    assert device.get_many("gross", "status") == [value, status]
    assert link.asked == [("read_registers", 6, 8, 7)]
    assert device.held("gross") == value


def test_a_scale_that_changes_while_running_is_an_error_by_name() -> None:
    device, link, _ = made(gross=12.34)
    device.identify()
    link.put(decimals=3)
    for ask in (lambda: device.get("gross"), device.differences, device.identify):
        with pytest.raises(DeviceError, match=r"decimals is 3, was 2 before, so the scale of its readings has changed"):
            ask()


def test_a_scale_that_stands_too_far_away_is_read_once_and_watched() -> None:
    far = tuple(replace(f, address=300) if f.name == "decimals" else f for f in FIELDS)
    device, link, _ = made(replace(THING, fields=far), gross=12.34)
    assert [device.get("gross") for _ in range(3)] == [12.34] * 3
    assert [asked[1:3] for asked in link.asked] == [(300, 1), (6, 3), (6, 3), (6, 3)]
    link.put(decimals=1)
    with pytest.raises(DeviceError, match="decimals is 1, was 2 before"):
        device.differences()


@pytest.mark.parametrize("ask", ["get", "held"])
def test_a_scale_that_cannot_be_is_an_error_by_name_and_no_reading(ask: str) -> None:
    thing = replace(THING, fields=tuple(replace(f, maximum=None) if f.name == "decimals" else f for f in FIELDS))
    device, link, _ = made(thing, gross=5)
    link.put(decimals=65535)
    with pytest.raises(
        DeviceError, match="gross cannot be used: decimals = 65535 is no number of decimals; valid: -20"
    ):
        getattr(device, ask)("gross")


def test_a_setting_is_written_in_the_scale_that_the_device_tells() -> None:
    device, link, _ = made()
    device.set(span=1.25)
    assert link.words[16] == 125
    assert device.differences() == []
    link.words[16] = 126
    assert device.differences() == ["thing at rack unit 7: span is 1.26, was set to 1.25"]


def test_another_unit_than_the_map_s_is_refused_by_name() -> None:
    some = tuple(replace(f, unit_in="unit") if f.name == "gross" else f for f in FIELDS)
    device, link, _ = made(replace(THING, fields=some))
    device.identify()
    link.put(unit="kg")
    for ask in (device.identify, device.differences):
        with pytest.raises(DeviceError, match="unit is 'kg', the contract reads 'N'; set the device to N"):
            ask()


def test_a_value_that_says_that_there_is_none_is_no_error() -> None:
    device, link, _ = made(average=math.nan)
    assert math.isnan(device.get("average"))
    link.put(average=5001)
    with pytest.raises(DeviceError, match="average = 5001 is outside"):
        device.get("average")


# --- wear ----------------------------------------------------------------------------------------------


def test_memory_that_wears_is_written_only_when_it_holds_another_value_and_never_in_a_loop() -> None:
    device, link, clock = made()
    for number in range(MOST):
        device.set(span=1.0 + number)
        device.set(span=1.0 + number)
    assert len(link.writes()) == MOST
    with pytest.raises(DeviceError, match=f"span was written {MOST} times within 3600 s, and its memory endures 10000"):
        device.set(span=99.0)
    assert len(link.writes()) == MOST
    clock.wait(WITHIN)
    device.set(span=99.0)
    assert len(link.writes()) == MOST + 1


# --- commands ------------------------------------------------------------------------------------------


def test_a_command_comes_behind_what_must_precede_it_and_is_cleared_when_it_is_done() -> None:
    device, link, clock = made()
    link.put(gone=0xF0)

    def work() -> None:
        if link.words[5] == 1:
            link.put(gone=0xF2)

    link.written = work
    device.command("tare")
    orders = [asked[:3] for asked in link.asked if asked[0].startswith("write")]
    assert orders == [
        ("write_coil", 402, [True]), ("write_register", 5, [7]), ("write_register", 5, [1]), ("write_register", 5, [0]),
    ]  # fmt: skip
    assert clock.now_ns() == 0


@pytest.mark.parametrize(
    ("state", "message", "waited", "cleared"),
    [
        (8, "refuses the command 'tare': gone reads 8", 0.0, True),
        (4, "'tare' was not done within 0.5 s: gone reads 4 (of which 0xF counts), should read 2", 0.5, False),
    ],
)
def test_a_command_that_is_not_carried_out_is_told_with_the_state_that_was_found(
    state: int, message: str, waited: float, cleared: bool
) -> None:
    device, link, clock = made(gone=state)
    with pytest.raises(DeviceError, match=re.escape(message)):
        device.command("tare")
    assert clock.now_ns() == waited * 1e9
    assert [asked[2] for asked in link.asked if asked[0] == "write_register"].count([1]) == 1
    assert (link.words[5] == 0) is cleared


# --- who answers ---------------------------------------------------------------------------------------


def test_a_device_is_known_by_its_marks_and_gives_its_serial_number() -> None:
    device, link, _ = made()
    device.identify()
    assert device.serial == "77"
    link.put(serial=78)
    with pytest.raises(IdentityError, match="has serial number 78, had 77 before"):
        device.identify()


@pytest.mark.parametrize(
    ("marks", "held", "said"),
    [
        ((Mark("type", 24),), {"type": 25}, "type reads 25, should be 24; this is another device or firmware"),
        ((Mark("model", "TLB4"),), {"model": "TLU 4"}, "model reads 'TLU 4', should begin with 'TLB4'"),
    ],
)
def test_a_mark_that_does_not_fit_is_another_device(marks: Any, held: Any, said: str) -> None:
    text = Field("model", 50, "text", "model", length=8)
    device, _, _ = made(replace(THING, fields=(*FIELDS, text), marks=marks), **held)
    with pytest.raises(IdentityError, match=said):
        device.identify()


def test_a_device_without_the_register_of_its_mark_is_another_one() -> None:
    device, link, _ = made()
    link.failures = [DeviceError("thing: answered exception 2, illegal address", code=2)]
    with pytest.raises(IdentityError, match=r"cannot read type, by which it is known \(thing: answered exception 2"):
        device.identify()


def test_a_device_that_tells_nothing_is_called_by_its_label_or_refused() -> None:
    mute = replace(THING, known_by="nothing", marks=(), serial="")
    device, _, _ = made(mute, inventory="LAB-12")
    device.identify()
    assert device.serial == "LAB-12"
    with pytest.raises(IdentityError, match='tells nothing by which it is known; write inventory = "LABEL"'):
        made(mute)[0].identify()
