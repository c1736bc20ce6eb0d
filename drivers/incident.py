"""Incidents: failures on a bench that it has recovered from. They are recorded at once, and counted."""

from __future__ import annotations

from collections.abc import Callable

from palpate.drivers.clock import Clock

INCIDENT = "incident"  # kind of the event
Store = Callable[[str, str, int], object]


class Incidents:
    """The incidents of one bench; `first` is the first one since it was emptied."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._store: Store | None = None
        self._waiting: list[tuple[str, int]] = []
        self._new = 0
        self.first = ""

    def note(self, what: str) -> None:
        """Count and record an incident. Raises what `store` raises: without a record of it the run must end."""
        self._new += 1
        self.first = self.first or what
        if self._store is None:
            self._waiting.append((what, self._clock.now_ns()))
        else:
            self._store(INCIDENT, what, self._clock.now_ns())

    def hold(self) -> None:
        """Stop recording incidents, because the record may be closed from now on."""
        self._store = None

    def new(self) -> int:
        """Number of incidents since the last call; a point has the number since the point before it."""
        new, self._new = self._new, 0
        return new

    def tell(self, store: Store) -> None:
        """Record the incidents so far, and each later one, with `store(kind, message, bench_ns)`."""
        self._store = store
        waiting, self._waiting = self._waiting, []
        for what, bench_ns in waiting:
            store(INCIDENT, what, bench_ns)
