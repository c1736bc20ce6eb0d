"""Answers to Modbus requests that pymodbus would answer otherwise than the Modbus specification says."""

from __future__ import annotations

from collections.abc import Coroutine, Iterable, Mapping
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.pdu.bit_message import WriteSingleCoilRequest, WriteSingleCoilResponse
from pymodbus.pdu.mei_message import ReadDeviceInformationRequest, ReadDeviceInformationResponse
from pymodbus.pdu.register_message import WriteSingleRegisterRequest, WriteSingleRegisterResponse

from palpate.simulators.wire.registers import IDENTIFY, Registers

CATEGORIES = {1: range(3), 2: range(0x80), 3: range(0x100)}  # read device id code: numbers of its identity objects
ONE_OBJECT = 4  # the read device id code that asks for a single object


def done(update: Coroutine[Any, Any, ModbusPDU]) -> ModbusPDU:
    """The answer of an update, which ends in one step because a device's action never awaits."""
    try:
        update.send(None)
    except StopIteration as done:
        answer: ModbusPDU = done.value
        return answer
    raise AssertionError("an action awaits something")


def identification(request: ReadDeviceInformationRequest, objects: Mapping[int, bytes]) -> ModbusPDU:
    """The answer to function 43/14."""
    if request.read_code == ONE_OBJECT:
        if request.object_id not in objects:
            return ExceptionResponse(IDENTIFY, ExcCodes.ILLEGAL_ADDRESS)
        asked: Iterable[int] = [request.object_id]
    elif request.read_code in CATEGORIES:
        category = CATEGORIES[request.read_code]
        first = request.object_id if request.object_id in objects and request.object_id in category else 0
        asked = [number for number in sorted(objects) if number in category and number >= first]
    else:
        return ExceptionResponse(IDENTIFY, ExcCodes.ILLEGAL_VALUE)
    return ReadDeviceInformationResponse(request.read_code, {number: objects[number] for number in asked})


def echo(request: WriteSingleRegisterRequest | WriteSingleCoilRequest, registers: Registers) -> ModbusPDU:
    """The answer to a write of one register or coil: what was written, though a command may be idle again by now."""
    values: list[Any] = [*request.bits[:1], *request.registers[:1]]
    refusal = registers.write(request.function_code, request.address, values)
    if refusal is not None:
        return ExceptionResponse(request.function_code, refusal)
    if isinstance(request, WriteSingleCoilRequest):
        return WriteSingleCoilResponse(address=request.address, bits=request.bits)
    return WriteSingleRegisterResponse(address=request.address, registers=request.registers)
