"""The contracts of the bench's own devices, by name, and what a run keeps of them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.own import (
    POSITIONER,
    SAMPLE_CHANGER,
    SENSOR_NODE,
    SHAKER_AMPLIFIER,
    SIGNAL_GENERATOR,
    STRAIN_INDICATOR,
)

CONTRACTS: dict[str, Contract] = {
    contract.name: contract
    for contract in (SIGNAL_GENERATOR, SHAKER_AMPLIFIER, STRAIN_INDICATOR, POSITIONER, SENSOR_NODE, SAMPLE_CHANGER)
}


def contracts_digest(others: Iterable[Contract] = ()) -> str:
    """SHA-256 over all contracts. Each run keeps it."""
    return hashlib.sha256("".join(c.digest() for c in (*CONTRACTS.values(), *others)).encode()).hexdigest()
