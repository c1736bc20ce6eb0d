"""A sample changer, for a bench at which nobody stands."""

from __future__ import annotations

from collections.abc import Sequence

from instrument.sample import Sample
from simulators.clock import NEVER
from simulators.rig import Rig


class Changer:
    """Lives on the virtual clock: the first sample lies under the probe, the next whenever that has come home again."""

    def __init__(self, rig: Rig, samples: Sequence[Sample]) -> None:
        self._rig = rig
        self._waiting = list(samples)
        self._below = False
        self._next()

    def next_event_ns(self) -> int:
        return NEVER

    def advance(self, start_ns: int, end_ns: int) -> None:
        below = self._rig.position > 0
        if self._below and not below:
            self._next()
        self._below = below

    def _next(self) -> None:
        if self._waiting:
            self._rig.mount(self._waiting.pop(0))
