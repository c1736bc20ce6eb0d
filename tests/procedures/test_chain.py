"""A chain of frames by itself: what its bytes are, where it ends, and how damage is told."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.procedures.records import chain
from palpate.procedures.records.chain import (
    FRAME,
    LARGEST_ROW,
    MAGIC,
    NOTHING,
    READINGS,
    SECTOR,
    ChainFile,
    Content,
    Head,
    opened,
    packed,
    read_head,
)

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


@pytest.mark.parametrize("size", [0, 1, 9, 10, 11, 25])
def test_zeros_are_only_zeros_to_their_end(size: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chain, "AT_A_TIME", 10)
    with ChainFile(put(tmp_path, b"x" + bytes(size) + b"x" + bytes(size))) as file:
        assert [file.only_zeros(at) for at in (0, 1, size + 2)] == [False, False, True]


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
