"""The bench's clock for drivers and procedures. While the bench drives, waits feed the exciter's watchdog in time."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol

from palpate.drivers.clock import BenchClock
from palpate.drivers.devices.canopen_device import Heartbeat
from palpate.instrument.own_process import Own

LOOKS = 1.0  # s between two checks of an exciter without a watchdog


class Fed(Protocol):
    """A device with a watchdog; see `palpate.drivers.devices.exciter.WatchdogGuard`."""

    def feed(self) -> None: ...
    def live(self) -> None: ...


class Watched(Protocol):
    """The exciter; see `palpate.drivers.devices.exciter.Exciter`."""

    @property
    def guard(self) -> Fed | None: ...
    def check(self) -> object: ...


class WatchedClock:
    """A clock whose waits are divided into pieces of half the watchdog's time-out; it checks the exciter after each.

    A virtual clock moves only during waits and requests. It feeds the watchdog after one of these, as soon as a quarter
    of the time-out has passed. A clock that goes on by itself also moves while the program computes. There a heartbeat,
    which is a thread, feeds the watchdog.
    """

    def __init__(self, clock: BenchClock) -> None:
        """Make the clock of a bench from the one that keeps the time. It has no exciter to watch yet."""
        self._clock = clock
        self.read_ns = 0  # time that was read last [ns]; a bus log notes each time that is read anew
        self._exciter: Watched | None = None
        self._guard: Fed | None = None
        self._longest = LOOKS
        self._fed_ns = 0
        self._heartbeat: Heartbeat | None = None
        self._heard: Callable[[int], object] = lambda _now_ns: None
        self._watching = False
        self._own = Own()

    def look_after(self, exciter: Watched, watchdog: float) -> None:
        """Watch this exciter whenever it drives; `watchdog`: time-out of its watchdog, if it has one [s]."""
        self._exciter, self._guard = exciter, exciter.guard
        if self._guard:
            self._longest = watchdog / 2
            self._heartbeat = Heartbeat(self._guard.live, watchdog / 4) if self._clock.goes_on else None

    def tap(self, heard: Callable[[int], object]) -> None:
        """From now on call `heard` with each time that somebody reads [ns]."""
        self._heard = heard

    def beating(self) -> AbstractContextManager[object]:
        """A context in which the heartbeat runs, if there is one, whether the bench drives or not."""
        return self._heartbeat or nullcontext()

    @property
    def watching(self) -> bool:
        """Whether the exciter drives, so that it must be fed and checked."""
        return self._watching

    @watching.setter
    def watching(self, watching: bool) -> None:
        self._watching = watching
        if self._heartbeat:
            self._heartbeat.expect(0.0 if watching else math.inf)
            self._heartbeat.failure()  # forgets an earlier failure
        elif watching and self._guard:
            self._fed_ns = self._clock.now_ns()  # it has just been enabled

    def now_ns(self) -> int:
        now = self.read_ns = self._clock.now_ns()
        self._heard(now)
        return now

    def wait(self, duration: float) -> None:
        """Wait for `duration` [s].

        Raises:
            BenchError: this process is a child that was forked from that of the bench.
            SafetyError: the exciter trips meanwhile.
            BenchInUse, SettingsLost: the exciter no longer knows this program as its owner.
        """
        self._own.check()
        while self.watching and duration > self._longest:
            self._pass(self._longest)
            duration -= self._longest
        self._pass(duration)

    def _pass(self, duration: float) -> None:
        if not self.watching or self._exciter is None:
            self._clock.wait(duration)
            return
        if self._heartbeat:
            self._heartbeat.expect(duration)
        self._clock.wait(duration)
        if self._heartbeat:
            self._heartbeat.expect(0.0)
            if failure := self._heartbeat.failure():
                raise failure
        self.feed_in_time()
        self._exciter.check()

    def feed_in_time(self) -> None:
        """Feed the watchdog if it is due; called after waits and requests, during which alone a virtual clock moves.

        Raises as the guard's `feed` does.
        """
        if self.watching and self._guard and not self._heartbeat:
            now = self._clock.now_ns()
            if 2e-9 * (now - self._fed_ns) >= self._longest:
                self._fed_ns = now
                self._guard.feed()
