"""Writing a run: what is stored, and where a point cannot be, the run stops with outputs off, nothing reported."""

from __future__ import annotations

import errno
import os
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any, NoReturn
from unittest.mock import Mock

import numpy as np
import pytest

from palpate import RangeError, RecordError, Run, UsageError
from palpate.procedures.console.terminal import Progress
from palpate.procedures.records.chain import HASH, HEAD_FILE, LARGEST_ROW, RECORD
from palpate.procedures.records.damage import check
from palpate.procedures.records.record import Recorder, new_run_folder
from palpate.procedures.records.record_file import IN_A_FRAME
from tests.procedures.conftest import OFF, Benches, Palpate, outputs

HEADER = {"procedure": "sweep loads", "simulated": True, "started": "2025-03-14T15:09:26Z", "seed": 7}
SECOND = 1_000_000_000


def waveform(seed: int, samples: int = 1000) -> tuple[float, np.ndarray]:
    return 1000.0, np.random.default_rng(seed).normal(size=samples).astype(np.float32)


def write(folder: Path, points: int = 3, seed: int = 0) -> Run:
    with Recorder.create(folder, HEADER) as recorder:
        for index in range(points):
            recorder.point(
                {"sample": 1 + index, "load_N": 1.5 + 0.5 * index},
                {"rigid": waveform(seed + index), "total": waveform(seed + index + 100)},
                index * SECOND,
            )
        recorder.finish("complete", {"points": points})
    return Run.open(folder)


def refuse(*_: object, **__: object) -> NoReturn:
    raise OSError(errno.EROFS, os.strerror(errno.EROFS))


def test_what_is_written_is_what_is_read(tmp_path: Path) -> None:
    run = write(tmp_path / "parents" / "run")
    assert run.header == HEADER
    assert "header=" not in repr(run)  # header and summary take pages
    assert (run.procedure, run.simulated, run.status, run.summary) == ("sweep loads", True, "complete", {"points": 3})
    assert run.started == datetime(2025, 3, 14, 15, 9, 26, tzinfo=UTC)
    assert run.points()[1] == {"id": 2, "bench_ns": SECOND, "sample": 2, "load_N": 2.0}
    assert run.waveform_names(2) == ["rigid", "total"]
    np.testing.assert_array_equal(run.waveform(2, "total"), waveform(101)[1])
    assert (run.folder / "run.record").read_bytes()[-HASH - 1 :].startswith(b"}")  # no zeros behind its end


def test_equal_measurements_give_equal_bytes_and_another_seed_does_not(tmp_path: Path) -> None:
    one, two, other = write(tmp_path / "1"), write(tmp_path / "2"), write(tmp_path / "3", seed=1)
    for name in ("run.record", "run.head"):
        files = [(run.folder / name).read_bytes() for run in (one, two, other)]
        assert files[0] == files[1] != files[2]
    assert one.digest() == two.digest() != other.digest()


def test_a_long_waveform_lies_in_several_frames_and_keeps_samples_that_are_not_finite(tmp_path: Path) -> None:
    rate, samples = waveform(1, 2 * IN_A_FRAME + 5)
    samples[:3] = np.nan, np.inf, -np.inf
    waveforms = {"a": samples, "none": samples[:0], "b": -samples}
    with Recorder.create(tmp_path, HEADER) as recorder:
        recorder.point({}, {name: (rate, each) for name, each in waveforms.items()}, 0)
        recorder.finish("complete", {"points": 1})
    assert (tmp_path / "run.record").read_bytes().count(b'"name":"a","rate":1000.0}') == 3
    run = Run.open(tmp_path)
    assert run.waveform_names(1) == list(waveforms)
    for name, each in waveforms.items():
        np.testing.assert_array_equal(run.waveform(1, name), each)


@pytest.mark.parametrize(
    ("data", "waveforms", "what"),
    [
        ({"id": 3}, {}, "id"),
        ({"simulated": False}, {}, "simulated"),
        ({}, {"film": (0.0, np.zeros(2))}, "sample rate"),
        ({}, {"film": (float("nan"), np.zeros(2))}, "sample rate"),
        ({}, {"film": (float("inf"), np.zeros(2))}, "sample rate"),
        ({}, {"film": (1.0, np.zeros((2, 2)))}, "shape"),
        ({}, {"film": (1.0, np.array([1e39]))}, "float32"),
        ({"text": "x" * LARGEST_ROW}, {}, r"has 400000\d\d bytes, 40000000 are the most"),
    ],
)
def test_a_point_that_cannot_be_stored_as_meant_is_refused_whole(
    tmp_path: Path, data: dict[str, object], waveforms: dict[str, tuple[float, np.ndarray]], what: str
) -> None:
    with Recorder.create(tmp_path, HEADER) as recorder:
        with pytest.raises(RangeError, match=what):
            recorder.point(data, waveforms, 0)
        assert recorder.point({"load_N": 1.5}, {}, 0) == 1
    assert list(Run.open(tmp_path).waveforms()) == []


@pytest.mark.slow
def test_of_recorders_that_start_at_once_in_a_folder_one_gets_it(tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from palpate.procedures.records.record import *\n"
        "print('ready', flush=True); sys.stdin.readline()\n"
        f"try: Recorder.create(Path({str(tmp_path / 'run')!r}), {HEADER!r}).finish('complete', {{}})\n"
        "except UsageError as error: sys.exit(error.exit_code)\n"
    )
    pipe = subprocess.PIPE
    racers = [subprocess.Popen([sys.executable, "-c", script], stdin=pipe, stdout=pipe) for _ in range(4)]
    for racer in racers:
        assert racer.stdout and racer.stdout.readline()
    for racer in racers:
        assert racer.stdin is not None
        racer.stdin.write(b"\n")
        racer.stdin.flush()
    for racer in racers:
        racer.communicate()
    assert sorted(racer.returncode for racer in racers) == [0, 2, 2, 2]
    assert Run.open(tmp_path / "run").status == "complete"


@pytest.mark.parametrize(
    ("error", "status"),
    [(ValueError("servo lost"), "failed"), (KeyboardInterrupt(), "stopped"), (SystemExit("SIGTERM"), "stopped")],
)
def test_an_exception_is_recorded_and_goes_on(tmp_path: Path, error: BaseException, status: str) -> None:
    with pytest.raises(type(error)) as raised, Recorder.create(tmp_path, HEADER) as recorder:
        recorder.point({"load_N": 1.5}, {}, 5 * SECOND)
        raise error
    assert raised.value is error
    run = Run.open(tmp_path)
    assert (run.status, len(run.points())) == (status, 1)
    assert run.events() == [{"bench_ns": 5 * SECOND, "kind": status, "message": f"{type(error).__name__}: {error}"}]


def test_a_place_that_takes_no_run_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RecordError, match=r"file/run: Not a directory; choose a writable folder with --out"):
        Recorder.create(tmp_path / "file" / "run", HEADER)
    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(RecordError, match=r"run: Read-only file system; choose a writable folder"):
        Recorder.create(tmp_path / "run", HEADER)


def test_a_start_that_fails_leaves_the_folder_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as disk, pytest.raises(RecordError, match="Read-only"):
        disk.setattr(Path, "replace", refuse)
        Recorder.create(tmp_path, HEADER)
    assert list(tmp_path.iterdir()) == []
    write(tmp_path)


# --- the one writer of a run, and how a run ends -------------------------------------------------------


SHORT: dict[str, object] = {"procedure": "sweep", "simulated": False, "started": "2025-03-14T15:09:26Z"}
FILM = {"film": (250.0, np.zeros(3, np.float32))}


# --- a new run -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ({}, "^the header of a run lacks procedure, simulated, started$"),
        ({"procedure": "sweep", "simulated": True}, "^the header of a run lacks started$"),
        ({**SHORT, "simulated": 1}, "^the header of a run says simulated = 1; write true or false$"),
        ({**SHORT, "started": "noon"}, "noon"),
    ],
)
def test_a_header_that_does_not_say_what_the_run_is_makes_no_folder(
    header: dict[str, object], message: str, tmp_path: Path
) -> None:
    with pytest.raises((RecordError, ValueError), match=message):
        Recorder.create(tmp_path / "run", header)
    assert list(tmp_path.iterdir()) == []


def test_a_run_stands_where_its_path_led_when_it_began_and_stays_as_it_is_when_it_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    with Recorder.create(Path("run"), SHORT) as recorder:
        monkeypatch.chdir(tmp_path / "elsewhere")
        assert recorder.folder == tmp_path / "run"
        assert [recorder.point({}, FILM, number) for number in (0, 5)] == [1, 2]
        recorder.close()
    run = Run.open(tmp_path / "run")
    assert run.points() == [{"id": 1, "bench_ns": 0}, {"id": 2, "bench_ns": 5}]
    assert (run.status, run.events()) == ("running", [])


def test_while_a_run_is_written_nobody_else_begins_or_goes_on_with_one_there(tmp_path: Path) -> None:
    message = f"^{re.escape(str(tmp_path))} is being written by another process; let that end first$"
    with Recorder.create(tmp_path, SHORT) as recorder:
        for header in (SHORT, None):
            with pytest.raises(UsageError, match=message):
                Recorder(tmp_path, header)
        recorder.finish("complete", {})
    Recorder(tmp_path).close()  # from now on others may


def test_no_file_stays_open_when_a_run_has_ended_or_could_not_begin_and_opened_again_nothing_is_written(
    tmp_path: Path,
) -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(ZeroDivisionError), Recorder.create(tmp_path, SHORT) as recorder:
        recorder.finish("complete", {})
        with pytest.raises(UsageError, match="already holds a run"):
            Recorder.create(tmp_path, SHORT)
        raise ZeroDivisionError  # after the end, so the result stays
    assert Run.open(tmp_path).status == "complete"
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with Recorder(tmp_path):
        pass
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == files
    assert len(list(Path("/proc/self/fd").iterdir())) == before


# --- the end -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("message", "events"), [("", []), ("no sample", ["no sample"])])
def test_a_run_ends_with_its_result_and_with_a_message_where_there_is_one(
    message: str, events: list[str], tmp_path: Path
) -> None:
    recorder = Recorder.create(tmp_path, SHORT)
    recorder.event("operator", "mounted", 7)
    recorder.finish("failed", {"n": 1}, message)
    run = Run.open(tmp_path)
    assert (run.status, run.summary) == ("failed", {"n": 1})
    assert [(event["kind"], event["message"]) for event in run.events()][1:] == [("failed", each) for each in events]
    assert all(event["bench_ns"] == 7 for event in run.events())  # the time that was told last


def test_the_failure_of_a_run_goes_on_though_its_end_cannot_be_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(KeyError, match="servo"), Recorder.create(tmp_path, SHORT):
        monkeypatch.setattr(os, "pwrite", full)
        raise KeyError("servo")


# --- folders and files beside it -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("procedure", "name"),
    [("sweep loads", "sweep-loads"), ("a/../b  c", "a-b-c"), ("Größe", "Gr-e"), ("x9", "x9")],
)
def test_a_folder_is_named_after_the_start_in_utc_and_the_procedure(procedure: str, name: str, tmp_path: Path) -> None:
    started = datetime(2025, 3, 14, 1, 2, 3, tzinfo=timezone(timedelta(hours=2)))
    for suffix in ("", "-2", "-3"):
        found = new_run_folder(tmp_path / "new" / "store", procedure, started)
        assert found == tmp_path / "new" / "store" / f"20250313T230203Z-{name}{suffix}"
        assert found.is_dir()


# --- A pass needs a durable record: where a point cannot be stored the run stops with outputs o --------


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
