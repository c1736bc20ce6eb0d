"""What the documentation tells a reader to type works, prints what the page says, and names what there is."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.pages import ROOT, RUN, blocks, fits, pages
from tests.procedures.conftest import Palpate

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
