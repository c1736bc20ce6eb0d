"""Memory that endures a limited number of writes: it is never written in a loop."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection

from palpate.drivers.clock import Clock
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.errors import DeviceError

MOST, WITHIN = 10, 3600.0  # writes of one field in this time [s]: 10,000 writes then last for six weeks without a pause


class Wear:
    """The writes of a device's fields whose memory wears."""

    def __init__(self, device: str, contract: Contract, clock: Clock) -> None:
        self._device, self._contract, self._clock = device, contract, clock
        self._written: dict[str, deque[int]] = {f.name: deque(maxlen=MOST) for f in contract.fields if f.endures}

    def of(self, names: Collection[str]) -> list[str]:
        """Those of some fields that wear."""
        if not self._written:
            return []
        return [name for name in names if name in self._written]

    def count(self, names: Collection[str]) -> None:
        """Count a write that is about to be sent. Raises DeviceError: too many were; it must not be sent."""
        now = self._clock.now_ns()
        for name in names:
            times = self._written[name]
            if len(times) == MOST and now - times[0] < 1e9 * WITHIN:
                raise DeviceError(
                    f"{self._device}: {name} was written {MOST} times within {WITHIN:g} s, and its memory endures "
                    f"{self._contract[name].endures} writes, so it is not written; write it once, before the run, or "
                    f"wait {WITHIN - 1e-9 * (now - times[0]):.0f} s",
                    device=self._device,
                )
        for name in names:
            self._written[name].append(now)
