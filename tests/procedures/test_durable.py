"""A pass needs a durable record: where a point cannot be stored the run stops with outputs off and nothing reported."""

from __future__ import annotations

import errno
import os
import re
import resource
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from palpate import RecordError, Run
from palpate.extend import Recorder
from palpate.procedures.console.terminal import Progress
from palpate.procedures.records.chain import HEAD_FILE, RECORD
from palpate.procedures.records.damage import check
from tests.procedures.conftest import HEADER, OFF, Benches, Palpate, outputs

SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--out", "day")
LONG = "x" * 20_000
Break = Callable[[Recorder, pytest.MonkeyPatch], object]


@contextmanager
def full() -> Iterator[None]:
    """The system lets this process write to no file."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def failing(call: str, code: int) -> Break:
    """A call of the system fails from now on."""
    refuse = Mock(side_effect=OSError(code, os.strerror(code)))
    return lambda _record, patch: patch.setattr(os, call, refuse)


def replaced(name: str) -> Break:
    """A copy takes the place of a file that is being written."""

    def replace(record: Recorder, _: pytest.MonkeyPatch) -> None:
        shutil.copy(record.folder / name, "copy")
        Path("copy").rename(record.folder / name)

    return replace


def removed(name: str) -> Break:
    return lambda record, _: (record.folder / name).unlink()


WRITES: dict[str, Callable[[Recorder], object]] = {
    "point": lambda record: record.point({"load_N": 3.0, "text": LONG}, {"rigid": (250.0, np.zeros(50))}, 2),
    "event": lambda record: record.event("note", LONG, 2),
    "finish": lambda record: record.finish("complete", {"text": LONG}),
}
FULL = failing("pwrite", errno.ENOSPC)
BREAKS: dict[str, tuple[Break, str]] = {
    "full": (FULL, f"{RECORD}: No space left on device; free space on the disk"),
    "read only": (failing("pwrite", errno.EROFS), f"{RECORD}: Read-only file system; choose a writable"),
    "no sync": (failing("fdatasync", errno.EIO), f"{RECORD}: Input/output error; check the disk"),
    "folder removed": (
        lambda record, _: shutil.rmtree(record.folder),
        "No such file or directory; do not move or remove",
    ),
    "record removed": (removed(RECORD), f"{RECORD}: No such file or directory"),
    "head removed": (removed(HEAD_FILE), f"{HEAD_FILE}: No such file or directory"),
    "record replaced": (replaced(RECORD), f"{RECORD}: it was replaced while the run was being written"),
    "head replaced": (replaced(HEAD_FILE), f"{HEAD_FILE}: it was replaced while the run was being written"),
}


@pytest.mark.parametrize("write", WRITES)
@pytest.mark.parametrize("broken", BREAKS)
def test_what_is_not_stored_is_not_acknowledged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, broken: str, write: str
) -> None:
    monkeypatch.chdir(tmp_path)
    breaks, message = BREAKS[broken]
    with pytest.raises(RecordError, match=re.escape(message)), Recorder.create(Path("day"), HEADER) as record:
        assert record.point({"load_N": 2.0}, {"rigid": (250.0, np.ones(50))}, 1) == 1
        breaks(record, monkeypatch)
        WRITES[write](record)
    assert record.points == 1


@pytest.mark.parametrize("write", WRITES)
def test_where_the_system_takes_nothing_more_what_was_stored_stays_and_the_run_can_go_on(
    tmp_path: Path, write: str
) -> None:
    with Recorder.create(tmp_path, HEADER) as record:
        record.point({"load_N": 2.0}, {"rigid": (250.0, np.ones(50))}, 1)
        with full(), pytest.raises(RecordError, match=r"raise the limit on file sizes \(ulimit -f\)"):
            WRITES[write](record)
    run, status = Run.open(tmp_path), "running" if write == "finish" else "stopped"
    assert ([point["load_N"] for point in run.points()], run.status, check(tmp_path).faults) == ([2.0], status, [])


def test_a_point_that_failed_for_want_of_space_is_stored_when_there_is_some(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Recorder.create(tmp_path, HEADER) as record:
        record.point({"load_N": 2.0}, {}, 1)
        with monkeypatch.context() as disk:
            FULL(record, disk)
            with pytest.raises(RecordError, match="free space"):
                WRITES["point"](record)
        assert WRITES["point"](record) == 2
    assert [point["load_N"] for point in Run.open(tmp_path).points()] == [2.0, 3.0]


@pytest.mark.parametrize(
    ("write", "status", "stored"),
    [
        ("point", "failed", 1),
        pytest.param("event", "failed", 1, marks=pytest.mark.slow),
        pytest.param("finish", "running", 2, marks=pytest.mark.slow),
    ],
)
def test_a_disk_that_is_full_in_the_middle_stops_the_sweep_with_outputs_off(
    palpate: Palpate, benches: Benches, on_progress: Callable[[Progress], None], monkeypatch: pytest.MonkeyPatch,
    write: str, status: str, stored: int,
) -> None:  # fmt: skip
    reported: list[int] = []
    store = getattr(Recorder, write)

    def refused(record: Recorder, *arguments: Any) -> object:
        with full() if record.points else nullcontext():
            return store(record, *arguments)

    def report(done: int, _total: int, what: str) -> None:
        reported.append(done)
        if (write, done, what) == ("event", 1, "sample 1, 3 N"):
            benches[0].amplifier.settings["gain"] = 1.0  # a knob: an incident, which is an event

    monkeypatch.setattr(Recorder, write, refused)
    on_progress(report)
    said = palpate(*SWEEP, "--json")
    assert (said.status, max(reported), outputs(benches[0])) == (1, stored, OFF)
    assert "cannot write" in said.complaint
    assert f"points already taken are kept in {Path('day').absolute()}" in said.complaint
    run = Run.open(Path("day"))
    assert (run.status, [point["load_N"] for point in run.points()]) == (status, [2.0, 3.0][:stored])


def test_after_a_sync_that_failed_nothing_more_is_acknowledged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        pytest.raises(RecordError, match="an earlier write or sync failed"),
        Recorder.create(tmp_path, HEADER) as record,
    ):
        record.point({"load_N": 2.0}, {}, 1)
        with monkeypatch.context() as disk, pytest.raises(RecordError, match="check the disk"):
            failing("fdatasync", errno.EIO)(record, disk)
            WRITES["point"](record)
        WRITES["point"](record)
    assert (Run.open(tmp_path).status, record.points) == ("running", 1)
