"""Every repaired cell of the thesis is proved: what is printed breaks a rule that the repaired value keeps.

Tables of finite elements obey rules among their own cells: every number presses (is negative); a film's voltage is one
constant times its force; stress is force over the tooth's face; the ratio is the sum of the forces; the odds, tooth
force over the rest of the load, run straight in the modulus from one row to the one after next. Their extracts in
chapter 4 and the twins on different bases repeat them. Experiments have each their own proof.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.instrument.thesis import EVERY_ROW, ThesisTable, read_table
from tests.instrument.test_thesis import REPAIRS

Array = NDArray[np.float64]
Cells = dict[str, Array]

SINGLE, PAIR = 0.99893e-3, 1.03512e-3  # V/N
ROUNDED = 0.6  # of the last digit of a voltage: half of one, and what the force's own last digit adds
FACE = math.pi * 1.4e-3**2  # of the tooth [m2]
STRAIGHT = 2.5e-4  # of the ratio; slips are 3.2e-4 and more
WHOLE = {"4.1": "A2.1", "4.2": "A2.2", "4.3": "A2.5", "4.4": "A2.6", "4.5": "A2.3", "4.6": "A2.4"}
TWINS = {"A2.3": "A2.5", "A2.4": "A2.6", "A2.5": "A2.3", "A2.6": "A2.4"}
ELEMENTS = ("A2.1", "A2.2", "A2.3", "A2.4", "A2.5", "A2.6", *WHOLE)


def broken(table: ThesisTable, values: Cells) -> set[tuple[str, int]]:
    """Cells that break a rule, as column and row."""
    return {(column, int(row)) for column, found in _judged(table, values) for row in np.flatnonzero(found)}


def _judged(table: ThesisTable, values: Cells) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    yield from ((column, found >= 0) for column, found in values.items())
    single = "force_rigid_N" in values
    forces = ["force_rigid_N"] if single else [name for name in values if name.startswith("force_pvdf")]
    films = ["voltage_pvdf2_V"] if single else [name for name in values if name.startswith("voltage")]
    for force, film in zip(forces, films, strict=True):
        digit = np.where(abs(values[film]) < 1e-4, 1e-7, 1e-6)  # three are printed
        off = abs(values[film] - (SINGLE if single else PAIR) * values[force]) > ROUNDED * digit
        yield from ((force, off), (film, off))
    if "stress_rigid_Pa" in values:
        off = abs(values["stress_rigid_Pa"] * FACE - values["force_rigid_N"]) > 1e-4
        yield from (("stress_rigid_Pa", off), ("force_rigid_N", off))
    if not single:
        off = abs(values["force_ratio"] - values[forces[0]] - values[forces[1]]) > 1.1e-4
        yield from ((name, off) for name in (*forces, "force_ratio"))
        for force, side in zip(forces, ("force_ratio_left", "force_ratio_right"), strict=True):
            if side in values:
                yield side, abs(values[side] - 2 * values[force]) > 1.1e-4
    if table.number.startswith("A"):
        name = forces[0] if single else "force_ratio"
        yield name, _bent(table.keys(), -values[name])


def _bent(moduli: Array, ratio: Array) -> NDArray[np.bool_]:
    """Where the odds do not lie on the straight line through the rows on either side, or, of the last row but one,
    through the two below. The last, 140 GPa, is beside them without end: nothing is said of it, or of the first."""
    odds = ratio / (1 - ratio)
    below, above = np.arange(-1, len(odds) - 1), np.arange(1, len(odds) + 1)
    below[-2], above[-2] = len(odds) - 4, len(odds) - 3
    inner = slice(1, -1)
    below, above = below[inner], above[inner]
    share = (moduli[inner] - moduli[below]) / (moduli[above] - moduli[below])
    straight = odds[below] + share * (odds[above] - odds[below])
    off = abs(straight / (1 + straight) - ratio[inner]) > STRAIGHT
    return np.concatenate([[False], off, [False]])


def numbers(table: ThesisTable) -> Cells:
    """Columns that the rules speak of, repaired."""
    given = ("compliant_modulus_Pa", "force_total_N")
    return {column: table.values(column) for column in table.columns if column not in given}


def test_repaired_a_table_keeps_every_rule() -> None:
    for number in ELEMENTS:
        table = read_table(number)
        assert broken(table, numbers(table)) == set()


def test_twins_and_extracts_repeat_a_table_once_both_are_repaired() -> None:
    for number in [*TWINS, *WHOLE]:
        table, other = read_table(number), read_table(TWINS.get(number) or WHOLE[number])
        rows = [other.rows.index(row) for row in table.rows]
        theirs = dict(zip(_in_order(other), (other.values(name) for name in _in_order(other)), strict=True))
        for column, name in zip(_in_order(table), _in_order(other), strict=True):
            assert table.values(column) == pytest.approx(theirs[name][rows], rel=1e-12), column


def _in_order(table: ThesisTable) -> list[str]:
    """Columns that twins and extracts share: films are named by other numbers, but stand in the same order."""
    return [name for name in table.columns if name.startswith(("voltage", "force_pvdf", "force_rigid"))] + [
        name for name in ("force_ratio",) if name in table.columns
    ]


@pytest.mark.parametrize(
    ("rings", "column", "line", "within"),
    [
        ({"A2.1": 24e3, "A2.2": 33e3}, "force_rigid_N", (0.10779, 0.092392), 1e-4),
        ({"A2.3": 24e3, "A2.4": 33e3}, "force_ratio", (0.06319, 0.049337), 2e-4),
    ],
)
def test_odds_are_one_straight_line_in_the_ratio_of_moduli_so_that_one_ring_proves_the_other(
    rings: dict[str, float], column: str, line: tuple[float, float], within: float
) -> None:
    for number, ring in rings.items():
        table = read_table(number)
        odds = line[0] + line[1] * table.keys() / ring
        assert (odds / (1 + odds))[:-1] == pytest.approx(-table.values(column)[:-1], abs=within)


def test_what_is_printed_is_no_number_breaks_a_rule_or_is_printed_right_in_its_twin() -> None:
    for number in ELEMENTS:
        table = read_table(number)
        twin = read_table(TWINS.get(number) or WHOLE[number]) if number in TWINS or number in WHOLE else None
        for repair in (repair for repair in REPAIRS if repair["table"] == number):
            row, column, values = table.rows.index(repair["row"]), repair["column"], numbers(table)
            try:
                values[column][row] = float(repair["printed"])
            except ValueError:
                continue
            if (column, row) in broken(table, values):
                continue
            assert twin is not None, repair
            there = twin.columns[_in_order(twin)[_in_order(table).index(column)]][twin.rows.index(repair["row"])]
            assert not there.reason and there.value == float(repair["best"]), repair


def at(number: str, row: str, column: str) -> float:
    table = read_table(number)
    return table.columns[column][table.rows.index(row)].value


def sum_of(number: str, column: str, but: str) -> float:
    """All rows but one and the average."""
    table = read_table(number)
    return math.fsum(
        cell.value for row, cell in zip(table.rows, table.columns[column], strict=True) if row not in (but, "average")
    )


def scaled(number: str, row: str, column: str, of: str, by: str) -> float:
    """What the other rows' common factor makes of a number beside it: `of` in the same table, or in table `by`."""
    table = read_table(number)
    pairs = [(at(number, r, column), at(by, r, of)) for r in table.rows if r != row]
    return float(np.median([one / other for one, other in pairs])) * at(by, row, of)


ERRORS = "different_base_vs_3D_error_percent"
SCOPE = "oscilloscope_mV"
# For cells of experiments: the repaired cell found in another way, and how closely that gives it.
PROOFS: dict[tuple[str, str, str], tuple[Callable[[], float], float]] = {
    ("5.2", "18.60", "stress_Pa"): (lambda: 124.9 * 263, 1e-5),
    ("5.2", "18.00", "strain"): (lambda: 1.475 / 3, 1e-4),
    ("5.3", "19.6", "reading_mV"): (lambda: -at("5.3", "19.6", "stress_Pa") / 100.7257, 1e-4),
    ("5.6", "1", SCOPE): (lambda: at("A2.15", "3", SCOPE), 0),
    ("5.6", "1", "pvdf1_mV"): (lambda: at("A2.15", "3", "pvdf1_mV"), 0),
    ("5.6", "3", "force2_N"): (lambda: at("A2.17", "3", "force2_N"), 0),
    ("5.6", "5", "force2_N"): (lambda: at("A2.19", "3", "force2_N"), 0),
    ("5.7", "4", "force1_N"): (lambda: (2 * 0.246 - 0.421 / 1.684) * 1.701, 5e-3),
    ("5.8", "5", ERRORS): (lambda: 6 * at("5.8", "average", ERRORS) - sum_of("5.8", ERRORS, "5"), 1e-2),
    ("A2.7", EVERY_ROW, "voltage_pvdf2_V"): (lambda: 0.213e-4, 1e-9),
    ("A2.11", "2.5", "force_total_N"): (lambda: 0.468 / 0.197, 2e-3),
    ("A2.13", "2", "force_total_N"): (lambda: 0.365 / 0.175, 2e-3),
    ("A2.15", "1.5", "pvdf1_mV"): (lambda: at("A2.9", "1.5", "pvdf2_rigid_mV") / 2, 1e-9),
    ("A2.16", "4.5", "pvdf3_total_mV"): (
        lambda: scaled("A2.16", "4.5", "pvdf3_total_mV", "force_total_N", "A2.16"), 1e-3
    ),
    ("A2.18", "4.5", SCOPE): (lambda: scaled("A2.18", "4.5", SCOPE, SCOPE, "A2.17"), 3e-4),
    **{
        (number, row, SCOPE): (lambda n=number, r=row: abs(scaled(n, r, SCOPE, SCOPE, "A2.16")), 1e-3)  # type: ignore[misc]
        for number in ("A2.19", "A2.20") for row in read_table(number).rows
    },
}  # fmt: skip


def test_repaired_experiments_follow_from_other_cells() -> None:
    for repair in (repair for repair in REPAIRS if repair["table"] not in ELEMENTS):
        proof, share = PROOFS[repair["table"], repair["row"], repair["column"]]
        assert float(repair["best"]) == pytest.approx(proof(), rel=share), repair


def test_every_reason_names_its_proof() -> None:
    for repair in REPAIRS:
        kind, _, proof = repair["reason"].partition(":")
        assert kind in ("scan", "thesis slip", "scan or thesis slip"), repair
        assert re.search(r"\d", proof), repair
