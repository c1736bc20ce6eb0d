"""Running a study on any executor: cells that are not stored yet are computed in blocks, in any order.

with Store(folder, asked) as store, ProcessPoolExecutor() as executor:
    run(study, compute, executor, store, progress, ahead=8)
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import io
import json
import math
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import BenchError, PalpateError, RecordError, UsageError
from palpate.instrument.findings.film_forces import mean_ratio
from palpate.instrument.own_process import Ends
from palpate.procedures.console.terminal import Progress
from palpate.procedures.records import chain
from palpate.procedures.records.chain import ChainFile, ChainWriter, HashChain, RecordFrame, create
from palpate.procedures.records.run import storing
from palpate.procedures.steps.flags import FLAGS
from palpate.procedures.study.description import Study, Value

# --- Outcomes of successive cells as columns, as they are computed, stored and read together -----------
#
# A block is stored as the arrays of an `.npz` file, which `numpy.load` reads by name:
#
# point.NAME      (cells, loads)  a value of each load set; of a cell that failed they mean nothing point.flags
# (cells, loads)  bit k: flag number k of `steps/flags.py` reason, alone   (cells,)        places in `texts`: why a
# cell failed, and why it was computed alone mean            (cells, 2)      mean force ratio over the valid load sets
# and its standard uncertainty; NaN: no mean

Column = npt.NDArray[Any]
Rows = Sequence[Mapping[str, Any]]  # the load sets of a cell by the names of their values; `flags` is a list of names

RAISED, VALID, POINT = "flags", "valid", "point."
FEW_CELLS = "few cells share a scene"  # why cells are computed alone where no effect is the cause


@dataclass(frozen=True, slots=True, eq=False)
class CellBlock:
    """Cells from number `first` on.

    Attributes:
        reasons: why each cell failed; empty: it did not.
        alone: why each cell was computed alone, by an effect or FEW_CELLS; empty: it was computed with others.
        columns: values of the load sets by name, each (cells, loads). Those of `RAISED` are bits, one for each flag in
            the order of `FLAGS` from the lowest on.
        means: mean force ratio of each cell and its standard uncertainty (cells, 2); NaN: no load set is valid.
    """

    first: int
    reasons: Sequence[str]
    alone: Sequence[str]
    columns: Mapping[str, Column]
    means: Floats

    def __len__(self) -> int:
        return len(self.reasons)

    @property
    def done(self) -> npt.NDArray[np.bool_]:
        """Which cells did not fail (cells,)."""
        return np.array([not reason for reason in self.reasons], bool)

    def stored(self) -> bytes:
        """The bytes of an `.npz` file."""
        texts = list(dict.fromkeys((*self.reasons, *self.alone)))
        place = {text: number for number, text in enumerate(texts)}
        points: dict[str, Any] = {f"{POINT}{name}": column for name, column in self.columns.items()}
        file = io.BytesIO()
        np.savez(
            file,
            texts=np.array(texts, np.str_),
            reason=np.array([place[text] for text in self.reasons], np.int32),
            alone=np.array([place[text] for text in self.alone], np.int32),
            mean=self.means,
            **points,
        )
        return file.getvalue()

    @classmethod
    def read(cls, first: int, stored: bytes) -> CellBlock:
        """Read what `stored` gave; columns are read when they are asked for.

        Raises ValueError, KeyError, OSError or BadZipFile: it is nothing of that kind.
        """
        arrays = np.load(io.BytesIO(stored), allow_pickle=False)
        texts = arrays["texts"].tolist()
        return cls(
            first,
            reasons=[texts[place] for place in arrays["reason"].tolist()],
            alone=[texts[place] for place in arrays["alone"].tolist()],
            columns=_StoredColumns(arrays),
            means=arrays["mean"],
        )


class _StoredColumns(Mapping[str, Column]):
    """The columns of a block's file. Reading a column takes longer than all it is needed for."""

    def __init__(self, arrays: Mapping[str, Column]) -> None:
        self._arrays = arrays
        self._names = [name[len(POINT) :] for name in arrays if name.startswith(POINT)]

    def __getitem__(self, name: str) -> Column:
        return self._arrays[f"{POINT}{name}"]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class BlockBuilder:
    """Outcomes of successive cells, which come in any order. Cells are counted from the first one of the block."""

    def __init__(self, first: int, cells: int, loads: int) -> None:
        self._first, self._shape = first, (cells, loads)
        self._reasons, self._alone = [""] * cells, [""] * cells
        self._columns: dict[str, Column] = {}

    def failed(self, cell: int, reason: str) -> None:
        """A cell failed."""
        self._reasons[cell] = reason

    def alone(self, cell: int, cause: str) -> None:
        """A cell is computed alone because of an effect, or because of another cause."""
        self._alone[cell] = cause

    def rows(self, cell: int, rows: Rows) -> None:
        """The load sets of a cell."""
        for name in rows[0]:
            if name != RAISED:
                self._put([cell], name, np.array([_number(row[name]) for row in rows]))
        self._put([cell], RAISED, np.array([_bits(row[RAISED]) for row in rows], np.uint16))

    def arrays(self, cells: Sequence[int], columns: Mapping[str, Column], flags: Mapping[str, Column]) -> None:
        """The load sets of some cells: values by name, and whether each flag is raised; each (cells, loads)."""
        for name, column in columns.items():
            self._put(cells, name, column)
        bits: Column = np.zeros((len(cells), self._shape[1]), np.uint16)
        for flag, raised in flags.items():
            bits |= raised * np.uint16(_bits([flag]))
        self._put(cells, RAISED, bits)

    def _put(self, cells: Sequence[int], name: str, column: Column) -> None:
        if name not in self._columns:
            self._columns[name] = np.zeros(self._shape, column.dtype)
        self._columns[name][cells] = column

    def block(self) -> CellBlock:
        """All cells, with their means."""
        means = np.full((self._shape[0], 2), np.nan)
        if self._columns:
            judged = zip(
                self._columns[VALID].tolist(), *(self._columns[name].tolist() for name in MEASURED), strict=True
            )
            for cell, (reason, (valid, *values)) in enumerate(zip(self._reasons, judged, strict=True)):
                points = [RatioOfLoad(*point) for used, *point in zip(valid, *values, strict=True) if used]
                if points and not reason:
                    mean = mean_ratio("force ratio", points, None)
                    means[cell] = mean.value, mean.u
        return CellBlock(self._first, self._reasons, self._alone, self._columns, means)


@dataclass(frozen=True, slots=True)
class RatioOfLoad:
    """A load set of a cell, a `mean_ratio.RatioPoint`."""

    force_ratio: float
    force_ratio_u: float
    noise_u: float
    pickup_u: float
    freedom: float  # NaN: infinitely many
    calibration_u: float = 0.0

    @property
    def degrees_of_freedom(self) -> float | None:
        return None if math.isnan(self.freedom) else self.freedom


MEASURED = ("force_ratio", "force_ratio_u", "noise_u", "pickup_u", "degrees_of_freedom")


def _number(value: Any) -> Any:
    """A value of a column; None and infinities are NaN, which a table shows as a missing value."""
    return math.nan if value is None or (isinstance(value, float) and math.isinf(value)) else value


def _bits(flags: Sequence[str]) -> int:
    return sum(1 << number for number, flag in enumerate(FLAGS) if flag in flags)


def flags_of(bits: int) -> list[str]:
    """Names of the flags of a load set."""
    return [flag for number, flag in enumerate(FLAGS) if bits >> number & 1]


# -------------------------------------------------------------------------------------------------------
# Folder of a study: its description, and each block of cells as soon as it is known. A stored cell is never computed
# again
#
# `study.record` is a chain of hashed rows with a head (`records/chain.py`), like that of a run. Rows are in the order
# in which blocks came. Readers get them by the numbers of the cells, also while the study runs, one block at a time.
#
#     kind  id          content
#     STUD  0           what was asked, JSON; the first frame
#     CELL  first cell  columns of successive cells (`CellBlock`)

RECORD, HEAD_FILE = "study.record", "study.head"
STUDY, CELL = b"STUD", b"CELL"
LONGEST_VALUE = 60  # characters, in a message


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
                blocks = StoredBlocks(path, _frames(found))
                self._cells = {block.first: len(block) for block in blocks}
                head, end = found.head, found.frames[-1]
                frames, cells = len(found.frames), self.done
                at_end = replace(head, frames=frames, length=end.end, points=cells, hash=end.hash)
                tail = found.file.read(head.length, end.end - head.length)
            with storing(path):
                self._writer = ChainWriter(path, head_path, head, 0)
                undo.callback(self._writer.close)
                self._writer.confirm(tail, at_end)
            self._undo = undo.pop_all()

    @property
    def done(self) -> int:
        """Number of stored cells."""
        return sum(self._cells.values())

    def missing(self, total: int) -> Iterator[range]:
        """Successive cells that are not stored, of so many cells, in their order."""
        at = 0
        for first in sorted(self._cells):
            if first > at:
                yield range(at, first)
            at = first + self._cells[first]
        if at < total:
            yield range(at, total)

    def add(self, blocks: Iterable[CellBlock]) -> None:
        """Store some blocks of cells. They are on disk when this returns. Stored cells stay as they are."""
        new = {block.first: block for block in blocks if block.first not in self._cells}
        frames = [(CELL, first, [block.stored()]) for first, block in new.items()]
        if frames:
            with storing(self.folder / RECORD):
                self._writer.append(frames, points=sum(map(len, new.values())))
        self._cells.update({first: len(block) for first, block in new.items()})

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._undo.close()


@dataclass(frozen=True, slots=True)
class StoredBlocks:
    """The blocks of a study in the order of their cells. Each is read when it is asked for."""

    path: Path
    frames: Sequence[RecordFrame]

    def __iter__(self) -> Iterator[CellBlock]:
        with _sound(self.path), ChainFile(self.path) as file:
            for frame in self.frames:
                yield CellBlock.read(frame.id, _content(file, frame))


def stored(folder: Path) -> tuple[dict[str, Any], StoredBlocks]:
    """Description and known cells of the study in a folder; also while it runs.

    Raises:
        UsageError: the folder holds none.
        RecordError: it is damaged; also when blocks are read.
    """
    path = folder.absolute() / RECORD
    if not path.is_file():
        raise UsageError(f"{folder} holds no study; make one with: palpate study STUDY.toml --out {folder}")
    with _sound(path), chain.opened(path, path.with_name(HEAD_FILE)) as found:
        return _asked(found), StoredBlocks(path, _frames(found))


def _frames(found: HashChain) -> list[RecordFrame]:
    return sorted(found.frames[1:], key=lambda frame: frame.id)


def _is_begun_in_vain(folder: Path) -> bool:
    """Whether a folder holds only what a start that was killed left behind."""
    head, _ = chain.read_head(folder / HEAD_FILE)
    names = {path.name for path in folder.iterdir()}
    return names <= {HEAD_FILE, f"{RECORD}.new"} and (head is None or not head.frames)


def _asked(found: HashChain) -> dict[str, Any]:
    if found.frames[0].kind != STUDY:
        raise ValueError("it is no study of palpate")
    text = _content(found.file, found.frames[0])
    if hashlib.sha256(text).digest()[:16] != found.head.chain:
        raise ValueError("its rows belong to another study")
    asked: dict[str, Any] = json.loads(text)
    return asked


def _content(file: ChainFile, frame: RecordFrame) -> bytes:
    content = file.content(frame)
    if content is None:
        raise ValueError(
            f"{f'the block of cell {frame.id}' if frame.kind == CELL else 'what was asked'} is not as it was written"
        )
    return content


@contextlib.contextmanager
def _sound(path: Path) -> Iterator[None]:
    """Turn errors by a damaged file into a RecordError."""
    try:
        yield
    except (UsageError, RecordError):
        raise
    except (OSError, ValueError, TypeError, KeyError, RecursionError, BadZipFile) as error:
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

Points = Iterable[Mapping[str, Any]]
Evaluate = Callable[[Mapping[str, Value]], Points]
Compute = Callable[[Study, range], CellBlock]
AIM = 1.0  # s for which a worker computes a block; after Ctrl-C that is waited for
GROWTH = 4  # greatest ratio of a block to the one before it
MOST_POINTS = 100_000  # in a block, so that it takes some MB


def run(study: Study, compute: Compute, executor: Executor, store: Store, progress: Progress, ahead: int) -> None:
    """Compute the missing cells in blocks, as large as a worker does in a second.

    Each cell is on disk before `progress` is told of it. On Ctrl-C no further block is begun; blocks that are being
    computed are waited for and stored.

    Args:
        study: the study.
        compute: function from a study and numbers of cells to their outcomes, which must be the same for the same cell,
            whatever others are in the block. The executor must be able to send it to a worker.
        executor: where blocks are computed.
        store: where they are stored.
        progress: is told of each block.
        ahead: number of blocks that the executor is given at a time.

    Raises:
        BenchError: the executor lost a worker.
        RecordError: a block cannot be stored.
    """
    total = len(study)
    missing = deque(store.missing(total))
    size, most = 1, max(1, MOST_POINTS // len(study.loads))
    begun: set[Future[tuple[CellBlock, float]]] = set()
    progress(store.done, total, "")
    try:
        while True:
            while missing and len(begun) < ahead:
                cells = missing.popleft()
                if len(cells) > size:
                    missing.appendleft(cells[size:])
                begun.add(executor.submit(timed, compute, study, cells[:size]))
            if not begun:
                return
            done = wait(begun, return_when=FIRST_COMPLETED).done
            for block, seconds in (future.result() for future in done):
                store.add([block])
                size = max(1, min(round(len(block) * AIM / max(seconds, 1e-6)), GROWTH * len(block), most))
                failed = [block.first + cell for cell, reason in enumerate(block.reasons) if reason]
                progress(store.done, total, f"cell {failed[-1]} failed" if failed else "")
            begun -= done
    except BaseException as error:
        kept = [future for future in begun if not future.cancel()]
        store.add(future.result()[0] for future in wait(kept).done if not _lost(future))
        stand = f"{store.done} of {total} cells are kept in {store.folder}; give the command again to go on"
        if isinstance(error, Exception) and not isinstance(
            error, PalpateError
        ):  # errors of cells are in their outcomes
            raise BenchError(
                f"a worker ended without an answer ({error}), perhaps for lack of memory; {stand}"
            ) from error
        error.add_note(stand)
        raise


def timed(compute: Compute, study: Study, cells: range) -> tuple[CellBlock, float]:
    """A block and how long it took [s]; called in whatever process computes it."""
    start = time.monotonic()
    return compute(study, cells), time.monotonic() - start


def one_by_one(evaluate: Evaluate, study: Study, cells: range) -> CellBlock:
    """A block whose cells are computed one by one. If `evaluate` raises, the cell fails and the others go on."""
    builder = BlockBuilder(cells[0], len(cells), len(study.loads))
    for place, cell in enumerate(cells):
        attempt(builder, place, lambda cell=cell: evaluate(study.cell(cell)))  # type: ignore[misc]
    return builder.block()


def attempt(builder: BlockBuilder, place: int, evaluate: Callable[[], Points]) -> None:
    """Put the outcome of a cell into a block."""
    try:
        builder.rows(place, list(evaluate()))
    except Exception as error:  # a defect in one cell must not take the others with it
        builder.failed(place, reason_of(error))


def reason_of(error: Exception) -> str:
    """Why a cell failed."""
    return str(error) if isinstance(error, PalpateError) else f"{type(error).__name__}: {error}"


def _lost(future: Future[Any]) -> bool:
    try:
        return future.exception() is not None
    except CancelledError:
        return True
