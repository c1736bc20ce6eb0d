"""A file that is longer than what was ever written of it is refused at once, by everything that reads runs."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

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
    with (run / RECORD).open("ab") as file:
        file.truncate(SPARSE)
    said = rf"{RECORD} is damaged \(it is {SPARSE} bytes long, and more than {MOST_HOLES} of them were never written"
    (fault, *_) = check(run).faults
    assert "never written" in fault
    with pytest.raises(RecordError, match=said):
        Run.open(run)
    with pytest.raises(RecordError, match=said):
        repair(run, tmp_path / "mended")
    (listed,) = list_runs(tmp_path)
    assert (listed.status, "never written" in listed.fault) == ("damaged", True)
    os.truncate(run / RECORD, whole)
    assert check(run).faults == []


@pytest.mark.parametrize("command", [("bus", "show"), ("bus", "replay")])
def test_so_is_a_bus_log_from_the_command_line(palpate: Palpate, command: tuple[str, str]) -> None:
    with Path("trace.pcapng").open("wb") as file:
        file.truncate(SPARSE)
    said = palpate(*command, "trace.pcapng")
    assert said.status == 1
    assert said.complaint.startswith(f"trace.pcapng is damaged (it is {SPARSE} bytes long")


def test_so_is_a_study(tmp_path: Path) -> None:
    with (tmp_path / "study.record").open("wb") as file:
        file.truncate(SPARSE)
    with pytest.raises(RecordError, match="never written"):
        read_results(tmp_path)


def test_too_little_memory_is_one_message(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    def greedy(_path: Path) -> None:
        raise MemoryError

    monkeypatch.setattr("palpate.procedures.logs.read_log", greedy)
    Path("trace.pcapng").touch()
    said = palpate("bus", "show", "trace.pcapng")
    assert said.status == 1
    assert said.complaint.startswith("this computer has too little memory")


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
