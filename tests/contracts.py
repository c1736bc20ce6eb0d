"""Contracts of devices that nobody sells, for tests of what a map may say."""

from __future__ import annotations

from typing import Any

from palpate.instrument.contracts.contract import Contract, Field, Identity


def modbus_contract(*fields: Field, **more: Any) -> Contract:
    """A Modbus device with these fields."""
    return Contract("thing", "thing", "modbus", Identity("Maker", "Thing", "1.0"), fields, **more)


def canopen_contract(*fields: Field, **more: Any) -> Contract:
    """A CANopen node with these objects; it has a number of its maker only."""
    return Contract("node", "node", "canopen", Identity("0x5F", "", ""), fields, **more)
