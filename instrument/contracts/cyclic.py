"""Cyclic frames: a list of frames with one identifier, which a CAN bus sends over and over by itself.

On a real bus the kernel of Linux does this (its broadcast manager). A bus within this machine has no such kernel: there
the list is handed to the bus's other end, in frames with 29-bit identifiers that no node listens to. That end then acts
as if it received the frames in time.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence

from palpate.instrument.contracts.pdo import LARGEST

MOST = 256  # frames of a list, as in Linux
HANDED_OVER, CONTENT = 0x1CBC_0000, 0x800  # identifiers are these and the identifier of the frames
HEAD = struct.Struct("<HI")  # number of frames, 0: the list ends; time between two frames [us]

Listed = tuple[int, list[bytes], int]
"""Identifier, frames, and the time between two frames [us]; no frames: the list ends."""


def hand_over(cob_id: int, frames: Sequence[bytes], period_us: int) -> Iterator[tuple[int, bytes]]:
    """29-bit identifier and data of the frames that hand a list over; an empty list ends the last one."""
    yield HANDED_OVER | cob_id, HEAD.pack(len(frames), period_us)
    for data in frames:
        yield HANDED_OVER | CONTENT | cob_id, data


class Receiver:
    """Puts lists together from the frames that hand them over."""

    def __init__(self) -> None:
        self._begun: dict[int, Listed] = {}
        self._missing: dict[int, int] = {}

    def heard(self, identifier: int, data: bytes) -> Listed | None:
        """The list that a frame completes; None: it completes none, or is none of these frames."""
        cob_id, kind = identifier & LARGEST, identifier & ~LARGEST
        if kind == HANDED_OVER and len(data) == HEAD.size:
            count, period_us = HEAD.unpack(data)
            if count > MOST or (count and not period_us):  # no kernel takes such a list
                return None
            self._missing[cob_id] = count
            self._begun[cob_id] = cob_id, [], period_us
        elif kind == HANDED_OVER | CONTENT and self._missing.get(cob_id):
            self._begun[cob_id][1].append(data)
            self._missing[cob_id] -= 1
        else:
            return None
        return None if self._missing[cob_id] else self._begun[cob_id]
