"""Mutation testing itself: what counts as a mistake, and that one is found where a test asks for it."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.mutation.__main__ import PARTS, Part, changed_lines, naming, parts_of
from tests.mutation.mutants import Mutant, mutants, mutated
from tests.mutation.reach import Reach
from tests.mutation.tried import in_child

SOURCE = '''"""A docstring."""
LIMIT: float = 2.0; __all__ = ["limited"]

def limited(value: float, least: float = 0) -> float:
    """Another."""
    if not least <= value < LIMIT:
        raise ValueError(f"{value} is not below {LIMIT}")
    return round(value - least, ndigits=1)
'''


def ran(number: int) -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(mutated(SOURCE, number, "source.py"), names)
    return names


def test_numbers_comparisons_operators_arguments_and_what_is_done_are_mistaken_one_by_one() -> None:
    found = mutants(SOURCE)
    assert [(each.line, each.what) for each in found] == [
        (2, "2.0 becomes 3.0"),
        (4, "0 becomes 1"),
        (6, "not least <= value < LIMIT: without not"),
        (6, "least <= value < LIMIT: Lt"),
        (6, "least <= value < LIMIT: LtE"),
        (7, "left out: raise ValueError(f'{value} is not below {LIMIT}')"),
        (8, "return round(value - least, ndigits=1) becomes return None"),
        (8, "round(value - least, ndigits=1): without ndigits"),
        (8, "value - least: Add"),
        (8, "1 becomes 2"),
    ]
    assert [each.line for each in found if each.runs_at_import] == [2, 4]


def test_a_mistake_is_in_the_code_and_no_other() -> None:
    by_what = {each.what: each.number for each in mutants(SOURCE)}
    assert ran(by_what["2.0 becomes 3.0"])["limited"](2.5) == 2.5
    assert ran(by_what["value - least: Add"])["limited"](1.0, 0.5) == 1.5
    assert ran(by_what["return round(value - least, ndigits=1) becomes return None"])["limited"](1.0) is None
    with pytest.raises(ValueError, match=r"0\.5 is not below 2\.0"):
        ran(by_what["not least <= value < LIMIT: without not"])["limited"](0.5)


def test_tests_that_reach_a_line_are_run_fastest_first_and_all_for_what_runs_before_any_test() -> None:
    seconds = {"a": 0.3, "b": 0.1, "tests/test_source.py::c": 0.2, "d": 0.05}
    on_a_busy_machine = dict.fromkeys(seconds, 9.0)
    reached = Reach(on_a_busy_machine, seconds, {"source.py": {6: ["a", "b", "tests/test_source.py::c"]}})
    inside = Mutant(0, 6, 0, False, "")
    assert reached.tests(Path("source.py"), inside) == ["tests/test_source.py::c", "b", "a"]
    at_import = Mutant(0, 2, 0, True, "")
    assert reached.tests(Path("source.py"), at_import) == ["tests/test_source.py::c", "b", "a", "d"]
    called_at_import = Reach(on_a_busy_machine, seconds, {"source.py": {6: ["", "a"]}})
    assert called_at_import.tests(Path("source.py"), inside) == ["tests/test_source.py::c", "a", "d", "b"]
    assert reached.tests(Path("source.py"), Mutant(0, 99, 0, False, "")) == []


def test_what_does_not_end_is_ended() -> None:
    assert in_child(lambda: 3, 10.0) == 3
    assert in_child(lambda: os.read(os.pipe()[0], 1)[0], 0.05) is None


def test_lines_changed_since_a_commit_are_those_of_the_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for variable in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(variable, raising=False)
    Path("drivers").mkdir()
    Path("drivers/one.py").write_text("a = 1\nb = 2\nc = 3\n")
    Path("notes.py").write_text("a = 1\n")
    identity = ["-c", "user.name=nobody", "-c", "user.email=nobody@example.org"]
    for command in (["init", "-q"], ["add", "."], [*identity, "commit", "-qm", "first"]):
        subprocess.run(["git", *command], check=True)
    Path("drivers/one.py").write_text("a = 1\nb = 5\nc = 3\nd = 4\n")
    Path("notes.py").write_text("a = 2\n")
    assert changed_lines("HEAD") == {Path("drivers/one.py"): {2, 4}}
    with pytest.raises(SystemExit, match="git does not know"):
        changed_lines("nowhere")


def test_a_file_that_belongs_to_no_part_has_the_tests_that_name_its_module_or_those_asked_for() -> None:
    assert "tests/instrument/test_noise.py" in naming(Path("instrument/signals/noise.py"))
    (together,) = parts_of(["one.py", "policy"], "tests/test_*.py")
    assert together == Part(("one.py", *PARTS["policy"].files), ("tests/test_*.py",))
