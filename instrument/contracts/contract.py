"""Registers or objects of a device, declared once and used at both ends of the wire.

A driver encodes and decodes with the contract, and a simulator validates with the same contract. Register tables, the
EDS and the DBC are generated from it. A wrong scale would pass every round-trip test, so each field also has a golden
frame that was written by hand (`tests/golden`).
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import struct
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Literal

from palpate.instrument.contracts.field import NUL, SIZE, STRUCT, Access, Field, Value, sdo
from palpate.instrument.contracts.pdo import Pdo
from palpate.instrument.errors import ConfigError, RangeError, UnknownName

LARGEST_PDO = 8  # bytes
__all__ = ["PROBE", "Access", "Contract", "Field", "Identity", "Pdo", "Value", "probe", "sdo"]


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity that a device reports (Modbus function 43/14, CANopen object 0x1018)."""

    vendor: str
    product: str
    revision: str


@dataclass(frozen=True)
class Contract:
    """All fields of one kind of device.

    Modbus contracts address 16-bit holding registers, big-endian, most significant word first;
    CANopen contracts address objects, little-endian.

    Attributes:
        pdos: process data that a node sends; the first one has its COB-ID and its transmission type in 1800h.
        receives: process data that a node takes; the first one has its COB-ID in 1400h.
        about: for people: whose map it is, and what it imitates.
    """

    name: str
    title: str
    bus: Literal["modbus", "canopen"]
    identity: Identity
    fields: tuple[Field, ...]
    pdos: tuple[Pdo, ...] = ()
    about: str = field(default="", compare=False)
    receives: tuple[Pdo, ...] = ()
    _by_name: dict[str, Field] = field(init=False, repr=False, compare=False)
    _codec: dict[str, struct.Struct] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check that the fields are possible on this bus and do not overlap. Raises ConfigError."""
        for f in self.fields:
            if self.bus == "modbus" and (f.size % 2 or not f.size):
                wide = ", ".join([*(name for name, size in SIZE.items() if size % 2 == 0), "text of an even length"])
                raise ConfigError(
                    f"{self.title}: {f.name} is of type {f.type}, which fills no whole 16-bit registers; valid: {wide}"
                )
        for first, second in itertools.pairwise(sorted(self.fields, key=lambda f: f.address)):
            if first.address + (first.size // 2 if self.bus == "modbus" else 1) > second.address:
                raise ConfigError(f"{self.title}: {first.name} and {second.name} overlap at 0x{second.address:x}")
        if twice := [name for name, count in Counter(f.name for f in self.fields).items() if count > 1]:
            raise ConfigError(f"{self.title}: several fields have the name {', '.join(twice)}; each needs its own")
        self._check_pdos()
        order = ">" if self.bus == "modbus" else "<"
        object.__setattr__(self, "_by_name", {f.name: f for f in self.fields})
        object.__setattr__(
            self,
            "_codec",
            {f.name: struct.Struct(order + STRUCT[f.type]) for f in self.fields if f.type != "text"},
        )

    def _check_pdos(self) -> None:
        """Raises ConfigError: a PDO cannot be sent on a CAN bus, or cannot hold one of its fields."""
        fields = {f.name: f for f in self.fields}
        if self.bus != "canopen" and (self.pdos or self.receives):
            raise ConfigError(f"{self.title}: has PDOs, which are for CANopen only; leave them out")
        for pdo, wrong in (*((each, "wo") for each in self.pdos), *((each, "ro") for each in self.receives)):
            for name in pdo.fields:
                if name not in fields or fields[name].type == "text" or fields[name].access == wrong:
                    raise ConfigError(
                        f"{self.title}: PDO {pdo.name} cannot hold {name}: it must be a number field of the contract "
                        f"that can be {'read' if wrong == 'wo' else 'written'}"
                    )
            if not 0 < (size := sum(fields[name].size for name in pdo.fields)) <= LARGEST_PDO:
                raise ConfigError(f"{self.title}: PDO {pdo.name} has {size} bytes; give 1 to {LARGEST_PDO}")
        names = Counter(pdo.name for pdo in (*self.pdos, *self.receives))
        if twice := [name for name, count in names.items() if count > 1]:
            raise ConfigError(f"{self.title}: several PDOs have the name {twice[0]}; each needs its own")

    def __getitem__(self, name: str) -> Field:
        try:
            return self._by_name[name]
        except KeyError:
            raise UnknownName(f"field of the {self.title}", name, self._by_name) from None

    def has(self, name: str) -> bool:
        """Whether there is a field of that name."""
        return name in self._by_name

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
            raise RangeError(f"{self.title}: {self._beyond(f, value)}")
        return f.to_raw(value)

    def misread(self, name: str, value: float) -> str:
        """What is wrong with a value that a device gave; "" where nothing is.

        Values that are read are held to the same limits and choices as values that are written. A float of a field
        without limits may be NaN, which says that the device has no reading.
        """
        f = self[name]
        bounded = f.choices or f.minimum is not None or f.maximum is not None
        if self.allows(name, value) or (math.isnan(value) and not bounded):
            return ""
        return self._beyond(f, value)

    def _beyond(self, f: Field, value: float) -> str:
        given = f"{f.name} = {value:g} {f.unit}".rstrip()
        if f.choices:
            return f"{given} is no choice; valid: {_listed(f.choices)}"
        low, high = f.limits
        return f"{given} is outside {low:g} to {high:g} {f.unit}".rstrip()

    def described(self, name: str, value: Value) -> str:
        """Text of a setting with its unit and its limits or choices, for messages."""
        f = self[name]
        if f.type == "text":
            return f"{name} = {value!r} (text of up to {f.length} bytes)"
        limits = ", ".join(f.choices) if f.choices else "{:g} to {:g}".format(*f.limits)
        return f"{name} = {value} {f.unit}".rstrip() + f" ({limits})"

    def allows(self, name: str, value: float) -> bool:
        """Whether a physical value, rounded to the field's resolution, is within limits and choices. NaN never is."""
        f = self[name]
        if not math.isfinite(value / f.scale):
            return False
        low, high = (f.to_raw(limit) if math.isfinite(limit) else limit for limit in f.limits)
        return low <= f.to_raw(value) <= high and (not f.choices or value in f.choices.values())

    def pack(self, name: str, value: float) -> bytes:
        """Wire bytes of a reading, without a check of limits. Raises struct.error: the value does not fit the type."""
        return self._codec[name].pack(self._by_name[name].to_raw(value))

    def encode(self, name: str, value: Value) -> bytes:
        """Wire bytes of `value`. Raises RangeError as `raw` does, and for a text as `encode_text` does."""
        if self[name].type == "text":
            return self.encode_text(name, str(value))
        raw = self.raw(name, value)
        return self._codec[name].pack(raw)

    def decode(self, name: str, data: bytes) -> float:
        """Physical value of wire bytes; NaN stays NaN. Raises struct.error: the length is wrong."""
        raw: float = self._codec[name].unpack(data)[0]
        f = self._by_name[name]
        if f.scale >= 1.0:
            return raw * f.scale
        return raw / (1.0 / f.scale)  # multiplying would not be exact: 25000 * 1e-6 < 0.025

    def encode_text(self, name: str, text: str) -> bytes:
        """Wire bytes of a text. Raises RangeError: the text is longer than the field, or cannot be printed."""
        f = self[name]
        if not text.isprintable():
            raise RangeError(f"{self.title}: {name} = {text!r} holds characters that cannot be printed; leave them out")
        data = text.encode()  # this cannot fail, because all printable characters have an encoding
        if len(data) > f.length:
            raise RangeError(
                f"{self.title}: {name} = {text!r} takes {len(data)} bytes of UTF-8, {f.length} are allowed; shorten it"
            )
        return data.ljust(f.length, NUL.encode())

    def decode_text(self, name: str, data: bytes) -> str:
        """Text of wire bytes. Raises ValueError: they are not the bytes of such a text."""
        text = data.decode().rstrip(NUL)
        if not text.isprintable():
            raise ValueError(f"{text!r} holds characters that cannot be printed")
        return text

    def set_bits(self, name: str, value: float) -> frozenset[str]:
        """Names of the bits that are set in a status word. A bit without a name is called by its number, as `bit 9`."""
        names = {number: bit for bit, number in self[name].bits.items()}
        word = int(value)
        return frozenset(names.get(n, f"bit {n}") for n in range(word.bit_length()) if word >> n & 1)

    def choice(self, name: str, value: float) -> str:
        """Name of the choice with raw value `value`; the number itself where no choice has it."""
        return next((k for k, v in self[name].choices.items() if v == value), f"{value:g}")

    def shown(self, name: str, data: bytes) -> str:
        """Name and value of a field, from its wire bytes, as text for people."""
        f = self[name]
        if f.type == "text":
            return f"{name} = {data.decode('utf-8', 'replace').rstrip(NUL)!r}"
        if len(data) != f.size:
            return f"{name} = {data.hex(' ')}"
        value = self.decode(name, data)
        if f.choices:
            return f"{name} = {self.choice(name, value)}"
        if f.bits:
            return f"{name} = {' '.join(sorted(self.set_bits(name, value))) or 'none'}"
        return f"{name} = {value:.10g} {f.unit}".rstrip()

    def block(self, names: Iterable[str]) -> tuple[int, int]:
        """First register and number of registers that hold the named fields (Modbus)."""
        fields = [self[n] for n in names]
        start = min(f.address for f in fields)
        end = max(f.address + f.size // 2 for f in fields)
        return start, end - start

    def layout(self, names: tuple[str, ...]) -> tuple[int, int, list[slice]]:
        """First register, number of registers, and the place of each named field in their bytes (Modbus)."""
        start, count = self.block(names)
        ends = [(2 * (f.address - start), f.size) for f in (self[name] for name in names)]
        return start, count, [slice(at, at + size) for at, size in ends]

    def widened(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """These fields and one number field beside them that can be read with them, if there is one (Modbus)."""
        start, count = self.block(names)
        readable = [f for f in self.fields if f.access != "wo" and f.type != "text"]
        beside = [f.name for f in readable if start + count == f.address or f.address + f.size // 2 == start]
        return (*names, *beside[-1:])

    def sent(self, name: str) -> Pdo:
        """The process data of that name that a node sends. Raises UnknownName."""
        return self._pdo(name, self.pdos, "sends")

    def taken(self, name: str) -> Pdo:
        """The process data of that name that a node takes. Raises UnknownName."""
        return self._pdo(name, self.receives, "takes")

    def _pdo(self, name: str, among: Sequence[Pdo], does: str) -> Pdo:
        for pdo in among:
            if pdo.name == name:
                return pdo
        raise UnknownName(f"PDO that the {self.title} {does}", name, [pdo.name for pdo in among])

    def packed(self, pdo: Pdo, values: Mapping[str, Value]) -> bytes:
        """Data of a PDO. Raises RangeError as `raw` does, and where a field has no value."""
        if values.keys() != set(pdo.fields):
            raise RangeError(
                f"{self.title}: PDO {pdo.name} holds {', '.join(pdo.fields)}, not {', '.join(values) or 'nothing'}; "
                "give each of them a value"
            )
        return b"".join(self.encode(name, values[name]) for name in pdo.fields)

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
        declared = {
            "name": self.name,
            "bus": self.bus,
            "identity": asdict(self.identity),
            "fields": [
                {k: dict(v) if isinstance(v, Mapping) else v for k, v in _slots(f).items()} for f in self.fields
            ],
            "pdos": [asdict(p) for p in self.pdos],
            **({"receives": [asdict(p) for p in self.receives]} if self.receives else {}),
        }
        return hashlib.sha256(json.dumps(declared, sort_keys=True).encode()).hexdigest()


def _slots(f: Field) -> dict[str, object]:
    return {name: getattr(f, name) for name in Field.__slots__}


def _listed(choices: Mapping[str, int]) -> str:
    return ", ".join(f"{name} ({raw})" for name, raw in choices.items())


PROBE = 0x12345678


def probe(address: int) -> Field:
    """The word-order probe that every device carries: reads 0x12345678 in the contract's order."""
    return Field("probe", address, "uint32", "word-order probe, always 0x12345678 = 305419896", default=float(PROBE))
