"""A thread that feeds a watchdog at regular intervals while the program works."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Self

from palpate.instrument.bench.patience import PATIENCE
from palpate.instrument.errors import LinkError
from palpate.instrument.own_process import Ends


class Heartbeat:
    """A context manager inside which `say` is called every `interval` of wall time [s].

    It acts for another thread, which drives the bench. The driving thread calls `expect` with the time until its next
    call. If that call is late by more than `PATIENCE`, the program counts as hanging, and `say` is no longer called. A
    program that is killed or stopped does not call it either.
    """

    def __init__(self, say: Callable[[], object], interval: float) -> None:
        self._say = say
        self._interval = interval
        self._until = math.inf
        self._failure: Exception | None = None
        self._end = threading.Event()
        self._ends = Ends()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._ends.callback(self._thread.join)
        self._ends.callback(self._end.set)
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    def expect(self, within: float) -> None:
        """Called by the driving thread: its next call comes within this time [s]; infinity: it drives nothing."""
        self._until = time.monotonic() + within + PATIENCE

    def failure(self) -> Exception | None:
        """The error of `say` since the last call, but no LinkError, which the next request on the link raises."""
        failure, self._failure = self._failure, None
        return failure

    def turn(self, now: float) -> None:
        """Called at each interval; `now` is the time of `time.monotonic` [s]."""
        if now > self._until:
            return
        try:
            self._say()
        except LinkError:
            pass
        except Exception as error:  # in a thread it would go unnoticed
            self._failure = error

    def _run(self) -> None:
        while not self._end.wait(self._interval):  # no sleep, so that leaving ends it at once
            self.turn(time.monotonic())
