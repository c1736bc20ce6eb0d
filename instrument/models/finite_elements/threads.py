"""Work that is shared between threads: numpy and SuperLU leave Python's lock to the others."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

from threadpoolctl import ThreadpoolController

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
