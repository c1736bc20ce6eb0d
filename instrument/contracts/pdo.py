"""Process data objects of CANopen nodes (CiA 301): fields that travel together in one frame, without an answer."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from palpate.instrument.errors import ConfigError

NODES = range(1, 128)
LARGEST = 0x7FF  # identifier of a frame
# Identifiers of other messages, whatever the node: of NMT, SYNC and time stamps, with those that CiA 301 keeps free;
# of node guarding. Those that a node has beside its PDOs are below.
KEPT = (range(0x00, 0x81), range(0x100, 0x181), range(0x6E0, 0x700), range(0x780, 0x800))
OF_A_NODE = {"emergencies": 0x80, "SDO answers": 0x580, "SDO requests": 0x600, "heartbeat": 0x700}
SENT, TAKEN = 0x1800, 0x1400  # objects of the first PDO that a node sends, and of the first that it takes
COB_ID, TRANSMISSION_TYPE = 1, 2  # their subindices
AT_SYNC = range(1, 241)  # transmission types
PDOS = 0x200  # PDOs that a node can have in each direction, and objects between one's communication and its mapping
MOST_ENTRIES = 8  # objects of one byte fill a frame
INHIBIT_STEP, LONGEST_INHIBIT = 1e-4, 6.5535  # s


@dataclass(frozen=True, slots=True)
class Pdo:
    """A process data object: COB-ID `base + node id`, fields packed in order.

    Attributes:
        name: its name.
        base: its COB-ID without the node id.
        fields: its fields.
        index: its communication object (1800h and on, or 1400h and on), if a driver sets the PDO when it connects; 0:
            the node has it as it is.
        transmission: its transmission type, which is then set; 1: at every SYNC, 255: when the node wants.
        inhibit: least time between two frames that a node sends, which is then set [s].
        fixed: its communication object, if the node lets nobody set the PDO up; 0: it is not known, or it can be.
        node: the node id at which alone its COB-ID is known; 0: any.
    """

    name: str
    base: int
    fields: tuple[str, ...]
    index: int = 0
    transmission: int = 1
    inhibit: float = 0.0
    fixed: int = 0
    node: int = 0

    def cob_id(self, node_id: int) -> int:
        """Its COB-ID at a node id. Raises ConfigError: it is known at another node id alone."""
        if self.node not in (0, node_id):
            raise ConfigError(
                f"PDO {self.name} has the COB-ID 0x{self.base + self.node:X} at node id {self.node}, and none that is "
                f"known at node id {node_id}; give the device node id {self.node}, or import the maker's file anew"
            )
        return self.base + node_id

    def node_of(self, cob_id: int) -> int:
        """The node id at which it has a COB-ID; 0: there is none."""
        node_id = cob_id - self.base
        return node_id if node_id in NODES and self.node in (0, node_id) else 0


def is_relative(index: int, subindex: int) -> bool:
    """Whether an object holds a COB-ID, to whose default the node id is added."""
    emergency = index == 0x1014
    return emergency or (subindex == COB_ID and (TAKEN <= index < TAKEN + PDOS or SENT <= index < SENT + PDOS))


# --- cyclic frames: a list of frames with one identifier, which a CAN bus sends over and over ------------

# On a real bus the kernel of Linux does this (its broadcast manager). A bus within this machine has no such kernel:
# there the list is handed to the bus's other end, in frames with 29-bit identifiers that no node listens to. That end
# then acts as if it received the frames in time.

MOST_CYCLIC = 256  # frames of a list, as in Linux
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
            if count > MOST_CYCLIC or (count and not period_us):  # no kernel takes such a list
                return None
            self._missing[cob_id] = count
            self._begun[cob_id] = cob_id, [], period_us
        elif kind == HANDED_OVER | CONTENT and self._missing.get(cob_id):
            self._begun[cob_id][1].append(data)
            self._missing[cob_id] -= 1
        else:
            return None
        return None if self._missing[cob_id] else self._begun[cob_id]
