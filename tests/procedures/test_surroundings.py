"""Palpate where the surroundings lack something: what it can do without is done without, and the rest is told."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

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


@pytest.fixture(scope="module")
def _namespaces() -> None:
    """Skips the test where this machine gives no user namespaces, within which devices and networks can be hidden."""
    if shutil.which("unshare") is None or said("unshare", "-Urnm", "true")[0] != 0:
        pytest.skip("this machine gives no user namespaces (unshare -Urnm)")


@pytest.mark.slow
def test_a_backend_for_figures_that_is_not_installed_does_not_matter() -> None:
    assert said(PALPATE, *SWEEP, "--out", "run", MPLBACKEND="nonsense") == (0, "")
    assert Path("run", "plot.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
@pytest.mark.parametrize(("wanted", "found"), [("nonsense", "None"), ("svg", "svg")])
def test_in_a_script_it_does_not_matter_either_and_one_that_is_installed_stays(wanted: str, found: str) -> None:
    script = (
        "import os; from palpate.procedures.console.terminal import load_matplotlib; load_matplotlib();"
        "import matplotlib; from matplotlib.figure import Figure; Figure().savefig('figure.png');"
        f"assert str(matplotlib.get_backend(auto_select=False)) == {found!r};"
        f"assert os.environ['MPLBACKEND'] == {wanted!r}"
    )
    assert said(sys.executable, "-c", script, MPLBACKEND=wanted) == (0, "")


@pytest.mark.slow
@pytest.mark.usefixtures("_namespaces")
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


@pytest.mark.slow
@pytest.mark.usefixtures("_namespaces")
def test_a_study_needs_no_shared_memory() -> None:
    Path("study.toml").write_text('name = "small"\n[axes]\nseed = "1-2"\nsample = ["1"]\n', encoding="utf-8")
    read_only = 'mount -t tmpfs none /dev/shm -o ro && exec "$@"'
    status, message = said(
        "unshare", "-Urm", "sh", "-c", read_only, "sh", PALPATE, "study", "study.toml", "--out", "out", "--json"
    )
    assert status == 0
    assert message.startswith("palpate: note: cells are computed one by one") and "/dev/shm" in message
    assert len(Path("out", "points.csv").read_text(encoding="utf-8").splitlines()) > 2


def test_where_processes_cannot_be_had_one_thread_computes_whatever_number_of_workers_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("palpate.procedures.virtual.study_cell.ProcessPoolExecutor", refused)
    with executor_of(4, None) as (executor, count):
        assert count == 1
        assert executor.submit(os.getpid).result() == os.getpid()
    assert "make /dev/shm writable" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_served_bench_that_a_script_started_in_the_background_ends_by_a_signal(number: signal.Signals) -> None:
    """The shell of a script starts such a program with SIGINT ignored."""
    serving = subprocess.Popen(
        [PALPATE, "serve", "thesis_single", "--out", "bench.toml"],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )  # fmt: skip
    with serving:
        assert serving.stdout is not None
        assert b"bench.toml" in serving.stdout.readline()
        serving.send_signal(number)
        assert serving.wait(TIMEOUT) == 0


@pytest.mark.slow
@pytest.mark.parametrize("words", [("--help",), ("scene", "list"), (*SWEEP[:-1], "--json")])
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


@pytest.mark.slow
def test_a_report_is_printed_where_the_locale_has_ascii_alone() -> None:
    ascii_alone = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    assert said(PALPATE, *SWEEP[:-1], "--budget", **ascii_alone) == (0, "")


# --- results in other programs -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Iterator[palpate.Finished[Any]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PALPATE_STORE", str(tmp_path_factory.mktemp("store")))
        with palpate.open_bench(scene="thesis_single", seed=3) as bench:
            yield palpate.run(palpate.LoadSweep(samples=("1",), loads=(2.0, 3.0), dwell=0.2), bench)


def test_the_cells_of_a_table_can_be_grouped_and_their_json_is_as_it_was(done: palpate.Finished[Any]) -> None:
    table = done.run.table()
    for column in table:
        table.groupby(column)
        assert all(isinstance(hash(cell), int) for cell in table[column])
    assert len(table.drop_duplicates()) == 2
    assert [type(point["flags"]) for point in done.run.points()] == [list, list]


def test_a_finished_run_can_be_pickled_with_its_result_its_outcome_and_its_plot(done: palpate.Finished[Any]) -> None:
    again = pickled(done)
    assert json.dumps(again.outcome) == json.dumps(done.outcome)
    assert again.procedure == done.procedure
    assert again.result.summary() == done.result.summary()
    assert (again.folder, again.replayed, again.run) == (done.folder, False, done.run)
    plot = again.plot()
    assert plot is not None
    drawn = plot.read_bytes()
    assert done.plot() == plot
    assert plot.read_bytes() == drawn
    assert pickled(again).folder == done.folder


def test_an_open_bench_that_is_to_be_pickled_is_refused_with_a_remedy() -> None:
    with (
        palpate.open_bench(scene="thesis_single") as bench,
        pytest.raises(palpate.UsageError, match="an open bench cannot be pickled, as for another process; open one"),
    ):
        pickle.dumps(bench)


def _kinds(kind: type[errors.PalpateError]) -> Iterator[type[errors.PalpateError]]:
    yield kind
    for each in kind.__subclasses__():
        yield from _kinds(each)


class Own(errors.DeviceError):
    """One whose constructor takes something else than its message."""

    def __init__(self, *, number: int) -> None:
        super().__init__(f"number {number}", device="mine", code=number)


def test_every_error_survives_pickling_with_its_message_its_notes_and_its_values() -> None:
    unusual: list[errors.PalpateError] = [
        errors.UnknownName("sample", "x", ["y", "z"]), Own(number=4),
        OutOfReach(0.1, Allocation(1, 10, 0.1, 20.0, 0.1, 0.2, {}, "noise"), 0.15, "films"),
    ]  # fmt: skip
    usual = [kind("it failed") for kind in _kinds(errors.PalpateError) if kind not in map(type, unusual)]
    assert len(usual) > 15
    for error in (*usual, *unusual):
        error.add_note("and more")
        again = pickled(error)
        assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))
