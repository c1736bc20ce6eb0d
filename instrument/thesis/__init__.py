"""Tables of the thesis, as printed and as repaired. Models and procedures are compared with them.

    read_table("A2.1").values("force_rigid_N")      # repaired, [N]
    read_table("A2.1").columns["force_rigid_N"][14].printed
    contents()["Figure 4.13"].shows                 # every table and figure of the thesis, by its number

`table_*.csv` hold the printed numbers, and where the scan is not readable, the numbers that must have been printed.
`repairs.csv` holds each doubtful cell: the printed number, its best value and the reason. `contents.csv` lists every
numbered table and figure, with the part of palpate that belongs to it.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Literal, cast, get_args

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import UnknownName

# What palpate has for a table or figure: the table cell by cell, a drawing from data, a part of palpate that is the
# thing which a schematic, photograph or definition shows, or nothing.
Ours = Literal["compared", "drawn", "part", "none"]

MODULUS, LOAD = "sensed_modulus_Pa", "load_nominal_N"
EVERY_ROW = "*"


@dataclass(frozen=True, slots=True)
class TableCell:
    """A number of a table.

    Attributes:
        printed: the text on the page.
        value: the best value: the printed or the repaired one.
        reason: reason of the repair; empty where the printed value holds.
    """

    printed: str
    value: float
    reason: str = ""


@dataclass(frozen=True, slots=True)
class ThesisTable:
    """A table of the thesis.

    Attributes:
        number: number of the table in the thesis.
        title: content of the table, in our words.
        key: name of the column that names the rows.
        rows: that column, as printed.
        columns: cells of each other column by its name, which ends in the unit. Units are SI except for percent.
        doubt: what is doubtful about the table as a whole; empty where nothing is.
    """

    number: str
    title: str
    key: str
    rows: tuple[str, ...]
    columns: Mapping[str, tuple[TableCell, ...]]
    doubt: str = ""

    def keys(self) -> Floats:
        """Key of each row as a number."""
        return np.array([float(row) for row in self.rows])

    def values(self, column: str) -> Floats:
        """Best values of a column, one for each row."""
        return np.array([cell.value for cell in self.columns[column]])

    def repaired(self) -> list[tuple[str, str, TableCell]]:
        """Row, column and cell of each repaired cell."""
        return [
            (row, column, cell)
            for column, cells in self.columns.items()
            for row, cell in zip(self.rows, cells, strict=True)
            if cell.reason
        ]


STRESS = (
    "stress takes 1 mV as 1 gf and a round face of 1 cm across: by the calibration of Table 5.1 the moduli were 9.5"
    " times larger"
)
COPIED = "not independent readings: one film's millivolts are a constant times the other's"
COPIED_PAIR = (
    "not independent readings: up to 4 N nearly all millivolts are those of the single sensor's tables times a factor,"
    " one a sample for the base film, one a load for the tooth films; the oscilloscope's are those of sample 2 times a"
    " factor for each sample"
)
SINGLE = "single sensor, three-dimensional finite elements"
COMMON = "two sensors on a common base, three-dimensional finite elements"
DIFFERENT = "two sensors on different bases, three-dimensional finite elements"
_HEADS_DIFFERENT = "The films are headed PVDF 3 and PVDF 4, and are PVDF 1 and PVDF 3"
_HEADS_COMMON = "The films are headed PVDF 2 and PVDF 3, and are PVDF 1 and PVDF 2"
_AS_SET = "; the oscilloscope's are proportional to the set load, to the last digit"
_RATIOS = ". The forces have the ratio 0.314 in every row, the printed average, and the printed ratios are others"
_COPY = "agrees with Table {} cell for cell once repaired, down to slips: no result of its own"
# By sample.
COMPRESSION_TABLES = {"1": "5.2", "6": "5.3"}
SINGLE_TABLES = {str(sample): f"A2.{8 + sample}" for sample in range(1, 7)}
COMMON_BASE_TABLES = {str(sample): f"A2.{14 + sample}" for sample in range(1, 7)}


def _powers(number: str) -> str:
    return f"powers of ten of the moduli are not readable; they are those of Table {number}"


# Title, key and doubt of each table by its number.
_TABLES: Mapping[str, tuple[str, str, str]] = MappingProxyType(
    {
        "4.1": (f"{SINGLE}, ring 24 kPa", MODULUS, ""),
        "4.2": (f"{SINGLE}, ring 33 kPa", MODULUS, ""),
        "4.3": (f"{DIFFERENT}, ring 24 kPa", MODULUS, f"{_powers('A2.5')}. {_HEADS_DIFFERENT}"),
        "4.4": (f"{DIFFERENT}, ring 33 kPa", MODULUS, _powers("A2.6")),
        "4.5": (f"{COMMON}, ring 24 kPa", MODULUS, f"{_powers('A2.3')}. {_HEADS_COMMON}"),
        "4.6": (f"{COMMON}, ring 33 kPa", MODULUS, f"{_powers('A2.4')}. {_HEADS_COMMON}"),
        "5.1": (
            "load cell under dead weights",
            "load_gf",
            "the sensitivity is headed mV/N and is in mV per gram-force: 102 times less. Its printed average of"
            " 0.105530 is not that of the rows, 0.10657",
        ),
        "5.2": ("compression of sample 1", "micropositioner_mm", STRESS),
        "5.3": (
            "compression of sample 6",
            "micropositioner_mm",
            f"{STRESS}; here it is 96.1 Pa/mV in three rows and 100.7 to 101.5 in the others",
        ),
        "5.4": (
            "catalogue of the rubbers",
            "sample",
            "a pressure at a fixed deflection, which the thesis takes as the modulus",
        ),
        "5.5": (
            "single sensor under 3 N",
            "sample",
            "rows of Tables A2.9 to A2.14. The ratio of sample 1, 0.329, is not that of its forces, 0.314",
        ),
        "5.6": ("two sensors on a common base under 3 N", "sample", "rows of Tables A2.15 to A2.20"),
        "5.7": (
            "two sensors on different bases under 3 N",
            "sample",
            "the load sets behind it, Tables A2.21 to A2.26, are announced and absent. The ratio of sample 2, 0.127, is"
            " not that of its forces, 0.123",
        ),
        "5.8": (
            "percent error of the experiments against the theories",
            "sample",
            "the error is not defined, and the columns do not share one definition",
        ),
        "A2.1": (f"{SINGLE}, ring 24 kPa, 48 moduli", MODULUS, ""),
        "A2.2": (f"{SINGLE}, ring 33 kPa, 48 moduli", MODULUS, ""),
        "A2.3": (f"{COMMON}, ring 24 kPa, 48 moduli", MODULUS, ""),
        "A2.4": (f"{COMMON}, ring 33 kPa, 48 moduli", MODULUS, ""),
        "A2.5": (f"{DIFFERENT}, ring 24 kPa, 48 moduli", MODULUS, _COPY.format("A2.3")),
        "A2.6": (f"{DIFFERENT}, ring 33 kPa, 48 moduli", MODULUS, _COPY.format("A2.4")),
        "A2.7": (
            "common base under a load of 1 N along its length",
            "x_inferred_mm",
            "neither the object's modulus nor the unit of x is printed: the rows mirror about the middle and peak at"
            " the teeth if they stand 1 mm apart. The films are headed PVDF 2 (total), 1 (right) and 3 (left)",
        ),
        **{
            number: (
                f"single sensor on sample {sample}",
                LOAD,
                COPIED + _AS_SET * (sample in "123") + _RATIOS * (sample == "1"),
            )
            for sample, number in SINGLE_TABLES.items()
        },
        **{
            number: (f"two sensors on a common base on sample {sample}", LOAD, COPIED_PAIR)
            for sample, number in COMMON_BASE_TABLES.items()
        },
    }
)
TABLES = tuple(_TABLES)


@cache
def read_table(number: str) -> ThesisTable:
    """The table of that number.

    Raises:
        UnknownName: there is no such table.
    """
    if number not in _TABLES:
        raise UnknownName("table of the thesis", number, TABLES)
    title, key, doubt = _TABLES[number]
    printed = _read(f"table_{number.replace('.', '_')}.csv")
    rows = tuple(row[key] for row in printed)
    repairs = {(r["column"], r["row"]): r for r in _read("repairs.csv") if r["table"] == number}

    def cell(column: str, row: str, text: str) -> TableCell:
        repair = repairs.get((column, row)) or repairs.get((column, EVERY_ROW))
        return (
            TableCell(repair["printed"], float(repair["best"]), repair["reason"])
            if repair
            else TableCell(text, float(text))
        )

    columns = {
        name: tuple(cell(name, row[key], row[name]) for row in printed) for name in printed[0] if name != key
    }  # fmt: skip
    return ThesisTable(number, title, key, rows, MappingProxyType(columns), doubt)


@dataclass(frozen=True, slots=True)
class Content:
    """A numbered table or figure of the thesis.

    Attributes:
        number: such as "Table 4.2" or "Figure 4.13".
        section: section that holds or cites it.
        shows: what it shows, in our words.
        ours: what palpate has for it (see `Ours`).
        part: the model, command, design or module of palpate; where there is none, the reason.
        doubt: what is wrong or lost in the thesis or its scan; empty where nothing is.
    """

    number: str
    section: str
    shows: str
    ours: Ours
    part: str
    doubt: str


@cache
def contents() -> Mapping[str, Content]:
    """Every numbered table and figure by its number, in the order of the thesis; also those only announced."""
    listed = {}
    for row in _read("contents.csv"):
        number, ours = row["number"], row["ours"]
        if ours not in get_args(Ours):
            raise UnknownName(f"kind of {number} in contents.csv", ours, get_args(Ours))
        listed[number] = Content(number, row["section"], row["shows"], cast(Ours, ours), row["part"], row["doubt"])
    return MappingProxyType(listed)


@dataclass(frozen=True, slots=True)
class ProgramLine:
    """A line of the program of Appendix A2.1 that is damaged or wrong.

    Attributes:
        line: number of the line in the listing, without blank lines.
        kind: "scan": characters are damaged; "slip": the program itself is wrong.
        printed: the damaged or wrong part, as the scan has it.
        repaired: the repaired text; for a slip, what model "beam" does instead.
        why: the reason, in one line.
    """

    line: int
    kind: str
    printed: str
    repaired: str
    why: str


@cache
def program_lines() -> tuple[ProgramLine, ...]:
    """Damaged lines, then slips, each in the order of the listing."""
    return tuple(
        ProgramLine(int(row["line"]), row["kind"], row["printed"], row["repaired"], row["why"])
        for row in _read("program_A2_1.csv")
    )


def _read(name: str) -> list[dict[str, str]]:
    text = (resources.files(__name__) / name).read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))
