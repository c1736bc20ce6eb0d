"""Contracts of devices that nobody sells, for tests of what a map may say."""

from __future__ import annotations

from typing import Any

from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import Identity
from palpate.instrument.contracts.field import Field, Scaling

SCALE = Field("scale", 1, "uint16", "scale")
SCALED = Field("value", 0x10, "int16", "value", scaling=Scaling("scale"))


def modbus_contract(*fields: Field, **more: Any) -> Contract:
    """A Modbus device with these fields."""
    return Contract("thing", "thing", "modbus", Identity("Maker", "Thing", "1.0"), fields, **more)


def canopen_contract(*fields: Field, **more: Any) -> Contract:
    """A CANopen node with these objects; it has a number of its maker only."""
    return Contract("node", "node", "canopen", Identity("0x5F", "", ""), fields, **more)


def contract(*fields: Field, bus: str = "modbus", **more: Any) -> Contract:
    """A device with these fields on either bus."""
    return (modbus_contract if bus == "modbus" else canopen_contract)(*fields, **more)


def one(**given: Any) -> Contract:
    """A device with one field of these attributes."""
    return contract(Field(**{"name": "value", "address": 0x10, "type": "int32", "meaning": "value"} | given))
