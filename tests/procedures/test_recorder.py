"""The one writer of a run by itself: who may write, what counts as stored, and how a run ends."""

from __future__ import annotations

import os
import re
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from palpate.instrument.errors import RecordError, UsageError
from palpate.procedures.records.record import Recorder, new_run_folder
from palpate.procedures.records.run import Run

HEADER: dict[str, object] = {"procedure": "sweep", "simulated": False, "started": "2025-03-14T15:09:26Z"}
FILM = {"film": (250.0, np.zeros(3, np.float32))}


# --- a new run -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ({}, "^the header of a run lacks procedure, simulated, started$"),
        ({"procedure": "sweep", "simulated": True}, "^the header of a run lacks started$"),
        ({**HEADER, "simulated": 1}, "^the header of a run says simulated = 1; write true or false$"),
        ({**HEADER, "started": "noon"}, "noon"),
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
    with Recorder.create(Path("run"), HEADER) as recorder:
        monkeypatch.chdir(tmp_path / "elsewhere")
        assert recorder.folder == tmp_path / "run"
        assert [recorder.point({}, FILM, number) for number in (0, 5)] == [1, 2]
        recorder.close()
    run = Run.open(tmp_path / "run")
    assert run.points() == [{"id": 1, "bench_ns": 0}, {"id": 2, "bench_ns": 5}]
    assert (run.status, run.events()) == ("running", [])


def test_while_a_run_is_written_nobody_else_begins_or_goes_on_with_one_there(tmp_path: Path) -> None:
    message = f"^{re.escape(str(tmp_path))} is being written by another process; let that end first$"
    with Recorder.create(tmp_path, HEADER) as recorder:
        for header in (HEADER, None):
            with pytest.raises(UsageError, match=message):
                Recorder(tmp_path, header)
        recorder.finish("complete", {})
    Recorder(tmp_path).close()  # from now on others may


def test_no_file_stays_open_when_a_run_has_ended_or_could_not_begin_and_opened_again_nothing_is_written(
    tmp_path: Path,
) -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(ZeroDivisionError), Recorder.create(tmp_path, HEADER) as recorder:
        recorder.finish("complete", {})
        with pytest.raises(UsageError, match="already holds a run"):
            Recorder.create(tmp_path, HEADER)
        raise ZeroDivisionError  # after the end, so the result stays
    assert Run.open(tmp_path).status == "complete"
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with Recorder(tmp_path):
        pass
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == files
    assert len(list(Path("/proc/self/fd").iterdir())) == before


# --- points and events ---------------------------------------------------------------------------------


# --- the end -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("message", "events"), [("", []), ("no sample", ["no sample"])])
def test_a_run_ends_with_its_result_and_with_a_message_where_there_is_one(
    message: str, events: list[str], tmp_path: Path
) -> None:
    recorder = Recorder.create(tmp_path, HEADER)
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

    with pytest.raises(KeyError, match="servo"), Recorder.create(tmp_path, HEADER):
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
