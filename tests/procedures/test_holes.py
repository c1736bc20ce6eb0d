"""A file that is longer than what was ever written of it is refused at once, by everything that reads runs."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from unittest.mock import Mock

import pytest

from palpate.instrument.errors import RecordError
from palpate.procedures.records.chain import MOST_HOLES, RECORD, check_holes
from palpate.procedures.records.damage import check, repair
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run, list_runs
from palpate.procedures.study.results import read_results
from tests.procedures.conftest import HEADER, Palpate

SPARSE = 200_000_000_000  # bytes


@pytest.fixture
def run(tmp_path: Path) -> Path:
    with Recorder.create(tmp_path / "run", HEADER) as record:
        record.point({"load_N": 2.0}, {}, 5)
        record.finish("complete", {"samples": []})
    return tmp_path / "run"


def test_a_sparse_file_of_a_run_is_refused_with_its_size_and_what_to_do(run: Path, tmp_path: Path) -> None:
    whole = (run / RECORD).stat().st_size
    os.truncate(run / RECORD, SPARSE)
    said = rf"{RECORD} is damaged \(it is {SPARSE} bytes long, and more than {MOST_HOLES} of them were never written"
    for read in (Run.open, lambda run: repair(run, tmp_path / "mended")):
        with pytest.raises(RecordError, match=said):
            read(run)
    (listed,) = list_runs(tmp_path)
    assert listed.status == "damaged"
    assert all("never written" in fault for fault in (check(run).faults[0], listed.fault))
    os.truncate(run / RECORD, whole)
    assert check(run).faults == []


@pytest.mark.parametrize("command", ["show", "replay"])
def test_so_is_a_bus_log_from_the_command_line(palpate: Palpate, command: str) -> None:
    sparse(Path("trace.pcapng"))
    said = palpate("bus", command, "trace.pcapng").complaint
    assert said.startswith(f"trace.pcapng is damaged (it is {SPARSE} bytes long")


def sparse(file: Path) -> None:
    file.touch()
    os.truncate(file, SPARSE)


def test_so_is_a_study(tmp_path: Path) -> None:
    sparse(tmp_path / "study.record")
    with pytest.raises(RecordError, match="never written"):
        read_results(tmp_path)


def test_too_little_memory_is_one_message(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.procedures.logs.read_log", Mock(side_effect=MemoryError))
    Path("trace.pcapng").touch()
    said = palpate("bus", "show", "trace.pcapng").complaint
    assert said.startswith("this computer has too little memory")


def test_holes_between_data_count_together_and_what_was_written_counts_for_none(tmp_path: Path) -> None:
    with (tmp_path / "file").open("wb") as file:
        for part in range(4):
            file.seek(part * MOST_HOLES // 2 + part * 4096)
            file.write(bytes(4096))
    with pytest.raises(RecordError):
        check_holes(tmp_path / "file")
    os.truncate(tmp_path / "file", MOST_HOLES // 2 + 4096)
    check_holes(tmp_path / "file")
    shutil.rmtree(tmp_path)
    check_holes(tmp_path / "file")
