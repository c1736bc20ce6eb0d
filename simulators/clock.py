"""The clock of a simulated bench: a wait advances the simulation, and takes no real time unless a pace is set."""

from __future__ import annotations

import math
import threading
import time
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Protocol

from palpate.instrument.errors import BenchError, PalpateError

if TYPE_CHECKING:
    from palpate.instrument.bench.links import Stepper

NEVER = 2**63 - 1
PATIENCE = 1.0  # s of wall time in which an interrupted program can still switch its outputs off


class Simulated(Protocol):
    """Something that the virtual clock advances."""

    def next_event_ns(self) -> int:
        """Time of its next event without any request, or NEVER [ns]."""

    def advance(self, start_ns: int, end_ns: int) -> None:
        """Advance over (start, end] [ns]; nothing else in the simulation changes in this time, except at `end`."""


class VirtualClock:
    """Simulated time in integer nanoseconds since the bench was opened.

    All that is simulated changes under `lock` only: during a wait in the waiting thread, or during a request in the
    thread that serves it. Between two events everything advances in one step, in the order in which it was added, so
    that results do not depend on how a wait is divided.
    """

    goes_on = False  # True: time passes without waits, because a pacer moves the clock on
    served = False  # whether clients in other processes keep the time of the wall
    stepper: Stepper | None = None  # answers in the waits of its clients; None: threads do
    pace: float | None = None  # most simulated seconds in a second of the wall's clock; None: no limit

    def __init__(self) -> None:
        self.lock: AbstractContextManager[Any] = threading.RLock()
        self.failure: PalpateError | None = None  # why the scene cannot be followed any more; None: it can be
        self._now = 0
        self._began: float | None = None  # `time.monotonic` when this clock would have shown 0 at its pace
        self._given_up_at: float | None = None  # of `time.monotonic`
        self._simulated: list[Simulated] = []

    def add(self, simulated: Simulated) -> None:
        self._simulated.append(simulated)

    def remove(self, simulated: Simulated) -> None:
        """Stop advancing it; call this under the lock."""
        self._simulated = [other for other in self._simulated if other is not simulated]

    def now_ns(self) -> int:
        return self._now

    def wait(self, duration: float) -> None:
        """Let simulated time pass [s].

        Raises ValueError: the duration is negative or not finite; PalpateError: the scene cannot be simulated.
        """
        if not (math.isfinite(duration) and duration >= 0):
            raise ValueError(f"cannot wait {duration} s; a wait is finite and not negative")
        if self.failure is not None:
            raise self.failure
        if self.pace is not None and self._began is None:
            self._began = time.monotonic() - 1e-9 * self._now / self.pace
        with self.lock:
            try:
                self._pass(self._now + round(duration * 1e9))
            except Exception as error:
                raise self.failed(error)  # noqa: B904  (it has its cause)
        if self.stepper is not None:
            self.stepper.step()  # clients hear at once what was sent meanwhile
        if self.pace is not None and self._began is not None:
            ahead = self._began + 1e-9 * self._now / self.pace - time.monotonic()
            time.sleep(max(0.0, ahead))  # noqa: TID251  (this is a bench's clock)

    def _pass(self, target: int) -> None:
        while self._now < target:
            step = min([target, *(s.next_event_ns() for s in self._simulated)])
            start, self._now = self._now, step
            for simulated in self._simulated:
                simulated.advance(start, step)

    def failed(self, error: Exception) -> PalpateError:
        """Keep the first error of computing the scene, which a device cannot tell on the wire.

        Returns the error to be raised: the same one, or one for people.
        """
        failure: PalpateError
        if isinstance(error, PalpateError):
            failure = error
        else:
            why = f"{type(error).__name__}: {' '.join(str(error).split())}"
            failure = BenchError(f"the scene cannot be simulated: {why}; look for a number in it that no bench has")
            failure.__cause__ = error
        self.failure = self.failure or failure
        return failure

    def give_up_soon(self) -> None:
        """From a while on, `check` ends what is being computed, because somebody has interrupted the program."""
        self._given_up_at = time.monotonic() + PATIENCE

    def check(self) -> None:
        """Called again and again while the scene is followed. Raises BenchError: somebody has interrupted that."""
        if self._given_up_at is not None and time.monotonic() > self._given_up_at:
            raise BenchError("the simulation was interrupted")
