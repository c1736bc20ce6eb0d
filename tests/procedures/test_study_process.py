"""A study as a process: Ctrl-C and a kill lose no stored cell and leave no worker."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from palpate.instrument.errors import UsageError
from palpate.procedures.study.run import stored

pytestmark = pytest.mark.slow

STUDY = """
name = "small"
loads = "2 N, 3 N"

[axes]
seed = "1-{last}"
"""
PATIENCE = 120.0  # s


def known(folder: Path) -> int:
    with suppress(UsageError):  # not begun yet
        return sum(map(len, stored(folder)[1]))
    return 0


def wait_for(true: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end
        threading.Event().wait(0.05)


def workers_of(group: int) -> list[str]:
    """Processes that are left of a process group."""
    left = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = status.read_text(encoding="utf-8").rpartition(")")[2].split()
            if int(fields[2]) == group and fields[0] != "Z":
                left.append(status.parent.name)
    return left


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_a_stopped_study_keeps_its_cells_and_leaves_no_worker(
    number: signal.Signals, status: int, tmp_path: Path
) -> None:
    file, folder = tmp_path / "study.toml", tmp_path / "out"
    file.write_text(STUDY.format(last=500_000), encoding="utf-8")
    command = [
        str(Path(sys.executable).with_name("palpate")),
        "study",
        str(file),
        "--workers",
        "1",
        "--out",
        str(folder),
    ]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    wait_for(lambda: known(folder) >= 2)
    before = known(folder)
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # as a terminal does
    else:
        os.kill(process.pid, number)
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == status
    after = known(folder)
    assert before <= after < 500_000
    if number == signal.SIGINT:
        assert said.lstrip() == (
            f"palpate: interrupted\n{after} of 500000 cells are kept in {folder}; give the command again to go on\n"
        )
    wait_for(lambda: not workers_of(process.pid))
