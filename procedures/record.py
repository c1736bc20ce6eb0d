"""Writing a run to disk: a point is durable before it is reported.

A run is one folder with two files:

- `run.sqlite`: header, points, waveform rows and events (`SCHEMA`). Write-ahead log, synchronous
  FULL, one writer. After a normal end it is a single file without a log.
- `waveforms.f32`: the samples of all waveforms, little-endian float32, only ever appended to. A row
  of the table `waveform` says where a waveform lies and carries its CRC-32; bytes that no row
  names belong to a point that was never stored, and readers ignore them.

Copy a live run with both files and `run.sqlite-wal`: without its log the database loses points.
`procedures/run.py` reads all this.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import itertools
import os
import re
import sqlite3
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Literal, Self, TypeVar

import numpy as np

from instrument.errors import RecordError, UsageError
from procedures.encoding import Waveforms, as_json, encoded
from procedures.run import DATABASE, SCHEMA, WAVEFORMS, row_crc32, storing, waveform_crc32

REQUIRED = frozenset({"procedure", "simulated", "started"})
_OWN_KEYS = frozenset({"status", "summary"})

T = TypeVar("T")


class Recorder:
    """The one writer of a run.

    A context manager: an exception leaves the status "failed" ("stopped" for Ctrl-C and SystemExit)
    with its message as an event, and goes on; a block left without `finish` is "stopped".

    Every write raises RecordError, which names the file and the remedy, if it cannot be stored.
    What was stored before stays readable.
    """

    def __init__(self, folder: Path) -> None:
        """Opens the files that `create` made, and keeps every other writer out.

        Raises:
            UsageError: another process is writing this run.
        """
        self.folder = folder
        self._points = 0
        self._bench_ns = 0
        self._inodes: dict[str, int] = {}
        with contextlib.ExitStack() as undo:
            with storing(folder / WAVEFORMS):
                self._waveforms = undo.enter_context((folder / WAVEFORMS).open("ab", buffering=0))
                try:
                    fcntl.flock(self._waveforms, fcntl.LOCK_EX | fcntl.LOCK_NB)  # a kill lets it go
                except BlockingIOError:
                    raise UsageError(f"{folder} is being written by another process; let that end first") from None
            with storing(folder / DATABASE):
                self._database = undo.enter_context(contextlib.closing(sqlite3.connect(folder / DATABASE)))
                self._database.execute("PRAGMA journal_mode = WAL")
                self._database.execute("PRAGMA synchronous = FULL")
            undo.pop_all()

    @classmethod
    def create(cls, folder: Path, header: Mapping[str, object]) -> Self:
        """A new run in `folder`, which is made with its parents where it does not exist.

        Args:
            folder: where the run goes; other files in it are left alone.
            header: what the run is, stored as JSON: at least `procedure` (text), `simulated` (bool) and
                `started` (UTC, ISO 8601); then scene, seed, bench, contracts, calibration, versions, commit.

        Raises:
            UsageError: the folder holds a run already, also one that another process is just starting.
            RecordError: the folder cannot be made or written to, or the header is no header.
            ValueError: `started` is no ISO 8601 time.
        """
        if lacking := REQUIRED - header.keys():
            raise RecordError(f"the header of a run lacks {', '.join(sorted(lacking))}")
        if taken := _OWN_KEYS & header.keys():
            raise RecordError(f"the header of a run may not set {', '.join(sorted(taken))}")
        if not isinstance(header["simulated"], bool):
            raise RecordError(f"the header of a run says simulated = {header['simulated']!r}; write true or false")
        datetime.fromisoformat(str(header["started"]))
        folder = folder.absolute()
        with storing(folder):
            made = [path for path in (folder, *folder.parents) if not path.exists()]
            folder.mkdir(parents=True, exist_ok=True)
            try:
                # Whoever makes this file owns the folder, so that two processes cannot share it.
                (folder / WAVEFORMS).open("xb").close()
            except FileExistsError:
                raise _already_held(folder) from None
            _write_database(folder, {**header, "status": "running", "summary": {}})
            for path in (folder, *(path.parent for path in made)):
                _sync_folder(path)
        return cls(folder)

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
                NaN and infinities are kept.
            bench_ns: bench time, ns.

        Raises:
            RangeError: a rate that is not positive, samples of another shape or beyond float32, or a name
                of the record's own columns (`id`, `bench_ns`, `simulated`) in `data`.
        """
        text, stored = encoded(data, waveforms)
        point_id = self._points + 1
        with storing(self.folder / WAVEFORMS):
            offsets = self._append([samples for _, _, samples in stored])
        rows = [
            (point_id, name, samples.dtype.str, float(rate), offset, samples.size, crc32)
            for (name, rate, samples), offset in zip(stored, offsets, strict=True)
            for crc32 in [waveform_crc32(point_id, name, rate, samples)]
        ]
        crc32 = row_crc32(point_id, bench_ns, text)
        with storing(self.folder / DATABASE), self._database:
            self._database.execute("INSERT INTO point VALUES (?, ?, ?, ?)", (point_id, bench_ns, text, crc32))
            self._database.executemany(
                "INSERT INTO waveform (point_id, name, dtype, rate, offset, length, crc32)"
                " VALUES (?, ?, ?, ?, ?, ?, ?)",
                rows,
            )
        self._check_files()
        self._points = point_id
        self._bench_ns = bench_ns
        return point_id

    @property
    def points(self) -> int:
        """How many points are stored."""
        return self._points

    def finished(self, _kind: type[T]) -> list[T]:
        """The points, as what they were stored from, that a procedure need not measure: none of a new run."""
        return []

    def event(self, kind: str, message: str, bench_ns: int) -> None:
        """Stores that something happened at the bench time `bench_ns`, ns; durable on return."""
        with storing(self.folder / DATABASE), self._database:
            self._insert_event(kind, message, bench_ns)
        self._check_files()
        self._bench_ns = bench_ns

    def finish(
        self,
        status: Literal["complete", "stopped", "failed"],
        summary: Mapping[str, object],
        message: str = "",
    ) -> None:
        """Ends the run with its result (`summary`, stored as JSON) and closes the files.

        A `message`, why it ended so, is stored as an event of the kind `status`.
        """
        try:
            with storing(self.folder / DATABASE), self._database:
                self._database.executemany(
                    "UPDATE run SET value = ?, crc32 = ? WHERE key = ?",
                    header_rows({"status": status, "summary": summary}),
                )
                if message:
                    self._insert_event(status, message, self._bench_ns)
            # All is durable by now. Where a reader holds the database its log stays, and that is as good.
            with contextlib.suppress(sqlite3.OperationalError):
                self._database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                self._database.execute("PRAGMA journal_mode = DELETE")
        finally:
            self.close()

    def close(self) -> None:
        """Close the files of a run that is left as it is; `finish` has done so."""
        self._database.close()
        self._waveforms.close()

    def _insert_event(self, kind: str, message: str, bench_ns: int) -> None:
        # File names in a message can hold bytes that are no UTF-8; SQLite would refuse the text.
        text = message.encode(errors="backslashreplace").decode()
        row = (bench_ns, kind, text)
        self._database.execute(
            "INSERT INTO event (bench_ns, kind, message, crc32) VALUES (?, ?, ?, ?)", (*row, row_crc32(*row))
        )

    def _check_files(self) -> None:
        """What was just written is in files that are still there: the system lets removed ones be written on."""
        for name in (DATABASE, f"{DATABASE}-wal", WAVEFORMS):
            with storing(self.folder / name):
                inode = (self.folder / name).stat().st_ino
                if inode != self._inodes.setdefault(name, inode):
                    raise FileNotFoundError(errno.ENOENT, "it was replaced while the run was being written")

    def _append(self, arrays: Sequence[np.ndarray]) -> list[int]:
        """Appends the samples, makes them durable and returns where each array starts, in bytes."""
        offsets: list[int] = []
        end = os.fstat(self._waveforms.fileno()).st_size
        for samples in arrays:
            offsets.append(end)
            end += samples.nbytes
            rest = samples.view(np.uint8).data
            while rest:
                rest = rest[self._waveforms.write(rest) :]
        if arrays:
            os.fsync(self._waveforms.fileno())
        return offsets

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._waveforms.closed:
            return
        if error is None:
            self.finish("stopped", {}, "the procedure ended without a result")
            return
        wanted = isinstance(error, (KeyboardInterrupt, SystemExit))
        with contextlib.suppress(RecordError):  # the exception under way says more
            self.finish("stopped" if wanted else "failed", {}, f"{type(error).__name__}: {error}")


def header_rows(header: Mapping[str, object]) -> list[tuple[str, int, str]]:
    """Value, CRC-32 and key of each entry."""
    rows = [(key, as_json(value)) for key, value in header.items()]
    return [(value, row_crc32(key, value), key) for key, value in rows]


def new_run_folder(store: Path, procedure: str, started: datetime) -> Path:
    """Makes an empty folder for a run in `store`, such as `20250314T150926Z-sweep-loads`, and returns it.

    A name that is taken gets -2, -3, … appended. `started` needs a time zone.

    Raises:
        RecordError: the store cannot be written to.
    """
    stem = f"{started.astimezone(UTC):%Y%m%dT%H%M%SZ}-{re.sub(r'[^A-Za-z0-9]+', '-', procedure)}"
    with storing(store):
        store.mkdir(parents=True, exist_ok=True)
        for suffix in itertools.chain([""], (f"-{count}" for count in itertools.count(2))):
            with contextlib.suppress(FileExistsError):
                (store / (stem + suffix)).mkdir()
                break
    return store / (stem + suffix)


def _already_held(folder: Path) -> UsageError:
    return UsageError(f"{folder} already holds a run; choose another --out")


def _write_database(folder: Path, header: Mapping[str, object]) -> None:
    """Makes the database aside and renames it, so that a killed start leaves a whole one or none."""
    aside = folder / f"{DATABASE}.new"
    try:
        if (folder / DATABASE).exists():
            raise _already_held(folder)
        aside.unlink(missing_ok=True)
        with contextlib.closing(sqlite3.connect(aside)) as database:
            database.execute("PRAGMA journal_mode = MEMORY")
            database.execute("PRAGMA synchronous = FULL")
            database.executescript(f"BEGIN; {SCHEMA}")
            database.executemany("INSERT INTO run (value, crc32, key) VALUES (?, ?, ?)", header_rows(header))
            database.commit()
        aside.replace(folder / DATABASE)
    except BaseException:
        aside.unlink(missing_ok=True)
        (folder / WAVEFORMS).unlink()
        raise


def _sync_folder(folder: Path) -> None:
    """Makes the names in `folder` durable; syncing a file does not."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
