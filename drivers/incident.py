"""What went wrong on a bench and was made good: told to the record at once, and counted."""

from __future__ import annotations

from collections.abc import Callable

from palpate.drivers.clock import Clock

INCIDENT = "incident"  # kind of the event
Store = Callable[[str, str, int], object]


class Incidents:
    """Of one bench."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._store: Store | None = None
        self._waiting: list[tuple[str, int]] = []
        self._new = 0

    def note(self, what: str) -> None:
        """Raises what storing raises: what cannot be recorded stops the run."""
        self._new += 1
        if self._store is None:
            self._waiting.append((what, self._clock.now_ns()))
        else:
            self._store(INCIDENT, what, self._clock.now_ns())

    def hold(self) -> None:
        """The record may be closed from now on: what comes is not stored."""
        self._store = None

    def new(self) -> int:
        """How many there were since the last call: what a point says of the time since the point before."""
        new, self._new = self._new, 0
        return new

    def tell(self, store: Store) -> None:
        """Store each with `store(kind, message, bench_ns)` from now on, and those so far."""
        self._store = store
        waiting, self._waiting = self._waiting, []
        for what, bench_ns in waiting:
            store(INCIDENT, what, bench_ns)
