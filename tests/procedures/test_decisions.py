"""docs/decisions: each record is short and has a number of its own; what it names, and who names it, exists."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "decisions"
PAGES = sorted(page for page in FOLDER.glob("*.md") if page.name != "index.md")
RECORD = re.compile(r"^## (\d{4}) (.+)\n\n((?:.|\n)*?)(?=^## |\Z)", re.MULTILINE)
LONGEST = 150  # words


def records() -> list[tuple[str, str, str, str]]:
    """Page, number, title and text of each."""
    return [(page.name, *found) for page in PAGES for found in RECORD.findall(page.read_text(encoding="utf-8"))]


def test_every_heading_is_a_record_with_a_number_of_its_own() -> None:
    numbers = [number for _, number, _, _ in records()]
    assert len(numbers) == sum(page.read_text(encoding="utf-8").count("\n## ") for page in PAGES)
    assert sorted(set(numbers)) == sorted(numbers)


def test_the_index_leads_to_every_page() -> None:
    linked = re.findall(r"\]\((\w+\.md)\)", (FOLDER / "index.md").read_text(encoding="utf-8"))
    assert sorted(linked) == [page.name for page in PAGES]


def test_a_record_is_short() -> None:
    assert {number: n for _, number, _, text in records() if (n := len(text.split())) > LONGEST} == {}


def test_what_a_record_names_exists() -> None:
    numbers = {number for _, number, _, _ in records()}
    for _, number, _, text in records():
        assert set(re.findall(r"(?<![\d.,])0\d{3}(?![\d.,]\d|\d)", text)) <= numbers, number
        paths = re.findall(r"`([\w.]+/[\w./]+\.\w+)`", text)
        assert [path for path in paths if not (ROOT / path).exists()] == [], number


def test_a_record_that_another_page_links_to_is_in_force() -> None:
    anchors = {
        f"{page}#" + re.sub(r"[^\w\- ]", "", f"{number} {title}".lower()).replace(" ", "-")
        for page, number, title, _ in records()
    }
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        linked = re.findall(r"decisions/(\w+\.md#[^)]+)\)", page.read_text(encoding="utf-8"))
        assert set(linked) <= anchors, page
