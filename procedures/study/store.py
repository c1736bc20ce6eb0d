"""The folder of a study: what was asked, and each cell as soon as it is known; a stored cell is never computed again.

`study.sqlite`, with a write-ahead log, synchronous FULL and one writer. Rows stand in the order in which cells came;
whoever reads them gets them by their numbers, also while the study runs.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import astuple, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from instrument.errors import RecordError, UsageError
from procedures.encoding import LARGEST_ROW, row_crc32
from procedures.run import storing

DATABASE = "study.sqlite"
APPLICATION_ID = 0x50414C53  # "PALS"
SCHEMA = (
    f"PRAGMA application_id = {APPLICATION_ID}",
    "CREATE TABLE study (asked TEXT NOT NULL, crc32 INTEGER NOT NULL) STRICT",
    # reason: why the cell failed; empty: it did not. data: JSON list of points, keys sorted, no time of the wall.
    "CREATE TABLE cell (id INTEGER PRIMARY KEY, reason TEXT NOT NULL, data TEXT NOT NULL, crc32 INTEGER NOT NULL)"
    " STRICT",
)
LONGEST_VALUE = 60  # characters, in a message


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a cell: `data`, the JSON list of its points, or the reason why it failed."""

    cell: int
    reason: str
    data: str

    @property
    def points(self) -> list[dict[str, Any]]:
        points: list[dict[str, Any]] = json.loads(self.data)
        return points


class Store:
    """The one writer of a study. A context manager; what cannot be stored is a RecordError that names the file."""

    def __init__(self, folder: Path, asked: Mapping[str, Any]) -> None:
        """Opens the study in a folder, or begins it there; the folder is made with its parents.

        Args:
            asked: what the study is, as JSON has it.

        Raises:
            UsageError: another study or something else lies there, with what differs, or another process is at it.
            RecordError: it is damaged, or cannot be written.
        """
        self.folder = folder
        path = folder / DATABASE
        with contextlib.ExitStack() as undo:
            with storing(path):
                folder.mkdir(parents=True, exist_ok=True)
                if not path.exists() and any(folder.iterdir()):
                    raise UsageError(f"{folder} holds other files; choose a new or empty folder with --out")
                lock = os.open(folder, os.O_RDONLY)
                undo.callback(os.close, lock)
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # a kill lets it go
                except BlockingIOError:
                    raise UsageError(f"{folder} is being worked on by another process; let that end first") from None
                self._database = undo.enter_context(contextlib.closing(sqlite3.connect(path, isolation_level=None)))
            with _sound(path):
                if not self._database.execute("PRAGMA schema_version").fetchone()[0]:
                    with storing(path):
                        self._begin(json.dumps(asked, allow_nan=False))  # its order counts
                _refuse_other(folder, _asked(self._database), asked)
                self.done = {cell for (cell,) in self._database.execute("SELECT id FROM cell")}
            with storing(path):
                self._database.execute("PRAGMA journal_mode = WAL")
                self._database.execute("PRAGMA synchronous = FULL")
            self._undo = undo.pop_all()

    def add(self, outcomes: Iterable[Outcome]) -> None:
        """Store what became of some cells; they are on disk when this returns. What is stored already stays."""
        rows = [(*astuple(outcome), row_crc32(*astuple(outcome))) for outcome in outcomes]
        with storing(self.folder / DATABASE), self._transaction():
            self._database.executemany("INSERT OR IGNORE INTO cell VALUES (?, ?, ?, ?)", rows)
        self.done.update(row[0] for row in rows)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._undo.close()

    def _begin(self, asked: str) -> None:
        with self._transaction():
            for statement in SCHEMA:
                self._database.execute(statement)
            self._database.execute("INSERT INTO study VALUES (?, ?)", (asked, row_crc32(asked)))

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        self._database.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")


def stored(folder: Path) -> tuple[dict[str, Any], list[Outcome]]:
    """What a study in a folder is, and the cells that are known of it by their numbers; also while it runs.

    Raises:
        UsageError: the folder holds none.
        RecordError: it is damaged.
    """
    path = folder.absolute() / DATABASE
    if not path.is_file():
        raise UsageError(f"{folder} holds no study; make one with: palpate study STUDY.toml --out {folder}")
    with _sound(path), contextlib.closing(sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_ROW)
        outcomes = []
        for *row, crc32 in database.execute("SELECT id, reason, data, crc32 FROM cell ORDER BY id"):
            if row_crc32(*row) != crc32:
                raise ValueError(f"cell {row[0]} is not as it was written, CRC-32 differs")
            outcomes.append(Outcome(*row))
        return _asked(database), outcomes


def _asked(database: sqlite3.Connection) -> dict[str, Any]:
    (application,) = database.execute("PRAGMA application_id").fetchone()
    if application != APPLICATION_ID:
        raise ValueError("it is no study of palpate")
    ((text, crc32),) = database.execute("SELECT asked, crc32 FROM study")
    if row_crc32(text) != crc32:
        raise ValueError("what was asked is not as it was written, CRC-32 differs")
    asked: dict[str, Any] = json.loads(text)
    return asked


@contextlib.contextmanager
def _sound(path: Path) -> Iterator[None]:
    """What a damaged file gives is a RecordError."""
    try:
        yield
    except (sqlite3.Error, ValueError, TypeError) as error:
        raise RecordError(
            f"{path} is damaged ({error}); restore it from a copy, or remove it to begin again"
        ) from error


def _refuse_other(folder: Path, there: Mapping[str, Any], here: Mapping[str, Any]) -> None:
    before, now = dict(_leaves(there)), dict(_leaves(here))
    for key in [*now, *before]:
        if before.get(key) != now.get(key):
            old, new = (_shown(leaves, key) for leaves in (before, now))
            raise UsageError(
                f"{folder} holds another study: {key} is {old} there and {new} here; choose another --out, or give the"
                " study as it was"
            )


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Of tables within tables, by their dotted keys."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _leaves(inner, f"{name}.{key}" if name else key)
    else:
        yield name, value


def _shown(leaves: Mapping[str, Any], key: str) -> str:
    text = repr(leaves[key]) if key in leaves else "absent"
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}…"
