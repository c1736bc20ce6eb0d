"""A list of runs by the index of their store: it says what reading the runs says, whatever became of runs and index."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from palpate.instrument.errors import RecordError
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from tests.procedures.conftest import Palpate
from tests.runs import rehash

STORE, INDEX = Path("runs"), Path("runs/runs.index")
COUNT = 30
LONG_AGO = 1_700_000_000  # s since 1970


def aged(folder: Path) -> None:
    """The files of a run as if they had been written long ago."""
    for path in folder.iterdir():
        os.utime(path, (LONG_AGO, LONG_AGO))


@pytest.fixture
def listed(palpate: Palpate) -> Callable[[], list[dict[str, Any]]]:
    """Lists the runs of a store of thirty, written long ago."""
    recorder = Recorder.create(
        STORE / "0", {"procedure": "sweep-loads", "simulated": True, "started": "2025-03-14T15:09:26Z"}
    )
    recorder.point({"load_N": 1.5}, {}, 1)
    recorder.finish("complete", {})
    for number in range(1, COUNT):
        shutil.copytree(STORE / "0", STORE / str(number))
    for folder in STORE.iterdir():
        aged(folder)

    def by_command() -> list[dict[str, Any]]:
        runs: list[dict[str, Any]] = palpate("runs", "list", "--json").object["runs"]
        return runs

    return by_command


def anew(by_command: Callable[[], list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """The list without an index."""
    INDEX.unlink()
    return by_command()


def test_runs_that_have_not_changed_are_listed_without_being_read(
    listed: Callable[[], list[dict[str, Any]]], palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, table = listed(), palpate("runs", "list").out
    assert len(before) == COUNT
    assert {(run["status"], run["points"], run["procedure"]) for run in before} == {("complete", 1, "sweep-loads")}

    def refused(folder: Path) -> Run:
        raise RecordError(f"{folder} was read")

    monkeypatch.setattr("palpate.procedures.records.run.Run.open", refused)
    assert listed() == before
    assert palpate("runs", "list").out == table
    INDEX.unlink()
    assert {run["status"] for run in listed()} == {"damaged"}


def test_a_run_that_was_changed_removed_or_added_is_listed_as_it_is_now(
    listed: Callable[[], list[dict[str, Any]]],
) -> None:
    listed()
    rehash(STORE / "3", status="stopped")
    aged(STORE / "3")
    shutil.rmtree(STORE / "4")
    shutil.copytree(STORE / "5", STORE / "new")
    shutil.rmtree(STORE / "6")
    shutil.copytree(STORE / "3", STORE / "6")
    now = {Path(run["run"]).name: run["status"] for run in listed()}
    assert (now["3"], now["6"], now["new"], now["5"]) == ("stopped", "stopped", "complete", "complete")
    assert "4" not in now and len(now) == COUNT
    assert listed() == anew(listed)


def test_a_run_that_was_changed_without_another_size_or_time_of_writing_is_read(
    listed: Callable[[], list[dict[str, Any]]],
) -> None:
    listed()
    record = STORE / "3" / "run.record"
    content = bytearray(record.read_bytes())
    content[len(content) // 2] ^= 1
    record.write_bytes(content)
    aged(STORE / "3")
    (damaged,) = [run for run in listed() if run["fault"]]
    assert Path(damaged["run"]).name == "3"
    assert damaged["status"] == "damaged"
    assert listed() == anew(listed)


def test_a_run_that_was_written_a_moment_ago_is_read_again(listed: Callable[[], list[dict[str, Any]]]) -> None:
    """It could be changed once more, and its files have the same times."""
    for folder in STORE.iterdir():
        for path in folder.iterdir():
            path.touch()
    listed()
    assert not INDEX.exists()


def _folder(index: Path) -> None:
    index.unlink()
    index.mkdir()


def _pipe(index: Path) -> None:
    index.unlink()
    os.mkfifo(index)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "lost": Path.unlink,
    "empty": lambda index: index.write_bytes(b""),
    "cut": lambda index: index.write_bytes(index.read_bytes()[:-1]),
    "zeros": lambda index: index.write_bytes(bytes(index.stat().st_size)),
    "another status": lambda index: index.write_bytes(index.read_bytes().replace(b'"complete"', b'"failed"')),
    "another version": lambda index: index.write_bytes(index.read_bytes().replace(b"runs 1", b"runs 9", 1)),
    "no text": lambda index: index.write_bytes(b"\xff\n{}"),
    "a folder, so that none can be written": _folder,
    "a pipe": _pipe,
    "a draft of a killed writer beside it": lambda index: (index.parent / ".runs.index.1.draft").write_bytes(b"{"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_whatever_became_of_the_index_the_runs_are_listed_as_they_are(
    damage: str, listed: Callable[[], list[dict[str, Any]]]
) -> None:
    before = listed()
    assert INDEX.is_file()
    DAMAGES[damage](INDEX)
    assert listed() == before
    assert listed() == before


def test_the_index_is_the_old_or_the_new_one_when_its_writer_is_killed(
    listed: Callable[[], list[dict[str, Any]]], monkeypatch: pytest.MonkeyPatch, palpate: Palpate
) -> None:
    before = listed()
    old = INDEX.read_bytes()
    for number in range(COUNT):
        shutil.copytree(STORE / "0", STORE / f"more-{number}")
        aged(STORE / f"more-{number}")

    def killed(_draft: Path, _to: Path) -> Path:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", killed)
        assert palpate("runs", "list").status == 130
    assert INDEX.read_bytes() == old
    after = listed()
    assert len(after) == 2 * COUNT
    assert [run for run in after if "more" not in run["run"]] == before
    assert INDEX.read_bytes() != old


def test_a_store_of_few_runs_needs_no_index(listed: Callable[[], list[dict[str, Any]]]) -> None:
    for number in range(5, COUNT):
        shutil.rmtree(STORE / str(number))
    assert len(listed()) == 5
    assert not INDEX.exists()
