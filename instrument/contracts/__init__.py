"""The contracts of the bench's six devices. The maps are our own; each module names the real maps that it imitates."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

from palpate.instrument.contracts import (
    positioner,
    sample_changer,
    sensor_node,
    shaker_amplifier,
    signal_generator,
    strain_indicator,
)
from palpate.instrument.contracts.contract import Contract

CONTRACTS: dict[str, Contract] = {
    module.CONTRACT.name: module.CONTRACT
    for module in (signal_generator, shaker_amplifier, strain_indicator, positioner, sensor_node, sample_changer)
}


def contracts_digest(others: Iterable[Contract] = ()) -> str:
    """SHA-256 over all contracts. Each run keeps it."""
    return hashlib.sha256("".join(c.digest() for c in (*CONTRACTS.values(), *others)).encode()).hexdigest()
