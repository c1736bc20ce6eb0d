"""The pages of the documentation and their code blocks.

A block's language says what is done with it:

- `console`: lines after `$ ` are commands; below each stands what it prints, `...` for anything.
- a first line such as `# study.toml` or `# test_order.py`: the block is a file of that name for the commands below it.
- `python` without such a line: the blocks of a page run one after another in one namespace.
- none: a picture in characters, or what is run elsewhere.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
RUN = ("console", "python", "toml")
FENCE = re.compile(r"^```(?P<language>[^\n`]*)\n(?P<text>.*?)^```$", flags=re.MULTILINE | re.DOTALL)
ANYTHING = "..."


@dataclass(frozen=True, slots=True)
class Block:
    line: int  # of the page, from 1, at which its text begins
    language: str
    text: str

    @property
    def file(self) -> str:
        """The name of a file in the first line; empty: there is none."""
        found = re.match(r"# (\w+\.(?:toml|py))$", self.text, flags=re.MULTILINE)
        return found[1] if found else ""

    def commands(self) -> Iterator[tuple[str, str]]:
        """The commands of a console block, each with what it is said to print."""
        for part in re.split(r"^\$ ", self.text, flags=re.MULTILINE)[1:]:
            command, _, expected = part.partition("\n")
            yield command, expected


def pages() -> dict[str, str]:
    """The text of the README and of every page, by path."""
    paths = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def blocks(text: str) -> list[Block]:
    return [
        Block(text.count("\n", 0, found.start("text")) + 1, found["language"].strip(), found["text"])
        for found in FENCE.finditer(text)
    ]


def fits(expected: str, printed: str) -> bool:
    """Whether a text is as expected, but for empty lines, spaces at the ends of lines, and what `...` stands for."""
    pattern = ".*".join(re.escape(part) for part in _lines(expected).split(ANYTHING))
    return re.fullmatch(pattern, _lines(printed), flags=re.DOTALL) is not None


def _lines(text: str) -> str:
    return "\n".join(line.rstrip() for line in text.splitlines() if line.strip())
