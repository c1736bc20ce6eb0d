"""Writing a run to disk: a point is durable before it is reported.

A run has two files. A point or event is appended to `run.record` and synced to disk; then `run.head`, a small file that
says how many points and events the record holds, is rewritten and synced. Only then does the caller hear of the point.
`procedures/records/chain.py` writes both files, `procedures/records/record_file.py` describes their format, and
`procedures/records/run.py` reads them.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Literal, Self, TypeVar

import numpy as np

from palpate.instrument.durable import make_folder, numbered
from palpate.instrument.errors import RangeError, RecordError, UsageError
from palpate.instrument.own_process import Ends
from palpate.procedures.records.chain import HEAD_FILE, RECORD, ChainFile, ChainWriter, Content, create, is_run
from palpate.procedures.records.events import Event, Kind, Listener, events_of, unheard
from palpate.procedures.records.record_file import (
    IN_A_FRAME,
    SIMULATED,
    WAVE,
    Waveforms,
    as_samples,
    chain_of,
    event_frame,
    header_frame,
    point_frames,
    status_frame,
    wave_frame,
    waves,
)
from palpate.procedures.records.run import reading, storing, telling_damage

# --- A long dwell, whose samples are stored while it lasts, and are read again from the record piece by piece


class StoredDwell:
    """The samples of one dwell at a point that is not stored yet. If it is taken anew, that is another dwell.

    Attributes:
        point_id: the point.
        number: number of the dwell at this point, from 1.
        samples: number of samples of each waveform so far.
    """

    def __init__(self, folder: Path, point_id: int, number: int, store: Callable[[Sequence[Content]], int]) -> None:
        """`store` puts frames into the record in a folder, and returns where they begin in its file."""
        self.point_id, self.number, self.samples = point_id, number, 0
        self._path, self._store = folder / RECORD, store
        self._begins, self._waveforms = 0, 0

    def add(self, waveforms: Mapping[str, tuple[float, np.ndarray]]) -> None:
        """Store the next samples of all waveforms; they are durable on return.

        Raises:
            RangeError: as `Recorder.point`, or they are not as many of each, or too many for a row of the record.
            RecordError: they cannot be stored.
        """
        named = {name: (rate, as_samples(name, rate, samples)) for name, (rate, samples) in waveforms.items()}
        counts = {samples.size for _, samples in named.values()}
        if len(counts) != 1 or max(counts) > IN_A_FRAME:
            raise RangeError(f"a piece of a dwell has {counts} samples; give as many of each, {IN_A_FRAME} at most")
        begins = self._store(
            [
                wave_frame(self.point_id, name, rate, samples, self.samples, self.number)
                for name, (rate, samples) in named.items()
            ]
        )
        if not self.samples:
            self._begins, self._waveforms = begins, len(named)
        self.samples += counts.pop()

    def pieces(self) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """All samples again: of each piece the number of its first sample, from 0, and the samples by name.

        Raises:
            RecordError: they are not as they were written.
        """
        piece: dict[str, np.ndarray] = {}
        first = 0
        with telling_damage(self._path), ChainFile(self._path) as file:
            frames = waves(file, self._begins)
            while first < self.samples:
                wave = next(frames, None)
                if wave is None:
                    raise ValueError(f"samples of point {self.point_id} are missing from number {first + 1} on")
                piece[wave.name] = wave.samples
                if len(piece) == self._waveforms:
                    yield first, piece
                    first, piece = first + wave.samples.size, {}


# --- writing a run -------------------------------------------------------------------------------------

REQUIRED = frozenset({"procedure", "simulated", "started"})
PAUSED = "paused"  # kind of the event that a pause begins with
MEASURED = "measured"  # kind of the event after which a run needs no more points, if they must be taken in one run

T = TypeVar("T")


class Recorder:
    """The one writer of a run.

    Use it as a context manager. If the block raises, the run gets the status "failed" ("stopped" for Ctrl-C and
    SystemExit), the error's message becomes an event, and the error goes on to the caller. If the block ends without
    `finish`, the run is "stopped".

    If something cannot be stored, RecordError names the file and says what to do. Earlier points stay readable.

    Attributes:
        listener: called with each event of the run, in the order in which they are stored; it must not raise.
    """

    def __init__(self, folder: Path, header: Mapping[str, object] | None = None, listener: Listener = unheard) -> None:
        """Lock the folder against other writers. With a `header`, begin a run; without, go on with one.

        Raises:
            UsageError: another process is writing this run, or a run is to begin where there is one already.
        """
        self.folder = folder
        self.listener = listener
        self._points = 0
        self._dwells = 0  # that were begun at the next point
        self._bench_ns = 0
        self._files = (folder / RECORD, folder / HEAD_FILE)
        self._inodes: dict[Path, int] = {}
        self._writer: ChainWriter | None = None
        self._closed = False
        with Ends() as undo:
            with storing(folder, running=True):
                undo.close_in_child(undo.enter_context(locked(folder)))
                if header is not None:
                    if is_run(folder):
                        raise UsageError(f"{folder} already holds a run; choose another --out")
                    flags = SIMULATED if header["simulated"] else 0
                    create(*self._files, chain_of(header), [header_frame(header)], flags)
            self._open = undo.pop_all()
        if header is not None:
            with contextlib.ExitStack() as undo:
                undo.callback(self.close)
                self._write_on()
                self._heard([header_frame(header)])
                undo.pop_all()

    def _write_on(self) -> None:
        """Open the files and go on behind the last whole frame.

        A writer that was killed may have left frames that the head does not count yet. They may be in the memory of the
        operating system and not on disk, so they are written and synced again before the head counts them.
        """
        with reading(self.folder) as record, storing(self.folder / RECORD, running=True):
            flags = SIMULATED if record.header["simulated"] else 0
            self._writer = ChainWriter(*self._files, record.head, flags)
            self._open.callback(self._writer.close)
            self._writer.confirm(record.tail(), record.head_at_end())

    @classmethod
    def create(cls, folder: Path, header: Mapping[str, object], listener: Listener = unheard) -> Self:
        """A new run in `folder`, which is made with its parents where it does not exist.

        Args:
            folder: where the run goes; other files in it are left alone.
            header: what the run is, stored as JSON: at least `procedure` (text), `simulated` (bool) and
                `started` (UTC, ISO 8601); then scene, seed, bench, contracts, calibration, versions, commit.
            listener: as the attribute.

        Raises:
            UsageError: the folder holds a run already, also one that another process is just starting.
            RecordError: the folder cannot be made or written to, or the header is no header.
            ValueError: `started` is no ISO 8601 time.
        """
        if lacking := REQUIRED - header.keys():
            raise RecordError(f"the header of a run lacks {', '.join(sorted(lacking))}")
        if not isinstance(header["simulated"], bool):
            raise RecordError(f"the header of a run says simulated = {header['simulated']!r}; write true or false")
        datetime.fromisoformat(str(header["started"]))
        folder = folder.absolute()
        with storing(folder):
            make_folder(folder)
        return cls(folder, header, listener)

    def point(
        self,
        data: Mapping[str, object],
        waveforms: Waveforms,
        bench_ns: int,
    ) -> int:
        """Stores a point and returns its id (1, 2, 3, …) once it is durable.

        Args:
            data: what was measured, SI values under names that carry a unit (`load_N`). Numpy scalars
                are taken as numbers; NaN and infinities are stored as null.
            waveforms: for each name the sample rate, Hz, and the samples, shape (n,), stored as float32;
                NaN and infinities are kept. Samples that are stored already are told by `InPieces`.
            bench_ns: bench time, ns.

        Raises:
            RangeError: a rate that is not positive, samples of another shape or beyond float32, or a name
                of the record's own columns (`id`, `bench_ns`, `simulated`) in `data`.
        """
        point_id = self._points + 1
        self._append(point_frames(point_id, data, waveforms, bench_ns), points=1)
        self._points, self._dwells = point_id, 0
        self._bench_ns = bench_ns
        return point_id

    def begin_dwell(self) -> StoredDwell:
        """A dwell at the next point, whose samples are stored while it lasts; the point then has them `InPieces`.

        If the dwell is taken anew, as after a failure, that is another dwell.
        """
        self._dwells += 1
        return StoredDwell(self.folder, self._points + 1, self._dwells, self._store_piece)

    def _store_piece(self, frames: Sequence[Content]) -> int:
        """Append the next samples of a dwell. Returns where they begin in the record's file."""
        begins = self._open_writer().head.length
        self._append(frames)
        return begins

    @property
    def points(self) -> int:
        """Number of stored points."""
        return self._points

    @property
    def measured(self) -> bool:
        """Whether a run that goes on has all its points already, although they must be taken in one run."""
        return False

    def finished(self, _kind: type[T]) -> list[T]:
        """The points that a procedure need not measure again, as objects of the class they were stored from.

        A new run has none; a resumed one has those of before.
        """
        return []

    def event(self, kind: str, message: str, bench_ns: int) -> None:
        """Stores that something happened at the bench time `bench_ns`, ns; durable on return."""
        self._append([self._event(kind, message, bench_ns)], events=1)
        self._bench_ns = bench_ns

    def finish(
        self,
        status: Literal["complete", "stopped", "failed"],
        summary: Mapping[str, object],
        message: str = "",
    ) -> None:
        """Ends the run with its result (`summary`, stored as JSON) and closes the files.

        A `message` says why it ended so; it is stored as an event whose kind is the status.

        Raises:
            RangeError: the summary holds a value that JSON has not; the run goes on.
        """
        events = [self._event(status, message, self._bench_ns)] if message else []
        frames = [*events, status_frame(status, summary)]
        try:
            self._append(frames, events=len(events))
            with storing(self.folder / RECORD, running=True):
                self._open_writer().end()
        finally:
            self.close()

    def tell(self, kind: Kind, bench_ns: int, data: Mapping[str, object]) -> None:
        """Tell the listener of an event that is not recorded."""
        self.listener(Event(kind, bench_ns, data))

    def _heard(self, frames: Sequence[Content]) -> None:
        """Tell the listener of what is on disk now."""
        if self.listener is unheard:
            return
        for kind, own, parts in frames:
            if kind != WAVE:
                for event in events_of(self.folder, kind, own, b"".join(parts), self._bench_ns):
                    self.listener(event)

    def close(self) -> None:
        """Close the files and leave the run as it is. After `finish` there is nothing left to close."""
        self._closed = True
        self._open.close()

    def _open_writer(self) -> ChainWriter:
        assert self._writer is not None
        return self._writer

    def _event(self, kind: str, message: str, bench_ns: int, behind: int = 0) -> Content:
        return event_frame(self._open_writer().head.events + 1 + behind, kind, message, bench_ns)

    def _append(self, frames: Sequence[Content], points: int = 0, events: int = 0) -> None:
        """Append frames. On return all of them are on disk; if this raises, none of them counts."""
        with storing(self.folder / RECORD, running=True):
            self._open_writer().append(frames, points=points, events=events)
        self._check_files()
        self._heard(frames)

    def _check_files(self) -> None:
        """Check that the files still have their names, because Linux lets a program write to a removed file."""
        for path in self._files:
            with storing(path, running=True):
                inode = path.stat().st_ino
                if inode != self._inodes.setdefault(path, inode):
                    raise FileNotFoundError(errno.ENOENT, "it was replaced while the run was being written")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is None:  # nothing was written yet
            self.close()
        if self._closed or self._open.elsewhere:
            return
        if error is None:
            self.finish("stopped", {}, "the procedure ended without a result")
            return
        wanted = isinstance(error, (KeyboardInterrupt, SystemExit))
        with contextlib.suppress(RecordError):  # the exception that is being raised says more
            self.finish("stopped" if wanted else "failed", {}, f"{type(error).__name__}: {error}")


def new_run_folder(store: Path, procedure: str, started: datetime) -> Path:
    """Makes an empty folder for a run in `store`, such as `20250314T150926Z-sweep-loads`, and returns it.

    A name that is taken gets -2, -3, … appended. `started` needs a time zone.

    Raises:
        RecordError: the store cannot be written to.
    """
    stem = f"{started.astimezone(UTC):%Y%m%dT%H%M%SZ}-{re.sub(r'[^A-Za-z0-9]+', '-', procedure)}"
    with storing(store):
        store.mkdir(parents=True, exist_ok=True)
        for name in numbered(stem):
            with contextlib.suppress(FileExistsError):
                (store / name).mkdir()
                break
    return store / name


def put_file(path: Path, text: str) -> None:
    """Write a text file beside a record, and replace what is there under that name.

    What is there is removed first, so that a link is not followed to another file, and a pipe is not waited for.

    Raises:
        RecordError: it cannot be written.
    """
    with storing(path, running=True):
        path.unlink(missing_ok=True)
        path.write_text(text, encoding="utf-8")


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[int]:
    """Lock a folder against other writers, and give the lock's descriptor.

    The system releases the lock when the process ends, even if it is killed.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(f"{folder} is being written by another process; let that end first") from None
        yield handle
    finally:
        os.close(handle)
