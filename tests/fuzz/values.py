"""Wire bytes of every field of every contract, and texts with units.

An input is a byte that says which field and its bytes, or a byte that says which unit is wanted and the text.
"""

from __future__ import annotations

import math
import re
import struct
from decimal import Decimal
from fractions import Fraction

from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.quantity import parse
from tests.fuzz.target import Target, require, same_number

FORMATS = {"uint8": "B", "int8": "b", "uint16": "H", "int16": "h", "uint32": "I", "int32": "i", "float32": "f"}
FIELDS = [(contract, field) for contract in CONTRACTS.values() for field in contract.fields if field.type != "text"]
SCALES = {field.scale: Fraction(str(field.scale)) for _, field in FIELDS}


def decode_field(data: bytes) -> None:
    contract, field = FIELDS[data[0] % len(FIELDS)] if data else FIELDS[0]
    wire = data[1 : 1 + field.size].ljust(field.size, b"\0")
    value = contract.decode(field.name, wire)
    (raw,) = struct.unpack((">" if contract.bus == "modbus" else "<") + FORMATS[field.type], wire)
    scale = SCALES[field.scale]
    held = raw * field.scale if field.type == "float32" else raw * scale.numerator / scale.denominator
    require(same_number(held, value), field.name, value, wire.hex())
    if contract.allows(field.name, value):
        require(contract.encode(field.name, value) == contract.pack(field.name, value), field.name, value)
        require(contract.pack(field.name, value) == wire or value == 0, field.name, value, wire.hex())


def fields() -> Target:
    seeds = [bytes([n]) + c.pack(f.name, float(f.default)).ljust(4, b"\0") for n, (c, f) in enumerate(FIELDS)]
    return Target(seeds, decode_field, [b"\x7f\xc0\0\0", b"\xff\xff\xff\xff", b"\x80\0\0\0", b"\x7f\x80\0\0"])


WANTED = ("N", "Pa", "Hz", "s", "m", "V", "A", "")
PREFIXES = {
    "": 1,
    "m": Decimal("1e-3"),
    "u": Decimal("1e-6"),
    "µ": Decimal("1e-6"),
    "k": 1000,
    "M": 10**6,
    "n": Decimal("1e-9"),
    "G": 10**9,
}
OTHERS = {
    "gf": ("N", Decimal("9.80665e-3")),
    "kgf": ("N", Decimal("9.80665")),
    "min": ("s", 60),
    "h": ("s", 3600),
    "%": ("", Decimal("0.01")),
}
UNITS = {prefix + unit: (unit, factor) for prefix, factor in PREFIXES.items() for unit in WANTED if unit} | OTHERS
TEXT = re.compile(r"\s*([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*(\S*)\s*", re.ASCII)


def value_of(text: str) -> tuple[Decimal, str] | None:
    """Value and SI unit by a table of our own; None where the unit is not in it, or the number beyond it."""
    found = TEXT.fullmatch(text)
    if found is None or (found[2] and found[2] not in UNITS):
        return None
    unit, factor = UNITS[found[2]] if found[2] else ("", 1)
    try:
        return Decimal(found[1]) * factor, unit
    except ArithmeticError:  # an exponent of more digits than a decimal has
        return None


def decode_text(data: bytes) -> None:
    wanted, text = WANTED[data[0] % len(WANTED)] if data else "N", data[1:].decode(errors="replace")
    value = parse(text, wanted)
    require(math.isfinite(value), "finite", text, value)
    held = value_of(text)
    if held is not None:
        require(held[1] == wanted, "unit", text, wanted)
        require(math.isclose(float(held[0]), value, rel_tol=1e-12, abs_tol=1e-300), "value", text, value)


def quantities() -> Target:
    given = [(n, f"1.5 {prefix}{unit}") for n, unit in enumerate(WANTED) if unit for prefix in PREFIXES]
    given += [(0, "140 gf"), (3, "2 min"), (7, "3 %"), (7, "1e-3"), (0, "+.5e1N")]
    words = [
        b"e308",
        b"1e400",
        b"nan",
        b"inf",
        b"**9",
        b"/",
        b"\xe2\x88\x9a",
        b"kN",
        b"degC",
        b" s",
        b"-",
        b"_",
        b"\xd9\xa3",
    ]
    return Target([bytes([n]) + text.encode() for n, text in given], decode_text, words)
