"""What no device can mean is refused where it is declared, by field, attribute and what is allowed."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from palpate.instrument.contracts.declaration import Command, Condition, Manners, Mark
from palpate.instrument.contracts.field import Field, Scaling, sdo
from palpate.instrument.errors import ConfigError, RangeError
from tests.contracts import SCALE, SCALED, contract, one

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
