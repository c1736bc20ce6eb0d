"""Process data objects of CANopen nodes (CiA 301): fields that travel together in one frame, without an answer."""

from __future__ import annotations

from dataclasses import dataclass

LARGEST = 0x7FF  # identifier of a frame
# Identifiers of other messages, whatever the node: of NMT, SYNC and time stamps, with those that CiA 301 keeps free;
# of node guarding. Those that a node has beside its PDOs are below.
KEPT = (range(0x00, 0x81), range(0x100, 0x181), range(0x6E0, 0x700), range(0x780, 0x800))
OF_A_NODE = {"emergencies": 0x80, "SDO answers": 0x580, "SDO requests": 0x600, "heartbeat": 0x700}
SENT, TAKEN = 0x1800, 0x1400  # objects of the first PDO that a node sends, and of the first that it takes
COB_ID, TRANSMISSION_TYPE = 1, 2  # their subindices
AT_SYNC = range(1, 241)  # transmission types


@dataclass(frozen=True, slots=True)
class Pdo:
    """A process data object: COB-ID `base + node id`, fields packed in order."""

    name: str
    base: int
    fields: tuple[str, ...]

    def cob_id(self, node_id: int) -> int:
        return self.base + node_id


def is_relative(index: int, subindex: int) -> bool:
    """Whether an object holds a COB-ID, to whose default the node id is added."""
    emergency = index == 0x1014
    return emergency or (subindex == COB_ID and (TAKEN <= index < TAKEN + 0x200 or SENT <= index < SENT + 0x200))
