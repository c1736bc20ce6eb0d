"""A thread that tells a device at regular intervals that the program is alive."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Self

from palpate.instrument.errors import LinkError

PATIENCE = 20.0  # s for which the thread that drives the bench may compute, write to disk, or have no processor


class Heartbeat:
    """A context manager: inside it `say` is called every `interval` s of the wall.

    It speaks for another thread, the one that drives the bench. That one calls `expect` with the time until its next
    call; where that is late by more than `PATIENCE`, the program is taken to hang, and `say` is not called any more.
    A program that is killed or stopped calls nothing.
    """

    def __init__(self, say: Callable[[], object], interval: float) -> None:
        self._say = say
        self._interval = interval
        self._until = math.inf
        self._failure: Exception | None = None
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()

    def expect(self, within: float) -> None:
        """Called by the thread that drives the bench: it will call again `within` s; infinity: it drives nothing."""
        self._until = time.monotonic() + within + PATIENCE

    def failure(self) -> Exception | None:
        """What `say` raised since the last call, but no LinkError: the next request on that link raises it, too."""
        failure, self._failure = self._failure, None
        return failure

    def turn(self, now: float) -> None:
        """Done at each interval; `now`: the time of `time.monotonic` [s]."""
        if now > self._until:
            return
        try:
            self._say()
        except LinkError:
            pass
        except Exception as error:  # nobody else would hear of it
            self._failure = error

    def _run(self) -> None:
        while not self._end.wait(self._interval):  # not a sleep: leaving wakes it at once
            self.turn(time.monotonic())
