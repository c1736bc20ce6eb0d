"""Whether the thesis' readings of the pair on a common base are readings of their own.

Tables A2.15 to A2.20 beside A2.9 to A2.14: where a column of one is that of the other times a constant, to the last
printed digit, it tells nothing that the other does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.instrument.thesis import COMMON_BASE_TABLES, SINGLE_TABLES, Cell, read_table

# Constants that are tried: of two digits behind the point, as the pair's are.
SHARES = tuple(round(0.01 * n, 2) for n in range(80, 180))
TEETH = ("pvdf1_mV", "pvdf2_mV")


@dataclass(frozen=True, slots=True)
class Copied:
    """How many cells of a film's column follow from the single sensor's by constants.

    Attributes:
        film: of the pair.
        cells: that both have; `same` of them agree to the last printed digit.
        how: with which constants.
    """

    film: str
    cells: int
    same: int
    how: str


def copied() -> list[Copied]:
    """The pair's base film, and its two tooth films."""
    return [_base(), *(_tooth(film) for film in TEETH)]


def _base() -> Copied:
    """Each sample's base film as some sample's of the single sensor over twice a constant."""
    same, cells, used = 0, 0, []
    for number in COMMON_BASE_TABLES.values():
        pair = read_table(number).columns["pvdf3_total_mV"]
        tried = []
        for sample, single in SINGLE_TABLES.items():
            one = read_table(single).columns["pvdf1_total_mV"]
            tried += [(_agreeing(one, pair, [0.5 / share] * len(one)), sample, share) for share in SHARES]
        best, sample, share = max(tried)
        cells += len(read_table(SINGLE_TABLES[sample]).rows)
        same += best
        used.append(f"{share:.2f} (sample {sample})")
    return Copied("base film", cells, same, f"the single sensor's over twice {', '.join(used)}")


def _tooth(film: str) -> Copied:
    """A tooth film as half the single sensor's times one constant a load, the same for every sample."""
    pairs = [
        (read_table(SINGLE_TABLES[sample]).columns["pvdf2_rigid_mV"], read_table(number).columns[film])
        for sample, number in COMMON_BASE_TABLES.items()
    ]
    loads = len(pairs[0][0])
    factors = [
        round(float(np.median([2 * pair[load].value / one[load].value for one, pair in pairs])), 2)
        for load in range(loads)
    ]
    same = sum(_agreeing(one, pair, [0.5 * factor for factor in factors]) for one, pair in pairs)
    by_load = ", ".join(f"{factor:.2f}" for factor in factors)
    return Copied(
        f"tooth film {film[4]}", loads * len(pairs), same, f"half the single sensor's times {by_load} by load"
    )


def _agreeing(one: Sequence[Cell], pair: Sequence[Cell], factors: Sequence[float]) -> int:
    """Cells of the pair that are the single sensor's times a factor, to one unit of the last printed digit."""
    return sum(
        abs(single.value * factor - other.value) <= _unit(other)
        for single, other, factor in zip(one, pair, factors, strict=False)
    )


def _unit(cell: Cell) -> float:
    """Of the last digit that is printed; of a repaired cell, that its best value has."""
    text = repr(cell.value) if cell.reason else cell.printed
    return 10.0 ** -len(text.partition(".")[2])
