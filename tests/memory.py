"""How much memory a piece of a test leaves taken."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def growth() -> Iterator[Callable[[], int]]:
    """Gives a function that tells how many bytes are taken since the block began."""
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        left: list[int] = []
        yield lambda: left[0]
        left.append(tracemalloc.get_traced_memory()[0] - before)
    finally:
        tracemalloc.stop()
