"""Texts of a modulus with both of its uncertainties, for tables."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from palpate.instrument.findings.object_modulus import AT_LEAST, AT_MOST, INTERVAL
from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.quantity import plus_minus, show
from palpate.procedures.records.columns import Column
from palpate.procedures.showing.tables import NOTHING

NOT_KNOWN = "not known"


def _modulus(row: Any) -> str:
    return NOTHING if row.modulus_Pa is None else show(row.modulus_Pa, "Pa", 4)


def _scale(row: Any) -> str:
    return between(row.kind, row.scale_low_Pa, row.scale_high_Pa)


def _scale_within(row: Any) -> str:
    return _within(row.modulus_Pa, row.scale_low_Pa, row.scale_high_Pa)


def _absolute_within(row: Any) -> str:
    return NOT_KNOWN if _only_scale(row) else _within(row.modulus_Pa, row.absolute_low_Pa, row.absolute_high_Pa)


def _within(modulus: float | None, low: float | None, high: float | None) -> str:
    """Half of a 95 % interval, relative to the modulus, or its factor."""
    if not (modulus and low and high):
        return NOTHING
    return plus_minus((high - low) / (2 * modulus), factor=math.sqrt(high / low))


def _absolute(row: Any) -> str:
    return NOT_KNOWN if _only_scale(row) else between(row.absolute_kind, row.absolute_low_Pa, row.absolute_high_Pa)


def _only_scale(row: Any) -> bool:
    return row.kind is not None and row.absolute_kind is None


COLUMNS = {  # of what `instrument.findings.object_modulus.estimate` finds
    "modulus_Pa": Column(head="modulus", cell=_modulus),
    "scale_u": Column(head="scale", cell=_scale_within),
    "scale_low_Pa": Column(head="95 % on the scale", cell=_scale),
    "absolute_u": Column(head="absolute", cell=_absolute_within),
    "absolute_low_Pa": Column(head="95 % absolute", cell=_absolute),
}


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
    text = f"absolute       validation error {100 * line.u:.2g} % of the ratio"
    return f"{text} ({degrees(line.degrees_of_freedom)}): {line.source}"


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
