"""Test whether the thesis' readings of the pair on a common base are independent of those of the single sensor.

Tables A2.15 to A2.20 are compared with A2.9 to A2.14. A column that is the other's times a constant, to the last
printed digit, holds no evidence of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.instrument.thesis import COMMON_BASE_TABLES, SINGLE_TABLES, Cell, read_table

# Constants that are tried, with two decimals, as those of the pair.
SHARES = tuple(round(0.01 * n, 2) for n in range(80, 180))
TEETH = ("pvdf1_mV", "pvdf2_mV")


@dataclass(frozen=True, slots=True)
class Copied:
    """Number of cells in a film's column that follow from the single sensor's by constants.

    Attributes:
        film: film of the pair.
        cells: number of cells that both tables have.
        same: number of these that agree to the last printed digit.
        how: the constants, in words.
    """

    film: str
    cells: int
    same: int
    how: str


def copied() -> list[Copied]:
    """Results for the pair's base film and its two tooth films."""
    return [_base(), *(_tooth(film) for film in TEETH)]


def _base() -> Copied:
    """Each sample's base film as a sample's base film of the single sensor, divided by twice a constant."""
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
    """A tooth film as half the single sensor's times a constant for each load that is the same for every sample."""
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
    """Number of the pair's cells that are the single sensor's times a factor, to one unit of the last digit."""
    return sum(
        abs(single.value * factor - other.value) <= _unit(other)
        for single, other, factor in zip(one, pair, factors, strict=False)
    )


def _unit(cell: Cell) -> float:
    """Unit of the last printed digit; for a repaired cell, of its best value."""
    text = repr(cell.value) if cell.reason else cell.printed
    return 10.0 ** -len(text.partition(".")[2])
