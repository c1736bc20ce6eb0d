"""A run survives SIGKILL at any moment with every point that was reported."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from procedures.run import DATABASE, Run
from procedures.run_list import list_runs

# Runs one after the other, so that a kill also meets the start and the end of a run. Long data fills
# the log in a few points, so that it also meets a checkpoint.
WRITER = """
import sys
from pathlib import Path
import numpy as np
from procedures.record import Recorder

store, points, values = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
for run in range(1000):
    header = {"procedure": "kill", "simulated": True, "started": f"2025-03-14T15:09:26.{run:06d}Z"}
    with Recorder.create(store / str(run), header) as recorder:
        for index in range(1, points + 1):
            data = {"index": index, "values": [float(index)] * values}
            waveforms = {name: (1000.0, np.arange(500) * scale * index) for name, scale in (("a", 1), ("b", -1))}
            print(run, recorder.point(data, waveforms, index), flush=True)
        recorder.finish("complete", {})
"""


def write_until(store: Path, lines: int, points: int, values: int) -> list[tuple[str, int]]:
    """The (run, point) pairs that a writer reported before it was killed, `lines` of them or more."""
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(store), str(points), str(values)], stdout=subprocess.PIPE, text=True
    ) as writer:
        assert writer.stdout is not None
        seen = [writer.stdout.readline() for _ in range(lines)]
        writer.kill()
        seen += writer.stdout.readlines()
    assert writer.returncode == -signal.SIGKILL
    return [(run, int(point)) for run, point in (line.split() for line in seen if line.endswith("\n"))]


@pytest.mark.parametrize(
    ("lines", "points", "values"),
    [
        *((lines, 3, 1) for lines in (1, 2, 3, 5, 6, 9, 30, 31)),
        *((lines, 1000, 5000) for lines in (20, 60, 61, 100)),
    ],
)
def test_a_killed_run_keeps_every_point_it_reported(tmp_path: Path, lines: int, points: int, values: int) -> None:
    reported = write_until(tmp_path, lines, points, values)
    assert len(reported) >= lines
    runs = {folder.name: Run.open(folder) for folder in tmp_path.iterdir() if (folder / DATABASE).exists()}
    stored = {(name, point["id"]): point for name, run in runs.items() for point in run.points()}
    for name, point_id in reported:
        assert stored[name, point_id]["values"] == [float(point_id)] * values
        for waveform, scale in (("a", 1), ("b", -1)):
            expected = (np.arange(500) * scale * point_id).astype(np.float32)
            np.testing.assert_array_equal(runs[name].waveform(point_id, waveform), expected)


def test_no_moment_of_a_kill_leaves_a_damaged_run(tmp_path: Path) -> None:
    for kill in range(1, 11):
        write_until(tmp_path / str(kill), kill, 1, 1)
        runs = list_runs(tmp_path / str(kill))
        assert [run.fault for run in runs] == [""] * len(runs)
        assert {run.status for run in runs} <= {"running", "complete"}
        assert len({Run.open(run.folder).digest() for run in runs if run.points}) == 1
