"""Contexts that handle or ignore signals, and restore the previous handlers afterwards."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType

Handler = Callable[[int, FrameType | None], object]


@contextmanager
def taken(numbers: Iterable[signal.Signals], handler: Handler) -> Iterator[None]:
    """Inside, `handler` gets these signals, except those that the program was started to ignore, as by nohup.

    Only the main thread of Python may set handlers; elsewhere signals stay as they are.
    """
    with _as(numbers, handler):
        yield


@contextmanager
def held(numbers: Iterable[signal.Signals]) -> Iterator[None]:
    """Inside, these signals are ignored; off the main thread they stay as they are."""
    with _as(numbers, signal.SIG_IGN):
        yield


@contextmanager
def _as(numbers: Iterable[signal.Signals], handler: Handler | signal.Handlers) -> Iterator[None]:
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in numbers:
            if signal.getsignal(number) not in (signal.SIG_IGN, None):  # None: set by a C library, cannot be restored
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, handler_before in before.items():
            signal.signal(number, handler_before)
