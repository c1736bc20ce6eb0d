"""Long computations: their time and memory, known before anything is computed, and the threads in which they run."""

from __future__ import annotations

import functools
import os
import resource
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar, copy_context
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

from palpate.instrument.errors import EstimateError
from palpate.instrument.notice import price

T = TypeVar("T")

# --- time and memory of an elimination, known from its order ---------------------------------------------

RATE = 1e10  # multiplications in a second of large matrices, on one core of a server of 2020 [M]
# Least share of the free memory that is left to everything else.
LEFT = 0.1


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
    return has is None or cost.bytes <= (1 - LEFT) * has


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
    known = [each for each in (_available(), _in_group(), _in_limit()) if each is not None]
    return min(known, default=None)


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


# --- threads: numpy and SuperLU leave Python's lock to the others ----------------------------------------

_given_up: ContextVar[threading.Event | None] = ContextVar("given_up", default=None)

# Runs a function for all shares at once and returns the results in their order.
Each = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]


@contextmanager
def one_each(shares: int) -> Iterator[Each]:
    """Run each share of the work in a thread of its own; the first is the caller's.

    A share stays with its thread, because SuperLU gives memory back only in the thread that took it.
    """
    with ExitStack() as stack:
        if shares > 1:
            stack.enter_context(single())
        pools = [stack.enter_context(ThreadPoolExecutor(1)) for _ in range(shares - 1)]

        def each(work: Callable[[Any], Any], of: Sequence[Any]) -> list[Any]:
            own, *others = of
            begun = [pool.submit(work, other) for pool, other in zip(pools, others, strict=True)]
            return [work(own), *(other.result() for other in begun)]

        yield each


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
