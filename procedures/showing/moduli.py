"""Texts of a modulus with both of its uncertainties, for tables."""

from __future__ import annotations

from collections.abc import Iterable

from palpate.instrument.findings.modulus_of_ratio import AT_LEAST, AT_MOST, INTERVAL
from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.quantity import show
from palpate.procedures.showing.text import percent

NOT_KNOWN = "not known"
COLUMNS = ("modulus", "scale u %", "95 % on the scale", "absolute u %", "95 % absolute")


def cells(
    modulus: float | None,
    scale_u: float | None,
    scale: tuple[str | None, float | None, float | None],
    absolute_u: float | None,
    absolute: tuple[str | None, float | None, float | None],
) -> list[str]:
    """The cells of COLUMNS: modulus [Pa], relative uncertainties, and intervals as kind and ends [Pa]."""
    unknown = scale[0] is not None and absolute[0] is None
    return [
        "-" if modulus is None else show(modulus, "Pa", 4),
        percent(scale_u),
        between(*scale),
        NOT_KNOWN if unknown else percent(absolute_u),
        NOT_KNOWN if unknown else between(*absolute),
    ]


def between(kind: str | None, low: float | None, high: float | None) -> str:
    """An interval of moduli [Pa] as text."""
    match kind:
        case kind if kind == INTERVAL and low and high:
            return f"{show(low, 'Pa', 3)} to {show(high, 'Pa', 3)}"
        case kind if kind == AT_LEAST and low:
            return f"at least {show(low, 'Pa', 3)}"
        case kind if kind == AT_MOST and high:
            return f"at most {show(high, 'Pa', 3)}"
    return "-" if kind is None else "any"


def absolute_line(line: ValidationLine) -> str:
    """A line that says what the absolute uncertainty rests on."""
    if line.u is None:
        return f"absolute       {line.source}"
    told = f"absolute       validation error {100 * line.u:.2g} % of the ratio"
    return f"{told} ({degrees(line.degrees_of_freedom)}): {line.source}"


def degrees(freedom: float) -> str:
    """Degrees of freedom as text."""
    return f"{freedom:.3g} degree{'' if freedom == 1 else 's'} of freedom"


def bound_line(modulus_known: Iterable[bool]) -> list[str]:
    """What would tell more of objects of which only a bound is known; nothing if all moduli are known."""
    if all(modulus_known):
        return []
    return [
        "only a bound   palpate test modulus tells more of such an object, or a sensor whose ring is nearer to its"
        " stiffness"
    ]
