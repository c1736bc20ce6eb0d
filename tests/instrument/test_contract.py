"""A contract declares a device once: what it says of itself, and how it turns values into bytes and back."""

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
from palpate.instrument.contracts.own import bus_load
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


@pytest.mark.parametrize("value", [1.0, 3.0, -1.0, 0.4, "medium", "Fast", ""])
def test_what_is_no_choice_is_refused_with_the_valid_ones(value: float | str) -> None:
    with pytest.raises(RangeError, match=r"toy device: mode = .* is no choice; valid: slow.*fast"):
        TOY.encode("mode", value)


def test_a_choice_goes_by_its_name_or_number() -> None:
    assert TOY.encode("mode", "fast") == TOY.encode("mode", 2.0) == b"\x00\x02"
    assert TOY.choice("mode", 2.0) == "fast"
    assert TOY.choice("mode", 7.0) == "7"


def test_a_name_where_a_number_belongs_is_refused() -> None:
    with pytest.raises(RangeError, match="speed = 'fast' is no choice"):
        TOY.encode("speed", "fast")


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
