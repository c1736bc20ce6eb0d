"""A chain of frames and the frames of a record: what their bytes are, where they end, and how damage is told.

Names of the modules of records are used: no door shows what a killed writer leaves, and which bytes are damaged how.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.instrument import durable
from palpate.procedures.records import chain, record_file
from palpate.procedures.records.chain import (
    AROUND,
    FRAME,
    HEAD_FILE,
    LARGEST_ROW,
    MAGIC,
    NOTHING,
    READINGS,
    RECORD,
    SECTOR,
    ChainFile,
    ChainWriter,
    Content,
    Head,
    create,
    head_of,
    opened,
    packed,
    read_head,
)
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.record_file import (
    SIMULATED,
    Record,
    as_json,
    chain_of,
    event_frame,
    header_frame,
    point_frames,
    status_frame,
    whole_waveforms,
)
from tests.procedures.conftest import HEADER
from tests.runs import flip

NAME = b"0123456789abcdef"
BEGINNING = Head(NAME, 0, 0, 0, 0, 0, NOTHING)
ADDITIONS: list[list[Content]] = [
    [(b"HEAD", 0, [b"header"])],
    [(b"WAVE", 1, [b"samples", b""]), (b"POIN", 1, [b"a point"])],
    [(b"EVNT", 1, [b""])],
]


def written(additions: Sequence[list[Content]] = ADDITIONS, head: Head = BEGINNING) -> tuple[bytes, Head]:
    """The bytes of a chain, and the head that counts them."""
    content = b""
    for frames in additions:
        parts, head = packed(head, frames, 0)
        content += b"".join(parts)
    return content, head


CONTENT, COUNTED = written()


def put(folder: Path, content: bytes = CONTENT, entries: Sequence[bytes] | None = None) -> Path:
    """A chain's two files."""
    (folder / "record").write_bytes(content)
    turns = (replace(COUNTED, turn=2), replace(COUNTED, turn=3))
    (folder / "head").write_bytes(b"".join(head.packed() for head in turns) if entries is None else b"".join(entries))
    return folder / "record"


# --- the head ------------------------------------------------------------------------------------------


ONE, TWO = replace(COUNTED, turn=2).packed(), replace(COUNTED, turn=3).packed()
FOUR = replace(COUNTED, turn=4, points=9).packed()


@pytest.mark.parametrize(
    ("entries", "turn", "whole"),
    [
        ([ONE, TWO], 3, True),
        ([FOUR, TWO], 4, True),
        ([TWO, ONE], 3, False),  # each in the sector of the other
        ([ONE, ONE], 2, False),
        ([ONE, replace(COUNTED, turn=5).packed()], 5, False),  # one in between was never written
        ([ONE, replace(COUNTED, turn=3, chain=b"x" * 16).packed()], 3, False),  # of two chains
        ([ONE, bytes(SECTOR)], 2, False),
        ([bytes(SECTOR), TWO], 3, False),
        ([ONE], 2, False),
        ([ONE, TWO, b"\0"], 3, False),
        ([], None, False),
    ],
)
def test_a_head_is_whole_where_both_entries_follow_each_other_each_in_its_sector(
    entries: list[bytes], turn: int | None, whole: bool, tmp_path: Path
) -> None:
    put(tmp_path, entries=entries)
    head, fault = read_head(tmp_path / "head")
    assert (head.turn if head else None) == turn
    assert (fault == "") == whole
    assert whole or fault == "head is not as it was written; whether the last points are there cannot be told"


@pytest.mark.parametrize(("torn", "whole"), [(READINGS - 1, True), (READINGS, False)])
def test_a_head_that_is_just_being_written_is_read_again(
    torn: int, whole: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path)
    reads = []

    def read(_file: ChainFile, at: int, length: int) -> bytes:
        reads.append((at, length))
        return ONE + (TWO[:88] + bytes(424) if len(reads) <= torn else TWO)

    monkeypatch.setattr(ChainFile, "read", read)
    head, fault = read_head(tmp_path / "head")
    assert (head and head.turn, fault == "") == ((3, True) if whole else (2, False))
    assert reads == [(0, 1025)] * READINGS


# --- the file ------------------------------------------------------------------------------------------


def test_bytes_are_read_from_their_place_however_few_the_system_gives_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pread, end = os.pread, len(CONTENT)
    monkeypatch.setattr(os, "pread", lambda handle, length, at: pread(handle, min(length, 7), at))
    with ChainFile(put(tmp_path)) as file:
        found = [file.read(at, length) for at, length in ((3, 50), (end - 5, 50), (end, 50), (3, 0))]
        assert (file.size, found) == (end, [CONTENT[3:53], CONTENT[-5:], b"", b""])


@pytest.mark.parametrize(("length", "there"), [(LARGEST_ROW, True), (LARGEST_ROW + 1, False)])
def test_a_frame_is_not_longer_than_the_largest_row(length: int, there: bool, tmp_path: Path) -> None:
    """Otherwise a forged length would fill the memory."""
    path = put(tmp_path, FRAME.pack(MAGIC, NAME, 0, b"HEAD", 0, 0, length, NOTHING))
    os.truncate(path, LARGEST_ROW + 1000)
    with ChainFile(path) as file:
        assert (file.frame(0) is not None) == there


def test_a_walk_checks_contents_only_behind_what_the_head_counts(tmp_path: Path) -> None:
    at = CONTENT.index(b"samples")
    with ChainFile(put(tmp_path, CONTENT[:at] + b"x" + CONTENT[at + 1 :])) as file:
        for counted, kinds in ((4, 4), (2, 4), (1, 1), (0, 1)):
            assert len(list(file.walk(replace(COUNTED, frames=counted)))) == kinds
        assert len(list(file.walk(None))) == 1


def other(head: Head) -> bytes:
    """One more frame that follows another head."""
    return b"".join(packed(head, [(b"EVNT", 2, [b""])], 0)[0])


@pytest.mark.parametrize(
    ("follows", "belongs"),
    [
        (COUNTED, True),
        (replace(COUNTED, frames=9), False),  # its number
        (replace(COUNTED, hash=NOTHING), False),  # the hash before
        (replace(COUNTED, chain=b"x" * 16), False),
    ],
)
def test_a_chain_ends_where_a_frame_does_not_follow_the_one_before(
    follows: Head, belongs: bool, tmp_path: Path
) -> None:
    with ChainFile(put(tmp_path, CONTENT + other(follows))) as file:
        assert len(list(file.walk(COUNTED))) == 4 + belongs
        assert len(list(file.scan())) == 5  # it is whole


@pytest.mark.parametrize("between", [b"", b"x", MAGIC, MAGIC * 9, CONTENT[:90], bytes(70)])
def test_whole_frames_are_found_among_other_bytes(
    between: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = other(COUNTED)
    with ChainFile(put(tmp_path, between + frame + between + frame + between)) as file:
        for at_a_time in (16, 61, 1_000_000):  # also where the magic bytes lie in two pieces
            monkeypatch.setattr(chain, "AT_A_TIME", at_a_time)
            found = [frame.at for frame in file.scan()]
            assert found == [len(between), 2 * len(between) + len(frame)]


# --- the chain -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("counted", "behind", "whole"),
    [
        (3, b"", True),
        (2, b"", True),  # the writer is one addition ahead
        (1, b"", False),
        (2, b"\0\0", True),
        (2, b"\0x", False),  # behind an addition there is nothing
        (3, b"x", True),  # an addition that was not finished
    ],
)
def test_behind_what_the_head_counts_lies_one_addition_at_most(
    counted: int, behind: bytes, whole: bool, tmp_path: Path
) -> None:
    _, head = written(ADDITIONS[:counted])
    path = put(tmp_path, CONTENT + behind, [replace(head, turn=2).packed(), replace(head, turn=3).packed()])
    older = pytest.raises(ValueError, match=r"^head is older than the rows that it counts$")
    with nullcontext() if whole else older, opened(path, tmp_path / "head") as found:
        assert [frame.kind for frame in found.frames] == [b"HEAD", b"WAVE", b"POIN", b"EVNT"]


# --- the writer ----------------------------------------------------------------------------------------


FRAMES: list[Content] = [(b"PART", 3, [b"first ", b"content"]), (b"MORE", 4, [b"second"])]
LENGTH = 2 * AROUND + len(b"first contentsecond")


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[ChainWriter]:
    create(tmp_path / "record", tmp_path / "head", NAME, [], 0)
    made = ChainWriter(tmp_path / "record", tmp_path / "head", Head(NAME, 1, 0, 0, 0, 0, NOTHING), 0)
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


def test_what_a_killed_writer_left_is_written_again_and_then_counted(
    writer: ChainWriter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer.append(FRAMES)
    parts, head = packed(writer.head, FRAMES, 0, points=1)
    tail = b"".join(parts)
    done = watch(monkeypatch)
    writer.confirm(tail, head)
    assert (done[0], done[-3:]) == (("write", "record"), [("sync", "record"), ("write", "head"), ("sync", "head")])
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


# --- the frames of a record ----------------------------------------------------------------------------


SAMPLES = np.array([1.5, -2.0, np.nan], dtype="<f4")


@pytest.mark.parametrize(
    ("value", "json_"),
    [
        ({"b": 1, "a": [True, None]}, '{"a":[true,null],"b":1}'),
        ("µ", '"\\u00b5"'),
        (float("nan"), "null"),
        ([float("inf"), -float("inf"), 1.0], "[null,null,1.0]"),
        (np.float32(0.5), "0.5"),
        (np.int64(3), "3"),
        (np.float64("nan"), "null"),
        (np.bool_(True), "true"),
        (np.arange(3), "[0,1,2]"),
        ((1, (2, np.array([np.nan]))), "[1,[2,[null]]]"),
        ({"a": {"b": np.float64(1.5)}}, '{"a":{"b":1.5}}'),
    ],
)
def test_values_are_canonical_json_with_null_for_what_is_not_finite(value: object, json_: str) -> None:
    assert as_json(value) == json_


# --- what a reader makes of them -------------------------------------------------------------------------


def put_record(folder: Path, *additions: list[Content], counted: int | None = None, name: bytes | None = None) -> None:
    """The two files of a record; the head counts so many additions, all where None."""
    head = Head(chain_of(HEADER) if name is None else name, 0, 0, 0, 0, 0, NOTHING)
    content, at_end = b"", head
    for number, frames in enumerate(additions):
        kinds = [frame[0] for frame in frames]
        parts, at_end = packed(at_end, frames, 1, kinds.count(b"POIN"), kinds.count(b"EVNT"))
        content += b"".join(parts)
        if counted is None or number < counted:
            head = at_end
    folder.mkdir(exist_ok=True)
    (folder / RECORD).write_bytes(content)
    (folder / HEAD_FILE).write_bytes(b"".join(replace(head, turn=turn).packed() for turn in (2, 3)))


def rest(head: Head) -> tuple[int, int, int, int, bytes]:
    return head.frames, head.length, head.points, head.events, head.hash


def point(number: int, **data: object) -> list[Content]:
    return point_frames(number, data, {"film": (250.0, SAMPLES + number), "total": (100.0, SAMPLES)}, 10 * number)


BEGINS = [header_frame(HEADER)]


@contextmanager
def record(folder: Path, *additions: list[Content], **given: Any) -> Iterator[Record]:
    put_record(folder, *additions, **given)
    with record_file.opened(folder) as found:
        yield found


def test_frames_of_other_kinds_are_ignored_but_must_be_whole(tmp_path: Path) -> None:
    with record(tmp_path, BEGINS, [(b"NEWS", 0, [b"{}"])]) as found:
        assert found.count() == 0
    flip(tmp_path / RECORD, b"{}")
    with pytest.raises(ValueError, match=r"^row 1 is not as it was written$"), record_file.opened(tmp_path):
        pass


@pytest.mark.parametrize(
    ("additions", "given", "says"),
    [
        ([[event_frame(1, "k", "m", 0)]], {}, "KeyError|format"),
        ([[(b"HEAD", 0, [b'{"format":5,"header":{}}'])]], {}, "its record format is not 4"),
        ([[(b"BODY", 0, [b'{"format":4,"header":{}}'])]], {}, "its record format is not 4"),
        ([BEGINS], {"name": b"x" * 16}, "its header belongs to other rows"),
        ([BEGINS, [(b"POIN", 1, [b"{}"]), (b"POIN", 1, [b"{}"])]], {}, "some of its 2 points and 0 events are missing"),
    ],
)
def test_a_record_that_does_not_hang_together_is_refused(
    additions: list[list[Content]], given: dict[str, Any], says: str, tmp_path: Path
) -> None:
    with pytest.raises((ValueError, KeyError), match=says), record(tmp_path, *additions, **given):
        pass


# --- what a killed writer leaves -------------------------------------------------------------------------


def test_what_lies_behind_the_head_is_confirmed_up_to_the_last_whole_addition(tmp_path: Path) -> None:
    with record(tmp_path, BEGINS, point(1), point(2), counted=2) as found:
        content = (tmp_path / RECORD).read_bytes()
        assert rest(found.head_at_end()) == (7, len(content), 2, 0, found.frames[-1].hash)
        assert found.tail() == content[found.head.length :]


def test_waveforms_without_their_point_are_not_confirmed_and_damage_in_them_is_a_fault(tmp_path: Path) -> None:
    with record(tmp_path, BEGINS, point(1), point(2)[:1], counted=2) as found:
        assert (found.tail(), rest(found.head_at_end()), list(found.faults())) == (b"", rest(found.head), [])
    put_record(tmp_path, BEGINS, point(1)[:1])  # which the head counts: they were written by a repair
    flip(tmp_path / RECORD, b'"rate":250.0}\n', 20)
    with record_file.opened(tmp_path) as found:
        assert found.head_at_end().frames == 2
        assert list(found.faults()) == ["a waveform of point 1 is not as it was written"]


@pytest.mark.parametrize(
    ("status", "faults"), [("complete", ["run.record goes on after its end, from byte {} on"]), ("stopped", [])]
)
def test_a_finished_run_goes_on_with_nothing_but_zeros(status: str, faults: list[str], tmp_path: Path) -> None:
    put_record(tmp_path, BEGINS, [status_frame(status, {})])
    content = (tmp_path / RECORD).read_bytes()
    for behind, told in ((bytes(9), []), (bytes(9) + b"x", faults)):
        (tmp_path / RECORD).write_bytes(content + behind)
        with record_file.opened(tmp_path) as found:
            assert list(found.faults()) == [fault.format(len(content)) for fault in told]


# --- waveforms in pieces -------------------------------------------------------------------------------

Pieces = list[tuple[int, str, float, list[float]]]


@pytest.mark.parametrize(
    ("pieces", "found"),
    [
        ([(0, "film", 250.0, [1.0, 2.0, 3.0])], [1.0, 2.0, 3.0]),
        ([(2, "film", 250.0, [3.0]), (0, "film", 250.0, [1.0, 2.0])], [1.0, 2.0, 3.0]),  # in another order
        ([(0, "film", 250.0, [1.0, 2.0]), (0, "film", 250.0, [1.0, 2.0]), (2, "film", 250.0, [3.0])], [1.0, 2.0, 3.0]),
        ([(0, "film", 250.0, [1.0, 2.0])], None),
        ([(1, "film", 250.0, [2.0, 3.0])], None),
        ([(0, "film", 250.0, [1.0]), (2, "film", 250.0, [3.0])], None),  # a gap
        ([(0, "film", 100.0, [1.0, 2.0, 3.0])], None),  # of another rate
        ([(0, "total", 250.0, [1.0, 2.0, 3.0])], None),
        ([(0, "film", 250.0, [1.0, 2.0, 3.0, 4.0])], None),
        ([], None),
    ],
)
def test_a_waveform_is_whole_where_its_pieces_join(pieces: Pieces, found: list[float] | None, tmp_path: Path) -> None:
    waves: list[Content] = [
        (
            b"WAVE", 1,
            [as_json({"first": first, "name": name, "rate": rate}).encode() + b"\n", np.array(values, "<f4").tobytes()],
        )
        for first, name, rate, values in pieces
    ]  # fmt: skip
    put_record(tmp_path, BEGINS, waves)
    with ChainFile(tmp_path / RECORD) as file:
        whole = whole_waveforms(file, list(file.walk(None))[1:], [["film", 250.0, 3]])
    assert {name: samples.tolist() for name, samples in whole.items()} == ({} if found is None else {"film": found})


def test_a_point_whose_waveform_is_not_whole_is_told_when_it_is_read(tmp_path: Path) -> None:
    _, *others = point(1)
    with record(tmp_path, BEGINS, others) as found:
        with pytest.raises(ValueError, match=r"^waveform 'film' of point 1 is not as it was written$"):
            list(found.waveforms(1))
        assert found.count() == 1
