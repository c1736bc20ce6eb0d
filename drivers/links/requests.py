"""Requests that a Modbus device may be sent, for `ModbusLink.transact`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pymodbus.pdu import ModbusPDU

BASIC, REGULAR, EXTENDED = 1, 2, 3  # categories of identity objects


def read_coils(client: Any, address: int, count: int, unit: int) -> ModbusPDU:
    """Read coils (function 1)."""
    reply: ModbusPDU = client.read_coils(address, count=count, device_id=unit)
    return reply


def read_discrete(client: Any, address: int, count: int, unit: int) -> ModbusPDU:
    """Read discrete inputs (function 2)."""
    reply: ModbusPDU = client.read_discrete_inputs(address, count=count, device_id=unit)
    return reply


def read_registers(client: Any, address: int, count: int, unit: int) -> ModbusPDU:
    """Read holding registers (function 3)."""
    reply: ModbusPDU = client.read_holding_registers(address, count=count, device_id=unit)
    return reply


def read_inputs(client: Any, address: int, count: int, unit: int) -> ModbusPDU:
    """Read input registers (function 4)."""
    reply: ModbusPDU = client.read_input_registers(address, count=count, device_id=unit)
    return reply


def write_coil(client: Any, address: int, coils: list[bool], unit: int) -> ModbusPDU:
    """Write one coil (function 5)."""
    reply: ModbusPDU = client.write_coil(address, coils[0], device_id=unit)
    return reply


def write_register(client: Any, address: int, registers: list[int], unit: int) -> ModbusPDU:
    """Write one holding register (function 6)."""
    reply: ModbusPDU = client.write_register(address, registers[0], device_id=unit)
    return reply


def write_coils(client: Any, address: int, coils: list[bool], unit: int) -> ModbusPDU:
    """Write coils (function 15)."""
    reply: ModbusPDU = client.write_coils(address, coils, device_id=unit)
    return reply


def write_registers(client: Any, address: int, registers: list[int], unit: int) -> ModbusPDU:
    """Write holding registers (function 16)."""
    reply: ModbusPDU = client.write_registers(address, registers, device_id=unit)
    return reply


def read_identity(client: Any, category: int, unit: int) -> ModbusPDU:
    """Read a category of identity objects (function 43/14)."""
    reply: ModbusPDU = client.read_device_information(read_code=category, object_id=0, device_id=unit)
    return reply


READS: dict[int, Callable[..., ModbusPDU]] = {1: read_coils, 2: read_discrete, 3: read_registers, 4: read_inputs}
WRITES: dict[int, Callable[..., ModbusPDU]] = {5: write_coil, 6: write_register, 15: write_coils, 16: write_registers}


def only_reads(request: Callable[..., ModbusPDU]) -> bool:
    """Whether a request changes nothing, so that it can be sent again."""
    return request is read_identity or request in READS.values()


def confirms(reply: Any, function: int, address: int, values: list[Any]) -> bool:
    """Whether a reply confirms that these values were written with this function from this address on."""
    if reply.function_code != function or reply.address != address:
        return False
    if function in (15, 16):
        return bool(reply.count == len(values))
    return bool((reply.bits if function == 5 else reply.registers) == values)  # they come back as they were sent
