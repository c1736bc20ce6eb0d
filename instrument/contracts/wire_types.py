"""Types of numbers on the wire, and how their bytes are made."""

from __future__ import annotations

import struct
from contextlib import suppress
from functools import cache
from typing import Any, Literal, Protocol

Type = Literal[
    "bool", "uint8", "int8", "uint16", "int16", "uint24", "int24", "uint32", "int32", "uint64", "int64", "float32",
    "float64", "text",
]  # fmt: skip
Endian = Literal[">", "<"]

STRUCT: dict[str, str] = {
    "bool": "B", "uint8": "B", "int8": "b", "uint16": "H", "int16": "h", "uint32": "I", "int32": "i", "uint64": "Q",
    "int64": "q", "float32": "f", "float64": "d",
}  # fmt: skip
SIGNED, FLOATS = ("int8", "int16", "int24", "int32", "int64"), ("float32", "float64")
EIGHT_BYTES = ("uint64", "int64")
EXACT = 2**53  # all whole numbers up to here are floats of 64 bits; beyond, digits would be lost
THREE_BYTES = {"uint24": False, "int24": True}  # whether it is signed; `struct` has no code for these
SIZE = {name: struct.calcsize(code) for name, code in STRUCT.items()} | dict.fromkeys(THREE_BYTES, 3)
NUL = "\0"  # the character that fills a text up to the length of its field
PADDING = b"\0\xff \t\r\n"  # with which devices of makers fill theirs


class Codec(Protocol):
    """Makes the bytes of one number, as `struct.Struct` does."""

    def pack(self, raw: Any, /) -> bytes:
        """Raises struct.error: the number does not fit."""

    def unpack(self, data: bytes, /) -> tuple[Any, ...]:
        """Raises struct.error: the length is wrong."""


class _ThreeBytes:
    """An integer of 24 bits."""

    def __init__(self, endian: Endian, signed: bool) -> None:
        self._order: Literal["big", "little"] = "big" if endian == ">" else "little"
        self._signed = signed

    def pack(self, raw: float, /) -> bytes:
        try:
            return int(raw).to_bytes(3, self._order, signed=self._signed)
        except OverflowError as error:
            raise struct.error(str(error)) from None

    def unpack(self, data: bytes, /) -> tuple[int]:
        if len(data) != 3:
            raise struct.error(f"an integer of 24 bits has 3 bytes, not {len(data)}")
        return (int.from_bytes(data, self._order, signed=self._signed),)


class _EightBytes:
    """An integer of 64 bits, whose value is a float, so that one with more digits than a float keeps is refused."""

    def __init__(self, packed: struct.Struct) -> None:
        self._packed = packed

    def pack(self, raw: float, /) -> bytes:
        return self._packed.pack(_exact(raw))

    def unpack(self, data: bytes, /) -> tuple[int]:
        return (_exact(self._packed.unpack(data)[0]),)


def _exact(raw: Any) -> Any:
    """A number as it is. Raises struct.error: it has more digits than a float keeps."""
    if not -EXACT <= raw <= EXACT:
        raise struct.error(f"{raw} has more digits than can be kept: {-EXACT} to {EXACT} are exact")
    return raw


@cache
def codec(type_: Type, endian: Endian) -> Codec:
    """What packs and unpacks numbers of a type, which is not `text`."""
    if type_ in THREE_BYTES:
        return _ThreeBytes(endian, THREE_BYTES[type_])
    packed = struct.Struct(endian + STRUCT[type_])
    return _EightBytes(packed) if type_ in EIGHT_BYTES else packed


def told_text(data: bytes) -> str:
    """The text in bytes that a device tells and nobody writes: without what fills it up, in UTF-8 or else in Latin-1.

    It ends at the first NUL behind a character, behind which some devices leave what stood there before.
    """
    text = data.lstrip(PADDING).partition(NUL.encode())[0].rstrip(PADDING)
    try:
        return text.decode()
    except UnicodeDecodeError:
        return text.decode("latin-1")


def signed(type_: Type, raw: int) -> int:
    """A raw value of a signed type that is given as its bits, as 0xFFFF for -1; any other as it is."""
    bits = 8 * SIZE[type_]
    return raw - (1 << bits) if type_ in SIGNED and 1 << bits - 1 <= raw < 1 << bits else raw


def bits_of(type_: Type, raw: float) -> frozenset[int]:
    """The bits, as whole numbers, that a raw value can mean: a whole number of a float is its value, or its bits.

    Empty: the type has no such value, and no such bits.
    """
    bits, found = 8 * SIZE[type_], set()
    if not isinstance(raw, float) and 0 <= raw < 1 << bits:
        found.add(int(raw))
    elif not isinstance(raw, float) and type_ in SIGNED and -(1 << bits - 1) <= raw < 0:
        found.add(int(raw) + (1 << bits))
    if type_ in FLOATS:
        with suppress(OverflowError):
            found.add(int.from_bytes(codec(type_, ">").pack(float(raw)), "big"))
    return frozenset(found)


def swapped(data: bytes, words: bool, octets: bool) -> bytes:
    """Bytes of some registers with their words in reverse, or the two bytes of each register exchanged, or both."""
    registers = [data[at : at + 2] for at in range(0, len(data), 2)]
    if words:
        registers.reverse()
    return b"".join(each[::-1] for each in registers) if octets else b"".join(registers)
