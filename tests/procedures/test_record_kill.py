"""A run survives SIGKILL at any moment with every point that was reported."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from palpate.procedures.records.run import Run
from palpate.procedures.records.run_folder import RECORD
from palpate.procedures.records.run_list import list_runs

pytestmark = pytest.mark.slow

# Forks a writer for each line on stdin, with everything imported, and says its process id and how it ended. It writes
# runs one after the other, so that a kill also meets the start and the end of a run. Long data fills the log in a few
# points, so that it also meets a checkpoint.
WRITERS = """
import json, os, sys
from pathlib import Path
import numpy as np
from palpate.procedures.records.record import Recorder

def write(store, points, values):
    for run in range(1000):
        header = {"procedure": "kill", "simulated": True, "started": f"2025-03-14T15:09:26.{run:06d}Z"}
        with Recorder.create(Path(store) / str(run), header) as recorder:
            for index in range(1, points + 1):
                data = {"index": index, "values": [float(index)] * values}
                waveforms = {name: (1000.0, np.arange(500) * scale * index) for name, scale in (("a", 1), ("b", -1))}
                print(run, recorder.point(data, waveforms, index), "kept", flush=True)
            recorder.finish("complete", {})

for line in sys.stdin:
    writer = os.fork()
    if not writer:
        try:
            print(os.getpid(), flush=True)
            write(*json.loads(line))
        finally:
            os._exit(1)
    _, status = os.waitpid(writer, 0)
    print("\\nended", status, flush=True)
"""


@pytest.fixture(scope="module")
def writers() -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", WRITERS]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as started:
        yield started


def write_until(
    writers: subprocess.Popen[str], store: Path, lines: int, points: int, values: int
) -> list[tuple[str, int]]:
    """The (run, point) pairs that a writer reported before it was killed, `lines` of them or more."""
    assert writers.stdin is not None
    assert writers.stdout is not None
    print(json.dumps([str(store), points, values]), file=writers.stdin, flush=True)
    writer = int(writers.stdout.readline())
    seen = [writers.stdout.readline() for _ in range(lines)]
    os.kill(writer, signal.SIGKILL)
    for line in writers.stdout:
        if line.startswith("ended"):
            break
        seen.append(line)
    assert line == f"ended {int(signal.SIGKILL)}\n"
    return [(words[0], int(words[1])) for words in map(str.split, seen) if words[2:] == ["kept"]]


@pytest.mark.parametrize(
    ("lines", "points", "values"),
    [
        *((lines, 3, 1) for lines in (1, 2, 5, 31)),
        *((lines, 1000, 5000) for lines in (20, 61)),
    ],
)
def test_a_killed_run_keeps_every_point_it_reported(
    writers: subprocess.Popen[str], tmp_path: Path, lines: int, points: int, values: int
) -> None:
    reported = write_until(writers, tmp_path, lines, points, values)
    assert len(reported) >= lines
    runs = {folder.name: Run.open(folder) for folder in tmp_path.iterdir() if (folder / RECORD).exists()}
    stored = {(name, point["id"]): point for name, run in runs.items() for point in run.points()}
    for name, point_id in reported:
        assert stored[name, point_id]["values"] == [float(point_id)] * values
        for waveform, scale in (("a", 1), ("b", -1)):
            expected = (np.arange(500) * scale * point_id).astype(np.float32)
            np.testing.assert_array_equal(runs[name].waveform(point_id, waveform), expected)


def test_no_moment_of_a_kill_leaves_a_damaged_run(writers: subprocess.Popen[str], tmp_path: Path) -> None:
    for kill in range(1, 11):
        write_until(writers, tmp_path / str(kill), kill, 1, 1)
        runs = list_runs(tmp_path / str(kill))
        assert [run.fault for run in runs] == [""] * len(runs)
        assert {run.status for run in runs} <= {"running", "complete"}
        assert len({Run.open(run.folder).digest() for run in runs if run.points}) == 1
