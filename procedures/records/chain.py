"""An append-only file of frames, each with the hash of the one before it, and a head of fixed size beside it.

A frame describes itself: magic bytes, the chain it belongs to, its number, kind and id, its length, the hash of the
frame before, then its content and the SHA-256 over all of that. So whole frames can be found by their magic bytes, and
a changed, missing or moved frame breaks the chain. A chain that lost its end would still be a chain. Therefore the
head, a file of its own, tells how long the chain is. It is synced after the frames, so that it never counts frames that
are not on disk. It has two entries, each in a sector of its own. They are written in turn, so that one of them is whole
whenever the power fails. They are counted, so that an entry that was overwritten by an older one is noticed.

Behind the frames the file holds zeros until it is closed: writing over zeros needs one sync less than making the file
longer.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import stat
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from palpate.procedures.records.encoding import LARGEST_ROW

MAGIC = b"\x89PALPATE"
FRAME = struct.Struct("<8s16sQ4sIII32s")  # magic, chain, number, kind, id, flags, length of the content, hash before
_HEAD = struct.Struct("<8s16sQQQQQ32s")  # magic, chain, turn, frames, length, points, events, hash of the last frame
HASH = 32  # bytes
AROUND = FRAME.size + HASH  # bytes of a frame beside its content
MOST_IN_VAIN = 4_000_000_000  # bytes hashed for false frames: a forged file could ask for any number
SECTOR = 512  # bytes; a disk writes a sector whole or not at all
AT_A_TIME = 1_000_000  # bytes that a search reads at once
READINGS = 3  # tries to read a head that is not whole: it may just be being written
NOTHING = bytes(HASH)  # hash before the first frame

LAST = 1 << 31  # flag of the last frame of each addition

Bytes = bytes | memoryview


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame in a file: `at` is where it begins, `hash` is the hash that it holds of itself."""

    chain: bytes
    number: int
    kind: bytes
    id: int
    flags: int
    length: int
    before: bytes
    hash: bytes
    at: int

    @property
    def end(self) -> int:
        return self.at + AROUND + self.length


@dataclass(frozen=True, slots=True)
class Head:
    """Length of a chain: number of its frames, their bytes, the points and events in them, and the last hash.

    `turn` counts the entries of the head's file from 0. Even ones are written to its first sector, odd ones to its
    second.
    """

    chain: bytes
    turn: int
    frames: int
    length: int
    points: int
    events: int
    hash: bytes

    def packed(self) -> bytes:
        """The bytes of an entry of the head's file."""
        told = (self.turn, self.frames, self.length, self.points, self.events, self.hash)
        content = _HEAD.pack(MAGIC, self.chain, *told)
        return (content + hashlib.sha256(content).digest()).ljust(SECTOR, b"\0")

    def again(self) -> Head:
        """The same numbers as the next entry."""
        return replace(self, turn=self.turn + 1)


def head_of(entry: bytes) -> Head | None:
    """Read an entry of the head's file. None: it is damaged."""
    content, check = entry[: _HEAD.size], entry[_HEAD.size : _HEAD.size + HASH]
    if hashlib.sha256(content).digest() != check or any(entry[_HEAD.size + HASH :]):
        return None
    magic, *fields = _HEAD.unpack(content)
    return Head(*fields) if magic == MAGIC and len(entry) == SECTOR else None


def read_head(path: Path) -> tuple[Head | None, str]:
    """The newer undamaged entry of a head's file, and what is wrong with the file ("": nothing)."""
    for _ in range(READINGS):
        try:
            with ChainFile(path) as file:
                content = file.read(0, 2 * SECTOR + 1)
        except OSError as error:
            return None, f"{path.name}: {error.strerror}; whether the last points are there cannot be told"
        head, fault = _newer(content, path.name)
        if not fault:
            break
    return head, fault


def _newer(content: bytes, name: str) -> tuple[Head | None, str]:
    entries = [head_of(content[:SECTOR]), head_of(content[SECTOR : 2 * SECTOR])]
    whole = sorted((head for head in entries if head is not None), key=lambda head: head.turn)
    newer = whole[-1] if whole else None
    match whole:
        case [one, two] if len(content) == 2 * SECTOR and one.chain == two.chain and one.turn + 1 == two.turn:
            if entries[two.turn % 2] == two:
                return newer, ""
    return newer, f"{name} is not as it was written; whether the last points are there cannot be told"


class ChainFile:
    """The file of a chain, for reading frame by frame. All methods raise OSError."""

    def __init__(self, path: Path) -> None:
        self._handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe would be waited for
        if not stat.S_ISREG(os.fstat(self._handle).st_mode):
            os.close(self._handle)
            raise OSError(errno.EINVAL, "It is no file")

    @property
    def size(self) -> int:
        """Size of the file, which may be growing [bytes]."""
        return os.fstat(self._handle).st_size

    def __enter__(self) -> ChainFile:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._handle)

    def read(self, at: int, length: int) -> bytes:
        """Read so many bytes; fewer where the file ends."""
        parts = []
        while length > 0 and (part := os.pread(self._handle, length, at)):
            parts.append(part)
            at, length = at + len(part), length - len(part)
        return b"".join(parts)

    def frame(self, at: int) -> Frame | None:
        """The frame that begins at a place; None: none begins there and ends within the file.

        Its content is not checked.
        """
        start = self.read(at, FRAME.size)
        if len(start) < FRAME.size or not start.startswith(MAGIC):
            return None
        _, chain, number, kind, own, flags, length, before = FRAME.unpack(start)
        if length > LARGEST_ROW or at + AROUND + length > self.size:
            return None
        check = self.read(at + FRAME.size + length, HASH)
        return Frame(chain, number, kind, own, flags, length, before, check, at) if len(check) == HASH else None

    def content(self, frame: Frame) -> bytes | None:
        """Content of a frame; None: the frame is damaged."""
        whole = self.read(frame.at, AROUND + frame.length)
        body = memoryview(whole)[:-HASH]
        if hashlib.sha256(body).digest() != frame.hash or whole[-HASH:] != frame.hash:
            return None
        return bytes(body[FRAME.size :])

    def walk(self, head: Head | None) -> Iterator[Frame]:
        """Frames of the chain from the first one to where the chain breaks or ends.

        Of frames that the head counts only the links are checked, because the head's hash proves them. Behind them each
        frame is checked as a whole, since frames that were not yet acknowledged may be torn.
        """
        at, number, before, chain = 0, 0, NOTHING, None
        while (frame := self.frame(at)) is not None:
            if (frame.number, frame.before) != (number, before) or chain not in (None, frame.chain):
                return
            if (head is None or number >= head.frames) and self.content(frame) is None:
                return
            yield frame
            at, number, before, chain = frame.end, number + 1, frame.hash, frame.chain

    def scan(self) -> Iterator[Frame]:
        """Every undamaged frame, wherever it lies. The search ends after too many bytes of false frames."""
        at, in_vain = 0, 0
        while (at := self._find(MAGIC, at)) >= 0 and in_vain < MOST_IN_VAIN:
            frame = self.frame(at)
            if frame is not None and self.content(frame) is not None:
                yield frame
                at = frame.end
            else:
                in_vain += 0 if frame is None else frame.length
                at += len(MAGIC)

    def only_zeros(self, at: int) -> bool:
        """Whether only zeros follow."""
        while part := self.read(at, AT_A_TIME):
            if part.strip(b"\0"):
                return False
            at += len(part)
        return True

    def _find(self, what: bytes, at: int) -> int:
        while len(part := self.read(at, AT_A_TIME)) >= len(what):
            if (found := part.find(what)) >= 0:
                return at + found
            at += len(part) - len(what) + 1
        return -1


@dataclass(frozen=True, slots=True)
class Chain:
    """A chain whose links are checked as far as its head counts. Contents are verified when they are read."""

    file: ChainFile
    head: Head
    frames: list[Frame]


@contextlib.contextmanager
def opened(path: Path, head_path: Path) -> Iterator[Chain]:
    """Open the chain in a file, also while it is being written. Raises OSError: no file; ValueError: it is damaged."""
    with ChainFile(path) as file:
        told = read_head(head_path)
        while True:
            try:
                chain = _linked(file, *told, head_path.name)
                break
            except ValueError:
                before, told = told, read_head(head_path)
                if told == before:  # otherwise the chain is being written and grew meanwhile
                    raise
        yield chain


def _linked(file: ChainFile, head: Head | None, fault: str, name: str) -> Chain:
    frames = list(file.walk(head))
    if head is None or fault:
        raise ValueError(fault)
    if not frames:
        raise ValueError("its first row is not as it was written")
    if frames[0].chain != head.chain:
        raise ValueError(f"{name} belongs to another run")
    if len(frames) < head.frames or (head.frames and frames[head.frames - 1].hash != head.hash):
        raise ValueError(f"some of its {head.frames} rows are missing, changed or not in their place")
    ends = [frame.end for frame in frames[head.frames :] if frame.flags & LAST]
    if len(ends) > 1 or not all(map(file.only_zeros, ends)):  # the writer is never further ahead
        raise ValueError(f"{name} is older than the rows that it counts")
    return Chain(file, head, frames)
