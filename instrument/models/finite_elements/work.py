"""Long computations: time and memory, known beforehand, the threads in which they run, and what is kept on disk."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import math
import os
import re
import resource
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from dataclasses import dataclass, fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO, TypeVar, get_origin, get_type_hints

import numpy as np
from threadpoolctl import ThreadpoolController

from palpate.instrument.arithmetic import arithmetic, without_processor
from palpate.instrument.arrays import Floats
from palpate.instrument.errors import ConfigError, EstimateError
from palpate.instrument.notice import price

# --- time and memory -----------------------------------------------------------------------------------


T = TypeVar("T")

# --- time and memory of an elimination, known from its order ---------------------------------------------

RATE = 1e10  # multiplications in a second of large matrices, on one core of a server of 2020 [M]
# Least share of the free memory that is left to everything else.
LEFT_FREE = 0.1


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of an elimination, or of several, one after the other.

    Attributes:
        operations: number of multiplications.
        entries: greatest number of matrix entries that exist at once.
        unknowns: number of unknowns of the greatest.
    """

    operations: float = 0.0
    entries: int = 0
    unknowns: int = 0

    def __add__(self, other: Cost) -> Cost:
        return Cost(
            self.operations + other.operations,
            max(self.entries, other.entries),
            max(self.unknowns, other.unknowns),
        )

    @property
    def seconds(self) -> float:
        """Processor time [s]."""
        return self.operations / RATE

    @property
    def bytes(self) -> int:
        """Memory."""
        return 8 * self.entries


def total(costs: Iterable[Cost]) -> Cost:
    """The cost of several eliminations, one after the other."""
    return sum(costs, Cost())


def require_memory(cost: Cost, remedy: str) -> None:
    """Check that what an elimination needs fits into the memory that is free. Raises EstimateError."""
    if not fits(cost):
        raise EstimateError(
            f"finite elements: a mesh of {cost.unknowns} unknowns needs {cost.bytes / 1e9:.1f} GB of memory, and "
            f"{(free_memory() or 0) / 1e9:.1f} GB are free; {remedy}"
        )


def fits(cost: Cost) -> bool:
    """Whether what an elimination needs fits into the memory that is free, as far as the system tells."""
    has = free_memory()
    return has is None or cost.bytes <= (1 - LEFT_FREE) * has


def judge(cost: Cost, remedy: str, then: str = "") -> None:
    """Before anything is computed, refuse what does not fit into memory, and say how long it takes if it takes long.

    Args:
        cost: the cost.
        remedy: what to do if it does not fit, as "give a larger tolerance".
        then: what follows, as "; its answers are kept".

    Raises:
        EstimateError: it does not fit.
    """
    require_memory(cost, remedy)
    price(f"setting up meshes of up to {cost.unknowns} unknowns", cost.seconds, then)


def free_memory() -> int | None:
    """Memory that this process may still take, in bytes; None: the system does not tell."""
    limits = [each for each in (_available(), _in_group(), _in_limit()) if each is not None]
    return min(limits, default=None)


def _available() -> int | None:
    """What the machine has left, with what its caches would give up."""
    try:
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    except (OSError, ValueError):
        pass
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def _in_group() -> int | None:
    """What the limit of a container leaves."""
    group = Path("/sys/fs/cgroup")
    try:
        most = int((group / "memory.max").read_text(encoding="ascii"))
        return max(0, most - int((group / "memory.current").read_text(encoding="ascii")))
    except (OSError, ValueError):  # there is no limit
        return None


def _in_limit() -> int | None:
    """What `ulimit -v` leaves."""
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if most == resource.RLIM_INFINITY:
        return None
    try:
        taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        taken = 0
    return max(0, most - taken)


# --- threads ---------------------------------------------------------------------------------------------

_given_up: ContextVar[threading.Event | None] = ContextVar("given_up", default=None)


@contextmanager
def single() -> Iterator[None]:
    """Keep BLAS to one thread: its own ones spin while they wait, and on small matrices take longer than the work."""
    with _blas().limit(limits=1, user_api="blas"):
        yield


@functools.cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


class _GivenUp(BaseException):
    """Ends a computation for which nobody waits any more."""


def go_on() -> None:
    """End the computation here if nobody waits for it any more; called between its long steps."""
    given_up = _given_up.get()
    if given_up is not None and given_up.is_set():
        raise _GivenUp


def interruptible(compute: Callable[[], T]) -> T:
    """The result of a long computation, during which Ctrl-C and signals are obeyed at once.

    It runs in a thread of its own, while the main thread waits. If the wait is interrupted, the thread ends at the next
    `go_on`, or with the program. Another thread than the main one gets no signals; it computes by itself.
    """
    if threading.current_thread() is not threading.main_thread():
        return compute()
    found: list[T] = []
    failed: list[BaseException] = []
    given_up, done = threading.Event(), threading.Event()

    def run() -> None:
        _given_up.set(given_up)
        try:
            found.append(compute())
        except _GivenUp:
            pass
        except BaseException as error:
            failed.append(error)
        finally:
            done.set()

    context = copy_context()
    try:
        threading.Thread(target=lambda: context.run(run), daemon=True).start()
        done.wait()
    finally:
        given_up.set()
    if failed:
        raise failed[0]
    return found[0]


# --- what is kept on disk ------------------------------------------------------------------------------

#     keep("axisymmetric;degree=4;layers=3;sensed_poisson=0.3;...", Curve, lambda: found_on(parameters, 4, 3))
#
# What is kept is a dataclass of numbers, arrays and other such dataclasses. Its file is named by the SHA-256 of the
# text, of the models' source code, and of the arithmetic: after a change of any, nothing old is found, so that no last
# digit depends on what another process left. A file is a line of JSON, with names and shapes, and the numbers after it;
# nothing of it is ever executed. A file that is damaged, or not to be written, never stops an answer.


Kept = TypeVar("Kept")

# The folder of kept curves; without it, that of the user's caches.
VARIABLE = "PALPATE_CURVES"
FORMAT = "palpate curve 1"
BUILD_AGAIN = "build it again: palpate model surfaces --store"  # kept curves are built again without a word
SUFFIX, PART = ".curve", ".part"
# Names of kept files: of whole ones, and of those that are being written.
NAMES = re.compile(r"[0-9a-f]{64}(\.curve|\.[0-9a-f]{16}\.part)")
LONGEST = 2**16  # bytes of a file's first line; it has some 600, and JSON takes 25 times as much memory as its text
LARGEST = 64 * 2**20  # bytes of a file; the curve of a sensor of 16 teeth has some 140,000
LEFT = 3600.0  # s; a file that is written for longer was left by a process that was killed
ROOM = 100 * 2**20  # bytes of all files; beyond it, those that were not used for longest are deleted
# What the numbers of the finite-element models depend on, besides what they are asked and the arithmetic.
PACKAGES = ("numpy", "scipy", "scikit-fem")
SOURCES = tuple(f"{each}.py" for each in ("models/*/*", "models/parameters", "sensor/*"))


def keep(text: str, kind: type[Kept], find: Callable[[], Kept]) -> Kept:
    """The result that is kept on disk under a text. If there is none, `find` computes it, and it is kept.

    Args:
        text: everything on which the result depends, besides the code.
        kind: the result's dataclass; it raises ValueError where its arrays do not go together.
        find: function that computes the result.
    """
    key, room = key_of(text), folder()
    if room is None:
        return find()
    path = room / f"{key}{SUFFIX}"
    with contextlib.suppress(ConfigError):
        found = read(path, kind, key, own=True)
        with contextlib.suppress(OSError):
            os.utime(path)
        return found
    found = find()
    with contextlib.suppress(OSError):
        room.mkdir(mode=0o700, parents=True, exist_ok=True)
        write(path, found, key)
        _make_room(room)
    return found


def is_kept(text: str) -> bool:
    """Whether `keep` will find a result under a text on disk."""
    room = folder()
    return room is not None and (room / f"{key_of(text)}{SUFFIX}").is_file()


def folder() -> Path | None:
    """The folder of kept curves; None: there is no home to have one in."""
    named = os.environ.get(VARIABLE)
    with contextlib.suppress(RuntimeError):  # no home
        if named:
            return Path(named).expanduser()
        return _caches() / "palpate" / "curves"
    return None


def _caches() -> Path:
    """The user's caches, where the system wants them."""
    given = Path(os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME", ""))
    if given.is_absolute():  # a relative one is to be ignored (XDG Base Directory Specification)
        return given
    if sys.platform == "win32":
        return Path.home() / "AppData" / "Local"
    return Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")


def key_of(text: str) -> str:
    """SHA-256 of a text, of the code that computes what it asks for, and of all on which its last digits depend."""
    return hashlib.sha256(f"{code_digest()};{without_processor(arithmetic())};{text}".encode()).hexdigest()


@functools.cache
def code_digest() -> str:
    """SHA-256 of the models' source code, and of the packages with which it computes."""
    digest = hashlib.sha256(" ".join(map(version, PACKAGES)).encode())
    instrument = Path(__file__).parents[2]
    for source in SOURCES:
        for file in sorted(instrument.glob(source)):
            digest.update(f"{file.name};".encode() + file.read_bytes())
    return digest.hexdigest()


# --- a file ---------------------------------------------------------------------------------------------


def write(path: Path, content: object, key: str) -> None:
    """Write a file at once: whoever reads finds the old one or the new one.

    Raises:
        OSError: the file cannot be written.
    """
    arrays = dict(_arrays(content))
    numbers = b"".join(array.astype("<f8").tobytes() for array in arrays.values())
    head = {"format": FORMAT, "key": key, "arrays": {name: array.shape for name, array in arrays.items()}}
    line = json.dumps({**head, "sha256": _content_hash(head, numbers)}).encode() + b"\n"
    part = path.with_name(f"{path.stem}.{os.urandom(8).hex()}{PART}")
    try:
        part.write_bytes(line + numbers)
        part.replace(path)
    except BaseException:  # also Ctrl-C
        with contextlib.suppress(OSError):
            part.unlink()
        raise


def read(path: Path, kind: type[Kept], key: str, own: bool = False) -> Kept:
    """Read a file that `write` wrote.

    Args:
        path: the file.
        kind: the dataclass that it holds.
        key: the key with which it was written.
        own: whether to refuse a file that another user wrote, and a symbolic link: anybody can write a file with the
            right key and a consistent hash.

    Raises:
        ConfigError: there is no such file, it was written for another key, or it is damaged.
    """
    try:
        with _opened(path, own) as file:
            line = file.readline(LONGEST)
            head, numbers = json.loads(line), file.read()
        if head.pop("sha256") != _content_hash(head, numbers):
            raise ValueError("its content hash does not fit its content")
        if (head["format"], head["key"]) != (FORMAT, key):
            raise ValueError("it was written for something else, or by another version")
        return _made(kind, _split(head["arrays"], np.frombuffer(numbers, dtype="<f8")))
    except Exception as error:  # a damaged file may raise any error
        why = error.strerror if isinstance(error, OSError) else error
        raise ConfigError(f"curve {path}: not readable ({why}); {BUILD_AGAIN}") from error


@contextlib.contextmanager
def _opened(path: Path, own: bool) -> Iterator[BinaryIO]:
    """An open file. Raises OSError, and ValueError: it is too large, no regular file, or with `own` not this user's."""
    # Some systems have neither flag. To open a pipe without the first would wait for ever.
    flags = getattr(os, "O_NONBLOCK", 0) | (getattr(os, "O_NOFOLLOW", 0) if own else 0)
    with open(path, "rb", opener=lambda name, mode: os.open(name, mode | flags)) as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise ValueError("it is no regular file")
        if own and status.st_uid != _user():
            raise ValueError("another user wrote it")
        if status.st_size > LARGEST:
            raise ValueError(f"it has more than {LARGEST} bytes")
        yield file


def _user() -> int:
    """Number of the user whose files this process writes; 0 where the system has no such numbers."""
    return os.geteuid() if hasattr(os, "geteuid") else 0


def _content_hash(head: dict[str, Any], numbers: bytes) -> str:
    digest = hashlib.sha256(json.dumps(head).encode())
    digest.update(numbers)
    return digest.hexdigest()


def _arrays(content: Any, within: str = "") -> Iterator[tuple[str, Floats]]:
    """Every number of a dataclass as an array, by its name."""
    for field in fields(content):
        value = getattr(content, field.name)
        if is_dataclass(value):
            yield from _arrays(value, f"{within}{field.name}.")
        else:
            yield within + field.name, np.asarray(value, dtype=np.float64)


def _split(shapes: dict[str, Any], numbers: Floats) -> dict[str, Floats]:
    """The arrays of a file. Raises ValueError: a number is not finite, or there are too many or too few."""
    if not np.isfinite(numbers).all():
        raise ValueError("a number is not finite")
    found, start = {}, 0
    for name, shape in shapes.items():
        if any(type(length) is not int or length < 0 for length in shape):
            raise ValueError(f"{name} has the shape {shape}")
        end = start + math.prod(shape)
        found[name] = numbers[start:end].reshape(shape).astype(np.float64)
        start = end
    if start != len(numbers):
        raise ValueError(f"{len(numbers)} numbers instead of {start}")
    return found


def _made(kind: type[Kept], arrays: dict[str, Floats], within: str = "") -> Kept:
    """The dataclass with these arrays."""
    values: dict[str, Any] = {}
    for name, hint in get_type_hints(kind).items():
        if is_dataclass(hint):
            values[name] = _made(hint, arrays, f"{within}{name}.")  # type: ignore[arg-type]
        elif hint in (float, int):
            values[name] = hint(arrays[within + name])
        elif get_origin(hint) is tuple:
            values[name] = tuple(arrays[within + name].tolist())
        else:
            values[name] = arrays[within + name]
    return kind(**values)


# --- the folder -----------------------------------------------------------------------------------------


def _make_room(room: Path) -> None:
    """Delete what was not used for longest, until the rest is no more than ROOM, and what killed processes left.

    Others may do so at the same time. Only files that `keep` names are deleted.
    """
    now, files = time.time(), []
    with os.scandir(room) as entries:
        for entry in entries:
            if NAMES.fullmatch(entry.name):
                with contextlib.suppress(FileNotFoundError):
                    status = entry.stat(follow_symlinks=False)
                    # A time in the future is as far from now as one as long ago: it must not keep a file for ever.
                    files.append((abs(now - status.st_mtime), status.st_size, entry.path))
    total = sum(size for _, size, _ in files)
    for age, size, path in sorted(files, reverse=True):
        if total > ROOM or (age > LEFT and path.endswith(PART)):
            with contextlib.suppress(OSError):
                Path(path).unlink()
            total -= size
