"""Wall time for a simulated bench that is served: a thread moves its clock on."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Self

from palpate.simulators.clock import VirtualClock

TICK = 0.002  # s of the wall between two moves of the clock
PIECE = 0.05  # s of the wall that the clock is moved on at once: requests wait meanwhile
LATE = 0.01  # s of the wall between two moves, after which requests may have been waiting
MOST = 0.5  # s of the wall that are made up for: well below a watchdog's time, since its owner goes by the wall


class Pacer:
    """A context manager: inside it `clock` goes on at `speed` times the speed of the wall's.

    On a busy machine it makes up for the time in which it had no processor, or its clients' waits would be too short
    for the bench; what came before is answered first, by `catch_up`, as a device must not miss what came in time. Where
    the scene cannot keep up, or a request has moved the clock on itself, time goes on from where it stands; what was
    lost is counted in `behind`, in seconds of the wall.
    """

    def __init__(
        self,
        clock: VirtualClock,
        speed: float,
        failed: Callable[[BaseException], None],
        catch_up: Callable[[], object],
    ) -> None:
        self._clock = clock
        self._catch_up = catch_up
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

    def turn(self, passed: float) -> None:
        """Go on after `passed` s of the wall."""
        self.behind += max(0.0, passed - MOST)
        due = min(passed, MOST)
        pieces = math.ceil(due / PIECE)
        for _ in range(pieces):
            if passed > LATE:
                self._catch_up()
            self._clock.wait(due / pieces * self._speed)

    def _run(self) -> None:
        last = time.monotonic()
        try:
            while not self._stop.wait(TICK):  # not a sleep: leaving wakes it at once
                now = time.monotonic()
                self.turn(now - last)
                last = now
        except BaseException as error:  # of the scene: nobody else would hear of it
            self._failed(error)
