"""A command imports what it needs and no more: of its time before anything happens, imports are most."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

slow = pytest.mark.slow
ROOTFINDERS = {"scipy.optimize", "scipy.interpolate"}  # which import most of scipy
TABLES = {"pandas", "pyarrow"}
BUSES = {"can", "canopen", "pymodbus", "serial"}


@pytest.mark.parametrize(
    ("command", "needless"),
    [
        ("--help", {"numpy", "pydantic", "rich", "pint"}),
        ("model ratio --sensed-modulus 15kPa", {"scipy", "pydantic", "pint", "matplotlib", *TABLES, *BUSES}),
        (
            "model ratio --design array --model surface --sensed-modulus 15kPa --json",
            {"scipy", "skfem", "pydantic", "pint", "matplotlib", "rich", *TABLES, *BUSES},
        ),
        (
            "model modulus --design single_round --model surface --force-ratio 0.3 --json",
            {"scipy", "skfem", "pydantic", "pint", "matplotlib", "rich", *TABLES, *BUSES},
        ),
        pytest.param("scene explain ideal", {"pint", "matplotlib", *ROOTFINDERS, *TABLES}, marks=slow),
        pytest.param(
            "sweep loads --samples 1 --loads 2N --json", {"pint", "rich.progress", *ROOTFINDERS, *TABLES}, marks=slow
        ),
    ],
)
def test_a_command_imports_nothing_that_it_can_do_without(command: str, needless: set[str], tmp_path: Path) -> None:
    code = "from palpate.procedures.commands import main; main()"
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", code, *command.split()],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines() if line.startswith("import time:")}
    assert "palpate.procedures.commands" in imported
    assert not imported & needless


@pytest.mark.parametrize("module", ["click", "palpate.procedures.commands.root"])
def test_ctrl_c_while_the_program_still_starts_is_no_traceback(module: str) -> None:
    code = f"""
import sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            raise KeyboardInterrupt

sys.meta_path.insert(0, Finder())
from palpate.procedures.commands import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code, "--help"], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "palpate: interrupted\n")


def test_a_first_sweep_installs_no_test_tools() -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    listed = (project["dependencies"], project["optional-dependencies"]["test"])
    needed, tools = ({re.split(r"[\[><=]", each)[0] for each in some} for some in listed)
    assert {"pytest", "mpmath"} <= tools - needed
    assert not needed & tools
