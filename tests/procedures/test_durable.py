"""A pass needs a durable record: where a point cannot be stored the run stops with outputs off and nothing reported."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from procedures import record
from procedures.cli.options import Progress
from procedures.run import DATABASE, WAVEFORMS, Run
from tests.procedures.conftest import OFF, Benches, Palpate, outputs

SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N, 4 N", "--dwell", "0.2 s", "--out", "day")
Break = Callable[[pytest.MonkeyPatch], object]


def refused(number: int) -> Break:
    """The disk takes nothing more."""

    def refuse(_handle: int) -> None:
        raise OSError(number, os.strerror(number))

    return lambda patch: patch.setattr(record.os, "fsync", refuse)


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
def test_a_run_that_cannot_be_stored_stops_with_outputs_off(
    palpate: Palpate,
    benches: Benches,
    on_progress: Callable[[Progress], None],
    monkeypatch: pytest.MonkeyPatch,
    broken: Break,
    message: str,
) -> None:
    reported: list[int] = []

    def report(done: int, _total: int, _what: str) -> None:
        if done == 1 and 1 not in reported:
            broken(monkeypatch)
        reported.append(done)

    on_progress(report)
    said = palpate(*SWEEP, "--json")
    assert said.status == 1
    assert message in said.complaint
    assert max(reported) == 1
    assert outputs(benches[0]) == OFF
    if "space" in message:
        assert [point["load_N"] for point in Run.open(Path("day")).points()] == [2.0]
