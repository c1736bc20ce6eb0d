"""Contexts that handle or ignore signals, and restore the previous handlers afterwards."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType

Handler = Callable[[int, FrameType | None], object]


@contextmanager
def taken(numbers: Iterable[signal.Signals], handler: Handler, *, ignored: bool = False) -> Iterator[None]:
    """Inside, `handler` gets these signals; those that the program was started to ignore only with `ignored`.

    nohup starts a program so, and the `&` of a shell's script. Only the main thread of Python may set handlers;
    elsewhere signals stay as they are.
    """
    with _as(numbers, handler, ignored):
        yield


@contextmanager
def held(numbers: Iterable[signal.Signals]) -> Iterator[None]:
    """Inside, these signals are ignored; off the main thread they stay as they are."""
    with _as(numbers, signal.SIG_IGN):
        yield


@contextmanager
def _as(numbers: Iterable[signal.Signals], handler: Handler | signal.Handlers, ignored: bool = False) -> Iterator[None]:
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in numbers:
            found = signal.getsignal(number)
            if found is not None and (ignored or found != signal.SIG_IGN):  # None: set by C, cannot be restored
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, handler_before in before.items():
            signal.signal(number, handler_before)
