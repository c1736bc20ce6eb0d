"""Running a study on any executor: cells that are not stored yet are computed, in any order.

with Store(folder, asked) as store, ProcessPoolExecutor() as executor:
    run(study, evaluate, executor, store, progress, ahead=8)
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import itertools
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from palpate.instrument.errors import BenchError, PalpateError, RecordError, UsageError
from palpate.instrument.own_process import Ends
from palpate.procedures.console.progress import Progress
from palpate.procedures.records import chain
from palpate.procedures.records.chain import ChainWriter, HashChain, RecordFrame, create
from palpate.procedures.records.record_file import as_json
from palpate.procedures.records.run import storing
from palpate.procedures.study.description import Study, Value

# -------------------------------------------------------------------------------------------------------
# Folder of a study: its description, and each cell as soon as it is known. A stored cell is never computed
# again
#
# `study.record` is a chain of hashed rows with a head (`records/chain.py`), like that of a run. Rows are in the order
# in which cells came. Readers get them by the numbers of the cells, also while the study runs.
#
#     kind  id    content
#     STUD  0     what was asked, JSON; the first frame
#     CELL  cell  why it failed, JSON text ("": it did not), a line feed, its points, JSON list, keys sorted

RECORD, HEAD_FILE = "study.record", "study.head"
STUDY, CELL = b"STUD", b"CELL"
LONGEST_VALUE = 60  # characters, in a message


@dataclass(frozen=True, slots=True)
class CellOutcome:
    """Outcome of a cell: `data`, the JSON list of its points, or the reason why it failed."""

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
        """Open the study in a folder, or begin it there. The folder is made with its parents.

        Args:
            folder: folder of the study.
            asked: the study's description as JSON has it.

        Raises:
            UsageError: the folder holds another study (the message says what differs) or something else, or another
                process writes it.
            RecordError: it is damaged, or cannot be written.
        """
        self.folder = folder
        path, head_path = folder / RECORD, folder / HEAD_FILE
        with Ends() as undo:
            with storing(path):
                folder.mkdir(parents=True, exist_ok=True)
                lock = os.open(folder, os.O_RDONLY)
                undo.callback(os.close, lock)
                undo.close_in_child(lock)
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # it ends with the process
                except BlockingIOError:
                    raise UsageError(f"{folder} is being worked on by another process; let that end first") from None
                if not path.exists():
                    if not _is_begun_in_vain(folder):
                        raise UsageError(f"{folder} holds other files; choose a new or empty folder with --out")
                    text = json.dumps(asked, allow_nan=False).encode()  # the order of keys counts
                    create(path, head_path, hashlib.sha256(text).digest()[:16], [(STUDY, 0, [text])], 0)
            with _sound(path), chain.opened(path, head_path) as found:
                _refuse_other(folder, _asked(found), asked)
                self.done = {outcome.cell for outcome in _outcomes(found)}
                head, end = found.head, found.frames[-1]
                frames, cells = len(found.frames), len(self.done)
                at_end = replace(head, frames=frames, length=end.end, points=cells, hash=end.hash)
                tail = found.file.read(head.length, end.end - head.length)
            with storing(path):
                self._writer = ChainWriter(path, head_path, head, 0)
                undo.callback(self._writer.close)
                self._writer.confirm(tail, at_end)
            self._undo = undo.pop_all()

    def add(self, outcomes: Iterable[CellOutcome]) -> None:
        """Store the outcomes of some cells. They are on disk when this returns. Stored cells stay as they are."""
        new = {outcome.cell: outcome for outcome in outcomes if outcome.cell not in self.done}
        frames = [(CELL, cell, [f"{json.dumps(new[cell].reason)}\n{new[cell].data}".encode()]) for cell in new]
        if frames:
            with storing(self.folder / RECORD):
                self._writer.append(frames, points=len(frames))
        self.done.update(new)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._undo.close()


def stored(folder: Path) -> tuple[dict[str, Any], list[CellOutcome]]:
    """Description and known cells, by their numbers, of the study in a folder; also while it runs.

    Raises:
        UsageError: the folder holds none.
        RecordError: it is damaged.
    """
    path = folder.absolute() / RECORD
    if not path.is_file():
        raise UsageError(f"{folder} holds no study; make one with: palpate study STUDY.toml --out {folder}")
    with _sound(path), chain.opened(path, path.with_name(HEAD_FILE)) as found:
        return _asked(found), sorted(_outcomes(found), key=lambda outcome: outcome.cell)


def _outcomes(found: HashChain) -> Iterator[CellOutcome]:
    for frame in found.frames[1:]:
        reason, _, data = _content(found, frame).partition("\n")
        yield CellOutcome(frame.id, json.loads(reason), data)


def _is_begun_in_vain(folder: Path) -> bool:
    """Whether a folder holds only what a start that was killed left behind."""
    head, _ = chain.read_head(folder / HEAD_FILE)
    names = {path.name for path in folder.iterdir()}
    return names <= {HEAD_FILE, f"{RECORD}.new"} and (head is None or not head.frames)


def _asked(found: HashChain) -> dict[str, Any]:
    if found.frames[0].kind != STUDY:
        raise ValueError("it is no study of palpate")
    text = _content(found, found.frames[0])
    if hashlib.sha256(text.encode()).digest()[:16] != found.head.chain:
        raise ValueError("its rows belong to another study")
    asked: dict[str, Any] = json.loads(text)
    return asked


def _content(found: HashChain, frame: RecordFrame) -> str:
    content = found.file.content(frame)
    if content is None:
        raise ValueError(f"{f'cell {frame.id}' if frame.kind == CELL else 'what was asked'} is not as it was written")
    return content.decode()


@contextlib.contextmanager
def _sound(path: Path) -> Iterator[None]:
    """Turn errors by a damaged file into a RecordError."""
    try:
        yield
    except (UsageError, RecordError):
        raise
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise RecordError(
            f"{path} is damaged ({error}); restore it from a copy, or remove its folder to begin again"
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
    """Values of nested tables by their dotted keys."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _leaves(inner, f"{name}.{key}" if name else key)
    else:
        yield name, value


def _shown(leaves: Mapping[str, Any], key: str) -> str:
    text = repr(leaves[key]) if key in leaves else "absent"
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}…"


# --- the run of a study --------------------------------------------------------------------------------

Points = Iterable[Mapping[str, object]]
Evaluate = Callable[[Mapping[str, Value]], Points]


def run(study: Study, evaluate: Evaluate, executor: Executor, store: Store, progress: Progress, ahead: int) -> None:
    """Compute the missing cells. Each cell is on disk before `progress` is told of it.

    On Ctrl-C no further cell is begun; cells that are being computed are waited for and stored.

    Args:
        study: the study.
        evaluate: function from a cell's values to its points, which must be the same for the same cell. The executor
            must be able to send it to a worker. If it raises, the cell fails for that reason and the others go on.
        executor: where cells are computed.
        store: where they are stored.
        progress: is told of each cell.
        ahead: number of cells that the executor is given at a time.

    Raises:
        BenchError: the executor lost a worker.
        RecordError: a cell cannot be stored.
    """
    total = len(study)
    missing = (number for number in range(total) if number not in store.done)
    begun: set[Future[CellOutcome]] = set()
    progress(len(store.done), total, "")
    try:
        while True:
            for number in itertools.islice(missing, ahead - len(begun)):
                begun.add(executor.submit(attempt, evaluate, number, study.cell(number)))
            if not begun:
                return
            done = wait(begun, return_when=FIRST_COMPLETED).done
            outcomes = [future.result() for future in done]
            store.add(outcomes)
            begun -= done
            failed = [outcome for outcome in outcomes if outcome.reason]
            progress(len(store.done), total, f"cell {failed[-1].cell} failed" if failed else "")
    except BaseException as error:
        kept = [future for future in begun if not future.cancel()]
        store.add(future.result() for future in wait(kept).done if not _lost(future))
        stand = f"{len(store.done)} of {total} cells are kept in {store.folder}; give the command again to go on"
        if isinstance(error, Exception) and not isinstance(
            error, PalpateError
        ):  # errors of cells are in their outcomes
            raise BenchError(
                f"a worker ended without an answer ({error}), perhaps for lack of memory; {stand}"
            ) from error
        error.add_note(stand)
        raise


def attempt(evaluate: Evaluate, number: int, cell: Mapping[str, Value]) -> CellOutcome:
    """Outcome of a cell; called in whatever process computes it."""
    try:
        return CellOutcome(number, "", as_json(list(evaluate(cell))))
    except PalpateError as error:
        return CellOutcome(number, str(error), "[]")
    except Exception as error:  # a defect in one cell must not take the others with it
        return CellOutcome(number, f"{type(error).__name__}: {error}", "[]")


def _lost(future: Future[CellOutcome]) -> bool:
    try:
        return future.exception() is not None
    except CancelledError:
        return True
