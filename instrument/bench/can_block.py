"""Frames of nodes that sample at each SYNC, as one thing that a CAN bus within this process hands on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Octets = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """What nodes send at several SYNCs: at each of them one frame of each identifier, in the order of `columns`.

    Attributes:
        time_ns: times of the SYNCs on the bench's clock, shape (n,) [ns].
        columns: for each identifier the data of its frames, shape (n, bytes).
    """

    time_ns: npt.NDArray[np.int64]
    columns: Sequence[tuple[int, Octets]]

    def frames(self) -> Iterator[tuple[int, int, bytes]]:
        """Time [ns], identifier and data of each frame, in the order in which a bus carries them."""
        sent = [(cob_id, data.shape[1], data.tobytes()) for cob_id, data in self.columns]
        for number, time_ns in enumerate(self.time_ns.tolist()):
            for cob_id, size, data in sent:
                yield time_ns, cob_id, data[number * size : (number + 1) * size]


def take_blocks(received: Any) -> None:
    """Let senders put whole blocks into the queue of a receiver on python-can's virtual bus."""
    received.takes_blocks = True


def takes_blocks(received: Any) -> bool:
    """Whether the queue of a receiver takes whole blocks; others on the bus get frames one by one."""
    return getattr(received, "takes_blocks", False)


def time_of(frame: object) -> int | None:
    """Time of a frame on the bench's clock [ns]; None: its bus does not tell it, as one with a wire."""
    return getattr(frame, "time_ns", None)
