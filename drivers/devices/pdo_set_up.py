"""How a node is told which fields its process data hold (CiA 301, 7.5.2.35 to 7.5.2.38)."""

from __future__ import annotations

from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.pdo import COB_ID, INHIBIT_STEP, PDOS, SENT, TRANSMISSION_TYPE, Pdo

INHIBIT_TIME = 3  # subindex of a communication object
OFF, NO_RTR = 0x8000_0000, 0x4000_0000  # bits of a COB-ID; many nodes refuse to change the second one

Write = tuple[int, int, bytes]
"""Index, subindex and content of an object."""


def entries(contract: Contract, pdo: Pdo) -> list[Write]:
    """The objects that hold the mapping of a PDO: the number of its fields last, as a node takes it."""
    mapping = pdo.index + PDOS
    fields = [contract[name] for name in pdo.fields]
    found = [
        (mapping, number, _u32(field.index << 16 | field.subindex << 8 | 8 * field.size))
        for number, field in enumerate(fields, 1)
    ]
    return [*found, (mapping, 0, bytes([len(fields)]))]


def steps(contract: Contract, pdo: Pdo, node_id: int, held: int) -> list[Write]:
    """What is written to set a PDO up, in order: it is off until all is written.

    Args:
        contract: the contract of the node.
        pdo: one of its PDOs.
        node_id: the node id.
        held: the COB-ID that the node holds, whose bit 30 must stay.
    """
    cob_id = pdo.cob_id(node_id) | held & NO_RTR
    found = [
        (pdo.index, COB_ID, _u32(cob_id | OFF)),
        (pdo.index + PDOS, 0, b"\0"),
        *entries(contract, pdo),
        (pdo.index, TRANSMISSION_TYPE, bytes([pdo.transmission])),
    ]
    if pdo.index >= SENT and pdo.inhibit:
        found.append((pdo.index, INHIBIT_TIME, round(pdo.inhibit / INHIBIT_STEP).to_bytes(2, "little")))
    return [*found, (pdo.index, COB_ID, _u32(cob_id))]


def _u32(value: int) -> bytes:
    return value.to_bytes(4, "little")
