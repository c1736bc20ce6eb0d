"""Tells whoever waits what a long computation costs, before it begins.

with told(print):
    response(design, load, "solid", tolerance=1e-4)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

LONG = 2.0  # s; less is not worth a word

_listener: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)


@contextmanager
def notices_to(listener: Callable[[str], None]) -> Iterator[None]:
    """A context in which a function is called with a sentence before each long computation."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def price(what: str, seconds: float, then: str = "") -> None:
    """Say what a computation costs, if it takes more than two seconds.

    Args:
        what: the computation, as "setting up a mesh of 5000 unknowns".
        seconds: its time [s].
        then: what follows from it, as "; its answers are kept"; empty: nothing to say.
    """
    listener = _listener.get()
    if listener is not None and seconds > LONG:
        listener(f"{what} takes about {duration(seconds)}{then}")


def duration(seconds: float) -> str:
    """A duration [s] to one or two digits, for people."""
    if seconds < 90:
        return f"{round(seconds, -1 if seconds > 20 else 0):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"
