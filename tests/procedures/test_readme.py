"""What the README says of the code is what stands there."""

from __future__ import annotations

from pathlib import Path

from procedures.policy import POLICIES

README = Path(__file__).parents[2] / "README.md"


def table(heading: str) -> list[tuple[str, ...]]:
    """The first table under a heading, without its head."""
    _, _, section = README.read_text(encoding="utf-8").partition(f"\n## {heading}\n")
    lines = [line for line in section.partition("\n## ")[0].splitlines() if line.startswith("|")]
    return [tuple(cell.strip() for cell in line.strip("|").split("|")) for line in lines[2:]]


def test_its_table_of_incidents_is_that_of_the_policies() -> None:
    assert table("When something fails") == [(p.incident, p.does, str(p.attempts)) for p in POLICIES]
