"""The SYNC of a CAN bus, by which its nodes sample (CiA 301, 7.2.5).

One of the nodes sends it, whose crystal keeps the rate. This program sends none: between two programs of a PC a frame
may wait for milliseconds, and a sample that is taken at another time than its number says is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np

from palpate.drivers.links.can import CanLink
from palpate.instrument.contracts.sensor_node import SYNC_COB_ID, SYNC_PRODUCER
from palpate.instrument.errors import DeviceError, RangeError

COB_ID, PERIOD = 0x1005, 0x1006  # objects
MICROSECONDS = 1e6
LONGEST = (1 << 32) - 1  # µs
BLOCK = 16  # SYNCs whose time stamps are compared with the next ones by their median
SHIFT = 0.4  # of a period: how far they must move until a SYNC is taken to be missing


class Asks(Protocol):
    """The node for which SYNC is sent, whose name stands in messages."""

    name: str
    link: CanLink


class Sync:
    """Switches SYNC on and off in the node that sends it."""

    def __init__(self, asking: Asks, node_id: int) -> None:
        self._asking, self.node_id = asking, node_id
        self.rate = 0.0  # SYNCs a second; 0: not set

    def set_rate(self, rate: float) -> None:
        """Set the rate [1/s], while no SYNC is sent. Raises RangeError, LinkError, DeviceError."""
        period = MICROSECONDS / rate if rate > 0 else math.inf
        if not 1 <= round(min(period, 2 * LONGEST)) <= LONGEST:
            raise RangeError(f"{self._asking.name}: no period of SYNC gives {rate:g} samples/s; give 0.001 to 1e6")
        self.off()  # a program that was killed may have left it on
        self._write(PERIOD, round(period))
        self.rate = MICROSECONDS / round(period)

    def lost(self) -> bool:
        """Whether the node that sends SYNC no longer holds its rate. Raises LinkError, DeviceError."""
        if not self.rate:
            return False
        held = self._asking.link.upload(self._asking.name, self._asking.link.add_node(self.node_id), PERIOD, 0, 4)
        return int.from_bytes(held, "little") != round(MICROSECONDS / self.rate)

    def restore(self) -> None:
        """Write the rate again. Raises LinkError, DeviceError."""
        if self.rate:
            self.set_rate(self.rate)

    def on(self) -> None:
        self._write(COB_ID, SYNC_PRODUCER | SYNC_COB_ID)

    def off(self) -> None:
        self._write(COB_ID, SYNC_COB_ID)

    def _write(self, index: int, value: int) -> None:
        link, who = self._asking.link, f"{self._asking.name}, whose SYNC node {self.node_id} sends"
        try:
            link.download(who, link.add_node(self.node_id), index, 0, value.to_bytes(4, "little"))
        except DeviceError as error:
            raise DeviceError(
                f"{error}, writing {index:04X}h; a node that sends SYNC takes this, so name one by sync_node"
            ) from None


def missing_sync(stamps: Sequence[float], rate: float) -> int | None:
    """Number of the SYNC from which on some are missing or too many, by the times at which they came; None: none is.

    A lost SYNC moves all later ones by a period, and a late time stamp moves itself alone. So the medians of successive
    blocks are compared.

    Args:
        stamps: time stamps of the CAN adapter or its driver, shape (n,) [s].
        rate: SYNCs a second.
    """
    late = np.asarray(stamps) * rate - np.arange(len(stamps))
    blocks = [float(np.median(late[at : at + BLOCK])) for at in range(0, len(late), BLOCK)]
    return next((at * BLOCK + 1 for at, (one, two) in enumerate(pairwise(blocks)) if abs(two - one) > SHIFT), None)
