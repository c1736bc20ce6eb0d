"""Wall time for a simulated bench that is served: a thread moves its clock on."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Self

from simulators.clock import VirtualClock

TICK = 0.002  # s of the wall between two moves of the clock
LONGEST = 0.05  # s of the wall that are made up for at once: requests wait meanwhile
LATE = 0.01  # s of the wall between two moves, after which requests may have been waiting


class Pacer:
    """A context manager: inside it `clock` goes on at `speed` times the speed of the wall's.

    Where the scene cannot keep up, or a request has moved the clock on itself, time goes on from where it stands;
    what was lost is counted in `behind`, in seconds of the wall. On a busy machine what came before a move is answered
    before it, by `catch_up`: a device that waits for a request must not have missed one that came in time.
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
        if passed > LATE:
            self._catch_up()
        self.behind += max(0.0, passed - LONGEST)
        self._clock.wait(min(passed, LONGEST) * self._speed)

    def _run(self) -> None:
        last = time.monotonic()
        try:
            while not self._stop.wait(TICK):  # not a sleep: leaving wakes it at once
                now = time.monotonic()
                self.turn(now - last)
                last = now
        except BaseException as error:  # of the scene: nobody else would hear of it
            self._failed(error)
