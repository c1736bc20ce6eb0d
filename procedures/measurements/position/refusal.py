"""A tolerance of a place that no load set reaches: where, why, the best there is, and which positions reach it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import counted
from palpate.procedures.measurements.position.expected import TABLE

FEWEST = 2  # positions of a sweep
AMBIGUOUS = 0.3e-3  # m; one place alone is known better


def below_floor(tolerance: float, floors: Mapping[float, float], reached: Iterable[float]) -> RangeError:
    """The refusal of a tolerance [m] below the floor of some positions.

    Args:
        tolerance: the tolerance [m].
        floors: what no load set lowers [m], by the position [m].
        reached: positions that can have the tolerance [m].
    """
    each = ", ".join(f"{mm(floor)} at {mm(x)}" for x, floor in floors.items())
    best = max(floors.values())
    lines = [
        f"--tolerance {mm(tolerance)} cannot be reached at {counted(len(floors), 'position')}: the error of the "
        f"{TABLE} leaves {each}, which no load set lowers",
        f"best now  {mm(best)} at all positions" + (", with --tolerance left out" if best > AMBIGUOUS else ""),
    ]
    if len(good := list(map(mm, reached))) >= FEWEST:
        lines.append(f"or        --positions '{', '.join(good)}', which reach it")
    if best > AMBIGUOUS:
        lines.append("note      two places on both sides of a tooth's middle give nearly the same shares")
    return RangeError("\n  ".join(lines))


def mm(length: float) -> str:
    """A length [m] in millimetres, for people."""
    return f"{1e3 * length:.3g} mm"
