"""A list of runs by the index of their store: it says what reading the runs says, whatever became of runs and index."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from palpate.instrument.errors import RecordError
from palpate.procedures.records.record import Recorder
from tests.procedures.conftest import Palpate
from tests.runs import flip, rehash

STORE, INDEX = Path("runs"), Path("runs/runs.index")
COUNT = 30
LONG_AGO = 1_700_000_000  # s since 1970
Listed = Callable[[], list[dict[str, Any]]]


def aged(folder: Path) -> None:
    """The files of a run as if they had been written long ago."""
    for path in folder.iterdir():
        os.utime(path, (LONG_AGO, LONG_AGO))


@pytest.fixture
def listed(palpate: Palpate) -> Listed:
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


def anew(by_command: Listed) -> list[dict[str, Any]]:
    """The list without an index."""
    INDEX.unlink()
    return by_command()


def test_runs_that_have_not_changed_are_listed_without_being_read(
    listed: Listed, palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, table = listed(), palpate("runs", "list").out
    assert [(run["status"], run["points"], run["procedure"]) for run in before] == [
        ("complete", 1, "sweep-loads")
    ] * COUNT
    refused = Mock(side_effect=RecordError("it was read"))
    monkeypatch.setattr("palpate.procedures.records.run.Run.open", refused)
    assert (listed(), palpate("runs", "list").out) == (before, table)
    INDEX.unlink()
    assert {run["status"] for run in listed()} == {"damaged"}


def test_a_run_that_was_changed_removed_or_added_is_listed_as_it_is_now(listed: Listed) -> None:
    listed()
    rehash(STORE / "3", status="stopped")
    aged(STORE / "3")
    for name in ("4", "6"):
        shutil.rmtree(STORE / name)
    for name, other in (("5", "new"), ("3", "6")):
        shutil.copytree(STORE / name, STORE / other)
    now = {Path(run["run"]).name: run["status"] for run in listed()}
    assert (now["3"], now["6"], now["new"], now["5"]) == ("stopped", "stopped", "complete", "complete")
    assert "4" not in now and len(now) == COUNT
    assert listed() == anew(listed)


def test_a_run_that_was_changed_without_another_size_or_time_of_writing_is_read(listed: Listed) -> None:
    listed()
    flip(STORE / "3" / "run.record")
    aged(STORE / "3")
    assert [(Path(run["run"]).name, run["status"]) for run in listed() if run["fault"]] == [("3", "damaged")]
    assert listed() == anew(listed)


def test_runs_that_were_written_a_moment_ago_or_few_are_read_again_without_an_index(listed: Listed) -> None:
    """Each could be changed once more, and its files have the same times."""
    for path in STORE.glob("*/*"):
        path.touch()
    assert (len(listed()), INDEX.exists()) == (COUNT, False)
    for folder in [*STORE.iterdir()][5:]:
        shutil.rmtree(folder)
    for folder in STORE.iterdir():
        aged(folder)
    assert (len(listed()), INDEX.exists()) == (5, False)


def in_its_place(make: Callable[[Path], None]) -> Callable[[Path], None]:
    def made(index: Path) -> None:
        index.unlink()
        make(index)

    return made


DAMAGES: dict[str, Callable[[Path], object]] = {
    "lost": Path.unlink,
    "cut": lambda index: index.write_bytes(index.read_bytes()[:-1]),
    "another status": lambda index: index.write_bytes(index.read_bytes().replace(b'"complete"', b'"failed"')),
    "another version": lambda index: index.write_bytes(index.read_bytes().replace(b"runs 1", b"runs 9", 1)),
    "no text": lambda index: index.write_bytes(b"\xff\n{}"),
    "a folder, so that none can be written": in_its_place(os.mkdir),
    "a pipe": in_its_place(os.mkfifo),
    "a draft of a killed writer beside it": lambda index: (index.parent / ".runs.index.1.draft").write_bytes(b"{"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_whatever_became_of_the_index_the_runs_are_listed_as_they_are(damage: str, listed: Listed) -> None:
    before = listed()
    assert INDEX.is_file()
    DAMAGES[damage](INDEX)
    assert [listed(), listed()] == [before, before]


def test_the_index_is_the_old_or_the_new_one_when_its_writer_is_killed(
    listed: Listed, monkeypatch: pytest.MonkeyPatch, palpate: Palpate
) -> None:
    before, old = listed(), INDEX.read_bytes()
    for number in range(COUNT):
        aged(shutil.copytree(STORE / "0", STORE / f"more-{number}"))
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", Mock(side_effect=KeyboardInterrupt))
        assert palpate("runs", "list").status == 130
    assert INDEX.read_bytes() == old
    after = listed()
    assert len(after) == 2 * COUNT
    assert [run for run in after if "more" not in run["run"]] == before
    assert INDEX.read_bytes() != old
