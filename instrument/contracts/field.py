"""One register, coil or object of a device: its type, place, scale, limits, choices and bits."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from palpate.instrument.contracts.contradictions import check_attributes
from palpate.instrument.contracts.wire_types import FLOATS, SIZE, Type, bits_of, codec, signed
from palpate.instrument.errors import ConfigError

Access = Literal["ro", "rw", "wo"]
Value = float | str
Table = Literal["holding", "input", "coil", "discrete"]
Order = Literal["big", "little"]

TYPES, ACCESSES, TABLES, ORDERS = get_args(Type), get_args(Access), get_args(Table), get_args(Order)

READS: dict[Table, int] = {"coil": 1, "discrete": 2, "holding": 3, "input": 4}  # function codes of Modbus
WRITES: dict[Table, tuple[int, ...]] = {"coil": (5, 15), "discrete": (), "holding": (16, 6), "input": ()}
ONE_REGISTER = 6  # function code that writes one register
BITS = ("coil", "discrete")  # tables of single bits
WORD = 16  # bits of a register
DECIMALS = range(-20, 21)  # numbers of decimals that a device may tell


def sdo(index: int, subindex: int = 0) -> int:
    """The address of a CANopen object, `index << 8 | subindex`."""
    return index << 8 | subindex


@dataclass(frozen=True, slots=True)
class Scaling:
    """A scale that the device itself tells by another field, such as its number of decimals.

    Attributes:
        told_by: name of the other field, which nobody may write.
        by: `decimals`: the scale is divided by ten to the power of its value; `factor`: it is multiplied by its value;
            `table`: it is multiplied by what `table` gives for its value.
        table: factor by value of the other field.
    """

    told_by: str
    by: Literal["decimals", "factor", "table"] = "decimals"
    table: Mapping[int, float] = field(default_factory=dict)

    def factor(self, value: float) -> float:
        """What the scale is multiplied by, for a value of the other field.

        Raises KeyError: the table lacks it; ValueError: no scale can be so.
        """
        if self.by == "table":
            factor = self.table.get(int(value)) if math.isfinite(value) and value == int(value) else None
            if factor is None:
                raise KeyError(value)
            return factor
        if self.by == "factor":
            if not 0 < value < math.inf:
                raise ValueError(f"{self.told_by} = {value:g} is no scale; it must be finite and above 0")
            return value
        return 1.0 / self.divisor(value)

    def divisor(self, decimals: float) -> float:
        """Ten to the power of a number of decimals. Raises ValueError: no device has so many."""
        if decimals not in DECIMALS:
            raise ValueError(
                f"{self.told_by} = {decimals:g} is no number of decimals; valid: {DECIMALS[0]} to {DECIMALS[-1]}"
            )
        return math.pow(10.0, decimals)


@dataclass(frozen=True, slots=True)
class Field:
    """One register (or run of registers), one coil, or one CANopen object.

    `physical value = scale * raw value + offset`, in `unit`; `minimum` and `maximum` are physical. A device that counts
    the other way has a negative scale. `choices` names the raw values of a setting, `bits` the bit numbers of a status
    word. A text on Modbus takes `length` bytes, two a register: UTF-8, filled up with NUL (as SunSpec has it); on
    CANopen it is as long as it is. One that is only read may be filled up otherwise, and be in Latin-1.

    Attributes:
        table: table of a Modbus device that holds it.
        function: function code that writes it; 0: the usual one of its table (16 or 5).
        words: whether the most significant register comes first (`big`) or last; Modbus only.
        octets: whether the most significant byte of a register comes first (`big`) or last; Modbus only.
        part: first bit and number of bits, if it shares its register with other fields; Modbus only.
        scaling: the field that tells its scale, if that is not fixed.
        sign: field and bit that tell whether it is negative, if its own register holds the magnitude.
        unit_in: field whose choice must be `unit`, if the device can show other units, too.
        missing: raw values which say that there is no reading. A whole number may also be the bits, as 0x80000000 of an
            int32; of a float it is both, so that 0x7F7FFFFF and 3.4028235e38 mean the same.
        endures: number of writes that its memory endures; 0: any number.
        source: document and page that tell of it.
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
    offset: float = 0.0
    table: Table = "holding"
    function: int = 0
    words: Order = "big"
    octets: Order = "big"
    part: tuple[int, int] | None = None
    scaling: Scaling | None = None
    sign: tuple[str, str] | None = None
    unit_in: str = ""
    missing: tuple[float, ...] = ()
    endures: int = 0
    source: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        """Check that the declaration makes sense. Raises ConfigError."""
        for what, given, valid in (
            ("type", self.type, TYPES), ("access", self.access, ACCESSES), ("table", self.table, TABLES),
            ("order of words", self.words, ORDERS), ("order of octets", self.octets, ORDERS),
        ):  # fmt: skip
            if given not in valid:
                raise ConfigError(f"field {self.name}: no {what} {given!r}; valid: {', '.join(valid)}")
        if not math.isfinite(self.scale) or not self.scale:
            raise ConfigError(
                f"field {self.name}: scale = {self.scale:g}; give a finite number other than 0, a negative one if the "
                "device counts the other way"
            )
        if not math.isfinite(self.offset):
            raise ConfigError(f"field {self.name}: offset = {self.offset:g}; give a finite number")
        if self.endures < 0:
            raise ConfigError(f"field {self.name}: endures = {self.endures} writes; give 0 (any number) or more")
        self._check_table()
        if self.type != "text":
            self._check_numbers()
        check_attributes(self)

    def _check_numbers(self) -> None:
        """Raises ConfigError: the type cannot have such limits, choices, bits or sign."""
        self._check_part()
        if self.type not in FLOATS:
            choices = {name: signed(self.type, raw) for name, raw in self.choices.items()}
            if choices != self.choices:
                object.__setattr__(self, "choices", choices)
        if unmet := [raw for raw in self.missing if not self.bits_of(raw)]:
            raise ConfigError(
                f"field {self.name}: missing = {unmet[0]!r} can never be met: a {self.type} has no such value and no "
                "such bits; give one that it has"
            )
        limits = [limit for limit in (self.minimum, self.maximum) if limit is not None]
        wrong = [value for value in limits if not (math.isfinite(value) if self.scaling else self.holds(value))]
        wrong += [raw for raw in self.choices.values() if not self._fits(raw)]
        if wrong or limits != sorted(limits):
            raise ConfigError(f"field {self.name}: {wrong or limits} cannot be limits or choices of a {self.type}")
        if any(not 0 <= number < 8 * self.size for number in self.bits.values()) or (self.bits and self.type[0] != "u"):
            raise ConfigError(f"field {self.name}: a {self.type} has no bits {dict(self.bits)}")
        if self.sign and self.type[0] != "u":
            raise ConfigError(
                f"field {self.name}: its sign is in {self.sign[0]}, but a {self.type} has a sign of its own; give it "
                "an unsigned type"
            )
        if self.sign and self.scale < 0:
            raise ConfigError(
                f"field {self.name}: scale = {self.scale:g}, but its sign is in {self.sign[0]}; give a scale above 0"
            )

    def _check_table(self) -> None:
        """Raises ConfigError: its table cannot hold it, or cannot be written with its function."""
        valid = WRITES[self.table]
        if self.access != "ro" and not valid:
            raise ConfigError(f"field {self.name}: access {self.access!r}, but the table {self.table!r} is read-only")
        if self.function and (self.access == "ro" or self.function not in valid):
            raise ConfigError(
                f"field {self.name}: is written with function {self.function}; valid for its access and table: "
                f"{'none' if self.access == 'ro' else ', '.join(map(str, valid))}"
            )
        if self.function == ONE_REGISTER and self.size != 2:
            raise ConfigError(f"field {self.name}: function 6 writes one register, {self.name} has {self.size} bytes")
        if self.table in BITS and self.type != "bool":
            raise ConfigError(f"field {self.name}: table {self.table!r} cannot hold a {self.type}; it holds bool")

    def _check_part(self) -> None:
        """Raises ConfigError: it cannot be a part of a register."""
        if self.part is None:
            return
        first, count = self.part
        if self.type != "uint16" or first < 0 or count < 1 or first + count > WORD:
            raise ConfigError(
                f"field {self.name}: part = {list(self.part)} (first bit, number of bits) must lie within the {WORD} "
                "bits of a uint16"
            )

    def holds(self, value: float) -> bool:
        """Whether the type can hold a physical value."""
        return math.isfinite(value) and self._fits(self.to_raw(value))

    def bits_of(self, raw: float) -> frozenset[int]:
        """The bits of its type, or of its part of a register, that a raw value can mean; empty: there are none."""
        found = bits_of(self.type, raw)
        return found if self.part is None else frozenset(bits for bits in found if bits < 1 << self.part[1])

    def _fits(self, raw: float) -> bool:
        """Whether the type, or its part of a register, can hold a raw value."""
        if self.part is not None:
            return 0 <= raw < 1 << self.part[1]
        try:
            codec(self.type, ">").pack(raw)
        except (struct.error, OverflowError):
            return False
        return True

    @property
    def size(self) -> int:
        """Number of bytes on the wire."""
        return self.length if self.type == "text" else SIZE[self.type]

    @property
    def width(self) -> int:
        """Number of Modbus addresses that it takes."""
        return 1 if self.table in BITS else self.size // 2

    @property
    def writes(self) -> int:
        """Function code of Modbus that writes it."""
        return self.function or WRITES[self.table][0]

    @property
    def index(self) -> int:
        return self.address >> 8

    @property
    def subindex(self) -> int:
        return self.address & 0xFF

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest physical value; infinite where there is no limit. A part holds no more than its bits."""
        low, high = -math.inf, math.inf
        if self.type == "bool" or self.part is not None:
            most = (1 << self.part[1]) - 1 if self.part else 1
            low, high = sorted((self.offset, self.scale * most + self.offset))
        return (low if self.minimum is None else self.minimum, high if self.maximum is None else self.maximum)

    @property
    def beside(self) -> tuple[str, ...]:
        """Names of the fields that tell its scale and its sign, without which its bytes mean nothing."""
        scale = (self.scaling.told_by,) if self.scaling else ()
        return (*scale, *((self.sign[0],) if self.sign else ()))

    def to_raw(self, value: float) -> float:
        """Raw value of a physical value, not checked; a whole number except for floats, and for what is too large."""
        raw = (value - self.offset) / self.scale
        return raw if self.type.startswith("float") or not math.isfinite(raw) else round(raw)

    def beyond(self, value: float) -> str:
        """Text that says that a value is outside the limits or no choice."""
        given = f"{self.name} = {value:g} {self.unit}".rstrip()
        if self.choices:
            listed = ", ".join(f"{name} ({raw})" for name, raw in self.choices.items())
            return f"{given} is no choice; valid: {listed}"
        low, high = self.limits
        if not math.isfinite(value) and (low, high) == (-math.inf, math.inf):
            return f"{given}, which is no finite number"
        return f"{given} is outside {low:g} to {high:g} {self.unit}".rstrip()

    def described(self, value: Value) -> str:
        """Text of a setting with its unit and its limits or choices, for messages."""
        if self.type == "text":
            return f"{self.name} = {value!r} (text of up to {self.length} bytes)"
        limits = ", ".join(self.choices) if self.choices else "{:g} to {:g}".format(*self.limits)
        return f"{self.name} = {value} {self.unit}".rstrip() + f" ({limits})"


PROBE = 0x12345678


def probe(address: int) -> Field:
    """The word-order probe that every device carries: reads 0x12345678 in the contract's order."""
    return Field("probe", address, "uint32", "word-order probe, always 0x12345678 = 305419896", default=float(PROBE))
