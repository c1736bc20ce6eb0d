"""Work that is shared between threads: numpy and SuperLU leave Python's lock to the others."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar, copy_context
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

T = TypeVar("T")
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
