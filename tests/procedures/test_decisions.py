"""docs/decisions: each record has a number of its own, its three parts and a row of the index; what it names exists."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "decisions"
PAGES = sorted(FOLDER.glob("*.md"))
HEADING = re.compile(r"^## (\d{4}) (.+)\n\n(\d{4}-\d\d-\d\d(?: and \d{4}-\d\d-\d\d)?) · (.+)\n", re.MULTILINE)


SHAPE = "`## NNNN Title`, an empty line, `date · state`"


@dataclass(frozen=True)
class Record:
    page: str
    number: str
    title: str
    date: str
    state: str
    text: str

    def row(self) -> str:
        anchor = re.sub(r"[^\w\- ]", "", f"{self.number} {self.title}".lower()).replace(" ", "-")
        return f"| [{self.number}]({self.page}#{anchor}) | {self.title} | {self.date} | {self.state} |"


def records_of(page: Path) -> list[Record]:
    text = page.read_text(encoding="utf-8")
    heads = list(HEADING.finditer(text))
    assert len(heads) == text.count("\n## "), f"{page.name}: a heading is not {SHAPE}"
    ends = [head.start() for head in heads[1:]] + [len(text)]
    return [Record(page.name, *head.groups(), text[head.end() : end]) for head, end in zip(heads, ends, strict=True)]


RECORDS = [record for page in PAGES if page.name != "index.md" for record in records_of(page)]


def test_the_index_lists_every_record_once_by_number() -> None:
    rows = re.findall(r"^\| \[\d{4}\].*$", (FOLDER / "index.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert rows == [record.row() for record in sorted(RECORDS, key=lambda record: record.number)]


def test_no_number_is_given_twice() -> None:
    numbers = [record.number for record in RECORDS]
    assert sorted(set(numbers)) == sorted(numbers)


def test_each_record_has_its_three_parts() -> None:
    for record in RECORDS:
        parts = re.findall(r"^\*\*(\w+)\.\*\* \S", record.text, re.MULTILINE)
        assert parts == ["Context", "Decision", "Consequence"], record.number


def test_records_and_files_that_are_named_exist() -> None:
    numbers = {record.number for record in RECORDS}
    for record in RECORDS:
        assert set(re.findall(r"(?<![\d.,])0\d{3}(?![\d.,]\d|\d)", record.state + record.text)) <= numbers, (
            record.number
        )
        paths = re.findall(r"`([\w.]+/[\w./]+\.\w+)`", record.text)
        assert [path for path in paths if not (ROOT / path).exists()] == [], record.number


def test_both_sides_tell_what_replaces_what() -> None:
    states = {record.number: record.state for record in RECORDS}
    for number, state in states.items():
        for later in re.findall(r"superseded by (\d{4})", state):
            assert number in states[later], f"{later} does not say that it replaces {number}"
        for earlier in re.findall(r"\d{4}", state.partition("replaces")[2]):
            assert f"superseded by {number}" in states[earlier], f"{earlier} does not say that {number} replaces it"
