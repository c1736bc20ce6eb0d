"""The writer of a chain: what is on disk before what, and what is left where a write or a sync fails."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from palpate.instrument import durable
from palpate.procedures.records import chain
from palpate.procedures.records.chain import (
    AROUND,
    FRAME,
    HASH,
    MAGIC,
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

CHAIN = b"0123456789abcdef"
FRAMES: list[Content] = [(b"PART", 3, [b"first ", b"content"]), (b"MORE", 4, [b"second"])]
LENGTH = 2 * AROUND + len(b"first contentsecond")


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[ChainWriter]:
    create(tmp_path / "record", tmp_path / "head", CHAIN, [], 0)
    made = ChainWriter(tmp_path / "record", tmp_path / "head", Head(CHAIN, 1, 0, 0, 0, 0, NOTHING), 0)
    yield made
    made.close()


def file_of(handle: int) -> str:
    """Name of an open file, as the system tells it."""
    return Path(f"/dev/fd/{handle}").readlink().name


def watch(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Writes and syncs from now on, each with its file."""
    done = list[tuple[str, str]]()
    pwrite, fdatasync = os.pwrite, os.fdatasync

    def write(handle: int, content: bytes, at: int) -> int:
        done.append(("write", file_of(handle)))
        return pwrite(handle, content, at)

    def sync(handle: int) -> None:
        done.append(("sync", file_of(handle)))
        fdatasync(handle)

    monkeypatch.setattr(os, "pwrite", write)
    monkeypatch.setattr(os, "fdatasync", sync)
    return done


def test_frames_are_on_disk_before_the_head_counts_them_and_the_head_before_the_caller_goes_on(
    writer: ChainWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer.append(FRAMES)  # writes zeros ahead as well
    done = watch(monkeypatch)
    writer.append(FRAMES, points=1)
    assert done == [("write", "record"), ("sync", "record"), ("write", "head"), ("sync", "head")]


def test_the_head_counts_frames_bytes_points_and_events_in_turn_in_two_sectors(
    writer: ChainWriter, tmp_path: Path
) -> None:
    writer.append(FRAMES, points=1, events=2)
    writer.append(FRAMES, points=3)
    entries = (tmp_path / "head").read_bytes()
    heads = [head_of(entries[at : at + SECTOR]) for at in (0, SECTOR)]
    assert [(h.turn, h.frames, h.length, h.points, h.events) for h in heads if h] == [
        (2, 2, LENGTH, 1, 2),
        (3, 4, 2 * LENGTH, 4, 2),
    ]
    assert heads[1] == writer.head


def test_a_frame_names_its_place_its_kind_and_the_frame_before_it() -> None:
    parts, head = packed(Head(CHAIN, 0, 5, 900, 0, 0, b"h" * HASH), FRAMES, 2)
    assert b"".join(map(bytes, parts[1:3])) == b"first content"
    first, second = (FRAME.unpack(parts[place]) for place in (0, 4))
    assert first == (MAGIC, CHAIN, 5, b"PART", 3, 2, 13, b"h" * HASH)
    assert second[:5] == (MAGIC, CHAIN, 6, b"MORE", 4)
    assert second[5] != first[5]  # the last of those that belong together
    assert second[7] == parts[3]  # the hash of the first
    assert (head.frames, head.length, head.hash) == (7, 900 + LENGTH, parts[-1])


def test_an_ended_chain_has_no_zeros_and_its_head_twice(writer: ChainWriter, tmp_path: Path) -> None:
    writer.append(FRAMES, points=1)
    assert (tmp_path / "record").stat().st_size > LENGTH
    writer.end()
    assert (tmp_path / "record").stat().st_size == LENGTH
    entries = (tmp_path / "head").read_bytes()
    one, other = (head_of(entries[at : at + SECTOR]) for at in (0, SECTOR))
    assert one and other
    assert one.again() == other or other.again() == one


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


def test_what_is_synced_is_synced_with_its_metadata_and_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced = list[str]()
    monkeypatch.setattr(os, "fsync", lambda handle: synced.append(str(Path(f"/proc/self/fd/{handle}").readlink())))
    before = len(list(Path("/proc/self/fd").iterdir()))
    chain.sync(tmp_path)
    assert synced == [str(tmp_path)]
    assert len(list(Path("/proc/self/fd").iterdir())) == before


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
def test_every_frame_of_a_run_says_whether_it_is_simulated(simulated: bool, tmp_path: Path) -> None:
    header = {"procedure": "sweep loads", "simulated": simulated, "started": "2025-03-14T15:09:26Z"}
    with Recorder.create(tmp_path / "run", header) as recorder:
        recorder.point({"load_N": 2.0}, {}, 0)
        recorder.finish("complete", {})
    with ChainFile(tmp_path / "run" / RECORD) as file:
        frames = list(file.scan())
    assert len(frames) >= 3
    assert {bool(frame.flags & SIMULATED) for frame in frames} == {simulated}


def test_folders_that_are_made_for_a_run_are_synced_with_their_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced = list[Path]()
    monkeypatch.setattr(durable, "sync", synced.append)
    header = {"procedure": "sweep loads", "simulated": True, "started": "2025-03-14T15:09:26Z"}
    Recorder.create(tmp_path / "new" / "run", header).close()
    assert set(synced) == {tmp_path, tmp_path / "new"}
