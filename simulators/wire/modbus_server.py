"""pymodbus' servers, corrected where they do not follow the Modbus specification.

pymodbus' own servers answer only the first of several pipelined requests, name no function code in the answer to a
request that they cannot decode, answer for an absent unit with code 4, echo the content of a register instead of the
written value, and keep one identity for all servers of a process.
"""

from __future__ import annotations

import asyncio
import logging
import math
import socket
import struct
from collections import deque
from collections.abc import Callable, Collection, Coroutine, Iterable, Mapping
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.bit_message import WriteSingleCoilRequest, WriteSingleCoilResponse
from pymodbus.pdu.mei_message import ReadDeviceInformationRequest, ReadDeviceInformationResponse
from pymodbus.pdu.register_message import WriteSingleRegisterRequest, WriteSingleRegisterResponse
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice
from pymodbus.transaction import TransactionManager

from palpate.instrument.contracts.declaration import ITSELF
from palpate.simulators.wire.device import IDENTIFY, Registers, Units
from palpate.simulators.wire.relay import Damage, Relay
from palpate.simulators.wire.terminal import Terminal

# -------------------------------------------------------------------------------------------------------
# Answers to Modbus requests that pymodbus would answer otherwise than the Modbus specification says

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


# --- Splits the bytes that a Modbus server receives into requests, and recognises malformed ones -------

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


# --- the servers ---------------------------------------------------------------------------------------

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # keeps a client's bad frames out of our stderr

BROADCAST = 0
PIPELINE = 65536  # bytes of received requests that may wait
MOST_CONNECTIONS = 32  # clients of one port
MOST_WAITING = 64  # requests of one client that may wait before the server stops reading from it
IDLE = 60.0  # s of silence after which a client makes room for another
PIECE = 4096  # bytes that are read from one client before the next one has its turn
UNREAD = 65536  # bytes of answers that a client may leave unread
AT_ONCE = struct.pack("ii", 1, 0)  # value of SO_LINGER with which closing resets the connection

UNUSED = SimDevice(1, [SimData(0, datatype=DataType.REGISTERS)])  # pymodbus wants one; `Units` answers in its place

Identity = Callable[[], Mapping[int, bytes]]


class _Connection(ServerRequestHandler):
    """One client, whose requests are answered one after the other."""

    def __init__(self, server: Any) -> None:
        super().__init__(server, server.trace_packet, server.trace_pdu, server.trace_connect)  # type: ignore[no-untyped-call]
        self._completed: Any = server
        self.max_buffer_size = PIPELINE
        self._waiting: deque[ModbusPDU] = deque()

    def callback_data(self, data: bytes, addr: tuple[Any, ...] | None = None) -> int:
        used, answering = 0, bool(self._waiting)
        while used < len(data):
            if isinstance(self.framer, FramerSocket) and alien(data[used:]):
                self.close()  # where the next request begins can no longer be told
                return len(data)
            size = TransactionManager.callback_data(self, data[used:], addr)
            if not size:
                break
            used += size
            if self.last_pdu is not None:
                self._waiting.append(self.last_pdu)
        if self._waiting and not answering:
            self._answer()
        return used

    def _answer(self) -> None:
        """Answer the first waiting request; the next one waits until other clients have had their turn."""
        request = self._waiting.popleft()
        self._completed.transactions += 1
        everybody = request.dev_id == BROADCAST and self._completed.broadcast_enable
        if everybody and BROADCAST not in self._completed.identities:
            for unit in self._completed.identities:
                done(request.datastore_update(self._completed.context, unit))
        else:
            response = self._response(request)
            response.transaction_id, response.dev_id = request.transaction_id, request.dev_id
            self.server_send(response, None)  # type: ignore[no-untyped-call]
        self._answered()
        if self._waiting:
            self.loop.call_soon(self._answer)

    def _answered(self) -> None:
        """Called after each answer."""

    def _response(self, request: ModbusPDU) -> ModbusPDU:
        identity = self._completed.identities.get(request.dev_id)
        if identity is None:
            return ExceptionResponse(request.function_code & ~EXCEPTION, ExcCodes.GATEWAY_NO_RESPONSE)
        registers: Registers = self._completed.context.registers[request.dev_id]
        if isinstance(request, ReadDeviceInformationRequest):
            if IDENTIFY not in registers.functions:
                return ExceptionResponse(IDENTIFY, ExcCodes.ILLEGAL_FUNCTION)
            return identification(request, identity())
        if isinstance(request, WriteSingleRegisterRequest | WriteSingleCoilRequest):
            return echo(request, registers)
        return done(request.datastore_update(self._completed.context, request.dev_id))


class _TcpConnection(_Connection):
    """One client on TCP, limited so that it cannot take the time or the memory of the others."""

    asked = -math.inf  # time of its last request on the loop's clock [s]
    unwanted = False
    _late = b""  # an answer held back until the next request
    _kept: bytearray | None = None  # collects answers instead of sending them; None: they are sent

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        if self.unwanted:
            transport.abort()  # type: ignore[attr-defined]
            return
        transport.max_size = PIECE  # type: ignore[attr-defined]
        super().connection_made(transport)

    def leave(self) -> None:
        """Close, to make room for another client; the connection may not even be established yet."""
        self.unwanted = True
        self.listener = None
        if self.transport:
            self.close()

    def callback_data(self, data: bytes, addr: tuple[Any, ...] | None = None) -> int:
        link = self._completed.link
        used = super().callback_data(data, addr) if link is None or self._waiting else self._struck(data, link)
        if len(self._waiting) > MOST_WAITING and self.transport:
            self.transport.pause_reading()  # type: ignore[attr-defined]
        return used

    def _struck(self, data: bytes, link: Relay) -> int:
        """Answer requests over a link with faults, one whole frame after the other."""
        used = 0
        while (frame := whole_frame(data[used:])) and self.transport:
            if alien(frame):
                self.close()
                return len(data)
            used += len(frame)
            fault = link.struck()
            answer = self._answer_to(frame) if fault is None or fault.forwards else b""
            if fault is not None and fault.then != "goes on":
                self._cut(link, fault)
                return len(data)
            for segment in (self._late, *([answer] if fault is None else fault.segments(frame, answer))):
                if segment and self.transport:
                    self.transport.write(segment)  # type: ignore[attr-defined]
            self._late = answer if fault is not None and fault.holds else b""
        return used

    def _answer_to(self, frame: bytes) -> bytes:
        self._kept = bytearray()
        super().callback_data(frame)
        answer, self._kept = bytes(self._kept), None
        return answer

    def _cut(self, link: Relay, fault: Damage) -> None:
        if fault.then == "refused":
            link.refuse(self._completed, fault.lasts_ns)
        end: Any = self.transport.get_extra_info("socket")
        end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, AT_ONCE)
        self.close()

    def send(self, data: bytes, addr: tuple[Any, ...] | None = None) -> None:
        if self._kept is not None:
            self._kept += data
            return
        begun = self.recv_buffer  # the beginning of the next request, which pymodbus would drop
        super().send(data, addr)
        self.recv_buffer = begun

    def _answered(self) -> None:
        """Read on, or disconnect a client that does not read its answers."""
        self.asked = self.loop.time()
        transport: Any = self.transport
        if transport is None:
            self._waiting.clear()
        elif transport.get_write_buffer_size() > UNREAD:
            self._waiting.clear()
            transport.abort()
        elif len(self._waiting) <= MOST_WAITING:
            transport.resume_reading()


class _Refused(asyncio.Protocol):
    """Turns away one client too many."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.abort()  # type: ignore[attr-defined]


class _Completed:
    """What the TCP and the serial server have in common."""

    identities: dict[int, Identity]
    decoder: DecodePDU
    context: Any
    transactions = 0

    def complete(self, registers: Mapping[int, Registers], identities: dict[int, Identity]) -> None:
        self.identities = identities
        self.context = Units(registers)
        self.decoder = RequestDecoder(frozenset().union(*(each.functions for each in registers.values())))

    def callback_new_connection(self) -> _Connection:
        return _Connection(self)


class TcpServer(_Completed, ModbusTcpServer):
    """One device on a TCP port, addressed by its unit id or by one of `ITSELF`."""

    link: Relay | None = None  # damages requests and answers; None: no faults

    def __init__(self, unit: int, registers: Registers, identity: Identity, address: tuple[str, int]) -> None:
        super().__init__([UNUSED], address=address)
        units = (unit, *ITSELF)
        self.complete(dict.fromkeys(units, registers), dict.fromkeys(units, identity))

    def callback_new_connection(self) -> _Connection:
        return _TcpConnection(self)

    def stop_listening(self) -> None:
        """Accept no new clients; connected clients stay connected."""
        listening: Any = self.transport
        self._address = listening.sockets[0].getsockname()[:2]
        listening.close()

    def listen_again(self) -> None:
        """Listen at the same address again; clients can connect at once, and the loop serves them."""
        host, _ = self._address
        end = socket.create_server(self._address, family=socket.AF_INET6 if ":" in host else socket.AF_INET)
        asyncio.run_coroutine_threadsafe(self._attend(end), self.loop)

    async def _attend(self, end: socket.socket) -> None:
        self.transport = await self.loop.create_server(self.handle_new_connection, sock=end)  # type: ignore[assignment]

    def handle_new_connection(self) -> Any:
        """Accept one more client.

        On a full server it takes the place of the client with the longest silence, if that exceeds `IDLE`; else it is
        turned away.
        """
        if len(self.active_connections) >= MOST_CONNECTIONS:
            clients: Iterable[Any] = self.active_connections.values()
            silent = min(clients, key=lambda client: client.asked)
            if self.loop.time() - silent.asked < IDLE:
                return _Refused()
            del self.active_connections[silent.unique_id]
            silent.leave()
        return super().handle_new_connection()


class SerialServer(_Completed, ModbusSerialServer):
    """Several units on a serial line. All carry out a request to unit 0 (broadcast), and none answers it."""

    def __init__(self, registers: Mapping[int, Registers], identities: dict[int, Identity], **traces: Any) -> None:
        super().__init__([UNUSED], broadcast_enable=True, **traces)
        self.complete(registers, identities)
        self.framer = LineFramer
        self.call_create = self._opened

    async def _opened(self) -> Terminal:
        return Terminal(self.handle_new_connection())
