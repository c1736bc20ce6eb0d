"""Writing a chain (`procedures/chain.py`): what was added is durable before anybody hears of it."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from procedures.chain import AROUND, FRAME, LAST, MAGIC, NOTHING, SECTOR, Bytes, Head

AHEAD = 1_000_000  # bytes of zeros that are written at a time

Content = tuple[bytes, int, Sequence[Bytes]]  # kind and id of a frame, parts of its content


class ChainWriter:
    """The one writer of a chain: what `append` is given is durable, in one piece, when it returns.

    Everything raises OSError. After a sync that failed nothing is written any more: the system then forgets what it
    had not written, and a later sync that succeeds says nothing of it. After a head that could not be written neither.
    """

    def __init__(self, path: Path, head_path: Path, head: Head, flags: int) -> None:
        """Opens the files, to go on behind what the head tells of."""
        self.head = head
        self._flags = flags
        self._broken = False
        with contextlib.ExitStack() as undo:
            self._file = undo.enter_context(_opened(path))
            self._head_file = undo.enter_context(_opened(head_path))
            self._size = os.fstat(self._file).st_size
            self._open = undo.pop_all()

    def close(self) -> None:
        self._open.close()

    def append(self, frames: Sequence[Content], *, points: int = 0, events: int = 0) -> None:
        """Adds frames (kind, id, parts of the content), with which so many points and events are complete."""
        if self._broken:
            raise OSError(0, "an earlier write or sync failed, nothing is written behind it")
        parts, head = packed(self.head, frames, self._flags, points, events)
        try:
            self._write(self._file, parts, self.head.length)
        except OSError:
            with contextlib.suppress(OSError):  # what was begun is not to be met again
                os.ftruncate(self._file, self.head.length)
                self._size = self.head.length
            raise
        self._grow(head.length)
        self._sync(self._file)
        self._tell(head)

    def confirm(self, tail: bytes, head: Head) -> None:
        """Puts frames that are there, and of which the head does not tell, on disk, and tells of them."""
        self._write(self._file, [tail], self.head.length)  # the same bytes over themselves: nothing is torn
        os.ftruncate(self._file, head.length)
        self._size = 0
        self._grow(head.length)
        self._sync(self._file)
        if tail:
            self._tell(head)

    def end(self) -> None:
        """Leaves the file without zeros, and both entries of the head with what the last one said."""
        os.ftruncate(self._file, self.head.length)
        self._sync(self._file)
        self._tell(self.head)

    def _grow(self, length: int) -> None:
        """Behind frames that end there are zeros, as far as there is space for them."""
        if length > self._size:
            with contextlib.suppress(OSError):
                self._write(self._file, [bytes(AHEAD)], length)
            self._size = os.fstat(self._file).st_size

    def _tell(self, so_far: Head) -> None:
        head = replace(so_far, turn=self.head.turn + 1)
        try:
            self._write(self._head_file, [head.packed()], SECTOR * (head.turn % 2))
        except OSError:
            self._broken = True  # it may tell of these frames by now, which must not be written over
            raise
        self._sync(self._head_file)
        self.head = head

    def _write(self, handle: int, parts: Sequence[Bytes], at: int) -> None:
        content = memoryview(b"".join(parts))
        while content:
            done = os.pwrite(handle, content, at)
            content, at = content[done:], at + done

    def _sync(self, handle: int) -> None:
        try:
            os.fdatasync(handle)
        except OSError:
            self._broken = True
            raise


def packed(
    head: Head, frames: Sequence[Content], flags: int, points: int = 0, events: int = 0
) -> tuple[list[Bytes], Head]:
    """Frames behind those that `head` tells of, as they lie in the file, and the head with them."""
    parts: list[Bytes] = []
    number, length, before = head.frames, head.length, head.hash
    for left, (kind, own, content) in zip(range(len(frames))[::-1], frames, strict=True):
        size = sum(map(len, content))
        start = FRAME.pack(MAGIC, head.chain, number, kind, own, flags if left else flags | LAST, size, before)
        total = hashlib.sha256(start)
        for part in content:
            total.update(part)
        before = total.digest()
        parts += [start, *content, before]
        number, length = number + 1, length + AROUND + size
    points, events = head.points + points, head.events + events
    return parts, replace(head, frames=number, length=length, points=points, events=events, hash=before)


def create(path: Path, head_path: Path, chain: bytes, frames: Sequence[Content], flags: int) -> None:
    """Makes the files of a chain, its own aside and renamed, so that a killed start leaves a whole one or none.

    The head tells of nothing yet: one that tells of something, and has no chain beside it, has lost it.
    """
    aside = path.with_name(f"{path.name}.new")
    head = Head(chain, 0, 0, 0, 0, 0, NOTHING)
    parts, _ = packed(head, frames, flags)
    try:
        aside.write_bytes(b"".join(parts))
        head_path.write_bytes(head.packed() + head.again().packed())
        for file in (aside, head_path):
            sync(file)
        aside.replace(path)
        sync(path.parent)
    except BaseException:
        for file in (aside, path, head_path):
            file.unlink(missing_ok=True)
        raise


def sync(path: Path) -> None:
    """Makes a file durable, or the names in a folder, which syncing a file does not."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[int]:
    handle = os.open(path, os.O_RDWR)
    try:
        yield handle
    finally:
        os.close(handle)
