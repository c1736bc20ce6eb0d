"""The end of a bench: how signals are handled meanwhile, and how what must be switched off is."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from types import FrameType

from palpate.drivers.clock import Clock
from palpate.instrument.own_process import when_whole

Handler = Callable[[int, FrameType | None], object]
TRIES = 4  # number of times that a failed step is tried again, evenly within its time


def insist(steps: Iterable[Callable[[], object]], clock: Clock, within: float = 0.0) -> list[str]:
    """Take each of these steps, even if others fail; returns the messages of those that failed to the end.

    Those that failed are taken again, over new connections, until `within` [s] has passed. So each must do no harm when
    it is done twice, as switching off does none.
    """
    failed, until = _failed(steps), time.monotonic() + within
    for _ in range(TRIES if within else 0):
        if not failed or time.monotonic() > until:  # a device that is silent takes its time, also of a virtual clock
            break
        clock.wait(within / TRIES)
        failed = _failed(failed)
    return list(failed.values())


def _failed(steps: Iterable[Callable[[], object]]) -> dict[Callable[[], object], str]:
    """Take steps; returns those that failed, with their messages."""
    return {step: why for step in steps if (why := _failure(step))}


def _failure(step: Callable[[], object]) -> str:
    try:
        step()
    except Exception as failure:  # also a defect of the code: the next way must still be tried
        return str(failure) or repr(failure)
    return ""


@contextmanager
def taken(numbers: Iterable[signal.Signals], handler: Handler, *, ignored: bool = False) -> Iterator[None]:
    """Inside, `handler` gets these signals; those that the program was started to ignore only with `ignored`.

    One that comes in the middle of what a simulated device does in this thread waits for its end. nohup starts a
    program with ignored signals, and the `&` of a shell's script. Only the main thread of Python may set handlers;
    elsewhere signals stay as they are.
    """

    def handle(number: int, frame: FrameType | None) -> None:
        when_whole(partial(handler, number, frame))

    with _as(numbers, handle, ignored):
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
