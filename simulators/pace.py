"""Wall time for a simulated bench that is served: a thread moves its clock on."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Self

from simulators.clock import VirtualClock

TICK = 0.002  # s of the wall between two moves of the clock
LONGEST = 0.05  # s of the wall that are made up for at once: requests wait meanwhile


class Pacer:
    """A context manager: inside it `clock` goes on at `speed` times the speed of the wall's.

    Where the scene cannot keep up, or a request has moved the clock on itself, time goes on from where it stands;
    what was lost is counted in `behind`, in seconds of the wall.
    """

    def __init__(self, clock: VirtualClock, speed: float, failed: Callable[[BaseException], None]) -> None:
        self._clock = clock
        self._speed = speed
        self._failed = failed
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="pacer", daemon=True)
        self.behind = 0.0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        last = time.monotonic()
        try:
            while not self._stop.wait(TICK):  # not a sleep: leaving wakes it at once
                now = time.monotonic()
                passed, last = now - last, now
                self.behind += max(0.0, passed - LONGEST)
                self._clock.wait(min(passed, LONGEST) * self._speed)
        except BaseException as error:  # of the scene: nobody else would hear of it
            self._failed(error)
