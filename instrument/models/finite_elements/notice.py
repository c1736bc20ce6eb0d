"""Tells whoever waits how long a set-up will take, before it begins.

with told(print):
    response(design, load, "solid", tolerance=1e-4)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from palpate.instrument.quantity import show

LONG = 3.0  # s; less is not worth a word
RATE = 3e9  # multiplications in a second, on one core of a server of 2020

_listener: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)


@contextmanager
def told(listener: Callable[[str], None]) -> Iterator[None]:
    """A context in which a function is called with a sentence before each long set-up."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def begin(operations: float, unknowns: int) -> None:
    """Say that an elimination begins, if it is a long one.

    Args:
        operations: number of its multiplications.
        unknowns: number of its unknowns.
    """
    listener, seconds = _listener.get(), operations / RATE
    if listener is not None and seconds > LONG:
        listener(
            f"setting up a mesh of {unknowns} unknowns takes about {show(seconds, 's', 1)}; its answers for all moduli"
            " are then kept"
        )
