"""The writer of a chain: what is on disk before what, and what is left where a write or a sync fails."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from palpate.instrument import durable
from palpate.procedures.records import chain
from palpate.procedures.records.chain import (
    AROUND,
    NOTHING,
    RECORD,
    SECTOR,
    ChainFile,
    ChainWriter,
    Content,
    Head,
    create,
    head_of,
    packed,
)
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.record_file import SIMULATED
from tests.procedures.conftest import HEADER

CHAIN = b"0123456789abcdef"
FRAMES: list[Content] = [(b"PART", 3, [b"first ", b"content"]), (b"MORE", 4, [b"second"])]
LENGTH = 2 * AROUND + len(b"first contentsecond")


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[ChainWriter]:
    create(tmp_path / "record", tmp_path / "head", CHAIN, [], 0)
    made = ChainWriter(tmp_path / "record", tmp_path / "head", Head(CHAIN, 1, 0, 0, 0, 0, NOTHING), 0)
    yield made
    made.close()


def watch(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Writes and syncs from now on, each with its file."""
    done = list[tuple[str, str]]()

    def noted(what: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def called(handle: int, *given: Any) -> Any:
            done.append((what, Path(f"/dev/fd/{handle}").readlink().name))
            return call(handle, *given)

        return called

    monkeypatch.setattr(os, "pwrite", noted("write", os.pwrite))
    monkeypatch.setattr(os, "fdatasync", noted("sync", os.fdatasync))
    return done


def test_frames_are_on_disk_before_the_head_counts_them_and_the_head_before_the_caller_goes_on(
    writer: ChainWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer.append(FRAMES)  # writes zeros ahead as well
    done = watch(monkeypatch)
    writer.append(FRAMES, points=1)
    assert done == [("write", "record"), ("sync", "record"), ("write", "head"), ("sync", "head")]


def test_the_head_counts_in_turn_in_two_sectors_and_an_ended_chain_has_no_zeros_and_its_head_twice(
    writer: ChainWriter, tmp_path: Path
) -> None:
    def heads() -> list[tuple[int, ...]]:
        entries = (tmp_path / "head").read_bytes()
        found = [head_of(entries[at : at + SECTOR]) for at in (0, SECTOR)]
        return [(h.turn, h.frames, h.length, h.points, h.events) for h in found if h]

    writer.append(FRAMES, points=1, events=2)
    writer.append(FRAMES, points=3)
    assert heads() == [(2, 2, LENGTH, 1, 2), (3, 4, 2 * LENGTH, 4, 2)]
    assert (tmp_path / "record").stat().st_size > 2 * LENGTH
    writer.end()
    assert (tmp_path / "record").stat().st_size == 2 * LENGTH
    assert heads() == [(4, 4, 2 * LENGTH, 4, 2), (3, 4, 2 * LENGTH, 4, 2)]


def test_a_new_chain_is_on_disk_before_it_has_its_name_and_its_name_before_it_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise a loss of power could leave a name without content, or a run that has begun without a file."""
    done = list[tuple[str, str]]()
    replace = Path.replace

    def renamed(path: Path, target: Path) -> Path:
        done.append(("named", target.name))
        return replace(path, target)

    monkeypatch.setattr(chain, "sync", lambda path: done.append(("synced", path.name)))
    monkeypatch.setattr(Path, "replace", renamed)
    create(tmp_path / "record", tmp_path / "head", CHAIN, FRAMES, 0)
    assert done == [("synced", "record.new"), ("synced", "head"), ("named", "record"), ("synced", tmp_path.name)]


def test_what_a_killed_writer_left_is_written_again_and_then_counted(
    writer: ChainWriter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer.append(FRAMES)
    parts, head = packed(writer.head, FRAMES, 0, points=1)
    tail = b"".join(parts)
    done = watch(monkeypatch)
    writer.confirm(tail, head)
    assert done[0] == ("write", "record")
    assert done[-3:] == [("sync", "record"), ("write", "head"), ("sync", "head")]
    assert (writer.head.frames, writer.head.points) == (4, 1)
    content = (tmp_path / "record").read_bytes()
    assert content[LENGTH : 2 * LENGTH] == tail
    assert not any(content[2 * LENGTH :])  # what lay behind is gone
    done.clear()
    writer.confirm(b"", writer.head)  # nothing was left
    assert ("write", "head") not in done


# --- a recorder ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("simulated", [True, False])
def test_every_frame_of_a_run_says_whether_it_is_simulated_and_its_folders_are_synced_with_their_names(
    simulated: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced = list[Path]()
    monkeypatch.setattr(durable, "sync", synced.append)
    with Recorder.create(tmp_path / "new" / "run", {**HEADER, "simulated": simulated}) as recorder:
        recorder.point({"load_N": 2.0}, {}, 0)
        recorder.finish("complete", {})
    with ChainFile(tmp_path / "new" / "run" / RECORD) as file:
        assert [bool(frame.flags & SIMULATED) for frame in file.scan()] == [simulated] * 3
    assert set(synced) == {tmp_path, tmp_path / "new"}
