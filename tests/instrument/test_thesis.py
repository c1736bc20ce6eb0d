"""The thesis' tables: what is printed is kept, every doubtful cell is marked, and every repair is proved."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterator
from importlib import resources

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.instrument import thesis
from palpate.instrument.errors import UnknownName
from palpate.instrument.thesis import (
    COMMON_BASE_TABLES,
    EVERY_ROW,
    SINGLE_TABLES,
    TABLES,
    ThesisTable,
    contents,
    read_table,
)


def raw(name: str) -> list[dict[str, str]]:
    text = (resources.files(thesis) / name).read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))


REPAIRS = raw("repairs.csv")


def test_every_repair_marks_its_cell_and_no_other_cell_is_marked() -> None:
    for number in TABLES:
        table = read_table(number)
        expected = {
            (row, repair["column"])
            for repair in REPAIRS
            if repair["table"] == number
            for row in (table.rows if repair["row"] == EVERY_ROW else [repair["row"]])
        }
        assert {(row, column) for row, column, _ in table.repaired()} == expected


def test_every_repair_belongs_to_a_table() -> None:
    assert {repair["table"] for repair in REPAIRS} <= set(TABLES)
    assert sum(repair["row"] != EVERY_ROW for repair in REPAIRS) + 25 == sum(
        len(read_table(number).repaired()) for number in TABLES
    )


def test_what_is_printed_is_kept_beside_its_repair() -> None:
    """Where the scan is readable the CSV has the printed number; where it is not, the number that it must be."""
    for number in TABLES:
        table = read_table(number)
        printed = {row[table.key]: row for row in raw(f"table_{number.replace('.', '_')}.csv")}
        for column, cells in table.columns.items():
            for row, cell in zip(table.rows, cells, strict=True):
                if not cell.reason:
                    assert (cell.printed, cell.value) == (printed[row][column], float(printed[row][column]))
                elif cell.reason.startswith("scan:"):
                    assert float(printed[row][column]) == cell.value
                else:
                    assert cell.printed == printed[row][column]
                    assert float(cell.printed) != cell.value


def test_an_unknown_table_is_refused_with_those_there_are() -> None:
    with pytest.raises(UnknownName, match=r"table of the thesis 'A2.8'.*valid: 4.1, 4.2"):
        read_table("A2.8")


def test_no_table_lies_here_that_is_not_read() -> None:
    files = {file.name for file in resources.files(thesis).iterdir() if re.fullmatch(r"table_.*\.csv", file.name)}
    assert files == {f"table_{number.replace('.', '_')}.csv" for number in TABLES}


@pytest.mark.parametrize("sample", SINGLE_TABLES)
def test_what_is_said_of_the_single_sensors_readings_is_so(sample: str) -> None:
    table = read_table(SINGLE_TABLES[sample])
    share = table.values("pvdf2_rigid_mV") / table.values("pvdf1_total_mV")
    assert np.ptp(share) < 2e-2 * share.mean() and "a constant times the other's" in table.doubt
    of_forces = table.values("force_rigid_N") / table.values("force_total_N")
    gain = table.values("oscilloscope_mV") / table.keys()
    assert (np.ptp(gain) < 1e-3 * gain.mean()) == ("proportional to the set load" in table.doubt)
    apart = np.abs(of_forces - table.values("force_ratio")).max()
    assert (apart > 2e-3) == ("the printed ratios are others" in table.doubt)
    if apart > 2e-3:
        assert np.abs(of_forces - 0.314).max() < 5e-4


@pytest.mark.parametrize("sample", COMMON_BASE_TABLES)
def test_what_is_said_of_the_common_bases_readings_is_so(sample: str) -> None:
    """The second tooth film: 36 of 36 readings up to 4 N; no constant joins the two films of a table."""
    table, single = read_table(COMMON_BASE_TABLES[sample]), read_table(SINGLE_TABLES[sample])
    factors = table.values("pvdf2_mV")[:6] / (single.values("pvdf2_rigid_mV") / 2)
    assert factors == pytest.approx([0.95, 1.13, 0.99, 1.15, 1.03, 0.95], abs=2e-3)
    assert np.ptp(table.values("pvdf2_mV") / table.values("pvdf1_mV")) > 0.1
    scope = (table.values("oscilloscope_mV") / read_table(COMMON_BASE_TABLES["2"]).values("oscilloscope_mV"))[:6]
    assert np.ptp(scope) < 2e-3
    assert "one a load for the tooth films" in table.doubt and "oscilloscope's are those of sample 2" in table.doubt


# --- The list of the thesis' tables and figures: every number is there once, and says what palpate has beside it

# Chapter or appendix -> its last number. Three figures come as a and b; some numbers are only announced or cited.
FIGURES = {"1": 2, "2": 7, "3": 9, "4": 19, "5": 9, "A1": 2, "A3": 5}
NUMBERED_TABLES = {"2": 1, "3": 2, "4": 6, "5": 8, "A2": 26}
HALVED = ("Figure 4.1", "Figure 4.11", "Figure 5.1")
ABSENT = {"Figure 4.19", "Table A2.8", *(f"Table A2.{number}" for number in range(21, 27))}


def numbers(kind: str, last: dict[str, int]) -> list[str]:
    whole = [f"{kind} {chapter}.{number + 1}" for chapter in last for number in range(last[chapter])]
    return [half for number in whole for half in ((number + "a", number + "b") if number in HALVED else (number,))]


@pytest.mark.parametrize(("kind", "last"), [("Figure", FIGURES), ("Table", NUMBERED_TABLES)])
def test_every_number_of_the_thesis_is_listed_once(kind: str, last: dict[str, int]) -> None:
    listed = [content.number for content in contents().values() if content.number.startswith(kind)]
    assert sorted(listed) == sorted(numbers(kind, last))


def test_each_entry_tells_where_it_stands_what_it_shows_and_what_is_beside_it() -> None:
    for content in contents().values():
        assert content.section and content.shows and content.part, content
        assert max(len(content.shows), len(content.part), len(content.doubt)) <= 120, content


def test_what_is_cited_and_absent_is_listed_as_such() -> None:
    absent = {number for number, content in contents().items() if "absent" in content.doubt}
    assert absent == ABSENT
    assert all(contents()[number].ours == "none" for number in absent)
    assert "caption is lost" in contents()["Figure 4.13"].doubt


def test_what_can_be_read_here_is_compared() -> None:
    compared = {number.removeprefix("Table ") for number, content in contents().items() if content.ours == "compared"}
    assert set(TABLES) == compared


# --- Every repaired cell of the thesis is proved: what is printed breaks a rule that the repaired value keeps

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


def judged_cells(table: ThesisTable) -> Cells:
    """Columns that the rules speak of, repaired."""
    given = ("compliant_modulus_Pa", "force_total_N")
    return {column: table.values(column) for column in table.columns if column not in given}


def test_repaired_a_table_keeps_every_rule() -> None:
    for number in ELEMENTS:
        table = read_table(number)
        assert broken(table, judged_cells(table)) == set()


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
            row, column, values = table.rows.index(repair["row"]), repair["column"], judged_cells(table)
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
