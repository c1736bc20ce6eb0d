"""A small share of what must not change, as `python -m tests.frozen` compares the whole of it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.frozen.__main__ import FROZEN, differences, matters, read
from tests.frozen.cells import CELLS
from tests.frozen.measure import WORDS, answers, digest, options

ROOT = Path(__file__).parents[2]


def compared(*texts: str) -> list[str]:
    """What the command says of some cells, in a process of its own: this one has another arithmetic already."""
    command = [sys.executable, "-m", "tests.frozen", *texts]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=240)
    said = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout + done.stderr
    if said[0].startswith("values are not compared"):
        pytest.skip(said[0])
    return said


def test_every_cell_is_frozen_and_nothing_else() -> None:
    assert {name for name in read(FROZEN) if not name.startswith("help")} == {*CELLS, "made with"}


def test_commands_and_their_options_are_those_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    found, frozen = dict(options()), read(FROZEN)
    assert found.keys() == {name for name in frozen if name.startswith("help")}
    assert [(name, *differences(frozen[name], found[name], values=False)) for name in found] == [
        (name,) for name in found
    ]


def test_old_bench_files_are_refused_with_their_new_text() -> None:
    name = "old bench files"
    assert list(differences(read(FROZEN)[name], answers(name, CELLS[name]))) == []


@pytest.mark.slow
def test_every_procedure_measures_what_it_measured_on_the_thesis_bench_and_old_runs_go_on() -> None:
    texts = ("thesis_single", "old run", "old bus log")
    said = compared(*texts)
    cells = sum(any(text in name for text in texts) for name in CELLS)
    assert sum(line.endswith(": same") for line in said) == len(said) - 1 == cells


BEFORE = [{"status": 0, "names": ["a", "b"], "values": {"x": "1", "y": "2"}}]


@pytest.mark.parametrize(
    ("now", "told"),
    [
        (BEFORE, []),
        ([], ["0 answers, not 1"]),
        ([{"status": 2, "said": "no"}], ["answer 1: exit status 2, not 0 no"]),
        ([{**BEFORE[0], "names": ["a"]}], ["answer 1: without the names b"]),
        ([{**BEFORE[0], "names": ["a", "b", "c"]}], ["answer 1: with the new names c"]),
        ([{**BEFORE[0], "names": ["b", "a"]}], ["answer 1: the names come in another order"]),
        ([{**BEFORE[0], "values": {"x": "1", "y": "3"}}], ["answer 1: y has changed"]),
        ([{**BEFORE[0], "values": {"x": "1", "z": "2"}}], ["answer 1: y is gone", "answer 1: z is new"]),
    ],
)
def test_what_differs_is_told_by_its_name(now: list[dict[str, object]], told: list[str]) -> None:
    assert list(differences(BEFORE, now)) == told
    assert matters(told) is (told != [])


def test_a_help_text_in_other_words_is_told_and_is_no_failure() -> None:
    before, now = ([{"status": 0, "values": {WORDS: digest(text)}}] for text in ("as it was", "as it is"))
    told = list(differences(before, now))
    assert told == ["answer 1: text has changed"]
    assert not matters(told)
    assert matters([*told, "answer 1: points has changed"])
