"""Wire bytes of every field of every contract. An input is a byte that says which field, and its bytes."""

from __future__ import annotations

import struct
from fractions import Fraction

from palpate.instrument.contracts import CONTRACTS
from tests.fuzz.target import Target, require, same_number

FORMATS = {"uint8": "B", "int8": "b", "uint16": "H", "int16": "h", "uint32": "I", "int32": "i", "float32": "f"}
FIELDS = [(contract, field) for contract in CONTRACTS.values() for field in contract.fields if field.type != "text"]
SCALES = {field.scale: Fraction(str(field.scale)) for _, field in FIELDS}


def decode(data: bytes) -> None:
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
    return Target(seeds, decode, [b"\x7f\xc0\0\0", b"\xff\xff\xff\xff", b"\x80\0\0\0", b"\x7f\x80\0\0"])
