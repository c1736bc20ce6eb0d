"""Each run on an open simulated bench can be resumed, and ends as if it had not been interrupted."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, repeat
from pathlib import Path
from unittest.mock import Mock

import pytest

import palpate
from palpate.drivers.bench import Bench
from palpate.procedures.console.terminal import Progress
from palpate.procedures.steps.pause import NOBODY
from palpate.testing import steps
from tests.examples.relaxation import Relaxation
from tests.procedures.conftest import interrupt_at
from tests.runs import rehash

pytestmark = pytest.mark.usefixtures("own_store")

CELL = palpate.LoadCellSeries(loads=(1.4, 3.3, 7.2), runs=1, creep=False)
FILMS = palpate.FilmSeries(loads=(2.0, 3.0, 4.0), dwell=0.2)
SWEEP = palpate.LoadSweep(samples=("2",), loads=(2.0, 3.0), dwell=0.2)
CHAIN = (CELL, FILMS, SWEEP)


def copying(run: Path, into: Path, at: list[int]) -> Progress:
    """A progress that copies a run whenever something is reported: what is on disk then is what a kill would leave."""

    def copy(done: int, _total: int, _what: str) -> None:
        if done not in at:
            at.append(done)
            shutil.copytree(run, into / f"{run.name}-{done}")

    return copy


@pytest.mark.slow
def test_each_run_of_a_chain_that_was_killed_at_any_point_ends_as_it_would_have(tmp_path: Path) -> None:
    killed = tmp_path / "killed"
    whole, at = [], {}
    with palpate.open_bench(scene="ideal") as bench:
        for number, procedure in enumerate(CHAIN):
            out, cuts = tmp_path / f"run{number}", at.setdefault(number, [])
            found = palpate.run(procedure, bench, out=out, listeners=[steps(copying(out, killed, cuts))])
            whole.append((found.run.digest(), found.run.summary))
            cuts.pop()  # complete
    assert (at[1], at[2]) == ([0, 1, 2], [0, 1])
    for number in (2, 1):  # what was stored when the last was interrupted is still stored
        for points in at[number]:
            again = palpate.resume(killed / f"run{number}-{points}")
            assert (again.run.digest(), again.run.summary) == whole[number], (number, points)
            assert again.outcome["achieved_seconds"] == whole[number][1]["achieved_seconds"]


FAULTY = """
name = "faulty"
purpose = "A chain in which runs get wrong replies, and sensors drift."
design = "single"
[effects.humidity_leak]
[effects.white_noise]
[[fault]]
kind = "wrong_count"
on = "shaker_amplifier"
probability = 0.04
"""


@pytest.mark.slow
def test_what_happened_before_a_run_happens_again(tmp_path: Path) -> None:
    """Pauses, incidents, and the time that a script lets pass between two runs."""
    scene, killed = tmp_path / "scene.toml", tmp_path / "killed"
    scene.write_text(FAULTY)
    whole = {}
    once = Mock(asked=Mock(side_effect=chain([True], repeat(False))))  # it asks for a pause before a point
    with palpate.open_bench(scene=scene) as bench:
        for number, pause in enumerate((NOBODY, once, NOBODY)):
            bench.bench.clock.wait(60.0 * number)
            out = tmp_path / f"run{number}"
            done = palpate.run(SWEEP, bench, out=out, listeners=[steps(copying(out, killed, []))], pause=pause)
            whole[number] = done.run
    assert [{event["kind"] for event in run.events()} for run in whole.values()] == [
        {"incident"},
        {"incident", "paused", "resumed"},
        {"incident"},
    ]
    assert len({run.digest() for run in whole.values()}) == len(whole)
    for number, run in list(whole.items())[1:]:
        again = palpate.resume(killed / f"run{number}-1").run
        assert again.digest() == run.digest(), number
        assert again.header.get("before") == run.header.get("before")


@pytest.mark.parametrize(
    ("runs", "something_else"),
    [
        (0, lambda bench: bench.operator.mount(palpate.get_sample("3"))),
        (1, lambda bench: bench.device("strain_indicator").set(filter=0.4)),
    ],
)
def test_a_run_after_something_that_nobody_knows_says_as_it_begins_that_it_cannot_be_resumed(
    runs: int, something_else: Callable[[Bench], None], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with palpate.open_bench(scene="ideal") as bench, pytest.raises(KeyboardInterrupt) as ended:
        for number in range(runs):
            palpate.run(Relaxation(readings=1), bench, out=tmp_path / str(number))
        assert "cannot be resumed" not in capsys.readouterr().err
        something_else(bench.bench)
        palpate.run(Relaxation(), bench, out=tmp_path / "last", listeners=[steps(interrupt_at(1))])
    when = "after run 1" if runs else "before its first run"
    why = f"something else was done with the bench {when}"
    assert capsys.readouterr().err == f"palpate: note: this run cannot be resumed if it is interrupted: {why}\n"
    assert not any("palpate runs resume" in note for note in ended.value.__notes__)
    with pytest.raises(palpate.UsageError, match=f"last: the simulated bench cannot be brought back .*: {why}; run it"):
        palpate.resume(tmp_path / "last", Relaxation)


@dataclass(frozen=True)
class Slower(Relaxation):
    name = "slower relaxation"
    readings: int = 3


def test_a_run_after_those_of_a_script_goes_on_where_their_classes_are_known(
    tmp_path: Path,
) -> None:
    with palpate.open_bench(scene="ideal") as bench:
        palpate.run(Slower(), bench, out=tmp_path / "first")
        out = tmp_path / "second"
        whole = palpate.run(SWEEP, bench, out=out, listeners=[steps(copying(out, tmp_path / "killed", []))])
    cut = tmp_path / "killed" / "second-1"
    shutil.rmtree(tmp_path / "first")  # the second one's header tells enough
    gone = shutil.copytree(cut, tmp_path / "gone")
    rehash(gone, header=lambda header: header["before"]["runs"]["1"]["header"].update(procedure="uninstalled"))
    with pytest.raises(palpate.UsageError, match=r"first: 'uninstalled' .* cannot be resumed without its class"):
        palpate.resume(gone)
    assert palpate.resume(cut).run.digest() == whole.run.digest()


SCRIPT = """
import os, sys, palpate
from palpate.testing import steps
from tests.procedures.test_chained_runs import CHAIN
cut, points, signal = map(int, sys.argv[1:])
def kill(done, total, what):
    if number == cut and done == points: os.kill(os.getpid(), signal)
with palpate.open_bench(scene="thesis_single") as bench:
    for number, procedure in enumerate(CHAIN):
        print(palpate.run(procedure, bench, out=f"run{number}", listeners=[steps(kill)]).run.digest(), flush=True)
"""
RESUME = "import sys, palpate; print(palpate.resume(sys.argv[1]).run.digest())"


@pytest.mark.slow
def test_a_chain_that_was_ended_by_a_signal_goes_on_in_another_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def python(folder: Path, code: str, *arguments: object) -> subprocess.CompletedProcess[str]:
        folder.mkdir(exist_ok=True)
        monkeypatch.setenv("PALPATE_STORE", str(folder / "store"))
        monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
        command = [sys.executable, "-c", code, *map(str, arguments)]
        return subprocess.run(command, cwd=folder, capture_output=True, text=True)

    whole = python(tmp_path / "whole", SCRIPT, -1, 0, 0).stdout.split()
    ended = python(tmp_path / "killed", SCRIPT, 1, 2, int(signal.SIGKILL))
    assert (ended.returncode, ended.stdout.split()) == (-signal.SIGKILL, whole[:1])
    assert python(tmp_path / "killed", RESUME, "run1").stdout.split() == [whole[1]]
