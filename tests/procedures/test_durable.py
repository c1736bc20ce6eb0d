"""A pass needs a durable record: where a point cannot be stored the run stops with outputs off and nothing reported."""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from instrument.errors import RecordError
from procedures.cli.options import Progress
from procedures.record import Recorder
from procedures.run import DATABASE, WAVEFORMS
from tests.procedures.conftest import HEADER, OFF, Benches, Palpate, outputs

SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--out", "day")
Break = Callable[[pytest.MonkeyPatch], object]


def refused(number: int) -> Break:
    """The disk takes nothing more."""

    def refuse(_handle: int) -> None:
        raise OSError(number, os.strerror(number))

    return lambda patch: patch.setattr(os, "fsync", refuse)


def replaced(name: str) -> Break:
    """A copy takes the place of a file that is being written."""

    def replace(_patch: pytest.MonkeyPatch) -> None:
        shutil.copy(Path("day") / name, "copy")
        Path("copy").rename(Path("day") / name)

    return replace


def removed(name: str) -> Break:
    return lambda _: (Path("day") / name).unlink()


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (refused(errno.ENOSPC), f"{WAVEFORMS}: No space left on device; free space"),
        (refused(errno.EROFS), f"{WAVEFORMS}: Read-only file system; choose a writable folder"),
        (lambda _: shutil.rmtree("day"), f"{DATABASE}: No such file or directory; do not move or remove a run"),
        (removed(DATABASE), f"{DATABASE}: No such file or directory"),
        (removed(f"{DATABASE}-wal"), f"{DATABASE}-wal: No such file or directory"),
        (replaced(WAVEFORMS), f"{WAVEFORMS}: it was replaced while the run was being written"),
    ],
    ids=["full", "read only", "removed", "database", "log", "waveforms"],
)
def test_a_point_that_is_not_stored_is_not_acknowledged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, broken: Break, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    films = {"rigid": (250.0, np.zeros(50))}
    with pytest.raises(RecordError, match=re.escape(message)), Recorder.create(Path("day"), HEADER) as record:
        assert record.point({"load_N": 2.0}, films, 1) == 1
        broken(monkeypatch)
        record.point({"load_N": 3.0}, films, 2)
    assert record.points == 1


def test_a_run_whose_folder_is_removed_stops_with_outputs_off(
    palpate: Palpate, benches: Benches, on_progress: Callable[[Progress], None]
) -> None:
    reported: list[int] = []

    def report(done: int, _total: int, _what: str) -> None:
        if done == 1 and 1 not in reported:
            shutil.rmtree("day")
        reported.append(done)

    on_progress(report)
    said = palpate(*SWEEP, "--json")
    assert said.status == 1
    assert "do not move or remove a run while it is being written" in said.complaint
    assert max(reported) == 1
    assert outputs(benches[0]) == OFF
