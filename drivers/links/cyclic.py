"""Frames that a CAN bus sends over and over by itself, on time, whatever this program is doing meanwhile."""

from __future__ import annotations

from collections.abc import Sequence

import can

from palpate.instrument.bench.can_ends import MULTICAST
from palpate.instrument.contracts.pdo import hand_over
from palpate.instrument.errors import LinkError

KERNEL = "socketcan"  # the interface of python-can whose cyclic frames the kernel sends
WITHIN = ("virtual", MULTICAST)  # buses within this machine, whose other end is palpate's own
LONGEST_US = 60_000_000


class Cyclic:
    """The lists of frames that one bus sends over and over.

    The kernel forgets its lists when this program ends in any way. A bus within this machine goes on with them.
    """

    def __init__(self, bus: can.BusABC, interface: str, name: str) -> None:
        self._bus, self._interface, self._name = bus, interface, name
        self._tasks: dict[int, can.CyclicSendTaskABC | None] = {}

    def check(self) -> None:
        """Raises LinkError: nothing sends frames on time on this interface."""
        if self._interface not in (KERNEL, *WITHIN):
            raise LinkError(
                f"CAN bus {self._name}: {self._interface} cannot send set-points on time, because no timer of the "
                f"kernel does; use an adapter with interface = {KERNEL!r}"
            )

    def begin(self, cob_id: int, frames: Sequence[bytes], period_us: int) -> None:
        """From now on send these frames in turn, the first at once; they replace those of the same identifier.

        Args:
            cob_id: identifier of the frames.
            frames: their data, up to `palpate.instrument.contracts.pdo.MOST_CYCLIC`.
            period_us: time between two frames [us].

        Raises LinkError: nothing sends frames on time on this interface, or it failed.
        """
        self.check()
        if self._interface == KERNEL:
            self.end(cob_id)
            listed = [can.Message(arbitration_id=cob_id, data=data, is_extended_id=False) for data in frames]
            self._tasks[cob_id] = self._bus.send_periodic(listed, 1e-6 * period_us)
        else:
            self._hand_over(cob_id, frames, period_us)
            self._tasks[cob_id] = None

    def end(self, cob_id: int) -> None:
        """Send no more of the frames with this identifier. Raises can.CanError: the bus failed."""
        if cob_id not in self._tasks:
            return
        task = self._tasks.pop(cob_id)
        if task is None:
            self._hand_over(cob_id, (), 0)
        else:
            task.stop()

    def end_all(self) -> None:
        """As `end`, for all lists."""
        for cob_id in list(self._tasks):
            self.end(cob_id)

    def _hand_over(self, cob_id: int, frames: Sequence[bytes], period_us: int) -> None:
        for identifier, data in hand_over(cob_id, frames, period_us):
            self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=True))
