"""Work that is shared between threads: numpy and SuperLU leave Python's lock to the others."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

from threadpoolctl import ThreadpoolController

# Does work on all shares at once, and gives what comes of each, in their order.
Each = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]


@contextmanager
def one_each(shares: int) -> Iterator[Each]:
    """A thread for each of so many shares, the first of which is the caller's own.

    A share stays with its thread: SuperLU gives memory back in the thread alone that took it.
    """
    with ExitStack() as stack:
        if shares > 1:  # the threads of BLAS, which spin for more work, would take the cores from these
            stack.enter_context(_blas().limit(limits=1, user_api="blas"))
        pools = [stack.enter_context(ThreadPoolExecutor(1)) for _ in range(shares - 1)]

        def each(work: Callable[[Any], Any], of: Sequence[Any]) -> list[Any]:
            own, *others = of
            begun = [pool.submit(work, other) for pool, other in zip(pools, others, strict=True)]
            return [work(own), *(other.result() for other in begun)]

        yield each


@functools.cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
