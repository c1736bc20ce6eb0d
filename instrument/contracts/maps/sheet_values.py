"""Types, access and values of the objects of a maker's data sheet, as CiA 306 writes them."""

from __future__ import annotations

import math
import re
import struct

from palpate.instrument.contracts.field import Access
from palpate.instrument.contracts.maps.data_sheet import DOMAIN, Entry, whole
from palpate.instrument.contracts.wire_types import SIZE, STRUCT, Type, codec

# by the numbers of CiA 301; what has no type of ours cannot be used
TYPES: dict[int, tuple[str, Type | None]] = {
    0x01: ("BOOLEAN", "bool"), 0x02: ("INTEGER8", "int8"), 0x03: ("INTEGER16", "int16"), 0x04: ("INTEGER32", "int32"),
    0x05: ("UNSIGNED8", "uint8"), 0x06: ("UNSIGNED16", "uint16"), 0x07: ("UNSIGNED32", "uint32"),
    0x08: ("REAL32", "float32"), 0x09: ("VISIBLE_STRING", "text"), 0x0A: ("OCTET_STRING", None),
    0x0B: ("UNICODE_STRING", None), 0x0C: ("TIME_OF_DAY", None), 0x0D: ("TIME_DIFFERENCE", None),
    DOMAIN: ("DOMAIN", None), 0x10: ("INTEGER24", "int24"), 0x11: ("REAL64", "float64"), 0x12: ("INTEGER40", None),
    0x13: ("INTEGER48", None), 0x14: ("INTEGER56", None), 0x15: ("INTEGER64", "int64"), 0x16: ("UNSIGNED24", "uint24"),
    0x18: ("UNSIGNED40", None), 0x19: ("UNSIGNED48", None), 0x1A: ("UNSIGNED56", None), 0x1B: ("UNSIGNED64", "uint64"),
}  # fmt: skip
USABLE = ", ".join(name for name, type_ in TYPES.values() if type_)
ACCESS: dict[str, Access] = {"const": "ro", "ro": "ro", "wo": "wo", "rw": "rw", "rwr": "rw", "rww": "rw"}
NODE_ID = "$NODEID"
HEXADECIMAL = ("0x", "0X")


def type_of(entry: Entry) -> Type:
    """The type of an object. Raises ValueError: it has none, or one that cannot be used."""
    if entry.data_type is None:
        raise ValueError(f"has no DataType; valid: {USABLE}")
    name, type_ = TYPES.get(entry.data_type, (f"{entry.data_type:X}h", None))
    if type_ is None:
        raise ValueError(f"its type {name} cannot be used; valid: {USABLE}")
    return type_


def access_of(entry: Entry) -> Access:
    """The access of an object. Raises ValueError: it has none, or one that CiA 306 does not know."""
    if entry.access not in ACCESS:
        raise ValueError(f"its access {entry.access!r} is unknown; valid: {', '.join(ACCESS)}")
    return ACCESS[entry.access]


def split(text: str) -> tuple[bool, str]:
    """Whether a value counts from the node id (`$NODEID`), and what stands beside that.

    Raises ValueError: more than a sum of the two.
    """
    if NODE_ID not in text.upper():
        return False, text
    before, _, after = (part.strip() for part in re.sub(r"(?i)\$nodeid", "\0", text, count=1).partition("\0"))
    if not before and not after:
        return True, "0"
    if before and not after and before.endswith("+"):
        return True, before[:-1].strip()
    if after and not before and after.startswith("+"):
        return True, after[1:].strip()
    raise ValueError(f"{text!r} is no sum of {NODE_ID} and a number")


def value_of(text: str, type_: Type) -> float:
    """The number that a text stands for in a type, which is not `text`. A whole number is exact.

    A signed number may be given by the bit pattern of its type, a float by that of IEEE 754, both in hexadecimal.

    Raises ValueError: the text is no such number, or the type cannot hold it.
    """
    if type_.startswith("float"):
        return _float(text, type_)
    number = whole(text)
    bits = 8 * SIZE[type_]
    if type_.startswith("int") and text.startswith(HEXADECIMAL) and 1 << bits - 1 <= number < 1 << bits:
        number -= 1 << bits
    try:
        codec(type_, "<").pack(number)
    except (struct.error, OverflowError):
        least, most = (-(1 << bits - 1), (1 << bits - 1) - 1) if type_.startswith("int") else (0, (1 << bits) - 1)
        why = "more digits than can be kept" if least <= number <= most else f"beyond {least} to {most}"
        raise ValueError(f"{text} has {why}" if "digits" in why else f"{text} is {why}") from None
    if type_ == "bool" and number > 1:
        raise ValueError(f"{text} is beyond 0 to 1")
    return number


def _float(text: str, type_: Type) -> float:
    packed = struct.Struct("<" + STRUCT[type_])
    try:
        if text.startswith(HEXADECIMAL):
            number: float = packed.unpack(whole(text).to_bytes(packed.size, "little"))[0]
        elif re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?", text):
            number = packed.unpack(packed.pack(float(text)))[0]  # as near as the type comes to it
        else:
            raise ValueError(f"{text[:40]!r} is no number")
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is beyond a number of {8 * packed.size} bits")
    return number
