"""Palpate where the surroundings lack something: what it can do without is done without, and the rest is told."""

from __future__ import annotations

import json
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

import pytest

import palpate
from palpate.instrument import errors
from palpate.instrument.allocation.table import Allocation, OutOfReach
from palpate.procedures.virtual.study_cell import executor_of

PALPATE = str(Path(sys.executable).with_name("palpate"))
SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2N", "--quiet")
TIMEOUT = 200  # s


@pytest.fixture(autouse=True)
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Makes the test's folder the current one, with a store of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path / "store"))
    return tmp_path / "store"


def said(*command: str, **environment: str) -> tuple[int, str]:
    """Exit status and stderr of a program, within an environment with these additions."""
    done = subprocess.run(
        command, env=os.environ | environment, capture_output=True, text=True, timeout=TIMEOUT, stdin=subprocess.DEVNULL
    )
    return done.returncode, done.stderr


@pytest.mark.slow
def test_neither_a_backend_for_figures_that_is_not_installed_nor_a_locale_with_ascii_alone_matters() -> None:
    lacking = {"MPLBACKEND": "nonsense", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    assert said(PALPATE, *SWEEP[:-1], "--budget", "--out", "run", **lacking) == (0, "")
    assert Path("run", "plot.png").read_bytes().startswith(b"\x89PNG")


@pytest.fixture(scope="module")
def namespaces() -> None:
    """Skips the test where this machine gives no user namespaces, within which devices and networks can be hidden."""
    if shutil.which("unshare") is None or said("unshare", "-Urnm", "true")[0] != 0:
        pytest.skip("this machine gives no user namespaces (unshare -Urnm)")


@pytest.mark.slow
@pytest.mark.usefixtures("namespaces")
@pytest.mark.parametrize(
    ("hidden", "told"),
    [
        ("mount --bind /dev/null /dev/ptmx", ("no pseudo-terminal", "mount -t devpts")),
        ("true", ("the loopback interface of this machine is down", "ip link set lo up")),
    ],
)
def test_a_machine_without_terminals_or_without_loopback_is_told_with_its_remedy(
    hidden: str, told: tuple[str, str]
) -> None:
    status, message = said("unshare", "-Urnm", "sh", "-c", f'{hidden} && exec "$@"', "sh", PALPATE, *SWEEP)
    assert status == 1
    assert message.startswith("palpate: error: ") and message.count("\n") == 1
    assert all(part in message for part in told)


def test_where_processes_cannot_be_had_one_thread_computes_whatever_number_of_workers_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("palpate.procedures.virtual.study_cell.ProcessPoolExecutor", refused)
    with executor_of(4, None) as (executor, count):
        assert (count, executor.submit(os.getpid).result()) == (1, os.getpid())
    assert "make /dev/shm writable" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("words", [("--help",), (*SWEEP[:-1], "--json")])
def test_output_that_nobody_reads_is_no_failure_of_the_bench(words: tuple[str, ...]) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    done = subprocess.run([PALPATE, *words], stdout=theirs, stderr=subprocess.PIPE, text=True, timeout=TIMEOUT)
    os.close(theirs)
    assert (done.returncode, done.stderr) == (128 + signal.SIGPIPE, "")


T = TypeVar("T")


def pickled(what: T) -> T:
    """What another process gets of it."""
    found: T = pickle.loads(pickle.dumps(what))  # noqa: S301
    return found


# --- results in other programs -------------------------------------------------------------------------


def test_a_finished_run_can_be_grouped_and_pickled_with_its_result_and_plot_and_an_open_bench_cannot() -> None:
    with palpate.open_bench(scene="thesis_single", seed=3) as bench:
        done = palpate.run(palpate.LoadSweep(samples=("1",), loads=(2.0, 3.0), dwell=0.2), bench)
        with pytest.raises(palpate.UsageError, match="an open bench cannot be pickled, as for another process; open"):
            pickle.dumps(bench)
    table = done.run.table()
    assert all(isinstance(hash(cell), int) for column in table for cell in table[column])
    assert [type(point["flags"]) for point in done.run.points()] == [list, list]
    again = pickled(done)
    assert json.dumps(again.outcome) == json.dumps(done.outcome)
    assert (again.procedure, again.result.summary()) == (done.procedure, done.result.summary())
    assert (again.folder, again.replayed, again.run) == (done.folder, False, done.run)
    plot = again.plot()
    assert plot is not None and plot == done.plot() and plot.read_bytes()


def kinds(kind: type[errors.PalpateError]) -> Iterator[type[errors.PalpateError]]:
    yield kind
    for each in kind.__subclasses__():
        yield from kinds(each)


class Own(errors.DeviceError):
    """One whose constructor takes something else than its message."""

    def __init__(self, *, number: int) -> None:
        super().__init__(f"number {number}", device="mine", code=number)


def test_every_error_survives_pickling_with_its_message_its_notes_and_its_values() -> None:
    unusual: list[errors.PalpateError] = [
        errors.UnknownName("sample", "x", ["y", "z"]), Own(number=4),
        OutOfReach(0.1, Allocation(1, 10, 0.1, 20.0, 0.1, 0.2, {}, "noise"), 0.15, "films"),
    ]  # fmt: skip
    usual = [kind("it failed") for kind in kinds(errors.PalpateError) if kind not in map(type, unusual)]
    assert len(usual) > 15
    for error in (*usual, *unusual):
        error.add_note("and more")
        again = pickled(error)
        assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))


# --- its start: of the time before anything happens, imports are most -----------------------------------

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
        pytest.param("scene explain ideal", {"pint", "matplotlib", *ROOTFINDERS, *TABLES}, marks=pytest.mark.slow),
        pytest.param(
            "sweep loads --samples 1 --loads 2N --json",
            {"pint", "rich.progress", *ROOTFINDERS, *TABLES},
            marks=pytest.mark.slow,
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
