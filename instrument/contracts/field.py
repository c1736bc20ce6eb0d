"""One register or object of a device: its type, scale, limits, choices and bits."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from palpate.instrument.errors import ConfigError

Type = Literal["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "text"]
Access = Literal["ro", "rw", "wo"]
Value = float | str

TYPES, ACCESSES = get_args(Type), get_args(Access)

STRUCT: dict[str, str] = {
    "uint8": "B", "int8": "b", "uint16": "H", "int16": "h", "uint32": "I", "int32": "i", "float32": "f",
}  # fmt: skip
SIZE = {name: struct.calcsize(code) for name, code in STRUCT.items()}
NUL = "\0"  # the character that fills a text up to the length of its field


def sdo(index: int, subindex: int = 0) -> int:
    """The address of a CANopen object, `index << 8 | subindex`."""
    return index << 8 | subindex


@dataclass(frozen=True, slots=True)
class Field:
    """One register (or run of registers) or one CANopen object.

    `physical value = scale * raw value`, in `unit`; `minimum` and `maximum` are physical.
    `choices` names the raw values of a setting, `bits` the bit numbers of a status word. A text on Modbus takes
    `length` bytes, two a register: UTF-8, filled up with NUL (as SunSpec has it); on CANopen it is as long as it is.
    """

    name: str
    address: int
    type: Type
    meaning: str
    unit: str = ""
    scale: float = 1.0
    access: Access = "ro"
    minimum: float | None = None
    maximum: float | None = None
    default: Value = 0.0
    choices: Mapping[str, int] = field(default_factory=dict)
    bits: Mapping[str, int] = field(default_factory=dict)
    length: int = 0

    def __post_init__(self) -> None:
        """Check that the declaration makes sense. Raises ConfigError."""
        if self.type not in TYPES:
            raise ConfigError(f"field {self.name}: no type {self.type!r}; valid: {', '.join(TYPES)}")
        if self.access not in ACCESSES:
            raise ConfigError(f"field {self.name}: no access {self.access!r}; valid: {', '.join(ACCESSES)}")
        if not (math.isfinite(self.scale) and self.scale > 0):
            raise ConfigError(f"field {self.name}: scale {self.scale:g} is not finite and above 0")
        if self.type == "text":
            return
        limits = [limit for limit in (self.minimum, self.maximum) if limit is not None]
        wrong = [
            value for value in (*limits, *(self.scale * raw for raw in self.choices.values())) if not self._holds(value)
        ]
        if wrong or limits != sorted(limits):
            raise ConfigError(f"field {self.name}: {wrong or limits} cannot be limits or choices of a {self.type}")
        if any(not 0 <= number < 8 * self.size for number in self.bits.values()) or (self.bits and self.type[0] != "u"):
            raise ConfigError(f"field {self.name}: a {self.type} has no bits {dict(self.bits)}")

    def _holds(self, value: float) -> bool:
        """Whether the type can hold a physical value."""
        try:
            struct.pack(STRUCT[self.type], self.to_raw(value))
        except (struct.error, OverflowError, ValueError):
            return False
        return math.isfinite(value)

    @property
    def size(self) -> int:
        """Number of bytes on the wire."""
        return self.length if self.type == "text" else SIZE[self.type]

    @property
    def index(self) -> int:
        return self.address >> 8

    @property
    def subindex(self) -> int:
        return self.address & 0xFF

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest physical value; infinite where there is no limit."""
        return (-math.inf if self.minimum is None else self.minimum, math.inf if self.maximum is None else self.maximum)

    def to_raw(self, value: float) -> float:
        """Raw value of a physical value, not checked; a whole number except for floats."""
        return value if self.type == "float32" else round(value / self.scale)
