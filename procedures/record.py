"""Writing a run to disk: a point is durable before it is reported.

A point is one transaction with its waveforms: one write to the log (`run.sqlite-wal`), one sync. The log is merged
into `run.sqlite` and begun anew every `MERGED_EVERY` points or `LONGEST_LOG` pages, so that points overwrite it in
place, and a merge stays shorter than the amplifier's watchdog. The end of a run leaves a single file.
`procedures/run.py` has the format, and reads it.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import itertools
import os
import re
import sqlite3
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Literal, Self, TypeVar

from instrument.errors import RecordError, UsageError
from procedures.encoding import Waveforms, as_json, encoded, row_crc32, waveform_crc32
from procedures.run import DATABASE, EVENT_COLUMNS, POINT_COLUMNS, SCHEMA, WAVEFORM_COLUMNS, storing

REQUIRED = frozenset({"procedure", "simulated", "started"})
_OWN_KEYS = frozenset({"status", "summary"})

LOG = f"{DATABASE}-wal"
MERGED_EVERY = 50  # points
LONGEST_LOG = 8000  # pages of 4096 bytes
FIRST_LOG = 1_000_000  # bytes that are there before the first point: a file that grows is takes longer to sync

_POINT = f"INSERT INTO point (id, {POINT_COLUMNS}) VALUES (?, ?, ?, ?, ?)"
_WAVEFORM = f"INSERT INTO waveform ({WAVEFORM_COLUMNS}) VALUES (?, ?, ?, ?, ?)"
_EVENT = f"INSERT INTO event ({EVENT_COLUMNS}) VALUES (?, ?, ?, ?)"

T = TypeVar("T")


class Recorder:
    """The one writer of a run.

    A context manager: an exception leaves the status "failed" ("stopped" for Ctrl-C and SystemExit)
    with its message as an event, and goes on; a block left without `finish` is "stopped".

    Every write raises RecordError, which names the file and the remedy, if it cannot be stored.
    What was stored before stays readable.
    """

    def __init__(self, folder: Path, header: Mapping[str, object] | None = None) -> None:
        """Keeps every other writer out, and opens the run in `folder`; with a `header` it is begun there.

        Raises:
            UsageError: another process is writing this run, or there is one where one was to be begun.
        """
        self.folder = folder
        self._points = 0
        self._bench_ns = 0
        self._files = (folder / DATABASE, folder / LOG)
        self._inodes: dict[Path, int] = {}
        self._closed = False
        with contextlib.ExitStack() as undo:
            with storing(folder):
                undo.enter_context(_locked(folder))
                if header is not None:
                    _begin(folder, header)
            with storing(folder / DATABASE):
                self._database = undo.enter_context(contextlib.closing(sqlite3.connect(folder / DATABASE)))
                self._database.execute("PRAGMA journal_mode = WAL")
                self._database.execute("PRAGMA synchronous = FULL")
                self._database.execute(f"PRAGMA wal_autocheckpoint = {LONGEST_LOG}")
            self._open = undo.pop_all()

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
            for path in made:
                _sync(path.parent)
        return cls(folder, {**header, "status": "running", "summary": {}})

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
        rows = [
            (point_id, name, rate, samples.data, waveform_crc32(point_id, name, rate, samples))
            for name, rate, samples in stored
        ]
        row = (point_id, bench_ns, text, len(rows))
        with self._transaction() as database:
            database.execute(_POINT, (*row, row_crc32(*row)))
            database.executemany(_WAVEFORM, rows)
        self._points = point_id
        self._bench_ns = bench_ns
        if point_id % MERGED_EVERY == 0:
            self._tidy("PRAGMA wal_checkpoint(PASSIVE)")
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
        with self._transaction():
            self._insert_event(kind, message, bench_ns)
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
            with self._transaction():
                self._update_header({"status": status, "summary": summary})
                if message:
                    self._insert_event(status, message, self._bench_ns)
            self._tidy("PRAGMA wal_checkpoint(TRUNCATE)")
            self._tidy("PRAGMA journal_mode = DELETE")
        finally:
            self.close()

    def close(self) -> None:
        """Close the files of a run that is left as it is; `finish` has done so."""
        self._closed = True
        self._open.close()

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """What is written inside is durable behind it, all or nothing."""
        with storing(self.folder / DATABASE), self._database:
            yield self._database
        self._check_files()

    def _tidy(self, statement: str) -> None:
        # All is durable by now: where a reader holds the database, or the disk is full, the log stays.
        with contextlib.suppress(sqlite3.Error):
            self._database.execute(statement)

    def _update_header(self, header: Mapping[str, object]) -> None:
        self._database.executemany("UPDATE run SET value = ?, crc32 = ? WHERE key = ?", _header_rows(header))

    def _insert_event(self, kind: str, message: str, bench_ns: int) -> None:
        # File names in a message can hold bytes that are no UTF-8; SQLite would refuse the text.
        text = message.encode(errors="backslashreplace").decode()
        row = (bench_ns, kind, text)
        self._database.execute(_EVENT, (*row, row_crc32(*row)))

    def _check_files(self) -> None:
        """What was just written is in files that are still there: the system lets removed ones be written on."""
        for path in self._files:
            with storing(path):
                inode = path.stat().st_ino
                if inode != self._inodes.setdefault(path, inode):
                    raise FileNotFoundError(errno.ENOENT, "it was replaced while the run was being written")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._closed:
            return
        if error is None:
            self.finish("stopped", {}, "the procedure ended without a result")
            return
        wanted = isinstance(error, (KeyboardInterrupt, SystemExit))
        with contextlib.suppress(RecordError):  # the exception under way says more
            self.finish("stopped" if wanted else "failed", {}, f"{type(error).__name__}: {error}")


def _header_rows(header: Mapping[str, object]) -> list[tuple[str, int, str]]:
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


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keeps every other writer out of a folder; a kill lets it go."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(f"{folder} is being written by another process; let that end first") from None
        yield
    finally:
        os.close(handle)


def _begin(folder: Path, header: Mapping[str, object]) -> None:
    """Makes the files of a run, the database aside and renamed, so that a killed start leaves a whole one or none."""
    if (folder / DATABASE).exists():
        raise UsageError(f"{folder} already holds a run; choose another --out")
    aside, log = folder / f"{DATABASE}.new", folder / LOG
    try:
        aside.unlink(missing_ok=True)
        with contextlib.closing(sqlite3.connect(aside)) as database:
            database.execute("PRAGMA journal_mode = WAL")
            database.executescript(f"BEGIN; {SCHEMA}")
            database.executemany("INSERT INTO run (value, crc32, key) VALUES (?, ?, ?)", _header_rows(header))
            database.commit()
        log.write_bytes(bytes(FIRST_LOG))  # SQLite takes it for an empty one
        for path in (aside, log):
            _sync(path)
        aside.replace(folder / DATABASE)
        _sync(folder)
    except BaseException:
        for path in (aside, log):
            path.unlink(missing_ok=True)
        raise


def _sync(path: Path) -> None:
    """Makes a file durable, or the names in a folder, which syncing a file does not."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
