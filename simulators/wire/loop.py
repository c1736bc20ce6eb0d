"""Serves the simulated end of all links: in a thread of its own, or in the waits of a client in the same thread."""

from __future__ import annotations

import heapq
import itertools
import logging
import math
import os
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Self

from palpate.instrument.own_process import Ends, Whole, close_in_child
from palpate.simulators.clock import VirtualClock

# --- the loop ------------------------------------------------------------------------------------------


Call = Callable[[], object]
MOST_ROUNDS = 1000  # in a step, which ends although another program asks without end
GLANCE = 0.005  # s of wall time after which a client that waits for no descriptor looks again


class Loop:
    """Calls what is to be called for each descriptor on which something comes, at each time, and in each turn.

    It serves in a thread once `start` has been called, and in `step` and `ready` in any case. Whatever it calls runs
    under `lock`, so that one thing is done at a time. Leaving the context ends it.
    """

    def __init__(self, hurry: Call = lambda: None) -> None:
        """`hurry`: called when a signal comes while something is served, which is done to its end all the same."""
        self._whole = Whole(hurry)
        self._epoll = select.epoll()
        self._ending = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._heard: dict[int, Call] = {}
        self._soon: deque[Call] = deque()
        self._timers: list[tuple[float, int, Call]] = []
        self._numbers = itertools.count()
        self._turns: list[Callable[[], bool]] = []
        self.ports: dict[str, Callable[[], socket.socket | None]] = {}  # what connects a client in this thread
        self.lock = threading.RLock()
        self._inside = False
        self._ends = Ends()
        close_in_child(self, lambda loop: loop._descriptors())
        self._ends.callback(self._close)

    def _descriptors(self) -> list[int]:
        return [] if self._epoll.closed else [*self._heard, self._ending, self._epoll.fileno()]

    def _close(self) -> None:
        self._epoll.close()
        os.close(self._ending)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    def start(self) -> None:
        """Serve in a thread from now on."""
        thread = threading.Thread(target=self._run, name="simulated Modbus", daemon=True)
        self._epoll.register(self._ending, select.EPOLLIN)
        thread.start()
        self._ends.callback(thread.join)
        self._ends.callback(os.eventfd_write, self._ending, 1)

    def _run(self) -> None:
        while True:
            events = self._epoll.poll(self._left())
            if any(descriptor == self._ending for descriptor, _ in events):
                return
            with self.lock:
                try:
                    self._serve([descriptor for descriptor, _ in events])
                except Exception:  # in a thread it would go unnoticed, and end all servers
                    logging.getLogger(__name__).exception("a simulated device failed")

    # --- what is served; to be called while it serves, or before it is used ----------------------------

    def watch(self, descriptor: int, heard: Call, *, writing: bool = False) -> None:
        """Call `heard` whenever something can be read there; with `writing`, or written. Any thread may call this."""
        registered = descriptor in self._heard
        self._heard[descriptor] = heard
        wanted = select.EPOLLIN | (select.EPOLLOUT if writing else 0)
        (self._epoll.modify if registered else self._epoll.register)(descriptor, wanted)

    def forget(self, descriptor: int) -> None:
        """Watch a descriptor no more; to be called before it is closed. Any thread may call this."""
        if self._heard.pop(descriptor, None) is not None:
            self._epoll.unregister(descriptor)

    def soon(self, call: Call) -> None:
        """Call it once all that has come meanwhile had its turn."""
        self._soon.append(call)

    def at(self, due: float, call: Call) -> None:
        """Call it at a time of `time.monotonic`, or later."""
        heapq.heappush(self._timers, (due, next(self._numbers), call))

    def take_turns(self, turn: Callable[[], bool]) -> None:
        """From now on call `turn` in each step, again and again until it returns that nothing was there."""
        self._turns.append(turn)

    def end_turns(self, turn: Callable[[], bool]) -> None:
        self._turns.remove(turn)

    def connected(self, port: str) -> socket.socket | None:
        return self.ports[port]() if port in self.ports else None

    # --- serving ---------------------------------------------------------------------------------------

    def step(self) -> None:
        """Serve all that has come, without waiting for more.

        What is served may move the clock on and so call this again, which then does nothing, as in a forked child.
        """
        with self.lock:
            if self._inside or self._ends.elsewhere:
                return
            self._inside = True
            try:
                with self._whole:
                    for _ in range(MOST_ROUNDS):
                        if not self._serve([descriptor for descriptor, _ in self._epoll.poll(0)]):
                            break
            finally:
                self._inside = False

    def ready(self, descriptor: int, within: float) -> bool:
        """Serve until something can be read at a descriptor, for at most so long [s]; returns whether it can."""
        looked = select.poll()
        looked.register(descriptor, select.POLLIN)
        looked.register(self._epoll, select.POLLIN)
        until = time.monotonic() + within
        while True:
            self.step()
            left = max(until - time.monotonic(), 0.0)
            found = looked.poll(1e3 * (min(left, self._left()) if self._timers else left))
            if any(each == descriptor for each, _ in found):
                return True
            if not found and not left:
                return False

    def glance(self, within: float) -> None:
        """Serve what comes, for a short time: at most `within`, and `GLANCE` [s]."""
        if not select.select([self._epoll], [], [], min(within, GLANCE))[0]:
            return
        self.step()

    def _left(self) -> float:
        """Time until something is to be called [s]; negative: nothing is."""
        if self._soon:
            return 0.0
        return max(self._timers[0][0] - time.monotonic(), 0.0) if self._timers else -1.0

    def _serve(self, descriptors: list[int]) -> bool:
        """Serve these descriptors and all that is due; returns whether there was anything."""
        busy = False
        for descriptor in descriptors:
            if (heard := self._heard.get(descriptor)) is not None:  # else it was closed meanwhile
                busy = True
                heard()
        while self._timers and self._timers[0][0] <= time.monotonic():
            busy = True
            heapq.heappop(self._timers)[2]()
        for _ in range(len(self._soon)):
            busy = True
            self._soon.popleft()()
        for turn in self._turns:
            busy |= turn()
        return busy


# --- pace ----------------------------------------------------------------------------------------------


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
