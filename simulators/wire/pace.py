"""Lets the clock of a served simulated bench follow the wall clock, by a thread that moves it on."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Self

from palpate.instrument.own_process import Ends
from palpate.simulators.clock import VirtualClock

TICK = 0.002  # s of wall time between two moves of the clock
PIECE = 0.05  # s of wall time by which the clock moves at most at once, because requests wait meanwhile
LATE = 0.01  # s of wall time since the last move, above which requests may have been waiting
MOST = 0.5  # s of wall time made up for at most: far less than a watchdog's time, which its client keeps by wall time


class Pacer:
    """A context manager inside which `clock` runs at `speed` times the speed of the wall clock.

    On a busy machine it makes up for the time in which it had no processor; else the waits of its clients would be too
    short for the bench. Before it does so, `catch_up` lets the servers answer the requests that have arrived, because a
    device must not miss a request that came in time. Where the simulation is too slow, or a request has moved the clock
    on itself, the clock goes on from where it stands.

    Args:
        clock: the clock to move on.
        speed: seconds of the clock for each second of wall time.
        failed: called with an error of the simulation, which would otherwise end this thread unnoticed.
        catch_up: lets the servers take up all requests that have arrived.

    Attributes:
        behind: wall time that was lost, and not made up for [s].
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
        self._ends = Ends()
        self._thread = threading.Thread(target=self._run, name="pacer", daemon=True)
        self.behind = 0.0

    def __enter__(self) -> Self:
        self._thread.start()
        self._ends.callback(self._thread.join)
        self._ends.callback(self._stop.set)
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    def turn(self, passed: float) -> None:
        """Move the clock on after `passed` seconds of wall time."""
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
            while not self._stop.wait(TICK):  # no sleep, so that leaving ends it at once
                now = time.monotonic()
                self.turn(now - last)
                last = now
        except BaseException as error:  # in a thread it would go unnoticed
            self._failed(error)
