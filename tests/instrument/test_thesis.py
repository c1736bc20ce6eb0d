"""The thesis' tables: what is printed is kept, and every doubtful cell is marked."""

from __future__ import annotations

import csv
import re
from importlib import resources

import numpy as np
import pytest

from palpate.instrument import thesis
from palpate.instrument.errors import UnknownName
from palpate.instrument.thesis import COMMON_BASE_TABLES, EVERY_ROW, SINGLE_TABLES, TABLES, read_table


def raw(name: str) -> list[dict[str, str]]:
    text = (resources.files(thesis) / name).read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))


REPAIRS = raw("repairs.csv")


def test_every_repair_marks_its_cell_and_no_other_cell_is_marked() -> None:
    for number in TABLES:
        marks_as_repaired(number)


def marks_as_repaired(number: str) -> None:
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
    for number in TABLES:
        keeps_what_is_printed(number)


def keeps_what_is_printed(number: str) -> None:
    """Where the scan is readable the CSV has the printed number; where it is not, the number that it must be."""
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
