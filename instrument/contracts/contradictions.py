"""Checks that the attributes of one field do not contradict each other."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol

from palpate.instrument.errors import ConfigError

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


class Attributes(Protocol):
    """What is looked at of a `palpate.instrument.contracts.field.Field`."""

    @property
    def name(self) -> str: ...
    @property
    def type(self) -> str: ...
    @property
    def meaning(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def scale(self) -> float: ...
    @property
    def default(self) -> float | str: ...
    @property
    def choices(self) -> Mapping[str, int]: ...
    @property
    def bits(self) -> Mapping[str, int]: ...
    @property
    def missing(self) -> tuple[float, ...]: ...
    @property
    def part(self) -> tuple[int, int] | None: ...
    @property
    def length(self) -> int: ...
    @property
    def scaling(self) -> object | None: ...
    @property
    def limits(self) -> tuple[float, float]: ...
    def holds(self, value: float) -> bool: ...
    def bits_of(self, raw: float) -> frozenset[int]: ...


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


def check_attributes(f: Attributes) -> None:
    """Check what `Field` can say that no device can mean. Raises ConfigError: field, attribute and what is allowed."""
    check_name("field", f.name)
    for problem in _problems(f):
        raise ConfigError(f"field {f.name}: {problem}")


def _given(f: Attributes, names: tuple[str, ...]) -> list[str]:
    """Those of some attributes that the declaration gives."""
    return [name for name in names if getattr(f, name) != USUAL[name]]


def _problems(f: Attributes) -> Iterator[str]:
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
