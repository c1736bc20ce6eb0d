"""What devices that can be bought say and no other contract does; and what no device can mean is refused."""

from __future__ import annotations

import itertools
import math
import re
import struct
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, get_args

import pytest

from palpate.instrument.contracts.declaration import Command, Condition, Manners, Mark
from palpate.instrument.contracts.field import SIZE, Field, Order, Scaling, sdo
from palpate.instrument.errors import ConfigError, RangeError
from tests.contracts import SCALE, SCALED, contract, one

ORDERS = get_args(Order)


# --- bytes ---------------------------------------------------------------------------------------------


# 12.5 is 4148 0000h as a float, 1234567890 is 4996 02D2h: worked out by hand
@pytest.mark.parametrize(
    ("words", "octets", "frame"),
    [
        ("big", "big", "49 96 02 D2"),
        ("little", "big", "02 D2 49 96"),
        ("big", "little", "96 49 D2 02"),
        ("little", "little", "D2 02 96 49"),
    ],
)
def test_four_orders_of_the_bytes_of_a_long(words: Order, octets: Order, frame: str) -> None:
    thing = one(words=words, octets=octets, access="rw")
    assert thing.encode("value", 1234567890) == bytes.fromhex(frame)
    assert thing.decode("value", bytes.fromhex(frame)) == 1234567890


@pytest.mark.parametrize("type_", [name for name, size in SIZE.items() if size % 2 == 0])
def test_every_type_comes_back_in_every_order(type_: Any) -> None:
    plain = one(type=type_).pack("value", 12345.0)
    registers = [plain[at : at + 2] for at in range(0, len(plain), 2)]
    for words, octets in itertools.product(ORDERS, ORDERS):
        thing = one(type=type_, words=words, octets=octets)
        ordered = registers[:: -1 if words == "little" else 1]
        frame = b"".join(each[:: -1 if octets == "little" else 1] for each in ordered)
        assert (thing.pack("value", 12345.0), thing.decode("value", frame)) == (frame, 12345.0)


# Baumer's manual: FEC780h is -80000 digits, which is -800.00 of a unit with two decimals
def test_a_long_of_three_bytes_keeps_its_sign() -> None:
    node = contract(Field("value", sdo(0x8130, 1), "int24", "value", scale=0.01), bus="canopen")
    assert node.decode("value", bytes.fromhex("80 C7 FE")) == -800.0
    assert node.pack("value", -800.0) == bytes.fromhex("80 C7 FE")
    with pytest.raises(struct.error):
        node.pack("value", 2**23 * 0.01)
    with pytest.raises(struct.error):
        node.decode("value", b"\0\0")


def test_text_may_have_the_bytes_of_each_register_exchanged() -> None:
    thing = one(type="text", length=4, octets="little")
    assert thing.decode_text("value", bytes.fromhex("42 41 44 43")) == "ABCD"
    assert thing.encode_text("value", "AB") == bytes.fromhex("42 41 00 00")


def test_parts_of_one_register_are_read_apart() -> None:
    thing = contract(
        Field("unit", 2, "uint16", "unit", part=(8, 8), choices={"kg": 0, "N": 5}, access="rw"),
        Field("polarity", 2, "uint16", "polarity", part=(0, 8), choices={"bipolar": 0, "unipolar": 1}, access="rw"),
    )
    frame = bytes.fromhex("05 01")
    assert [thing.decode(name, frame) for name in ("unit", "polarity")] == [5, 1]
    assert thing.encode("unit", "N") == bytes.fromhex("05 00")
    assert thing.encode("polarity", "unipolar") == bytes.fromhex("00 01")
    with pytest.raises(ConfigError, match="cannot be limits or choices"):
        Field("unit", 2, "uint16", "unit", part=(8, 4), choices={"high": 16})


def test_an_offset_is_added() -> None:
    thing = one(type="int16", scale=0.1, offset=-40.0, unit="degC", minimum=-40, maximum=100)
    assert thing.decode("value", bytes.fromhex("01 F4")) == 10.0
    assert thing.pack("value", 10.0) == bytes.fromhex("01 F4")


# --- scale, sign and unit in other registers -----------------------------------------------------------

WEIGHT = contract(
    Field("status", 6, "uint16", "status", bits={"negative": 7, "stable": 11}),
    Field("gross", 7, "uint32", "weight", "N", sign=("status", "negative"), scaling=Scaling("decimals")),
    Field("decimals", 13, "uint16", "decimals", minimum=0, maximum=4),
)


@pytest.mark.parametrize(("status", "value"), [(0x0800, 12.34), (0x0880, -12.34)])
def test_sign_and_decimals_come_from_other_registers(status: int, value: float) -> None:
    beside = {"status": status, "decimals": 2}
    assert WEIGHT["gross"].beside == ("decimals", "status")
    assert WEIGHT.decode("gross", bytes.fromhex("00 00 04 D2"), beside) == value
    assert WEIGHT.pack("gross", value, beside) == bytes.fromhex("00 00 04 D2")
    assert WEIGHT.step("gross", beside) == 0.01


@pytest.mark.parametrize(
    ("scaling", "told", "factor"),
    [
        (Scaling("scale", "decimals"), 3, 0.001),
        (Scaling("scale", "factor"), 80.0, 80.0),
        (Scaling("scale", "table", {0: 100.0, 7: 0.05}), 7, 0.05),
    ],
)
def test_a_scale_may_be_decimals_a_factor_or_a_table(scaling: Scaling, told: float, factor: float) -> None:
    scale = Field("scale", 1, "float32" if scaling.by == "factor" else "uint16", "scale")
    thing = contract(Field("value", 0x10, "int16", "value", scaling=scaling), scale)
    assert thing.decode("value", bytes.fromhex("00 64"), {"scale": told}) == pytest.approx(100 * factor, rel=1e-15)
    assert thing.pack("value", 100 * factor, {"scale": told}) == bytes.fromhex("00 64")


# 0 would make any reading 0, and 65535 decimals no float
@pytest.mark.parametrize(
    ("scaling", "told", "error"),
    [
        (Scaling("scale"), 65535, "65535 is no number of decimals; valid: -20 to 20"),
        (Scaling("scale"), -400, "-400 is no number of decimals"),
        (Scaling("scale"), 1.5, "1.5 is no number of decimals"),
        (Scaling("scale"), math.nan, "nan is no number of decimals"),
        (Scaling("scale", "factor"), 0, "scale = 0 is no scale; it must be finite and above 0"),
        (Scaling("scale", "factor"), -1, "scale = -1 is no scale"),
        (Scaling("scale", "factor"), math.inf, "scale = inf is no scale"),
        (Scaling("scale", "factor"), math.nan, "scale = nan is no scale"),
        (Scaling("scale", "table", {1: 2.0}), math.nan, "nan"),
        (Scaling("scale", "table", {1: 2.0}), 1.5, "1.5"),
    ],
)
def test_a_scale_that_cannot_be_is_an_error_and_no_reading(scaling: Scaling, told: float, error: str) -> None:
    thing = contract(replace(SCALED, scaling=scaling), Field("scale", 1, "float64", "scale"))
    with pytest.raises((ValueError, KeyError), match=error):
        thing.decode("value", b"\0\1", {"scale": told})


@pytest.mark.parametrize("name", ["long", "signed", "bits"])
def test_no_digit_of_a_long_is_lost_silently(name: str) -> None:
    thing = contract(
        Field("long", 1, "uint64", "long", access="rw"),
        Field("signed", 10, "int64", "signed", access="rw", words="little"),
        Field("bits", 20, "uint64", "bits", bits={"lowest": 0, "highest": 63}, access="rw"),
    )
    frame = (2**53 + 1).to_bytes(8, "big")
    frame = b"".join(frame[at : at + 2] for at in (6, 4, 2, 0)) if name == "signed" else frame
    with pytest.raises(struct.error, match="9007199254740993 has more digits than can be kept"):
        thing.decode(name, frame)
    assert thing.decode(name, thing.encode(name, 2**53)) == 2**53
    with pytest.raises(RangeError, match="does not fit"):
        thing.encode(name, 2.0**54)


@pytest.mark.parametrize("value", [256, 300, -1])
def test_a_part_never_spills_into_the_bits_of_its_neighbour(value: float) -> None:
    low = Field("low", 1, "uint16", "low", part=(0, 8), access="rw")
    thing = contract(low, replace(low, name="high", part=(8, 8)))
    with pytest.raises(RangeError, match=f"low = {value} is outside 0 to 255"):
        thing.encode("low", value)
    with pytest.raises(struct.error):
        thing.pack("low", value)


def test_a_bool_is_0_or_1() -> None:
    node = contract(Field("on", sdo(0x2000), "bool", "on", access="rw"), bus="canopen")
    assert node.misread("on", node.decode("on", b"\7")) == "on = 7 is outside 0 to 1"
    with pytest.raises(RangeError, match="on = 2 is outside 0 to 1"):
        node.encode("on", 2)


@pytest.mark.parametrize(("value", "fits"), [(0.3, False), (0.4, True), (9.6, True), (9.61, False), (0.3999, False)])
def test_limits_of_a_scale_that_is_told_are_physical(value: float, fits: bool) -> None:
    thing = contract(replace(SCALED, access="rw", minimum=0.4, maximum=9.6), SCALE)
    assert thing.allows("value", value) == fits
    assert (thing.misread("value", value) == "") == fits


def test_a_limit_may_exceed_what_a_type_holds_in_a_scale_that_is_told() -> None:
    thing = contract(replace(SCALED, scaling=Scaling("scale", "factor"), maximum=1e6), SCALE)
    assert thing.decode("value", b"\0\5", {"scale": 1e5}) == 5e5
    assert thing.shown("value", b"\0\5") == "value = 00 05 (its scale or sign is not known here)"


FLT_MAX, NO_READING = "7F7F FFFF", "7CF0 0000"  # 3.4028235e38 and 9.96921e36, as manuals give them


@pytest.mark.parametrize(
    ("type_", "missing", "frame"),
    [
        ("float32", 0x7F7FFFFF, FLT_MAX),
        ("float32", 3.4028234663852886e38, FLT_MAX),
        ("float32", 9.96921e36, NO_READING),
        ("float32", 0x7CF00000, NO_READING),
        ("float32", 99999, "47C3 4F80"),
        ("float32", -99999, "C7C3 4F80"),
        ("float32", 0x7FC00001, "7FC0 0001"),  # a NaN that is not Python's
        ("float32", 0x7F800000, "7F80 0000"),
        ("float32", -0.0, "8000 0000"),
        ("float64", 0x7FEFFFFFFFFFFFFF, "7FEF FFFF FFFF FFFF"),
        ("int16", 0x8000, "8000"),
        ("int16", -32768, "8000"),
        ("int32", 0x80000000, "8000 0000"),
        ("int32", 0x7FFFFFFF, "7FFF FFFF"),
        ("uint32", 0xFFFFFFFF, "FFFF FFFF"),
        ("int64", 0x8000000000000000, "8000 0000 0000 0000"),
        ("uint64", 0xFFFFFFFFFFFFFFFF, "FFFF FFFF FFFF FFFF"),
    ],
)
def test_what_says_that_there_is_no_reading_is_given_by_its_value_or_by_its_bits(
    type_: Any, missing: float, frame: str
) -> None:
    thing = one(type=type_, missing=(missing,))
    data = bytes.fromhex(frame)
    assert math.isnan(thing.decode("value", data))
    assert thing.misread("value", math.nan) == ""
    assert math.isnan(thing.decode("value", thing.pack("value", math.nan)))
    assert thing.decode("value", bytes(len(data))) == 0.0  # 0 differs from -0


def test_a_choice_of_a_signed_type_may_be_given_by_its_bits() -> None:
    thing = one(type="int16", access="rw", choices={"off": 0, "on": 0xFFFF})
    assert thing.encode("value", "on") == b"\xff\xff"
    assert thing.choice("value", thing.decode("value", b"\xff\xff")) == "on"


@pytest.mark.parametrize("type_", ["int16", "uint16", "float32", "int32"])
def test_a_device_that_counts_the_other_way_has_a_negative_scale(type_: Any) -> None:
    thing = one(type=type_, scale=-0.1, minimum=-500.0, maximum=-10.0, default=-20.0, access="rw")
    assert thing.decode("value", thing.pack("value", -123.4)) == pytest.approx(-123.4)
    assert thing.encode("value", -20) == thing.pack("value", -20.0)
    for beyond in (-500.1, -9.9, 20.0):
        with pytest.raises(RangeError, match="outside -500 to -10"):
            thing.encode("value", beyond)
    assert math.copysign(1.0, one(type=type_, scale=-0.1).decode("value", bytes(SIZE[type_]))) == 1.0  # not -0


def test_a_coil_and_a_part_can_count_the_other_way() -> None:
    thing = one(type="uint16", part=(4, 4), scale=-2.0, access="rw")
    assert thing["value"].limits == (-30.0, 0.0)
    assert thing.decode("value", thing.encode("value", -6)) == -6.0


@pytest.mark.parametrize(
    "data",
    [
        b"AB12\0\0\0\0",
        b"AB12    ",
        b"AB12\xff\xff\xff\xff",
        b"  AB12\0\0",
        b"AB12 \0\xff ",
        b"\0\0AB12\r\n",
        b"AB12\0x\x07y",
    ],
)
def test_a_text_that_is_only_read_may_be_filled_up_in_any_way(data: bytes) -> None:
    thing = one(type="text", length=8)
    assert thing.decode_text("value", data) == "AB12"
    assert thing.shown("value", data) == "value = 'AB12'"


def test_a_text_that_is_only_read_may_be_in_latin_1() -> None:
    thing = one(type="text", length=8)
    assert thing.decode_text("value", "Wäge-µ".encode("latin-1").ljust(8, b" ")) == "Wäge-µ"
    assert thing.decode_text("value", "Wäge".encode().ljust(8, b"\0")) == "Wäge"
    with pytest.raises(ValueError, match="cannot be printed"):
        thing.decode_text("value", b"AB\x0712345")
    with pytest.raises(ValueError, match="decode"):  # one that is written is read back as it was written
        one(type="text", length=8, access="rw").decode_text("value", b"W\xe4ge    ")


# --- What no device can mean is refused where it is declared, by field, attribute and what is allowed --

SCALED_BY_TABLE = (replace(SCALED, scaling=Scaling("scale", "table", {0: math.inf})), SCALE)
TEXT = Field("text", 1, "text", "text", length=4)
ORDER = Field("order", 0x20, "uint16", "order", access="rw")


def test_a_field_that_no_device_has_is_refused() -> None:
    for given, message in [
        ({"table": "input", "access": "rw"}, "access 'rw', but the table 'input' is read-only"),
        ({"table": "coil"}, "table 'coil' cannot hold a int32"),
        ({"table": "file"}, "no table 'file'; valid: holding"),
        ({"function": 6, "access": "rw"}, "function 6 writes one register, value has 4 bytes"),
        ({"function": 16}, "is written with function 16; valid for its access and table: none"),
        ({"function": 5, "access": "rw"}, "is written with function 5; valid for its access and table: 16, 6"),
        ({"words": "mixed"}, "no order of words 'mixed'; valid: big, little"),
        ({"type": "uint16", "part": (10, 8)}, "must lie within the 16 bits of a uint16"),
        ({"part": (0, 8)}, "must lie within the 16 bits of a uint16"),
        ({"offset": math.inf}, "offset = inf; give a finite number"),
        ({"sign": ("status", "negative")}, "a int32 has a sign of its own"),
        ({"missing": (2**32,)}, "missing = 4294967296 can never be met: a int32 has no such value and no such bits"),
        ({"endures": -1}, "endures = -1 writes"),
        ({"scale": 5e-324}, "scale = 4.94066e-324 is outside 1e-30 to 1e+30"),
        ({"scale": 5e-324, "maximum": 100.0}, "[100.0] cannot be limits or choices of a int32"),
        ({"scale": 1e-9, "maximum": 1e308}, "[1e+308] cannot be limits or choices of a int32"),
        ({"choices": {"a": 10**400}}, "cannot be limits or choices of a int32"),
        ({"missing": (10**400,)}, "can never be met: a int32 has no such value"),
        ({"missing": (9.5,)}, "missing = 9.5 can never be met"),
        ({"type": "float32", "missing": (1e39,)}, "missing = 1e+39 can never be met: a float32 has no such value"),
        ({"type": "uint16", "part": (0, 8), "missing": (256,)}, "missing = 256 can never be met"),
        ({"type": "uint16", "scale": -1.0, "sign": ("status", "negative")}, "give a scale above 0"),
        ({"type": "uint64", "choices": {"a": 2**53 + 1}}, "cannot be limits or choices of a uint64"),
        ({"choices": {"N": 5, "kg": 5}}, "choices N and kg are both 5"),
        ({"choices": {"": 5}}, "choices has an empty name"),
        ({"choices": {"a": 5}, "scale": 0.1}, "has choices, which name raw values, and scale; leave one of them out"),
        ({"choices": {"a": 5}, "missing": (5,)}, "choice 'a' is 5, which says that there is no reading"),
        ({"choices": {"a": 5}, "maximum": 3}, "choice 'a' is 5, outside -inf to 3"),
        ({"type": "uint16", "bits": {"a": 5, "b": 5}}, "bits a and b are both 5"),
        ({"type": "uint16", "bits": {"a": 5}, "offset": 1.0}, "has bits, which name raw values, and offset"),
        ({"type": "uint16", "bits": {"a": 5}, "missing": (7,)}, "has bits and missing"),
        ({"type": "uint16", "bits": {"a": 5}, "choices": {"b": 1}}, "has bits and choices"),
        ({"type": "uint16", "bits": {"a": 9}, "part": (0, 8)}, "bit 'a' is number 9; its part has 8 bits"),
        ({"type": "text", "length": 4, "part": (0, 8), "missing": (1,)}, "missing, part: a text has none of these"),
        ({"type": "text", "length": -2}, "length = -2 bytes; give 0 to 65535"),
        ({"length": 4}, "length = 4, which is for texts"),
        ({"default": "a"}, "default = 'a'; give a number for a int32"),
        ({"default": math.nan}, "default = nan"),
        ({"default": 1e308, "scale": 1e-9}, "default = 1e+308 does not fit a int32 with the scale 1e-09"),
        ({"default": 40_000, "type": "int16"}, "default = 40000 does not fit a int16"),
        ({"meaning": "\x1b[31m"}, "meaning = '\\x1b[31m' holds characters that cannot be printed"),
        ({"name": "größe"}, "field 'größe': give a name of up to 64 lower-case letters"),
        ({"name": ""}, "field '': give a name"),
    ]:
        with pytest.raises(ConfigError, match=re.escape(message)):
            one(**given)


def test_a_limit_beyond_all_raw_values_of_a_scale_that_the_device_tells_is_no_limit() -> None:
    made = contract(replace(SCALED, access="rw", scale=1e-9, minimum=0.0, maximum=1e308), SCALE)
    with pytest.raises(RangeError, match=r"value = 1e\+290 does not fit a int16"):
        made.encode("value", 1e290, {"scale": 0})


def test_a_contract_that_does_not_hold_together_is_refused() -> None:
    for fields, more, message in [
        ((SCALED,), {}, "its scale is in 'scale', which is no number field"),
        ((SCALED, Field("scale", 1, "uint16", "scale", access="rw")), {}, "has access 'rw'; it must be 'ro'"),
        ((replace(SCALED, scaling=Scaling("value")),), {}, "whose own scale is not fixed"),
        ((replace(SCALED, scaling=Scaling("scale", "table")), Field("scale", 1, "uint16", "s")), {}, "give a table"),
        ((Field("value", 0xFFFF, "int32", "value"),), {}, "ends at address 65536; the addresses go from 0 to 65535"),
        ((Field("value", 1, "uint32", "v", sign=("s", "n")), Field("s", 5, "uint16", "s")), {}, "valid bits: none"),
        (
            (Field("value", 1, "int16", "v", "N", unit_in="u"), Field("u", 5, "uint16", "u", choices={"kg": 0})),
            {},
            "u cannot tell its unit 'N', only kg",
        ),
        ((ORDER,), {"commands": (Command("go", "speed", 1),)}, "command go: 'speed' cannot be written; valid: order"),
        ((ORDER,), {"commands": (Command("go", "order", 70000),)}, "order = 70000"),
        ((ORDER,), {"commands": (Command("go", "order", 1, after=("arm",)),)}, "after 'arm', no command before it"),
        (
            (ORDER,),
            {"commands": (Command("go", "order", 1, done=Condition("order", (2,), 0x1)),)},
            "waits for [2] in order, which cannot read so (mask 0x1)",
        ),
        ((ORDER,), {"commands": (Command("go", "order", 1), Command("go", "order", 2))}, "several commands"),
        ((ORDER,), {"marks": (Mark("order", "text"),), "known_by": "marks"}, "is no value of a field"),
        ((ORDER,), {"known_by": "marks"}, "known by marks, but has none"),
        ((ORDER,), {"marks": (Mark("order", 1),)}, "has marks, but is known by identity"),
        ((ORDER,), {"serial": "number"}, "its serial number is in 'number'"),
        ((ORDER,), {"manners": Manners(together=(("order", "speed"),))}, "'speed' is no field that can be written"),
        (
            (ORDER, replace(ORDER, name="far", address=0x30)),
            {"manners": Manners(together=(("order", "far"),))},
            "must be adjacent",
        ),
        (SCALED_BY_TABLE, {}, "its table of scales has a factor that is not above 0, or not 1e-30 to 1e+30"),
        (
            (
                Field("a", 1, "uint16", "a", "N", unit_in="u"),
                Field("b", 2, "uint16", "b", "kg", unit_in="u"),
                Field("u", 5, "uint16", "u", choices={"N": 0, "kg": 1}),
            ),
            {},
            "u should tell 'N' for a and 'kg' for b",
        ),
        (
            (Field("a", 1, "uint16", "a", part=(0, 8)), Field("b", 1, "uint16", "b", part=(8, 8), octets="little")),
            {},
            "a and b are parts of one register, 0x1; give them the same octets, function and access",
        ),
        ((ORDER,), {"marks": (Mark("order", 70000),), "known_by": "marks"}, "order = 70000 does not fit a uint16"),
        ((ORDER,), {"marks": (Mark("order", math.nan),), "known_by": "marks"}, "order = nan"),
        ((ORDER,), {"marks": (Mark("order", 1), Mark("order", 2)), "known_by": "marks"}, "several marks have the name"),
        ((SCALED, SCALE), {"marks": (Mark("value", 1),), "known_by": "marks"}, "whose scale or sign is told by scale"),
        ((TEXT,), {"marks": (Mark("text", ""),), "known_by": "marks"}, "may begin with any text"),
        ((TEXT,), {"marks": (Mark("text", "abcdef"),), "known_by": "marks"}, "takes 6 bytes of UTF-8, 4 are allowed"),
        (
            (replace(SCALED, access="rw"), SCALE),
            {"commands": (Command("go", "value", 1),)},
            "has a scale that scale tells",
        ),
        (
            (ORDER, replace(ORDER, name="next", address=0x21)),
            {"commands": (Command("go", "order", 1),), "manners": Manners(together=(("order", "next"),))},
            "command go: order cannot be written without next",
        ),
        (
            (replace(ORDER, part=(0, 8)), replace(ORDER, name="next", part=(8, 8))),
            {"commands": (Command("go", "order", 1),)},
            "command go: order cannot be written without next",
        ),
        ((ORDER,), {"commands": (Command("go", "order", 1, clear=1),)}, "clear = 1 is its value"),
        ((ORDER,), {"commands": (Command("Go", "order", 1),)}, "command 'Go': give a name"),
        ((ORDER,), {"commands": (Command("go", "order", 1, done=Condition("order", (0,), 0)),)}, "mask = 0x0 of order"),
        (
            (ORDER,),
            {"commands": (Command("go", "order", 1, done=Condition("order", (1,), -1)),)},
            "mask = -0x1 of order",
        ),
        (
            (ORDER, replace(ORDER, name="state", address=0x21, part=(0, 4))),
            {"commands": (Command("go", "order", 1, done=Condition("state", (99,))),)},
            "which cannot read so (mask 0xF)",
        ),
        (
            (ORDER,),
            {"commands": (Command("go", "order", 1, (), Condition("order", (2,)), Condition("order", (2, 3))),)},
            "is done and has failed in one state of order",
        ),
        ((ORDER,), {"manners": Manners(together=((),))}, "together: [] is no run"),
        (
            (replace(ORDER, function=6), replace(ORDER, name="next", address=0x21)),
            {"manners": Manners(together=(("order", "next"),))},
            "order is written with function 6, which writes it alone",
        ),
        ((Field("long", 0, "uint64", "long"),), {"manners": Manners(most_read=2)}, "but a reply holds 2"),
    ]:
        with pytest.raises(ConfigError, match=re.escape(message)):
            contract(*fields, **more)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"most_read": 126}, "most_read = 126 is outside 1 to 125"),
        ({"gap": -1.0}, "gap = -1 is outside 0 to 10"),
        ({"units": (5, 2)}, "units = 5 is outside 0 to 2"),
        ({"responds": 0.0}, "responds = 0 is outside"),
    ],
)
def test_manners_that_no_bus_has_are_refused(given: Mapping[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Manners(**given)


def test_a_command_must_end() -> None:
    with pytest.raises(ConfigError, match="command go: seconds = inf"):
        Command("go", "order", 1, seconds=math.inf)


def test_a_bool_is_a_coil_or_an_object_and_no_register() -> None:
    assert contract(Field("on", sdo(0x2000), "bool", "on", access="rw"), bus="canopen").encode("on", 1) == b"\1"
    with pytest.raises(ConfigError, match="fills no whole 16-bit registers"):
        contract(Field("on", 1, "bool", "on"))


def test_modbus_manners_on_canopen_are_refused() -> None:
    with pytest.raises(ConfigError, match="are for Modbus; leave them out on CANopen"):
        contract(Field("value", sdo(0x2000), "int16", "value", words="little"), bus="canopen")


def test_coils_and_registers_may_have_the_same_numbers() -> None:
    thing = contract(
        Field("remote", 402, "bool", "remote control", table="coil", access="rw", choices={"off": 0, "on": 1}),
        Field("voltage", 402, "uint16", "voltage", access="rw"),
    )
    assert thing["remote"].writes == 5
    assert thing["voltage"].writes == 16
    with pytest.raises(ConfigError, match="overlap at 0x192"):
        contract(*thing.fields, Field("again", 402, "bool", "again", table="coil"))


def test_what_a_contract_says_of_manners_counts_in_its_digest() -> None:
    plain = one()
    assert one(words="little").digest() != plain.digest()
    assert replace(plain, manners=Manners(gap=0.005)).digest() != plain.digest()
    assert replace(plain, manners=Manners(busy=2.0)).digest() != plain.digest()
    assert one(source="manual, page 3").digest() == plain.digest()
    assert replace(plain, about="told anew").digest() == plain.digest()


def test_a_manner_that_maps_could_not_tell_earlier_changes_no_digest_that_runs_have_kept() -> None:
    kept = "57283aefc37b8e991688e12e3b609d45fa833afddd749c15bafb35ff80e1d079"  # from before there was a key `busy`
    assert replace(one(), manners=Manners(gap=0.005)).digest() == kept


@pytest.mark.parametrize(
    ("raw", "mask", "holds"), [(0x1637, 0x6F, True), (0x1633, 0x6F, False), (0x27, None, True), (math.nan, None, False)]
)
def test_a_condition_looks_at_the_bits_that_count(raw: float, mask: int | None, holds: bool) -> None:
    assert Condition("status", (0x27,), mask).holds(raw) is holds
