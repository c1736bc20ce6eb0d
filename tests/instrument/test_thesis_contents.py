"""The list of the thesis' tables and figures: every number is there once, and says what palpate has beside it."""

from __future__ import annotations

import pytest

from palpate.instrument import thesis
from palpate.instrument.errors import UnknownName
from palpate.instrument.thesis import TABLES, contents

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


def test_an_unknown_kind_is_refused_with_those_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    row = {"number": "Figure 9.9", "section": "9", "shows": "x", "ours": "guessed", "part": "y", "doubt": ""}
    monkeypatch.setattr(thesis, "_read", lambda name: [row])
    with pytest.raises(UnknownName, match=r"kind of Figure 9\.9 in contents\.csv 'guessed'.*valid: compared, drawn"):
        contents.__wrapped__()
