"""Writing a chain of frames (`procedures/records/chain.py`): frames are on disk before the caller goes on."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from palpate.instrument.durable import sync
from palpate.instrument.own_process import Ends
from palpate.procedures.records.chain import AROUND, FRAME, LAST, MAGIC, NOTHING, SECTOR, Bytes, Head

AHEAD = 1_000_000  # bytes of zeros that are written at a time

Content = tuple[bytes, int, Sequence[Bytes]]  # kind and id of a frame, parts of its content


class ChainWriter:
    """The one writer of a chain. When `append` returns, all frames that it was given are on disk.

    Every method raises OSError. After a sync has failed, nothing more is written: Linux drops the data that it could
    not write, and a later sync that succeeds would not bring it back. The same holds after the head could not be
    written.
    """

    def __init__(self, path: Path, head_path: Path, head: Head, flags: int) -> None:
        """Open the files, to go on behind the frames that the head counts. `flags` go into every frame."""
        self.head = head
        self._flags = flags
        self._broken = False
        with Ends() as undo:
            self._file = undo.enter_context(_opened(path))
            self._head_file = undo.enter_context(_opened(head_path))
            undo.close_in_child(self._file, self._head_file)
            self._size = os.fstat(self._file).st_size
            self._open = undo.pop_all()

    def close(self) -> None:
        self._open.close()

    def append(self, frames: Sequence[Content], *, points: int = 0, events: int = 0) -> None:
        """Add frames, each of a kind, an id and the parts of its content. They complete so many points and events."""
        if self._open.elsewhere:
            raise OSError(0, "it belongs to the process that this one was forked from; write it there")
        if self._broken:
            raise OSError(0, "an earlier write or sync failed, so nothing is written after it")
        parts, head = packed(self.head, frames, self._flags, points, events)
        try:
            self._write(self._file, parts, self.head.length)
        except OSError:
            with contextlib.suppress(OSError):  # half a frame must not stay behind the whole ones
                os.ftruncate(self._file, self.head.length)
                self._size = self.head.length
            raise
        self._grow(head.length)
        self._sync(self._file)
        self._tell(head)

    def confirm(self, tail: bytes, head: Head) -> None:
        """Write frames behind those that the head counts once more (`tail`) and sync them; then write `head`."""
        self._write(self._file, [tail], self.head.length)  # the same bytes: a crash changes nothing
        os.ftruncate(self._file, head.length)
        self._size = 0
        self._grow(head.length)
        self._sync(self._file)
        if tail:
            self._tell(head)

    def end(self) -> None:
        """Cut off the zeros at the end of the file, and write the last entry of the head a second time."""
        os.ftruncate(self._file, self.head.length)
        self._sync(self._file)
        self._tell(self.head)

    def _grow(self, length: int) -> None:
        """Write zeros ahead where frames of this length reach the end of the file; without them if the disk is full.

        To write over zeros takes one sync less than to make a file longer.
        """
        if length > self._size:
            with contextlib.suppress(OSError):
                self._write(self._file, [bytes(AHEAD)], length)
            self._size = os.fstat(self._file).st_size

    def _tell(self, so_far: Head) -> None:
        head = replace(so_far, turn=self.head.turn + 1)
        try:
            self._write(self._head_file, [head.packed()], SECTOR * (head.turn % 2))
        except OSError:
            self._broken = True  # the head may count these frames by now, so they must not be written over
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
    """The bytes of frames that follow those which `head` counts, and the head that counts them, too."""
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
    """Create the two files of a chain.

    The chain is written under another name and then renamed, so that a program which is killed meanwhile leaves a whole
    chain or none. The head counts no frames yet: a head that counts some, without a chain beside it, shows that the
    chain was lost.
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


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[int]:
    handle = os.open(path, os.O_RDWR)
    try:
        yield handle
    finally:
        os.close(handle)
