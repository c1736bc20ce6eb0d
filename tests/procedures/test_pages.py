"""What the documentation tells a reader to type works, prints what the page says, and names what there is.

A block's language says what is done with it:

- `console`: lines after `$ ` are commands; below each stands what it prints, `...` for anything.
- a first line such as `# study.toml` or `# test_order.py`: the block is a file of that name for the commands below it.
- `python` without such a line: the blocks of a page run one after another in one namespace.
- none: a picture in characters, or what is run elsewhere.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.procedures.conftest import Palpate

ROOT = Path(__file__).parents[2]
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


# --- pages -------------------------------------------------------------------------------------------

PAGES = pages()
README_LINES = 150
ELSEWHERE = {
    "README.md": ".ci/run",
    "docs/validation.md": "tests/procedures/test_model_command.py",
}  # pages with commands that are run there


def test_every_block_is_run_or_holds_no_command() -> None:
    for page, text in PAGES.items():
        for block in blocks(text):
            where = f"{page}:{block.line}"
            if not block.language and page not in ELSEWHERE:
                assert not re.search(r"^(\$|palpate|pip|python\d?) ", block.text, flags=re.MULTILINE), where
            assert block.language in ("", *RUN) or block.language.startswith("{"), where
            assert block.file or block.language != "toml", where


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if {b.language for b in blocks(PAGES[page])} & set(RUN)])
def test_what_a_page_tells_to_do_works(page: str, palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(Path.cwd())  # the folder of its files
    namespace: dict[str, object] = {"__name__": page}
    for block in blocks(PAGES[page]):
        if block.file:
            Path(block.file).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            exec(compile("\n" * (block.line - 1) + block.text, ROOT / page, "exec"), namespace)
        elif block.language == "console":
            for command, expected in block.commands():
                printed = said(command, palpate)
                assert fits(expected, printed), f"{page}:{block.line}: {command}\n{printed}"


def said(command: str, palpate: Palpate) -> str:
    """What a terminal shows of a command: in this process where it is one of palpate and nothing else."""
    words = shlex.split(command)
    if words[0] == "palpate" and not {"|", "||", "&&"} & set(words):
        spoken = palpate(*words[1:])
        assert spoken.status == 0, f"{command}\n{spoken.err}"
        return spoken.out + spoken.err
    tools = f"export PATH={shlex.quote(str(Path(sys.executable).parent))}:$PATH; {command}"
    done = subprocess.run(
        ["bash", "-c", tools], check=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=60
    )
    return done.stdout


def links() -> Iterator[tuple[str, str]]:
    for page, text in PAGES.items():
        for target in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)):
            if not target.startswith(("http://", "https://")):
                yield page, target


def test_every_link_leads_somewhere_and_those_of_the_readme_to_every_guide_and_explanation() -> None:
    files = [(page, target, target.partition("#")[0]) for page, target in links()]
    assert [each for each in files if not each[2] or not ((ROOT / each[0]).parent / each[2]).exists()] == []
    told = {(ROOT / file).resolve() for page, _, file in files if page == "README.md"}
    assert {ROOT / page for page in PAGES if page.startswith(("docs/how-to/", "docs/explanation/"))} <= told
    assert len(PAGES["README.md"].splitlines()) <= README_LINES


PATH = re.compile(r"`((?:docs|drivers|instrument|procedures|simulators|tests|\.ci)/[\w./-]*)`")


def test_every_path_that_a_page_names_exists() -> None:
    """But for `NAME`, which stands for the reader's own, and the histories, which tell of what was."""
    named = {(page, path) for page, text in PAGES.items() for path in PATH.findall(text)}
    assert [each for each in sorted(named) if "NAME" not in each[1] and not (ROOT / each[1]).exists()] == []
