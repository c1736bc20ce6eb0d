"""Registers or objects of a device, declared once and used at both ends of the wire.

A driver encodes and decodes with the contract, and a simulator validates with the same contract. Register tables, the
EDS and the DBC are generated from it. A wrong scale would pass every round-trip test, so each field also has a golden
frame that was written by hand (`tests/golden`).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from palpate.instrument.contracts.declaration import (
    Command,
    Condition,
    Declaration,
    Identity,
    Manners,
    Mark,
    Pdo,
    check_declaration,
    digest,
)
from palpate.instrument.contracts.field import (
    NUL,
    PROBE,
    STRUCT,
    Access,
    Codec,
    Field,
    Scaling,
    Value,
    codec,
    probe,
    sdo,
    swapped,
    told_text,
)
from palpate.instrument.errors import RangeError

__all__ = [
    "PROBE", "Access", "Command", "Condition", "Contract", "Field", "Identity", "Manners", "Mark", "Pdo", "Scaling",
    "Value", "probe", "sdo",
]  # fmt: skip
NOTHING: Mapping[str, float] = {}
ROUNDING = 1e-12  # relative; of a value that was scaled by what a device tells


@dataclass(frozen=True)
class Contract(Declaration):
    """A declaration that is possible on its bus, and how its values become bytes; see `Declaration`."""

    _codec: dict[str, Codec] = field(init=False, repr=False, compare=False)
    # of most fields: codec, scale, and what divides a number if the scale is below 1
    _plain: dict[str, tuple[Codec, float, float]] = field(init=False, repr=False, compare=False)
    _raw_limits: dict[str, tuple[float, float]] = field(init=False, repr=False, compare=False)
    _missing: dict[str, frozenset[int]] = field(init=False, repr=False, compare=False)  # bits that say: no reading

    def __post_init__(self) -> None:
        """Check that the declaration is possible on this bus. Raises ConfigError."""
        super().__post_init__()
        order: Literal[">", "<"] = ">" if self.bus == "modbus" else "<"
        object.__setattr__(self, "_codec", {f.name: codec(f.type, order) for f in self.fields if f.type != "text"})
        plain = {f.name: (self._codec[f.name], f.scale, 1.0 / f.scale) for f in self.fields if _is_plain(f)}
        object.__setattr__(self, "_plain", plain)
        object.__setattr__(self, "_raw_limits", {f.name: _raw_limits(f) for f in self.fields})
        missing = {f.name: frozenset[int]().union(*map(f.bits_of, f.missing)) for f in self.fields if f.missing}
        object.__setattr__(self, "_missing", missing)
        check_declaration(self, self.encode)

    def raw(self, name: str, value: Value) -> float:
        """Raw value that belongs to `value`, which is checked against the field's limits.

        Args:
            value: physical value in the field's unit, or the name of a choice.

        Raises:
            RangeError: the value is outside the limits, not finite, or no such choice; the message names device, field,
                value and limit.
        """
        f = self[name]
        if isinstance(value, str):
            if value not in f.choices:
                raise RangeError(f"{self.title}: {f.name} = {value!r} is no choice; valid: {', '.join(f.choices)}")
            return f.choices[value]
        if not self.allows(name, value):
            raise RangeError(f"{self.title}: {f.beyond(value)}")
        return f.to_raw(value)

    def misread(self, name: str, value: float) -> str:
        """What is wrong with a value that a device gave; "" where nothing is.

        Values that are read are held to the same limits and choices as values that are written. NaN says that the
        device has no reading; a field may read so if it has a raw value for that, or is a float without limits.
        """
        f = self[name]
        if self.allows(name, value):
            return ""
        bounded = f.choices or f.minimum is not None or f.maximum is not None
        return "" if math.isnan(value) and (f.missing or not bounded) else f.beyond(value)

    def described(self, name: str, value: Value) -> str:
        """Text of a setting with its unit and its limits or choices, for messages."""
        return self[name].described(value)

    def allows(self, name: str, value: float) -> bool:
        """Whether a physical value, rounded to the field's resolution, is within limits and choices. NaN never is."""
        f = self[name]
        if not math.isfinite(value) or not math.isfinite((value - f.offset) / f.scale):
            return False
        if f.scaling is not None:  # its resolution is told by the device
            low, high = f.limits
            return low <= value <= high or any(math.isclose(value, limit, rel_tol=ROUNDING) for limit in f.limits)
        low, high = self._raw_limits[name]
        return low <= f.to_raw(value) <= high and (not f.choices or value in f.choices.values())

    def pack(self, name: str, value: float, beside: Mapping[str, float] = NOTHING) -> bytes:
        """Wire bytes of a reading, without a check of limits; see `decode`. Raises struct.error: it does not fit."""
        f = self._by_name[name]
        if f.missing and math.isnan(value):
            bits = min(f.bits_of(f.missing[0])) << (f.part[0] if f.part else 0)
            return self._ordered(f, bits.to_bytes(f.size, self._octets))
        if f.beside:
            value = (abs(value) if f.sign else value) / self._factor(f, beside)
        return self._packed(f, f.to_raw(value))

    def _packed(self, f: Field, raw: float) -> bytes:
        if f.part is not None:
            if not 0 <= raw < 1 << f.part[1]:
                raise struct.error(f"{raw} does not fit {f.part[1]} bits")
            raw = int(raw) << f.part[0]
        return self._ordered(f, self._codec[f.name].pack(raw))

    def together(self, fields: Sequence[Field]) -> struct.Struct | None:
        """What packs the raw values of fields that follow each other; None: some have bytes of a kind of their own."""
        codecs = [self._plain[f.name][0] if f.name in self._plain else None for f in fields]
        if not all(isinstance(each, struct.Struct) for each in codecs):
            return None
        return struct.Struct((">" if self.bus == "modbus" else "<") + "".join(STRUCT[f.type] for f in fields))

    @property
    def _octets(self) -> Literal["big", "little"]:
        return "big" if self.bus == "modbus" else "little"

    @staticmethod
    def _ordered(f: Field, data: bytes) -> bytes:
        """Bytes as they are on the wire from those of the usual order, or back."""
        if f.words == f.octets == "big":
            return data
        return swapped(data, words=f.words == "little" and f.type != "text", octets=f.octets == "little")

    def encode(self, name: str, value: Value, beside: Mapping[str, float] = NOTHING) -> bytes:
        """Wire bytes of `value`; see `decode`. Raises RangeError as `raw` does; for a text as `encode_text` does."""
        f = self[name]
        plain = name in self._plain
        if f.type == "text":
            return self.encode_text(name, str(value))
        raw = self.raw(name, value)
        try:
            if not plain and f.beside and not isinstance(value, str):  # the limits are those of the physical value
                return self.pack(name, value, beside)
            return self._plain[name][0].pack(raw) if plain else self._packed(f, raw)
        except (struct.error, OverflowError):
            raise RangeError(
                f"{self.title}: {name} = {value:g} {f.unit}".rstrip() + f" does not fit a {f.type}"
            ) from None

    def decode(self, name: str, data: bytes, beside: Mapping[str, float] = NOTHING) -> float:
        """Physical value of wire bytes; NaN stays NaN, and says that the device has no reading.

        Args:
            name: name of the field.
            data: its bytes; of a part of a register, those of the register.
            beside: values of the fields that tell its scale and its sign (`Field.beside`), if there are any.

        Raises:
            struct.error: the length is wrong, or an integer of 64 bits has more digits than a float keeps.
            KeyError: `beside` lacks a value, or the device names a scale that the contract does not know.
            ValueError: the device names a scale that cannot be.
        """
        if name in self._plain:  # most fields, and quicker
            packed, scale, divisor = self._plain[name]
            number: float = packed.unpack(data)[0]
            return number * scale if scale >= 1.0 else number / divisor
        f = self._by_name[name]
        data = self._ordered(f, data)
        if f.missing and len(data) == f.size:
            bits = int.from_bytes(data, self._octets)
            if (bits if f.part is None else bits >> f.part[0] & (1 << f.part[1]) - 1) in self._missing[name]:
                return math.nan
        raw: float = self._codec[name].unpack(data)[0]
        if f.part is not None:
            raw = int(raw) >> f.part[0] & (1 << f.part[1]) - 1
        # multiplying by a small scale would not be exact: 25000 * 1e-6 < 0.025
        value = raw * f.scale if abs(f.scale) >= 1.0 else raw / (1.0 / f.scale)
        if f.offset or f.scale < 0:  # 0 times a negative scale is -0
            value += f.offset
        return self._scaled(f, value, beside) if f.beside else value

    def _scaled(self, f: Field, value: float, beside: Mapping[str, float]) -> float:
        if f.scaling is not None and f.scaling.by == "decimals":
            value /= f.scaling.divisor(beside[f.scaling.told_by])  # dividing is exact where multiplying is not
        elif f.scaling is not None:
            value *= self._factor(f, beside)
        if f.sign is not None and f.sign[1] in self.set_bits(f.sign[0], beside[f.sign[0]]):
            return -value
        return value

    def _factor(self, f: Field, beside: Mapping[str, float]) -> float:
        return 1.0 if f.scaling is None else f.scaling.factor(beside[f.scaling.told_by])

    def step(self, name: str, beside: Mapping[str, float] = NOTHING) -> float:
        """Step of an integer field, in its unit, negative if it counts the other way; see `decode`."""
        f = self[name]
        return f.scale * self._factor(f, beside)

    def encode_text(self, name: str, text: str) -> bytes:
        """Wire bytes of a text. Raises RangeError: the text is longer than the field, or cannot be printed."""
        f = self[name]
        if not text.isprintable():
            raise RangeError(f"{self.title}: {name} = {text!r} holds characters that cannot be printed; leave them out")
        data = text.encode()  # this cannot fail, because all printable characters have an encoding
        if self.bus == "canopen":
            return data
        if len(data) > f.length:
            raise RangeError(
                f"{self.title}: {name} = {text!r} takes {len(data)} bytes of UTF-8, {f.length} are allowed; shorten it"
            )
        return self._ordered(f, data.ljust(f.length, NUL.encode()))

    def decode_text(self, name: str, data: bytes) -> str:
        """Text of wire bytes; of one that is only read, see `told_text`.

        Raises ValueError: they are not the bytes of such a text.
        """
        f = self[name]
        data = self._ordered(f, data)
        text = told_text(data) if f.access == "ro" else data.decode().rstrip(NUL)
        if not text.isprintable():
            raise ValueError(f"{text!r} holds characters that cannot be printed")
        return text

    def set_bits(self, name: str, value: float) -> frozenset[str]:
        """Names of the bits that are set in a status word. A bit without a name is called by its number, as `bit 9`."""
        names, word = {number: bit for bit, number in self[name].bits.items()}, int(value)
        return frozenset(names.get(n, f"bit {n}") for n in range(word.bit_length()) if word >> n & 1)

    def choice(self, name: str, value: float) -> str:
        """Name of the choice with raw value `value`; the number itself where no choice has it."""
        return next((k for k, v in self[name].choices.items() if v == value), f"{value:g}")

    @property
    def tells_serial(self) -> bool:
        """Whether the device has a place for its serial number: a field, or the identity objects of Modbus."""
        return bool(self.serial) or self.has("serial") or (self.bus == "modbus" and self.known_by == "identity")

    def shown(self, name: str, data: bytes, beside: Mapping[str, float] = NOTHING) -> str:
        """Name and value of a field, from its wire bytes, as text for people; `beside`: see `decode`."""
        f = self[name]
        if f.type == "text":
            data = self._ordered(f, data)
            text = told_text(data) if f.access == "ro" else data.decode("utf-8", "replace").rstrip(NUL)
            return f"{name} = {text!r}"
        try:
            value = self.decode(name, data, beside)
        except struct.error:  # a wrong length
            return f"{name} = {data.hex(' ')}"
        except KeyError:
            return f"{name} = {data.hex(' ')} (its scale or sign is not known here)"
        if math.isnan(value) and f.missing:
            return f"{name} = no reading"
        if f.choices:
            return f"{name} = {self.choice(name, value)}"
        if f.bits:
            return f"{name} = {' '.join(sorted(self.set_bits(name, value))) or 'none'}"
        return f"{name} = {value:.10g} {f.unit}".rstrip()

    def packed(
        self, pdo: Pdo, values: Mapping[str, Value], encode: Callable[[str, Value], bytes] | None = None
    ) -> bytes:
        """Data of a PDO. Raises RangeError as `raw` does, and where a field has no value.

        Args:
            pdo: the PDO.
            values: values of all its fields.
            encode: makes the bytes of a field that has a scale told by the device; None: there is no such field.
        """
        if values.keys() != set(pdo.fields):
            given = ", ".join(values) or "nothing"
            raise RangeError(
                f"{self.title}: PDO {pdo.name} holds {', '.join(pdo.fields)}, not {given}; give all of them"
            )
        return b"".join(map(encode or self.encode, pdo.fields, map(values.__getitem__, pdo.fields)))

    def parts(self, pdo: Pdo, data: bytes) -> dict[str, bytes]:
        """The bytes of each field of a PDO; fields that `data` is too short for are left out."""
        found, at = {}, 0
        for name in pdo.fields:
            end = at + self[name].size
            if end <= len(data):
                found[name] = data[at:end]
            at = end
        return found

    def digest(self) -> str:
        """SHA-256 of the whole declaration. Each run keeps it."""
        return digest(self)


def _is_plain(f: Field) -> bool:
    """Whether its value is its number in the usual order, times its scale."""
    special = f.part or f.missing or f.offset or f.scale < 0 or f.beside or "little" in (f.words, f.octets)
    return f.type != "text" and not special


def _raw_limits(f: Field) -> tuple[float, float]:
    low, high = (f.to_raw(limit) if math.isfinite(limit) else limit for limit in f.limits)
    if f.scale > 0:
        return low, high
    return (-math.inf if math.isinf(high) else high), (math.inf if math.isinf(low) else low)
