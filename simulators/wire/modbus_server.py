"""pymodbus' servers, completed where they fall short of the Modbus specification.

Taken alone they answer the first of several pipelined requests only, name no function in the answer to one they
cannot read, give code 4 for a unit that is absent, echo what a register holds instead of what was written to it, and
keep one identity for all servers of a process.
"""

from __future__ import annotations

import asyncio
import logging
import math
import socket
import struct
from collections import deque
from collections.abc import Callable, Coroutine, Iterable, Mapping
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.framer import FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.mei_message import ReadDeviceInformationRequest, ReadDeviceInformationResponse
from pymodbus.pdu.register_message import WriteSingleRegisterRequest
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import SimDevice
from pymodbus.transaction import TransactionManager

from palpate.simulators.wire.modbus_frames import EXCEPTION, IDENTIFY, LineFramer, RequestDecoder, alien, whole_frame
from palpate.simulators.wire.relay import Damage, Relay
from palpate.simulators.wire.terminal import Terminal

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # what a client sends is no news on our stderr

BROADCAST = 0
SELF = (0, 255)  # unit ids by which a device on TCP may be addressed as well (Modbus messaging on TCP/IP)
PIPELINE = 65536  # bytes of requests that may wait
MOST_CONNECTIONS = 32  # to one port
MOST_WAITING = 64  # requests of one client, above which nothing more is read from it
IDLE = 60.0  # s, after which a client that asks nothing makes room for another
PIECE = 4096  # bytes that are read from a client before it is the next one's turn
UNREAD = 65536  # bytes of answers that a client may leave unread
CATEGORIES = {1: range(3), 2: range(0x80), 3: range(0x100)}  # of identity objects, by read device id code
ONE_OBJECT = 4
AT_ONCE = struct.pack("ii", 1, 0)  # to linger: closing resets the connection

Identity = Callable[[], Mapping[int, bytes]]


def _done(update: Coroutine[Any, Any, ModbusPDU]) -> ModbusPDU:
    """The answer of a device, whose action never awaits."""
    try:
        update.send(None)
    except StopIteration as done:
        answer: ModbusPDU = done.value
        return answer
    raise AssertionError("an action awaits something")


def _identification(request: ReadDeviceInformationRequest, objects: Mapping[int, bytes]) -> ModbusPDU:
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
                self.close()  # nothing tells where its next request would begin
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
        """The first of the requests that wait; the next in its turn among those of other clients."""
        request = self._waiting.popleft()
        self._completed.transactions += 1
        if request.dev_id == BROADCAST and self._completed.broadcast_enable:
            for unit in self._completed.identities:
                _done(request.datastore_update(self._completed.context, unit))
        else:
            response = self._response(request)
            response.transaction_id, response.dev_id = request.transaction_id, request.dev_id
            self.server_send(response, None)  # type: ignore[no-untyped-call]
        self._answered()
        if self._waiting:
            self.loop.call_soon(self._answer)

    def _answered(self) -> None:
        """After each answer."""

    def _response(self, request: ModbusPDU) -> ModbusPDU:
        identity = self._completed.identities.get(request.dev_id)
        if identity is None:
            return ExceptionResponse(request.function_code & ~EXCEPTION, ExcCodes.GATEWAY_NO_RESPONSE)
        if isinstance(request, ReadDeviceInformationRequest):
            return _identification(request, identity())
        response = _done(request.datastore_update(self._completed.context, request.dev_id))
        if isinstance(request, WriteSingleRegisterRequest) and not response.isError():
            response.registers = request.registers  # a command register has fallen back to idle meanwhile
        return response


class _TcpConnection(_Connection):
    """One client among others: none can take the time or the memory of the rest."""

    asked = -math.inf  # when it did last [s of the loop]
    unwanted = False
    _late = b""  # an answer that the next request brings
    _kept: bytearray | None = None  # answers, in place of their being sent

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        if self.unwanted:
            transport.abort()  # type: ignore[attr-defined]
            return
        transport.max_size = PIECE  # type: ignore[attr-defined]
        super().connection_made(transport)

    def leave(self) -> None:
        """Make room for another; the connection may still be on its way."""
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
        """Requests on a link that has faults, one whole frame after the other."""
        used = 0
        while (frame := whole_frame(data[used:])) and self.transport:
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
        begun = self.recv_buffer  # of the next request; pymodbus forgets it
        super().send(data, addr)
        self.recv_buffer = begun

    def _answered(self) -> None:
        """Reads on, unless the answers are left unread."""
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
    """One client too many."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.abort()  # type: ignore[attr-defined]


class _Completed:
    """What both servers have in common."""

    identities: dict[int, Identity]
    decoder: DecodePDU
    transactions = 0

    def complete(self, identities: dict[int, Identity]) -> None:
        self.identities = identities
        self.decoder = RequestDecoder(True)

    def callback_new_connection(self) -> _Connection:
        return _Connection(self)


class TcpServer(_Completed, ModbusTcpServer):
    """One device on a TCP port, by its unit id and by those that mean the device itself."""

    link: Relay | None = None  # where it has faults

    def __init__(self, device: SimDevice, identity: Identity, address: tuple[str, int]) -> None:
        super().__init__([device], address=address)
        self.complete(dict.fromkeys((device.id, *SELF), identity))
        units: Any = self.context
        units.devices.update(dict.fromkeys(SELF, units.devices[device.id]))

    def callback_new_connection(self) -> _Connection:
        return _TcpConnection(self)

    def stop_listening(self) -> None:
        """Clients that are connected stay so."""
        listening: Any = self.transport
        self._address = listening.sockets[0].getsockname()[:2]
        listening.close()

    def listen_again(self) -> None:
        """At the address of before; clients can connect as soon as this returns, and are served in the loop."""
        host, _ = self._address
        end = socket.create_server(self._address, family=socket.AF_INET6 if ":" in host else socket.AF_INET)
        asyncio.run_coroutine_threadsafe(self._attend(end), self.loop)

    async def _attend(self, end: socket.socket) -> None:
        self.transport = await self.loop.create_server(self.handle_new_connection, sock=end)  # type: ignore[assignment]

    def handle_new_connection(self) -> Any:
        """A place for one more client: where there is none, that of the longest silent, unless it has just asked."""
        if len(self.active_connections) >= MOST_CONNECTIONS:
            clients: Iterable[Any] = self.active_connections.values()
            silent = min(clients, key=lambda client: client.asked)
            if self.loop.time() - silent.asked < IDLE:
                return _Refused()
            del self.active_connections[silent.unique_id]
            silent.leave()
        return super().handle_new_connection()


class SerialServer(_Completed, ModbusSerialServer):
    """Several units on a serial line; what is sent to unit 0 all of them carry out, and none answers."""

    def __init__(self, devices: list[SimDevice], identities: dict[int, Identity], **traces: Any) -> None:
        super().__init__(devices, broadcast_enable=True, **traces)
        self.complete(identities)
        self.framer = LineFramer
        self.call_create = self._opened

    async def _opened(self) -> Terminal:
        return Terminal(self.handle_new_connection())
