"""A sweep that is killed leaves every point it reported; one that is told to stop leaves its outputs off, too."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from instrument.estimate import amplitude_ratio, fit_sine
from procedures.run import DATABASE, Run
from tests.procedures.conftest import OFF, Palpate

# For each folder it is given, a long sweep in a process of its own, forked with everything imported. It says "tick"
# at each wait, "point" with the number of points when it reports them, and "off" with its outputs at the end.
SWEEPS = """
import contextlib, json, os, sys
import canopen, matplotlib.figure, pymodbus, scipy.interpolate
from instrument.quantity import parse
from procedures import load_sweep, report
from procedures.cli import main, session
from procedures.cli.options import Output
from simulators.bench import SimulatedBench
from simulators.clock import VirtualClock

def say(*words):
    os.write(1, (" ".join(map(str, words)) + "\\n").encode())

@contextlib.contextmanager
def progress(self):
    yield lambda done, total, what: say("point", done)
Output.progress = progress

wait = VirtualClock.wait
def ticking(self, duration):
    say("tick")
    wait(self, duration)
VirtualClock.wait = ticking

class Told(SimulatedBench):
    def __exit__(self, *error):
        generator = self.generator.settings
        say("off", json.dumps([self.amplifier.settings["enable"], generator["output"], generator["amplitude"]]))
        super().__exit__(*error)
session.SimulatedBench = Told

parse("1 N", "N")
for line in sys.stdin:
    child = os.fork()
    if not child:
        sys.argv = ["palpate", "sweep", "loads", "--loads", "1.5 N:4 N:0.01 N", "--out", line.strip(), "--quiet"]
        main()
    say("pid", child)
    say("end", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@dataclass(frozen=True, slots=True)
class End:
    """Exit status of a sweep, how many points it reported, and its outputs at the end if it came to one."""

    status: int
    reported: int
    outputs: tuple[bool, bool, float] | None


@pytest.fixture(scope="module")
def sweeps() -> Iterator[subprocess.Popen[str]]:
    pipe, null = subprocess.PIPE, subprocess.DEVNULL
    with subprocess.Popen([sys.executable, "-c", SWEEPS], stdin=pipe, stdout=pipe, stderr=null, text=True) as process:
        yield process
        assert process.stdin is not None
        process.stdin.close()


def signalled(sweeps: subprocess.Popen[str], folder: Path, number: int, word: str, count: int) -> End:
    """A sweep that gets a signal when it has said `word` for the `count`-th time."""
    assert sweeps.stdin is not None
    assert sweeps.stdout is not None
    print(folder, file=sweeps.stdin, flush=True)
    child, said, reported, sent, outputs = 0, 0, 0, False, None
    for line in sweeps.stdout:
        kind, *rest = line.split(maxsplit=1)
        said += kind == word
        match kind:
            case "pid":
                child = int(rest[0])
            case "point":
                reported = int(rest[0])
            case "off":
                outputs = tuple(json.loads(rest[0]))
            case "end":
                return End(int(rest[0]), reported, outputs)
        if child and said >= count and not sent:
            sent = True
            os.kill(child, number)
    raise AssertionError("the process that starts sweeps has ended")


def check(run: Run, reported: int) -> None:
    """Every point that was reported is there, and its waveforms give it again."""
    points = run.points()
    assert [p["id"] for p in points] == list(range(1, len(points) + 1))
    assert len(points) >= reported
    stored = {(w.point_id, w.name): w for w in run.waveforms()}
    assert stored.keys() == {(p["id"], name) for p in points for name in ("rigid", "total")}
    for p in points:
        films = np.array([stored[p["id"], name].samples for name in ("rigid", "total")])
        fit = fit_sine(np.arange(250) / 250.0, films, 10.0)
        assert amplitude_ratio(fit, 0, 1)[0] * 68.60 / 5.995 == pytest.approx(p["force_ratio"], rel=1e-6)


@pytest.mark.parametrize(
    ("word", "count"),
    [("tick", 1), ("tick", 20), ("tick", 90), ("tick", 155), ("tick", 260), ("point", 3), ("point", 9), ("point", 20)],
)
def test_a_killed_sweep_keeps_every_point_it_reported(
    sweeps: subprocess.Popen[str], palpate: Palpate, tmp_path: Path, word: str, count: int
) -> None:
    end = signalled(sweeps, tmp_path / "run", signal.SIGKILL, word, count)
    assert end.status == -signal.SIGKILL
    if not (tmp_path / "run" / DATABASE).exists():
        assert end.reported == 0
        return
    run = Run.open(tmp_path / "run")
    assert run.status == "running"
    check(run, end.reported)
    shown = palpate("runs", "show", "run", "--json").object
    assert (shown["points"], shown["status"], shown["simulated"]) == (run.points(), "running", True)


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGTERM, 128 + signal.SIGTERM), (signal.SIGINT, 128 + signal.SIGINT)]
)
def test_a_sweep_that_is_told_to_stop_ends_with_its_outputs_off(
    sweeps: subprocess.Popen[str], palpate: Palpate, tmp_path: Path, number: signal.Signals, status: int
) -> None:
    end = signalled(sweeps, tmp_path / "run", number, "tick", 110)
    assert (end.status, end.outputs) == (status, OFF)
    assert end.reported > 0
    run = Run.open(tmp_path / "run")
    assert run.status == "stopped"
    check(run, end.reported)
    assert palpate("runs", "show", "run").status == 0
