"""One register, coil or object of a device: its type, place, scale, limits, choices and bits."""

from __future__ import annotations

import math
import re
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal, Protocol, get_args

from palpate.instrument.errors import ConfigError

# --- types of numbers on the wire, and how their bytes are made ------------------------------------------

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


# --- a field ---------------------------------------------------------------------------------------------

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


# --- checks that the attributes of one field do not contradict each other --------------------------------

NAME = re.compile("[a-z][a-z0-9_]{0,63}")
LEAST_SCALE, GREATEST_SCALE = 1e-30, 1e30
LONGEST_TEXT = 65_535  # bytes
# what attributes are if they are not given
USUAL: dict[str, object] = {
    "minimum": None, "maximum": None, "choices": {}, "bits": {}, "missing": (), "part": None, "scaling": None,
    "sign": None, "unit_in": "", "scale": 1.0, "offset": 0.0,
}  # fmt: skip
# attributes that mean nothing for a text are all of these; for the raw values of a setting or a status word:
OF_SCALED = ("scale", "offset", "scaling", "sign")


def check_once(title: str, what: str, names: Sequence[str]) -> None:
    """Raises ConfigError: several things of a contract have one name."""
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise ConfigError(f"{title}: several {what} have the name {', '.join(twice)}; each needs its own")


def check_name(what: str, name: str) -> None:
    """Raises ConfigError: a name cannot stand in a frame, a bench file or a record."""
    if not NAME.fullmatch(name):
        raise ConfigError(
            f"{what} {name!r}: give a name of up to 64 lower-case letters a to z, digits and _, with a letter first"
        )


def check_attributes(f: Field) -> None:
    """Check what `Field` can say that no device can mean. Raises ConfigError: field, attribute and what is allowed."""
    check_name("field", f.name)
    for problem in _problems(f):
        raise ConfigError(f"field {f.name}: {problem}")


def _given(f: Field, names: tuple[str, ...]) -> list[str]:
    """Those of some attributes that the declaration gives."""
    return [name for name in names if getattr(f, name) != USUAL[name]]


def _problems(f: Field) -> Iterator[str]:
    for what, text in (("meaning", f.meaning), ("unit", f.unit)):
        if not text.isprintable():
            yield f"{what} = {text!r} holds characters that cannot be printed; leave them out"
    if f.type == "text":
        if given := _given(f, tuple(USUAL)):
            yield f"{', '.join(given)}: a text has none of these; leave them out"
        if not 0 <= f.length <= LONGEST_TEXT:
            yield f"length = {f.length} bytes; give 0 to {LONGEST_TEXT}"
        return
    if f.length:
        yield f"length = {f.length}, which is for texts; a {f.type} has its own length, leave it out"
    if not LEAST_SCALE <= abs(f.scale) <= GREATEST_SCALE:
        yield f"scale = {f.scale:g} is outside {LEAST_SCALE:g} to {GREATEST_SCALE:g} of either sign"
    if isinstance(f.default, str) or not math.isfinite(f.default):
        yield f"default = {f.default!r}; give a number for a {f.type}"
    elif f.default and f.scaling is None and not f.holds(f.default):  # 0 may just be left out
        yield f"default = {f.default:g} {f.unit}".rstrip() + f" does not fit a {f.type} with the scale {f.scale:g}"
    for what, named in (("choices", f.choices), ("bits", f.bits)):
        yield from _ambiguous(what, named)
        if named and (given := _given(f, OF_SCALED)):
            yield f"has {what}, which name raw values, and {', '.join(given)}; leave one of them out"
    if f.bits and f.choices:
        yield "has bits and choices; give those of a status word or those of a setting"
    if f.bits and f.missing:
        yield "has bits and missing; a status word has no value that says that there is none"
    if f.part and (beyond := [bit for bit, number in f.bits.items() if number >= f.part[1]]):
        yield f"bit {beyond[0]!r} is number {f.bits[beyond[0]]}; its part has {f.part[1]} bits, counted from 0"
    if both := [name for name, raw in f.choices.items() if any(f.bits_of(raw) & f.bits_of(none) for none in f.missing)]:
        yield f"choice {both[0]!r} is {f.choices[both[0]]}, which says that there is no reading; leave one of them out"
    low, high = f.limits
    if outside := [name for name, raw in f.choices.items() if not low <= raw <= high]:
        yield f"choice {outside[0]!r} is {f.choices[outside[0]]}, outside {low:g} to {high:g}"


def _ambiguous(what: str, named: Mapping[str, int]) -> Iterator[str]:
    if "" in named:
        yield f"{what} has an empty name; name each"
    if twice := [raw for raw, count in Counter(named.values()).items() if count > 1]:
        same = [name for name, raw in named.items() if raw == twice[0]]
        yield f"{what} {' and '.join(same)} are both {twice[0]}; give each its own"
