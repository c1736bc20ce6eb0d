"""A contract declares a device once: what it says of itself, of values, and of bytes that came."""

from __future__ import annotations

import math
import re
import struct
from dataclasses import replace
from typing import Any

import pytest

from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import Identity
from palpate.instrument.contracts.field import PROBE, Field
from palpate.instrument.contracts.own import bus_load, shortest_transfer, stuff_bits
from palpate.instrument.errors import ConfigError, RangeError, UnknownName

TOY = Contract(
    name="toy",
    title="toy device",
    bus="modbus",
    identity=Identity("Palpate", "TOY", "1.0"),
    fields=(
        Field("speed", 0x10, "uint16", "speed", "m/s", 1e-3, "rw", 0.5, 20.0, 1.0),
        Field("position", 0x11, "int32", "position", "m", 1e-6),
        Field("mode", 0x13, "uint16", "mode", access="rw", choices={"slow": 0, "fast": 2}),
        Field("status", 0x14, "uint16", "status", bits={"ready": 0, "hot": 3}),
        Field("reading", 0x15, "float32", "reading", "mV"),
    ),
)


# --- every contract ------------------------------------------------------------------------------------


@pytest.mark.parametrize("contract", CONTRACTS.values(), ids=list(CONTRACTS))
def test_what_can_be_written_has_limits_or_choices_and_a_default_within_them(contract: Contract) -> None:
    for field in contract.fields:
        if field.access == "ro":
            continue
        if field.type == "text":
            assert field.length > 0, field.name
            continue
        assert field.choices or (field.minimum is not None and field.maximum is not None), field.name
        assert not (field.choices and field.minimum is not None), field.name
        assert field.access == "wo" or contract.allows(field.name, float(field.default)), field.name


@pytest.mark.parametrize("contract", CONTRACTS.values(), ids=list(CONTRACTS))
def test_every_device_carries_the_word_order_probe(contract: Contract) -> None:
    probe = contract["probe"]
    assert (probe.type, probe.default, probe.access) == ("uint32", 0x12345678, "ro")
    expected = "12 34 56 78" if contract.bus == "modbus" else "78 56 34 12"
    assert contract.encode("probe", float(PROBE)) == bytes.fromhex(expected)


def test_twenty_nodes_at_1_kHz_need_five_real_buses() -> None:
    assert bus_load(1, 1000, 1e6) == pytest.approx(0.29, abs=0.01)
    assert 4 < bus_load(20, 1000, 1e6) < 5
    assert bus_load(20, 1000, 500e3) == 2 * bus_load(20, 1000, 1e6)


# --- values and bytes ----------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [0.4994, 20.0006, -1.0, math.nan, math.inf, -math.inf, 1e308])
def test_a_value_outside_its_limits_is_refused_with_device_field_value_and_limit(value: float) -> None:
    with pytest.raises(RangeError, match=re.escape(f"toy device: speed = {value:g} m/s is outside 0.5 to 20 m/s")):
        TOY.encode("speed", value)
    assert not TOY.allows("speed", value)


@pytest.mark.parametrize(("value", "raw"), [(0.5, 500), (20.0, 20000), (0.4996, 500), (20.0004, 20000), (1.2346, 1235)])
def test_limits_hold_to_the_resolution_of_the_field(value: float, raw: int) -> None:
    assert TOY.raw("speed", value) == raw
    assert TOY.encode("speed", value) == raw.to_bytes(2)


@pytest.mark.parametrize(
    ("name", "value", "valid"),
    [*(("mode", value, "slow.*fast") for value in (1.0, 3.0, -1.0, 0.4, "medium", "Fast", "")), ("speed", "fast", "")],
)
def test_what_is_no_choice_is_refused_with_the_valid_ones(name: str, value: float | str, valid: str) -> None:
    with pytest.raises(RangeError, match=rf"toy device: {name} = .* is no choice; valid: {valid}"):
        TOY.encode(name, value)


def test_a_choice_goes_by_its_name_or_number() -> None:
    assert TOY.encode("mode", "fast") == TOY.encode("mode", 2.0) == b"\x00\x02"
    assert TOY.choice("mode", 2.0) == "fast"
    assert TOY.choice("mode", 7.0) == "7"


def test_status_bits_have_names() -> None:
    assert TOY.set_bits("status", 0b1001) == {"ready", "hot"}
    assert TOY.set_bits("status", 0b0110) == {"bit 1", "bit 2"}  # which the contract does not name


def test_a_reading_has_no_limits_but_those_of_its_type() -> None:
    assert TOY.pack("position", -2147.483648) == b"\x80\x00\x00\x00"
    with pytest.raises(struct.error):
        TOY.pack("position", -2147.483649)


def test_a_reading_that_is_not_a_number_stays_one() -> None:
    assert math.isnan(TOY.decode("reading", TOY.pack("reading", math.nan)))


@pytest.mark.parametrize("data", [b"", b"\x00", b"\x00\x00\x00"])
def test_bytes_of_another_length_are_refused(data: bytes) -> None:
    with pytest.raises(struct.error):
        TOY.decode("speed", data)


def test_an_unknown_field_is_refused_with_the_nearest_name() -> None:
    for asked in (TOY.encode, TOY.misread):
        with pytest.raises(UnknownName, match=r"field of the toy device 'positon' \(did you mean 'position'\?\)"):
            asked("positon", 1.0)


# --- the digest that a run keeps -----------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        {"scale": 1e-2}, {"address": 0x09}, {"type": "int16"}, {"unit": "mm/s"}, {"minimum": 0.0}, {"maximum": 19.0},
        {"access": "ro"}, {"choices": {"a": 1}, "scale": 1.0},
        {"bits": {"a": 1}, "scale": 1.0}, {"meaning": "velocity"}, {"default": 2.0},
    ],
)  # fmt: skip
def test_any_change_of_a_contract_changes_its_digest(change: dict[str, object]) -> None:
    first, *rest = TOY.fields
    changed = replace(TOY, fields=(replace(first, **change), *rest))  # type: ignore[arg-type]
    assert changed.digest() != TOY.digest()


# --- what cannot be declared ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"type": "bcd"}, "field speed: no type 'bcd'; valid: bool, uint8, int8"),
        ({"access": "const"}, "field speed: no access 'const'; valid: ro, rw, wo"),
        ({"scale": 0.0}, "field speed: scale = 0; give a finite number other than 0"),
        ({"scale": math.nan}, "field speed: scale = nan; give"),
        ({"maximum": 100.0}, r"field speed: \[100.0\] cannot be limits or choices of a uint16"),
        ({"minimum": 21.0}, "cannot be limits"),
        ({"choices": {"odd": -1}}, "cannot be limits or choices of a uint16"),
        ({"bits": {"ready": 16}}, "a uint16 has no bits {'ready': 16}"),
    ],
)
def test_a_field_that_cannot_be_is_refused_where_it_is_declared(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        replace(TOY["speed"], **given)


@pytest.mark.parametrize("type_", ["uint8", "int8", "text"])
def test_what_fills_no_whole_register_is_refused_on_modbus(type_: Any) -> None:
    field = Field("part", 0x30, type_, "part of a register")
    with pytest.raises(ConfigError, match=f"toy device: part is of type {type_}, .* valid: uint16, int16, uint32"):
        replace(TOY, fields=(*TOY.fields, field))
    replace(TOY, bus="canopen", identity=Identity("0x1", "", ""), fields=(field,))


def test_fields_that_overlap_or_share_a_name_are_refused() -> None:
    with pytest.raises(ConfigError, match="position and half overlap at 0x12"):
        replace(TOY, fields=(*TOY.fields, Field("half", 0x12, "uint16", "half of it")))
    with pytest.raises(ConfigError, match="several fields have the name speed"):
        replace(TOY, fields=(*TOY.fields, Field("speed", 0x30, "uint16", "again")))


# --- What a contract says of bytes that came: whether they can be true, and how they are shown to people

OVEN = Contract(
    name="oven",
    title="oven",
    bus="modbus",
    identity=Identity("Acme", "OV-60", "1.0"),
    fields=(
        Field("setpoint", 0x10, "int16", "asked for", "degC", 0.1, "rw", -10.0, 60.0, 20.0),
        Field("heater", 0x11, "uint16", "heater", access="rw", choices={"off": 0, "on": 1}),
        Field("name", 0x12, "text", "name", access="rw", default="", length=6),
        Field("status", 0x15, "uint16", "status", bits={"hot": 0, "open": 3}),
        Field("heat", 0x16, "float32", "heat", "W"),
        Field("order", 0x18, "uint16", "order", access="wo", minimum=0, maximum=9),
        Field("hours", 0x19, "uint32", "hours of use", "h"),
        Field("cycles", 0x20, "uint32", "how often it was heated up"),
    ),
)


# --- readings that cannot be true ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "fault"),
    [
        ("setpoint", 60.0, ""),
        ("setpoint", -10.0, ""),
        ("setpoint", 60.1, "setpoint = 60.1 degC is outside -10 to 60 degC"),
        ("setpoint", math.nan, "setpoint = nan degC is outside -10 to 60 degC"),
        ("heater", 1.0, ""),
        ("heater", 2.0, "heater = 2 is no choice; valid: off (0), on (1)"),
        ("heat", 1e30, ""),
        ("heat", math.nan, ""),  # of a float without limits: the device has no reading
        ("heat", math.inf, "heat = inf W, which is no finite number"),
    ],
)
def test_a_reading_is_held_to_the_limits_and_choices_of_its_field(name: str, value: float, fault: str) -> None:
    assert OVEN.misread(name, value) == fault


@pytest.mark.parametrize(("minimum", "maximum"), [(0.0, None), (None, 0.0)])
def test_one_limit_is_enough_to_make_not_a_number_a_misreading(minimum: float | None, maximum: float | None) -> None:
    field = Field("heat", 0x10, "float32", "heat", minimum=minimum, maximum=maximum)
    assert Contract("oven", "oven", "modbus", OVEN.identity, (field,)).misread("heat", math.nan)


# --- texts ---------------------------------------------------------------------------------------------


def test_a_text_is_filled_up_with_nul_which_no_reader_sees() -> None:
    assert OVEN.encode("name", "fünf") == b"f\xc3\xbcnf\x00"
    assert OVEN.encode("name", "sechs!") == b"sechs!"
    assert OVEN.decode_text("name", b"f\xc3\xbcnf\x00") == "fünf"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sieben.", r"^oven: name = 'sieben\.' takes 7 bytes of UTF-8, 6 are allowed; shorten it$"),
        ("füüü", r"^oven: name = 'füüü' takes 7 bytes of UTF-8"),
        ("a\nb", r"^oven: name = 'a\\nb' holds characters that cannot be printed; leave them out$"),
        ("\udc80", r"^oven: name = '\\udc80' holds characters that cannot be printed"),
    ],
)
def test_a_text_that_does_not_fit_or_cannot_be_printed_is_refused(text: str, message: str) -> None:
    with pytest.raises(RangeError, match=message):
        OVEN.encode("name", text)


@pytest.mark.parametrize("data", [b"a\x00b\x00\x00\x00", b"a\nb\x00\x00\x00", b"\xff\xff\xff\x00\x00\x00"])
def test_bytes_that_are_no_such_text_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"cannot be printed|decode"):
        OVEN.decode_text("name", data)


# --- shown to people -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "data", "text"),
    [
        ("setpoint", "ff9c", "setpoint = -10 degC"),
        ("setpoint", "ff9c00", "setpoint = ff 9c 00"),  # of another length
        ("heater", "0001", "heater = on"),
        ("heater", "0007", "heater = 7"),
        ("name", "61ff00000000", "name = 'a�'"),
        ("status", "0009", "status = hot open"),
        ("status", "0002", "status = bit 1"),
        ("status", "0000", "status = none"),
        ("hours", "00ffffff", "hours = 16777215 h"),
        ("cycles", "00000007", "cycles = 7"),
    ],
)
def test_bytes_are_shown_by_name_with_what_they_mean(name: str, data: str, text: str) -> None:
    assert OVEN.shown(name, bytes.fromhex(data)) == text


def test_a_setting_is_described_with_what_may_be_written() -> None:
    assert OVEN.described("name", "a") == "name = 'a' (text of up to 6 bytes)"
    assert OVEN.described("setpoint", 7.5) == "setpoint = 7.5 degC (-10 to 60)"
    assert OVEN.described("order", 7) == "order = 7 (0 to 9)"
    assert OVEN.described("heater", "on") == "heater = on (off, on)"


# --- a CAN bus -----------------------------------------------------------------------------------------


def test_a_transfer_takes_at_least_two_frames_of_eight_bytes() -> None:
    """By ISO 11898-1 a frame without stuffed bits has 44 + 64 = 108 bits, and 3 bits lie between two.

    So 218 bits pass until the receiver has the last but one of the second frame: 1.744 ms at 125 kbit/s, and 1.58 %
    less by a fast clock.
    """
    assert shortest_transfer(125e3) == pytest.approx(1.744e-3 * (1 - 0.0158), rel=1e-12)
    assert shortest_transfer(1e6) == pytest.approx(shortest_transfer(125e3) / 8, rel=1e-12)


def test_a_frame_of_eight_bytes_has_24_stuffed_bits_at_most_and_3_on_average() -> None:
    """98 bits are watched: the first five equal ones and then each fourth bit may bring a stuffed one."""
    assert stuff_bits(8) == 24
    assert stuff_bits(0) == 8
    assert stuff_bits(8, "mean") == pytest.approx(98 / 30)


# --- what a device holds when it is switched on --------------------------------------------------------

SWITCHED_ON = {
    "signal_generator": {"frequency": 10.0},
    "shaker_amplifier": {"gain": 2.0, "current_limit": 5.0},
    "strain_indicator": {"gage_factor": 8.98, "full_scale": 200.0, "filter": 0.1},
    "positioner": {"speed": 1e-3, "limit_high": 0.025},
    "sample_changer": {"speed": 0.02},
    "sensor_node": {
        "device_type": 0x0002_0194,  # CiA 404, analogue inputs
        "sync_cob_id": 0x80, "emergency_cob_id": 0x80, "tpdo1_cob_id": 0x180, "tpdo2_cob_id": 0x280,  # CiA 301, 7.3.5
        "tpdo1_type": 1, "tpdo2_type": 1,  # at every SYNC
        "sync_period": 1e-3, "heartbeat": 1.0,
        "device_name": "Palpate SN-1", "hardware_version": "1.0",
        "vendor": 0x50414C50, "product": 0x534E0001, "revision": 0x0001_0000,
        **{f"unit_{channel}": 0x0026_0000 for channel in range(1, 5)},  # volt, CiA 303-2
    },
}  # fmt: skip


@pytest.mark.parametrize("name", SWITCHED_ON)
def test_a_device_that_was_switched_on_holds_what_was_written_down_here_and_else_zeros(name: str) -> None:
    contract = CONTRACTS[name]
    held = {field.name: field.default for field in contract.fields if field.name != "probe"}
    assert {name: value for name, value in held.items() if value not in (0.0, "")} == SWITCHED_ON[name]


WHOLE = 2**32 - 1
LIMITS = {
    "signal_generator": {"frequency": (0, 20e3), "amplitude": (0, 10), "offset": (-10, 10), "phase_reset": (1, 1)},
    "shaker_amplifier": {
        "gain": (0, 20), "current_limit": (0.1, 6), "clear_faults": (1, 1), "watchdog": (0, 60),
        "temperature": (-40, 150), "token": (1, WHOLE), "counter": (1, WHOLE), "order_value": (0, 65535),
        "release": (1, WHOLE),
    },
    "strain_indicator": {"gage_factor": (0.5, 20), "full_scale": (10, 30e3), "filter": (0.01, 10), "decimals": (0, 9)},
    "positioner": {
        "target": (0, 0.025), "speed": (1e-6, 5e-3), "limit_low": (0, 0.025), "limit_high": (0, 0.025),
    },
    "sample_changer": {"speed": (1e-3, 0.2)},
    "sensor_node": {
        "sync_cob_id": (0, WHOLE), "sync_period": (1e-4, 10), "emergency_cob_id": (0x81, 0x8000_07FF),
        "heartbeat": (0, 60), **{f"reset_{channel}": (1, 1) for channel in range(1, 5)},
    },
}  # fmt: skip


@pytest.mark.parametrize("name", LIMITS)
def test_a_field_takes_what_lies_within_the_limits_that_were_written_down_here(name: str) -> None:
    limited = [field for field in CONTRACTS[name].fields if field.minimum is not None or field.maximum is not None]
    assert {field.name: field.limits for field in limited} == LIMITS[name]


@pytest.mark.parametrize("contract", CONTRACTS.values(), ids=list(CONTRACTS))
def test_a_unit_is_one_of_those_that_devices_speak_in(contract: Contract) -> None:
    assert {field.unit for field in contract.fields} <= {"", "A", "Hz", "V", "V/V", "degC", "m", "m/s", "mV", "s"}


# --- Whatever is allowed survives the wire; whatever is not never gets there ---------------------------
