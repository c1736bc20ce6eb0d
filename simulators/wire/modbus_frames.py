"""Splits the bytes that a Modbus server receives into requests, and recognises malformed ones."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU

from palpate.simulators.wire.registers import IDENTIFY

READ_IDENTITY = b"\x0e"
HEADER = 6  # bytes of an MBAP header up to the end of its length field
UNIT_AND_CHECK = 3  # bytes around a request on a serial line: unit id and CRC
LONGEST_REQUEST = 256  # bytes on a serial line
LENGTHS = range(2, 255)  # values that the length field of an MBAP header may have
EXCEPTION = 0x80  # the bit of a function code that marks an exception


class Refusal(ModbusPDU):
    """A request that gets an exception code as its answer, whatever it asks for."""

    def __init__(self, function: int, code: ExcCodes) -> None:
        super().__init__()
        self.function_code = function
        self._code = code

    async def datastore_update(self, context: Any, device_id: int) -> ModbusPDU:
        return ExceptionResponse(self.function_code & ~EXCEPTION, self._code)


class _WholeFrame(ModbusPDU):
    """A request with an unknown function code on a serial line: only the end of its bytes tells its length."""

    @classmethod
    def calculateRtuFrameSize(cls, data: bytes) -> int:
        return len(data)


class RequestDecoder(DecodePDU):
    """Decodes every request: a good one as itself, a bad one as the `Refusal` that answers it."""

    def __init__(self, functions: Collection[int]) -> None:
        """Make a decoder; `functions` are the codes of the functions that the server has."""
        super().__init__(True)
        self.functions = functions

    def decode(self, frame: bytes) -> ModbusPDU:
        function, kind = frame[0], frame[1:2]
        if function not in self.functions or (function == IDENTIFY and kind != READ_IDENTITY):
            return Refusal(function, ExcCodes.ILLEGAL_FUNCTION)
        request = super().decode(frame)
        if request is None or not _same(request, frame):  # a count of 0 or too large, missing or surplus bytes
            return Refusal(function, ExcCodes.ILLEGAL_VALUE)
        return request

    def lookupPduClass(self, data: bytes) -> type[ModbusPDU] | None:
        known: type[ModbusPDU] | None = super().lookupPduClass(data)
        if known is None and FramerRTU.check_CRC(data[:-2], int.from_bytes(data[-2:], "big")):
            return _WholeFrame
        return known


class LineFramer(FramerRTU):
    """Takes one frame at a time.

    A pseudo-terminal may deliver two frames in one piece, without the silence between them.
    """

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        used, unit, transaction, frame = super().decode(data)
        if frame:
            used = data.index(bytes([unit]) + frame) + len(frame) + UNIT_AND_CHECK
            return used, unit, transaction, frame
        return self._last(data) or (used, unit, transaction, frame)

    def _last(self, data: bytes) -> tuple[int, int, int, bytes] | None:
        """The whole request at the end of `data`, after the bytes of a broken one that arrived together with it."""
        decoder: Any = self.decoder
        for at in range(max(1, len(data) - LONGEST_REQUEST), len(data) - UNIT_AND_CHECK):
            tail, check = data[at:], int.from_bytes(data[-2:], "big")
            kind = decoder.lookupPduClass(tail) if tail[1] in decoder.functions else None
            if kind and kind.calculateRtuFrameSize(tail) == len(tail) and self.check_CRC(tail[:-2], check):
                return len(data), tail[0], 0, tail[1:-2]
        return None


def _same(request: ModbusPDU, frame: bytes) -> bool:
    """Whether the request encodes to exactly these bytes."""
    try:
        return frame == bytes([request.function_code]) + request.encode()
    except (ModbusException, ValueError):
        return False


def alien(data: bytes) -> bool:
    """Whether `data` cannot be the beginning of a request on TCP, by its MBAP header."""
    return any(data[2:4]) or (len(data) >= HEADER and int.from_bytes(data[4:HEADER], "big") not in LENGTHS)


def whole_frame(data: bytes) -> bytes:
    """The first whole request on TCP; empty if it is incomplete.

    Bytes that cannot begin a request are returned with everything after them.
    """
    if alien(data):
        return data
    size = HEADER + int.from_bytes(data[4:HEADER], "big")
    return data[:size] if HEADER < size <= len(data) else b""
