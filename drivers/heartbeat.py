"""Says that the program is alive, from a thread of its own, while time goes on by itself."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Self

from instrument.errors import LinkError

PATIENCE = 20.0  # s that who drives the bench may compute, write or be kept waiting for a processor


class Heartbeat:
    """A context manager: inside it `say` is called every `interval` s of the wall.

    It speaks for the thread that drives the bench, which says how soon it will be heard of again: if it is not, and not
    within `PATIENCE` more, it hangs, and nothing is said any more. A program that is killed or stopped says nothing.
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
        """Who drives the bench is alive now, and will be heard of `within` s; infinity: nothing is driven."""
        self._until = time.monotonic() + within + PATIENCE

    def failure(self) -> Exception | None:
        """What went wrong since the last call, but for a link that failed, which whoever uses it meets, too."""
        failure, self._failure = self._failure, None
        return failure

    def turn(self, now: float) -> None:
        """What is done at each interval; `now` is of the wall [s]."""
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
