"""A disk whose every write and sync is written down, to fail one of them or to be what it would be after a power cut.

The model: a file's content is durable up to its last sync. Of what was written since, any part may be there after a
power cut, sector by sector; a file that was made longer reads as zeros where nothing came. Names are durable once their
folder was synced; until then each renaming or making of a file may be there or not, in their order. A sync that the
disk only pretends to have done makes nothing durable.
"""

from __future__ import annotations

import errno
import os
import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

from palpate.instrument.errors import RecordError
from palpate.procedures.records.chain import is_run
from palpate.procedures.records.damage import check
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run

SECTOR = 512
Call = Callable[..., Any]


@dataclass(frozen=True, slots=True)
class Operation:
    """What was asked of the disk: "make", "write", "truncate", "rename", "remove", "sync", or "said": of points."""

    what: str
    name: str = ""
    at: int = 0
    content: bytes = b""
    to: str = ""


@dataclass(slots=True)
class Disk:
    """Listens to all that is asked of files in a folder; the operation with the number `fails` fails."""

    folder: Path
    fails: int = -1
    operations: list[Operation] = field(default_factory=list)
    _count: int = 0

    @contextmanager
    def listening(self) -> Iterator[None]:
        asked: dict[str, Callable[..., Sequence[Any]]] = {
            "ftruncate": lambda handle, size: ("truncate", _path(handle), size),
            "fdatasync": lambda handle: ("sync", _path(handle)),
            "fsync": lambda handle: ("sync", _path(handle)),
            "replace": lambda one, other: ("rename", one, 0, b"", Path(other).name),
            "unlink": lambda path, **_: ("remove", path),
        }
        with ExitStack() as stack:
            for name, what in asked.items():
                stack.enter_context(patch.object(os, name, self._telling(getattr(os, name), what)))
            stack.enter_context(patch.object(os, "pwrite", self._pwrite(os.pwrite)))
            make = self._telling(Path.write_bytes, lambda path, content: ("make", path, 0, content))
            stack.enter_context(patch.object(Path, "write_bytes", make))
            yield

    def said(self, points: int) -> None:
        """Notes that so many points were acknowledged by now."""
        self.operations.append(Operation("said", at=points))

    def _asked(self, what: str, path: str | Path, at: int = 0, content: bytes = b"", to: str = "") -> None:
        if Path(path).parent != self.folder and Path(path) != self.folder:
            return
        self._count += 1
        if self._count - 1 == self.fails:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        name = "" if Path(path) == self.folder else Path(path).name
        self.operations.append(Operation(what, name, at, content, to))

    def _pwrite(self, call: Call) -> Call:
        def pwrite(handle: int, content: Any, at: int) -> int:
            try:
                self._asked("write", _path(handle), at, bytes(content))
            except OSError:  # half of it comes through
                call(handle, memoryview(content)[: len(content) // 2], at)
                raise
            return int(call(handle, content, at))

        return pwrite

    def _telling(self, call: Call, what: Callable[..., Sequence[Any]]) -> Call:
        def told(*given: Any, **options: Any) -> Any:
            self._asked(*what(*given, **options))
            return call(*given, **options)

        return told


def _path(handle: int) -> Path:
    return Path(f"/proc/self/fd/{handle}").readlink()


# --- what is there after a power cut -------------------------------------------------------------------


def after_a_cut(
    operations: Sequence[Operation], lies: int, chance: random.Random | None, kept: bool
) -> dict[str, bytes]:
    """The files after a power cut behind these operations.

    Args:
        lies: number of the sync that the disk only pretends to have done; -1: none.
        chance: draws what of that which was not synced is there; None: all of it, or nothing.
        kept: all, where nothing is drawn.
    """
    durable: dict[int, bytes] = {}  # by file
    pending: dict[int, list[Operation]] = {}
    names: dict[str, int] = {}
    seen: dict[str, int] = {}  # names as the program sees them
    changes: list[Callable[[dict[str, int]], object]] = []
    for number, op in enumerate(operations):
        match op.what:
            case "make":
                seen[op.name] = made = len(durable)
                durable[made] = b""
                pending[made] = [Operation("write", at=0, content=op.content)]
                changes.append(lambda there, name=op.name, made=made: there.__setitem__(name, made))
            case "write" | "truncate":
                pending[seen[op.name]].append(op)
            case "rename":
                seen[op.to] = seen.pop(op.name)
                changes.append(lambda there, op=op: op.name in there and there.__setitem__(op.to, there.pop(op.name)))
            case "remove":
                seen.pop(op.name, None)
                changes.append(lambda there, op=op: there.pop(op.name, None))
            case "sync" if number != lies:
                if op.name:
                    file = seen[op.name]
                    durable[file] = _content(durable[file], pending[file], None, True)
                    pending[file] = []
                else:
                    for change in changes:
                        change(names)
                    changes = []
    there = len(changes) if chance is None and kept else chance.randrange(len(changes) + 1) if chance else 0
    for change in changes[:there]:
        change(names)
    return {name: _content(durable[file], pending[file], chance, kept) for name, file in names.items()}


def _content(durable: bytes, pending: list[Operation], chance: random.Random | None, kept: bool) -> bytes:
    content = bytearray(durable)
    for op in pending:
        if chance is None and not kept:
            continue
        if op.what == "truncate":
            if chance is None or chance.random() < 0.5:
                del content[op.at :]
            continue
        how = chance.random() if chance else 0.0
        if how < 0.4:
            _put(content, op.at, op.content)
        elif how < 0.8:
            # a sector is there or not; where the first ends is up to the place in the file
            at = 0
            while at < len(op.content):
                size = SECTOR - (op.at + at) % SECTOR
                if chance is not None and chance.random() < 0.5:
                    _put(content, op.at + at, op.content[at : at + size])
                at += size
    return bytes(content)


def _put(content: bytearray, at: int, part: bytes) -> None:
    content.extend(bytes(max(0, at - len(content))))
    content[at : at + len(part)] = part


# --- a run on it ----------------------------------------------------------------------------------------


def record(run: Run, disk: Disk) -> int:
    """Records a run once more, as its procedure did, on that disk; how many points were acknowledged."""
    films = {point["id"]: {} for point in run.points()}
    for waveform in run.waveforms():
        films[waveform.point_id][waveform.name] = (waveform.rate, waveform.samples)
    said = 0
    with suppress(RecordError), disk.listening():
        disk.said(0)
        with Recorder.create(disk.folder, run.header) as recorder:
            for point in run.points():
                data = {key: value for key, value in point.items() if key not in ("id", "bench_ns")}
                recorder.point(data, films[point["id"]], point["bench_ns"])
                said = recorder.points
                disk.said(said)
                if said % 2 == 0:
                    recorder.event("note", f"after point {said}", point["bench_ns"])
            recorder.finish("complete", run.summary)
    return said


def verdict(folder: Path, run: Run, said: int) -> str:
    """What came of so many acknowledged points of a run: "kept", "lost and told", "told" (none is lost), "silent"."""
    faults = check(folder).faults if said or is_run(folder) else []  # a run that is not there is missed
    try:
        left = Run.open(folder).points() if is_run(folder) else []
    except RecordError:
        left = []
    whole = left[:said] == run.points()[:said] and left == run.points()[: len(left)]
    if whole:
        return "told" if faults else "kept"
    return "lost and told" if faults else "silent"
