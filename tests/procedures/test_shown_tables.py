"""What is printed for people: blocks of columns in a narrow terminal, the singular for one, and no negative zero."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from rich.console import Console

from palpate.instrument.quantity import counted
from palpate.procedures.engine.catalogue import SHIPPED
from palpate.procedures.showing import text
from palpate.procedures.showing.text import PIPE_WIDTH, new_table, number, percent, print_all, stamped

SHOWING = Path(text.__file__).parent
COLUMNS = ("id", *(f"quantity_{n}" for n in range(20)))


@pytest.mark.parametrize("width", [20, 40, 80, 400])
def test_a_table_too_wide_for_the_terminal_is_printed_in_blocks_that_repeat_its_first_column(
    width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(text, "console", lambda: Console(width=width, force_terminal=True, color_system=None))
    table = new_table(stamped(False, "T"), *COLUMNS)
    for row in range(2):
        table.add_row(str(row), *(f"{row}.{n}" for n in range(20)))
    print_all(table)
    lines = [line for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert all(len(line.rstrip()) <= width for line in lines)
    heads = [line.split() for line in lines if "quantity_" in line]
    assert len(heads) == {20: 20, 40: 10, 80: 4, 400: 1}[width]
    assert [name for head in heads for name in head if name != "id"] == list(COLUMNS[1:])
    assert {head[0] for head in heads} == {"id"}
    cells = [line.split()[1:] for line in lines if line.split()[0] == "1"]
    assert [cell for some in cells for cell in some] == [f"1.{n}" for n in range(20)]
    assert lines[0].strip() == "T"


def test_a_terminal_gets_no_line_wider_than_itself_but_one_that_a_single_word_makes_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(text, "console", lambda: Console(width=40, force_terminal=True, color_system=None))
    path = "/" + 5 * "a-folder/" + "plot.png"
    words = "the scatter of mountings was never measured and counts as none"
    print_all(f"note           {words}", words, f"  best now  {words}\nplot           {path}")
    assert capsys.readouterr().out.splitlines() == [
        "note           the scatter of mountings",
        "               was never measured and",
        "               counts as none",
        "the scatter of mountings was never",
        "measured and counts as none",
        "  best now  the scatter of mountings was",
        "            never measured and counts as",
        "            none",
        f"plot           {path}",
    ]


def test_where_the_output_is_no_terminal_a_table_has_eighty_columns_at_most(capsys: pytest.CaptureFixture[str]) -> None:
    table = new_table(None, *COLUMNS)
    table.add_row("0", *(f"0.{n}" for n in range(20)))
    print_all(table)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= PIPE_WIDTH == 80
    assert [head.split()[0] for head in lines if "quantity_" in head] == ["id"] * 4


def test_where_the_output_is_no_terminal_a_line_stays_whole(capsys: pytest.CaptureFixture[str]) -> None:
    line = "note           " + 40 * "word "
    print_all(line)
    assert capsys.readouterr().out == f"{line}\n"


def test_one_is_singular() -> None:
    assert [counted(n, "point") for n in range(3)] == ["0 points", "1 point", "2 points"]


def test_no_table_has_a_negative_zero() -> None:
    assert (percent(-1e-6), number(-0.0)) == ("0.00", "0")
    measurements = SHOWING.parent / "measurements"
    shown = [
        file.read_text(encoding="utf-8").partition("# --- what it shows")[2] for file in measurements.rglob("*.py")
    ]
    texts = [*(file.read_text(encoding="utf-8") for file in SHOWING.glob("*.py")), *filter(None, shown)]
    fixed = [found for text in texts for found in re.findall(r":\+?\.\df\}", text)]
    columns = [file.read_text(encoding="utf-8") for file in measurements.rglob("*.py")]
    fixed += [found for text in columns for found in re.findall(r"\"\+?\.\df\"", text)]
    assert sum(map(bool, shown)) == len(SHIPPED)
    assert fixed == []  # a z after the colon or quote, or the sign, makes -0.0 into 0.0
