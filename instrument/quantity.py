"""Quantities: text with a unit in files and on the command line, SI floats inside.

`parse("24 kPa", "Pa")` is 24000.0. A text without a unit is refused where a unit belongs, because the number might be
in another unit than the reader thinks.
"""

from __future__ import annotations

import functools
import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Self

from palpate.instrument.errors import QuantityError, RangeError, quoted

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler
    from pydantic_core import CoreSchema

# pint gets only the unit: in a whole text it would also evaluate powers, such as 9**9**9.
_QUANTITY = re.compile(
    r"\s*(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*"
    r"(?P<unit>(?:[A-Za-zµμΩ°%]+(?: [A-Za-zµμΩ]+)?(?:/√?[A-Za-zµμΩ°%]+)?)?)\s*",
    re.ASCII,
)
LONGEST_UNIT = 100  # characters; pint's time grows with their square
LARGEST_TOLERANCE = 0.5  # a share
LARGEST_SHARE = 0.2  # half-width above which an interval is told as a factor
SHARE = "give a share such as '5 %' or 0.05"
_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_UNPREFIXED = ("", "%", "1", "mV", "dB")  # before these no prefix can stand, such as before 1/K and mV/N
MOST_DECIMALS, LONGEST_NUMBER = 8, 1e9  # of a number without a prefix; beyond these it is told by a power of ten
_FACTORS = {prefix: float(f"1e{exponent}") for exponent, prefix in _PREFIXES.items()}


@functools.cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(cache_folder=None)


@functools.lru_cache(maxsize=1024)
def parse(text: str, unit: str, example: str = "") -> float:
    """Value of `text` in `unit`.

    Args:
        text: a number and its unit, such as "1.5 N", "24 kPa" or "140 gf".
        unit: the unit of the result, such as "N"; "" for a plain number.
        example: a text that would be right here, for messages; empty: any of that unit.

    Raises:
        QuantityError: the text has no number or no unit, the unit has another dimension, or the value is not finite.
    """
    remedy = f"write for example {(example or _example(unit))!r}" if example or unit else "give a plain number"
    found = _QUANTITY.fullmatch(text)
    if found is None or len(found["unit"]) > LONGEST_UNIT:
        raise QuantityError(f"{quoted(text)} is not a quantity; {remedy}")
    value, written = float(found["number"]), found["unit"]
    factor = _factor(written, unit)
    converted = value * factor if factor is not None else _converted(text, value, written, unit, remedy)
    if not math.isfinite(converted):
        raise QuantityError(f"{quoted(text)} is not finite; {remedy}")
    return converted


def unit_of(text: str) -> str:
    """Unit in which a quantity is written; "" for a plain number and for a percentage.

    Raises QuantityError: the text is no number with a unit or without one, or there is no such unit.
    """
    found = _QUANTITY.fullmatch(text)
    if found is None or len(found["unit"]) > LONGEST_UNIT:
        raise QuantityError(f"{quoted(text)} is not a quantity; write for example '24 kPa', '5 %' or '0.3'")
    written = found["unit"]
    if written in ("", "%"):
        return ""
    import pint

    try:
        _registry().Unit(_spelled(written))
    except (pint.PintError, ValueError):
        raise QuantityError(f"{quoted(text)}: {quoted(written)} is no unit; write for example '24 kPa'") from None
    return written


class Typed(float):
    """A quantity, with the text that somebody typed for it, so that messages quote it as it was typed."""

    text: str

    def __new__(cls, value: float, text: str) -> Self:
        made = super().__new__(cls, value)
        made.text = text
        return made

    def __getnewargs__(self) -> tuple[float, str]:  # type: ignore[override]
        return float(self), self.text


def as_typed(value: float, unit: str) -> str:
    """A quantity as it was typed, unless that is long; or else with a prefix of its unit."""
    return value.text if isinstance(value, Typed) and len(value.text) <= LONGEST_UNIT else show(value, unit)


def parse_list(text: str, unit: str, example: str = "") -> tuple[float, ...]:
    """Values in `unit` of a text with commas, such as "1 N, 2 N". Raises QuantityError as `parse`."""
    return tuple(parse(part, unit, example) for part in text.split(","))


def parse_tolerance(text: str) -> float:
    """Share that the text of a tolerance means: 0.05 for "5 %" and for "0.05".

    Raises:
        QuantityError: the text is no number and no percentage.
        RangeError: as in `check_tolerance`; "5" would be 500 %.
    """
    try:
        tolerance = parse(text, "")
    except QuantityError as error:
        raise QuantityError(f"{quoted(text)} is no share; {SHARE}") from error
    return check_tolerance(tolerance, quoted(text))


def check_tolerance(tolerance: float, what: str) -> float:
    """Return a tolerance that is above 0 and at most 0.5; `what` names it in messages. Raises RangeError."""
    if not tolerance > 0:
        raise RangeError(f"{what} is not above 0; {SHARE}")
    if not tolerance <= LARGEST_TOLERANCE:
        raise RangeError(
            f"{what} is {100 * tolerance:.4g} %, above the {100 * LARGEST_TOLERANCE:g} % that are allowed; {SHARE}"
        )
    return tolerance


def _factor(written: str, unit: str) -> float | None:
    """Factor from a unit with an SI prefix to the unit; None: only pint knows, whose import takes half a second."""
    if written == unit:
        return 1.0
    if not written.endswith(unit) or unit in ("", "kg"):
        return None
    return _FACTORS.get(written.removesuffix(unit))


def _converted(text: str, value: float, written: str, unit: str, remedy: str) -> float:
    import pint

    try:
        quantity = _registry().Quantity(value, _spelled(written))
    except (pint.PintError, ValueError):  # pint reads "nan" and others as numbers
        raise QuantityError(f"{quoted(text)}: {quoted(written)} is no unit; {remedy}") from None
    if unit and quantity.unitless:
        raise QuantityError(f"{quoted(text)} has no unit where {unit} belongs; {remedy}")
    try:
        return float(quantity.to(_spelled(unit) or "dimensionless").magnitude)
    except pint.PintError:  # the unit has another dimension, or is a temperature with its own zero
        raise QuantityError(
            f"{quoted(text)} is in {quantity.units:~} where {unit or 'a plain number'} belongs; {remedy}"
        ) from None


def _spelled(unit: str) -> str:
    """Spelling of a unit that pint reads."""
    return unit.replace("√Hz", "Hz**0.5")


def _example(unit: str) -> str:
    return {"N": "3 N", "Pa": "24 kPa", "Hz": "10 Hz", "s": "1 s", "m": "3 mm", "V/√Hz": "20 µV/√Hz"}.get(
        unit, f"1 {unit}".strip()
    )


def show(value: float, unit: str, digits: int = 4) -> str:
    """Text of an SI value with a prefix: `show(24000.0, "Pa")` is "24 kPa"."""
    exponent = _exponent(value, unit)
    if exponent is None:
        return f"{value:.{digits}g} {unit}".rstrip()
    rounded = float(f"{value / 10.0**exponent:.{digits}g}")
    return f"{rounded:.{max(digits, 4)}g} {_PREFIXES[exponent]}{unit}"  # 140, not 1.4e+02


def show_with_u(value: float, u: float, unit: str) -> tuple[str, str]:
    """Texts of an SI value and of its uncertainty with one prefix, both to the second digit of the uncertainty.

    `show_with_u(1.7768e-3, 1.4e-4, "V/N")` is ("1.78 mV/N", "0.14 mV/N").
    """
    exponent = _exponent(max(abs(value), abs(u)), unit)
    if u == 0 or not math.isfinite(u):
        return show(value, unit), show(u, unit, 2)
    scale, prefix = (1.0, "") if exponent is None else (10.0**exponent, _PREFIXES[exponent])
    _, digit = f"{u / scale:.1e}".split("e")
    decimals = max(1 - int(digit), 0)
    if exponent is None and not (decimals <= MOST_DECIMALS and abs(value) < LONGEST_NUMBER):
        return show(value, unit), show(u, unit, 2)
    texts = [f"{each / scale:z.{decimals}f} {prefix}{unit}".rstrip() for each in (value, u)]
    return texts[0], texts[1]


def plus_minus(half: float, digits: int = 2, factor: float | None = None) -> str:
    """Text of the half-width of a 95 % interval, or of an error bound: "± 3.2 %", and "× 1.5" above ± 20 %.

    Args:
        half: half-width of the value's logarithm.
        digits: significant digits.
        factor: the factor to tell above 20 %, where the interval is not symmetric; None: e to the half-width.
    """
    if half <= LARGEST_SHARE * (1 + 1e-9):
        return f"± {100 * half:.{digits}g} %"
    shown = math.exp(min(half, 100.0)) if factor is None else factor
    return f"× {shown:.{digits if shown < 99.5 else 3}g}"


def rounded_up(share: float) -> float:
    """A share above 0, rounded up to two digits in percent."""
    step = 10.0 ** (math.floor(math.log10(share)) - 1)
    return step * math.ceil(share / step * (1 - 1e-9))


def as_asked(tolerance: float, digits: int = 2) -> str:
    """Text of a tolerance as it is typed, above ± 20 % with what `plus_minus` makes of it: "± 50 % (× 1.6)"."""
    typed, shown = f"± {100 * tolerance:.{digits}g} %", plus_minus(tolerance)
    return f"{typed} ({shown})" if shown.startswith("×") else typed


def _exponent(value: float, unit: str) -> int | None:
    """Power of ten of the prefix with which a value is shown; None: it is shown without one."""
    if value == 0 or not math.isfinite(value) or unit in ("", "%", "mV"):
        return None
    if unit.partition("/")[0] in _UNPREFIXED:
        return 0
    exponent = min(max(3 * math.floor(math.log10(abs(value)) / 3), -12), 9)
    if unit in ("N", "V", "Hz", "s") and exponent >= 0:
        exponent = min(exponent, 3 if unit == "Hz" else 0)
    return exponent


def counted(number: int, what: str) -> str:
    """A number of things, as "1 point" or "2 points"; `what` is their name in the singular."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


@dataclass(frozen=True, slots=True)
class Unit:
    """Marks a field of a configuration file: text with a unit in the file, an SI float inside."""

    unit: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        from pydantic_core import core_schema

        return core_schema.no_info_before_validator_function(
            self._read,
            handler(source),
            serialization=core_schema.plain_serializer_function_ser_schema(lambda value: f"{value!r} {self.unit}"),
        )

    def _read(self, value: object) -> float:
        if isinstance(value, str):
            return parse(value, self.unit)
        raise ValueError(f"{value!r} needs a unit; write it as text, for example {_example(self.unit)!r}")


Newtons = Annotated[float, Unit("N")]
Metres = Annotated[float, Unit("m")]
Seconds = Annotated[float, Unit("s")]
Volts = Annotated[float, Unit("V")]
Amperes = Annotated[float, Unit("A")]
Ohms = Annotated[float, Unit("ohm")]
NewtonsPerAmpere = Annotated[float, Unit("N/A")]
VoltsPerNewton = Annotated[float, Unit("V/N")]
NewtonsPerMetre = Annotated[float, Unit("N/m")]
VoltsPerRootHertz = Annotated[float, Unit("V/√Hz")]
Hertz = Annotated[float, Unit("Hz")]
Henries = Annotated[float, Unit("H")]
Farads = Annotated[float, Unit("F")]
Coulombs = Annotated[float, Unit("C")]
CoulombsPerNewton = Annotated[float, Unit("C/N")]
Kilograms = Annotated[float, Unit("kg")]
NewtonSecondsPerMetre = Annotated[float, Unit("N s/m")]
NewtonsPerKelvin = Annotated[float, Unit("N/K")]
KelvinPerSecond = Annotated[float, Unit("K/s")]
Degrees = Annotated[float, Unit("deg")]
BitsPerSecond = Annotated[float, Unit("bit/s")]
