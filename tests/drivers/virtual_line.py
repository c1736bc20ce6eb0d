"""A serial line of pure arithmetic: our client's own code, with a device and a clock in place of port and wall."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterable
from typing import Any

from palpate.drivers.links.modbus import RtuClient
from palpate.instrument.bench.links import SILENCE
from palpate.instrument.contracts.maps.golden_frames import crc

BITS = 10  # of a character: start, eight, stop
Answers = Callable[[bytes], Iterable[tuple[float, bytes]]]


def checked(frame: bytes) -> bytes:
    """A frame with its check sum."""
    return frame + crc(frame)


class VirtualLine(RtuClient):
    """`device` gives for a request when what comes on the line: each so many s after the wire could bring it first.

    A delay may be negative: then it is a byte that nobody asked for.
    """

    def __init__(self, device: Answers, baudrate: int = 115200, timeout: float = 1.0, **settings: Any) -> None:
        super().__init__("virtual line", baudrate=baudrate, timeout=timeout, **settings)
        self.device = device
        self.speed = baudrate
        self.now = 0.0
        self._timeout = timeout
        self._coming: list[tuple[float, int, bytes]] = []
        self._numbers = itertools.count()

    def connect(self) -> bool:
        return True

    def close(self) -> None:
        """It stays as it is."""

    def wire(self, size: float) -> float:
        """What so many characters take [s]."""
        return size * BITS / self.comm_params.baudrate

    def comes(self, at: float, data: bytes) -> None:
        """`data` comes as a whole, at this time [s]."""
        heapq.heappush(self._coming, (at, next(self._numbers), data))

    def _patience(self) -> float:
        return self._timeout

    def _now(self) -> float:
        return self.now

    def _ready(self, within: float) -> bool:
        until = self.now + within
        if self._coming and self._coming[0][0] <= until:
            self.now = max(self.now, self._coming[0][0])
            return True
        self.now = until
        return False

    def _read(self) -> bytes:
        data = b""
        while self._coming and self._coming[0][0] <= self.now:
            data += heapq.heappop(self._coming)[2]
        return data

    def _write(self, request: bytes) -> int:
        first = self.now + self.wire(len(request) + SILENCE)
        for delay, data in self.device(request):
            self.comes(first + delay + (self.wire(len(data)) if delay >= 0 else 0.0), data)
        return len(request)
