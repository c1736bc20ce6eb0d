"""An append-only file of frames, each with the hash of the one before it, and its head; and the names of a run's files.

A frame describes itself: magic bytes, the chain it belongs to, its number, kind and id, its length, the hash of the
frame before, then its content and the SHA-256 over all of that. So whole frames can be found by their magic bytes, and
a changed, missing or moved frame breaks the chain. A chain that lost its end would still be a chain. Therefore the
head, a file of its own, tells how long the chain is. It is synced after the frames, so that it never counts frames that
are not on disk. It has two entries, each in a sector of its own. They are written in turn, so that one of them is whole
whenever the power fails. They are counted, so that an entry that was overwritten by an older one is noticed.

Behind the frames the file holds zeros until it is closed: writing over zeros needs one sync less than making the file
longer. What is written is on disk before the caller goes on. A sparse file is refused before it is read: a hole of
200 GB takes no space on disk, but hours to read.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import os
import stat
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from palpate.instrument.durable import sync
from palpate.instrument.errors import RecordError
from palpate.instrument.own_process import Ends

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
LARGEST_ROW = 40_000_000  # bytes of a frame's content; a point has some thousand
AHEAD = 1_000_000  # bytes of zeros that are written at a time
MOST_HOLES = 1_000_000_000  # bytes of holes; a file of a run has none, a copy of it some MB

Bytes = bytes | memoryview
Content = tuple[bytes, int, Sequence[Bytes]]  # kind and id of a frame, parts of its content


@dataclass(frozen=True, slots=True)
class RecordFrame:
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
        numbers = (self.turn, self.frames, self.length, self.points, self.events, self.hash)
        content = _HEAD.pack(MAGIC, self.chain, *numbers)
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

    def frame(self, at: int) -> RecordFrame | None:
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
        return RecordFrame(chain, number, kind, own, flags, length, before, check, at) if len(check) == HASH else None

    def content(self, frame: RecordFrame) -> bytes | None:
        """Content of a frame; None: the frame is damaged."""
        whole = self.read(frame.at, AROUND + frame.length)
        body = memoryview(whole)[:-HASH]
        if hashlib.sha256(body).digest() != frame.hash or whole[-HASH:] != frame.hash:
            return None
        return bytes(body[FRAME.size :])

    def walk(self, head: Head | None) -> Iterator[RecordFrame]:
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

    def scan(self) -> Iterator[RecordFrame]:
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
class HashChain:
    """A chain whose links are checked as far as its head counts. Contents are verified when they are read."""

    file: ChainFile
    head: Head
    frames: list[RecordFrame]


@contextlib.contextmanager
def opened(path: Path, head_path: Path) -> Iterator[HashChain]:
    """Open the chain in a file, also while it is being written. Raises OSError: no file; ValueError: it is damaged."""
    with ChainFile(path) as file:
        head = read_head(head_path)
        while True:
            try:
                chain = _linked(file, *head, head_path.name)
                break
            except ValueError:
                before, head = head, read_head(head_path)
                if head == before:  # otherwise the chain is being written and grew meanwhile
                    raise
        yield chain


def _linked(file: ChainFile, head: Head | None, fault: str, name: str) -> HashChain:
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
    return HashChain(file, head, frames)


# --- writing -------------------------------------------------------------------------------------------


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
            self._file = undo.enter_context(_writable(path))
            self._head_file = undo.enter_context(_writable(head_path))
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
def _writable(path: Path) -> Iterator[int]:
    handle = os.open(path, os.O_RDWR)
    try:
        yield handle
    finally:
        os.close(handle)


# --- sparse files --------------------------------------------------------------------------------------


def check_holes(path: Path) -> None:
    """Refuse a file whose holes are too large. Raises RecordError. A path that is no file is left to its reader."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe would be waited for
    except OSError:
        return
    try:
        size = os.fstat(handle).st_size
        begins = _too_many(handle, size) if size > MOST_HOLES else None
    finally:
        os.close(handle)
    if begins is not None:
        raise RecordError(
            f"{path} is damaged (it is {size} bytes long, and more than {MOST_HOLES} of them were never written, a "
            f"hole from byte {begins} on); restore it from a copy, or cut it off there: truncate -s {begins}"
        )


def _too_many(handle: int, size: int) -> int | None:
    """Start of the hole with which all holes together become too large; None: they do not."""
    at = holes = 0
    while at < size:
        begins = os.lseek(handle, at, os.SEEK_HOLE)
        try:
            at = os.lseek(handle, begins, os.SEEK_DATA) if begins < size else size
        except OSError:  # no data follows
            at = size
        holes += at - begins
        if holes > MOST_HOLES:
            return begins
    return None


# --- The folder of a run: the names of its files, and whether it holds a run ---------------------------

RECORD, HEAD_FILE = "run.record", "run.head"


def is_run(folder: Path) -> bool:
    """Whether a folder holds a run or what is left of one; not if its writer was killed before the run had begun."""
    if _is_there(folder / RECORD):
        return True
    head = read_head(folder / HEAD_FILE)[0]
    return head is not None and head.frames > 0


def _is_there(path: Path) -> bool:
    """Whether anything has that name, even a broken link or a file that may not be read; its reader reports that."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:
        return True
    return True


def is_written(folder: Path) -> bool:
    """Whether a process is writing the run in a folder. It is asked for an instant only, so that none is kept out."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(handle)
    return False


def last_modified(folder: Path) -> datetime:
    """Time of the last write to any file in a folder; to the folder itself where its files may not be listed."""
    times = [0.0]
    with contextlib.suppress(OSError):
        times = [folder.lstat().st_mtime]
        times = [path.lstat().st_mtime for path in folder.iterdir()] or times
    return datetime.fromtimestamp(max(times), UTC)
