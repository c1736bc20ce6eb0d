"""Modbus servers of the simulated bench: TCP on loopback sockets, RTU on a pseudo-terminal."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import re
import socket
import struct
import termios
import time
from collections.abc import Callable, Collection, Coroutine, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Protocol, Self

from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.bit_message import WriteSingleCoilRequest, WriteSingleCoilResponse
from pymodbus.pdu.mei_message import ReadDeviceInformationRequest, ReadDeviceInformationResponse
from pymodbus.pdu.register_message import WriteSingleRegisterRequest, WriteSingleRegisterResponse

from palpate.instrument.bench.links import (
    LOOPBACK,
    SHORTEST_SILENCE,
    SILENCE,
    character_bits,
    check_loopback,
    pseudo_terminal,
    reply_begins,
)
from palpate.instrument.contracts.declaration import ITSELF
from palpate.instrument.errors import BenchError, PalpateError
from palpate.instrument.own_process import Ends
from palpate.simulators.wire.device import IDENTIFY, Registers, SimulatedDevice, Units
from palpate.simulators.wire.loop import Loop
from palpate.simulators.wire.relay import Damage, LineNoise, Relay

if TYPE_CHECKING:
    from palpate.simulators.physics.effect import LineEffect


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
MBAP = struct.Struct(">HHH")  # a request's header on TCP: transaction, protocol, and length of what follows
HEADER = MBAP.size
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
        pdu: type[ModbusPDU] | None = super().lookupPduClass(data)
        if pdu is None and FramerRTU.check_CRC(data[:-2], int.from_bytes(data[-2:], "big")):
            return _WholeFrame
        return pdu


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
    except (ModbusException, ValueError, struct.error):
        return False


def whole_frame(data: bytes) -> bytes | None:
    """The first whole request on TCP; empty: it is incomplete; None: by its header it cannot become one."""
    if len(data) < HEADER:
        return None if any(data[2:4]) else b""
    _, protocol, size = MBAP.unpack_from(data)
    if protocol or size not in LENGTHS:
        return None
    return data[: HEADER + size] if len(data) >= HEADER + size else b""


# --- The functions that programs ask for most, a fifth of the time with the same answers ----------------

THIN = frozenset({3, 4, 6, 16})  # codes of functions
WRITES_ONE, WRITES_SOME = 6, 16
TWO_NUMBERS = struct.Struct(">BHH")  # function, address, and a count or a value
MOST_READ, MOST_WRITTEN = 125, 123  # registers in one request


def thin_answer(registers: Registers, request: bytes) -> bytes:
    """The answer to a request of `THIN`, both without header; empty: only pymodbus' messages tell what is wrong."""
    if len(request) < TWO_NUMBERS.size:
        return b""
    function, address, number = TWO_NUMBERS.unpack_from(request)
    code: ExcCodes | None
    if function == WRITES_SOME:
        values = request[TWO_NUMBERS.size + 1 :]
        if not 1 <= number <= MOST_WRITTEN or not len(values) == 2 * number == request[TWO_NUMBERS.size]:
            return b""
        code = registers.write(function, address, struct.unpack(f">{number}H", values))
    elif len(request) > TWO_NUMBERS.size:
        return b""
    elif function == WRITES_ONE:
        code = registers.write(function, address, (number,))
    elif 1 <= number <= MOST_READ:
        found = registers.read(function, address, number)
        if isinstance(found, bytes):
            return bytes([function, 2 * number]) + found
        assert isinstance(found, ExcCodes)
        code = found
    else:
        return b""
    return request[: TWO_NUMBERS.size] if code is None else bytes([function | EXCEPTION, code])


# --- the servers ---------------------------------------------------------------------------------------
#
# pymodbus' own servers need asyncio, whose loop runs in no client's wait. They also answer only the first of several
# pipelined requests, name no function code in the answer to a request that they cannot decode, answer for an absent
# unit with code 4, echo the content of a register instead of the written value, and keep one identity for all servers
# of a process.

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # keeps a client's bad frames out of our stderr

BROADCAST = 0
LONGEST_RUBBISH = 65536  # bytes on a serial line among which a request is looked for
MOST_CONNECTIONS = 32  # clients of one port
REST = 0.1  # s after which a server that could not accept a client tries again
IDLE = 60.0  # s of silence after which a client makes room for another
PIECE = 4096  # bytes that are read from one client before the next one has its turn
UNREAD = 65536  # bytes of answers that a client may leave unread
AT_ONCE = struct.pack("ii", 1, 0)  # value of SO_LINGER with which closing resets the connection

Identity = Callable[[], Mapping[int, bytes]]


class _Server:
    """What the TCP and the serial server have in common."""

    transactions = 0  # number of requests that have come in so far

    def __init__(self, loop: Loop, registers: Mapping[int, Registers], identities: dict[int, Identity]) -> None:
        self.loop = loop
        self._identities = identities
        self._units: Any = Units(registers)
        self._decoder = RequestDecoder(frozenset().union(*(each.functions for each in registers.values())))

    def _carried_out(self, unit: int, request: bytes) -> bytes:
        """Carry a request out; returns the answer, both without what the link puts around them."""
        registers = self._units.registers.get(unit)
        if request[0] in THIN and registers is not None and (answer := thin_answer(registers, request)):
            return answer
        response = self._response(unit, self._decoder.decode(request))
        return bytes([response.function_code]) + response.encode()

    def _response(self, unit: int, request: ModbusPDU) -> ModbusPDU:
        identity = self._identities.get(unit)
        if identity is None:
            return ExceptionResponse(request.function_code & ~EXCEPTION, ExcCodes.GATEWAY_NO_RESPONSE)
        registers = self._units.registers[unit]
        if isinstance(request, ReadDeviceInformationRequest):
            if IDENTIFY not in registers.functions:
                return ExceptionResponse(IDENTIFY, ExcCodes.ILLEGAL_FUNCTION)
            return identification(request, identity())
        if isinstance(request, WriteSingleRegisterRequest | WriteSingleCoilRequest):
            return echo(request, registers)
        return done(request.datastore_update(self._units, unit))


class _Connection:
    """One client on TCP: its requests are answered in turn, and it cannot take the time or memory of the others."""

    def __init__(self, server: TcpServer, end: socket.socket) -> None:
        self._server, self._end, self._loop = server, end, server.loop
        self.asked = -math.inf  # time of its last request on the clock of `time.monotonic` [s]
        self._come = b""  # what has come and is not answered
        self._unsent = b""
        self._late = b""  # an answer held back until the next request
        self._turn_comes = False
        self._loop.watch(end.fileno(), self._heard)

    def _heard(self) -> None:
        """Something has come, or what waits can be sent."""
        try:
            if self._unsent:
                self._send(b"")
            if self._turn_comes:
                return  # what has come before is not all answered
            data = self._end.recv(PIECE)
        except BlockingIOError:
            return
        except OSError:
            self.close()
            return
        if not data:
            self.close()
            return
        self._come += data
        self._turn()

    def _turn(self) -> None:
        """Answer the first whole request that has come; the next one waits until other clients have had their turn."""
        self._turn_comes = False
        if self._closed:
            return
        frame = whole_frame(self._come)
        if frame is None:
            self.close()  # where the next request begins can no longer be told
        if not frame:
            return
        self._come = self._come[len(frame) :]
        self._answer(frame)
        self.asked = time.monotonic()
        if self._come and not self._closed:
            self._turn_comes = True
            self._loop.soon(self._turn)

    def _answer(self, frame: bytes) -> None:
        link = self._server.link
        if link is None:
            self._send(self._server.answer(frame))
            return
        fault = link.struck()
        answer = self._server.answer(frame) if fault is None or fault.forwards else b""
        if fault is not None and fault.then != "goes on":
            self._cut(link, fault)
            return
        for segment in (self._late, *([answer] if fault is None else fault.segments(frame, answer))):
            if segment:
                self._send(segment)
        self._late = answer if fault is not None and fault.holds else b""

    def _cut(self, link: Relay, fault: Damage) -> None:
        if fault.then == "refused":
            link.refuse(self._server, fault.lasts_ns)
        self._end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, AT_ONCE)
        self.close()

    def _send(self, data: bytes) -> None:
        """Send what waits and this; a client that does not read its answers is disconnected."""
        if self._closed:
            return
        waiting = self._unsent
        self._unsent += data
        try:
            sent = self._end.send(self._unsent)
        except BlockingIOError:
            sent = 0
        except OSError:
            self.close()
            return
        self._unsent = self._unsent[sent:]
        if len(self._unsent) > UNREAD:
            self.close()
        elif self._unsent or waiting:
            self._loop.watch(self._end.fileno(), self._heard, writing=bool(self._unsent))

    @property
    def _closed(self) -> bool:
        return self._end.fileno() < 0

    def close(self) -> None:
        if not self._closed:
            self._loop.forget(self._end.fileno())
            self._end.close()
            self._server.connections.remove(self)


class TcpServer(_Server):
    """One device on a TCP port, addressed by its unit id or by one of `ITSELF`."""

    link: Relay | None = None  # damages requests and answers; None: no faults

    def __init__(
        self, loop: Loop, unit: int, registers: Registers, identity: Identity, address: tuple[str, int]
    ) -> None:
        """Listen. Raises OSError: that is not possible at this address."""
        units = (unit, *ITSELF)
        super().__init__(loop, dict.fromkeys(units, registers), dict.fromkeys(units, identity))
        self.connections: list[_Connection] = []
        self._address = address
        self.listen_again()
        self._address = self._listening.getsockname()[:2]

    @property
    def port(self) -> int:
        return self._address[1]

    def answer(self, frame: bytes) -> bytes:
        """Carry out the request in a whole frame; returns the frame that answers it."""
        self.transactions += 1
        answer = self._carried_out(frame[HEADER], frame[HEADER + 1 :])
        return frame[: HEADER - 2] + (1 + len(answer)).to_bytes(2) + frame[HEADER : HEADER + 1] + answer

    def stop_listening(self) -> None:
        """Accept no new clients; connected clients stay connected."""
        self.loop.forget(self._listening.fileno())
        self._listening.close()

    def listen_again(self) -> None:
        """Listen at the same address again; clients can connect at once, and the loop serves them."""
        host, _ = self._address
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listening = socket.create_server(self._address, family=family)
        self._listening.setblocking(False)
        self._attend()

    def _attend(self) -> None:
        if self._listening.fileno() >= 0:
            self.loop.watch(self._listening.fileno(), self._accept)

    def _accept(self) -> None:
        """Accept one more client.

        On a full server it takes the place of the client with the longest silence, if that exceeds `IDLE`; else it is
        turned away.
        """
        try:
            end, _ = self._listening.accept()
        except BlockingIOError:  # it has gone again
            return
        except OSError:  # this process may open nothing more for now
            self.loop.forget(self._listening.fileno())
            self.loop.at(time.monotonic() + REST, self._attend)
            return
        if len(self.connections) >= MOST_CONNECTIONS:
            silent = min(self.connections, key=lambda client: client.asked)
            if time.monotonic() - silent.asked < IDLE:
                end.close()
                return
            silent.close()
        end.setblocking(False)
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connections.append(_Connection(self, end))

    def close(self) -> None:
        """Close everything."""
        if self._listening.fileno() >= 0:
            self.stop_listening()
        for each in list(self.connections):
            each.close()


class LineManners(Protocol):
    """What a serial line does with frames; see `palpate.simulators.wire.modbus`."""

    def lets_in(self, unit: int) -> bool:
        """Whether a device hears a request that begins now."""

    def request(self, size: int) -> None:
        """Let a request of so many bytes pass."""

    def reply(self, unit: int, size: int) -> bool:
        """Let the reply of a unit pass; returns whether there is such a unit."""


class SerialServer(_Server):
    """Several units on a serial line. All carry out a request to unit 0 (broadcast), and none answers it."""

    def __init__(
        self, loop: Loop, registers: Mapping[int, Registers], identities: dict[int, Identity], manners: LineManners
    ) -> None:
        super().__init__(loop, registers, identities)
        self._framer = LineFramer(self._decoder)
        self._manners = manners
        self._come = b""

    def heard(self, data: bytes, send: Callable[[bytes], object], *, anew: bool) -> None:
        """Take what has come, and answer with `send`; `anew`: after a silence, with which a request begins."""
        self._come = (data if anew else self._come + data)[-LONGEST_RUBBISH:]
        while self._come:
            if not self._manners.lets_in(self._come[0]):
                self._come = b""
                return
            used, unit, _, request = self._framer.decode(self._come)
            self._come = self._come[used:]
            if not used:
                return
            if request:
                self._answer(unit, request, send)

    def _answer(self, unit: int, request: bytes, send: Callable[[bytes], object]) -> None:
        self.transactions += 1
        self._manners.request(len(request) + UNIT_AND_CHECK)
        if unit == BROADCAST and BROADCAST not in self._identities:
            for each in self._identities:
                self._carried_out(each, request)
            return
        answer = self._framer.encode(self._carried_out(unit, request), unit, 0)
        if self._manners.reply(unit, len(answer)):
            send(answer)


# --- a serial line -------------------------------------------------------------------------------------


BITS = character_bits(parity=True, stop_bits=2)  # bits of the longest character
SPEEDS = {getattr(termios, name): int(name[1:]) for name in dir(termios) if re.fullmatch(r"B[1-9]\d*", name)}
SLOWEST = 1200  # bit/s, taken for a speed that `termios` does not name


class Terminal:
    """The line of a serial Modbus server; a client opens `path`.

    It keeps the client's end open too, so that a client may leave and come back. Bytes that the client does not read
    are lost once the terminal is full, as on a real line.

    A pseudo-terminal carries bytes at once. The timing of a real wire at the client's baud rate is therefore made here:
    no answer begins before its request can have been sent completely, and after a silence a new request begins, even
    if the old one is incomplete. A client in whose waits the line is served knows that, and is answered at once,
    through a pair of sockets.
    """

    def __init__(self, loop: Loop, server: SerialServer, *, at_once: bool) -> None:
        """Raises BenchError: this machine gives no pseudo-terminal."""
        self._loop, self._server = loop, server
        self._at_once = at_once
        self._noise: LineNoise | None = None
        self._own, self._client, self.path = pseudo_terminal()
        os.set_blocking(self._own, False)
        self._heard_at = self._earliest = time.monotonic()
        self._near: socket.socket | None = None
        loop.watch(self._own, self._heard)
        if at_once:
            loop.ports[self.path] = self._connected

    def make_noisy(self, noise: LineNoise) -> None:
        """From now on pass frames through `noise`."""
        noise.watch(self._own)
        self._noise = noise
        self._leave()  # a client that is connected notes that before its next request, and opens the terminal

    def _connected(self) -> socket.socket | None:
        """The client's end of a pair of sockets in place of the terminal; None: noise needs that.

        Each write to a terminal wakes a thread of the kernel, which takes the processor from this one.
        """
        if self._noise is not None:
            return None
        self._leave()
        near, far = socket.socketpair()
        near.setblocking(False)
        self._near = near
        self._loop.watch(near.fileno(), lambda: self._heard_near(near))
        return far

    def _heard_near(self, near: socket.socket) -> None:
        try:
            data = near.recv(PIECE)
        except BlockingIOError:
            return
        except OSError:  # it was left with an answer unread
            data = b""
        if data:
            self._server.heard(data, lambda answer: _send(near.fileno(), answer), anew=True)
        else:
            self._leave()

    def _leave(self) -> None:
        if self._near is not None:
            self._loop.forget(self._near.fileno())
            self._near.close()
        self._near = None

    def _heard(self) -> None:
        try:
            data = os.read(self._own, PIECE)
        except BlockingIOError:
            return
        if self._noise is not None:
            data = self._noise.to_device(self._own, data)
        if data:
            self._server.heard(data, self._answer, anew=self._keep_time(len(data)))

    def _keep_time(self, size: int) -> bool:
        """Take note of when bytes have come; returns whether the line was silent before them."""
        now, speed = time.monotonic(), SPEEDS.get(termios.tcgetattr(self._client)[5], SLOWEST)
        anew = now - self._heard_at > max(SILENCE * BITS / speed, SHORTEST_SILENCE)
        self._heard_at = now
        self._earliest = now if self._at_once else now + reply_begins(size, speed, BITS)
        return anew

    def _answer(self, data: bytes) -> None:
        sent = data if self._noise is None else self._noise.to_client(data)
        if time.monotonic() < self._earliest:
            self._loop.at(self._earliest, lambda: _send(self._own, sent))
        else:
            _send(self._own, sent)

    def close(self) -> None:
        """Close both ends: the server hears nothing more, and the client's line is gone."""
        self._leave()
        self._loop.ports.pop(self.path, None)
        if self._own >= 0:
            self._loop.forget(self._own)
            os.close(self._client)
            os.close(self._own)
        self._own = -1


def _send(end: int, data: bytes) -> None:
    if end >= 0:  # else it was closed meanwhile
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            os.write(end, data)


# --- the links -----------------------------------------------------------------------------------------


NEVER_YET = -(10**18)  # ns


class Servers:
    """All Modbus servers of a bench, on one loop. Leaving the context stops all that it started.

    Attributes:
        loop: serves them, in a thread of its own unless `stepped`: then only in the steps of its clients.
    """

    def __init__(self, loop: Loop | None = None, *, stepped: bool = False) -> None:
        self.loop = loop or Loop()
        self._stepped = stepped
        self._servers: list[TcpServer | SerialServer] = []
        self._open: list[TcpServer | Terminal] = []
        self._of_device: dict[int, TcpServer] = {}
        self._ends = Ends()

    def __enter__(self) -> Self:
        self._ends.enter_context(self.loop)
        self._ends.callback(self._close)
        if not self._stepped:
            self.loop.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    def _close(self) -> None:
        with self.loop.lock:
            for each in self._open:
                each.close()

    def catch_up(self) -> None:
        """Let the servers take up all requests that have arrived up to now."""
        self.loop.step()

    @property
    def transactions(self) -> int:
        """Number of requests that have come in so far."""
        return sum(server.transactions for server in self._servers)

    def serve_tcp(
        self,
        unit: int,
        device: SimulatedDevice,
        address: tuple[str, int] = (LOOPBACK, 0),
    ) -> int:
        """Serve one device; port 0 takes any free port. Returns the port.

        Raises BenchError: the port is in use, the host is no address of this machine, or loopback is down.
        """

        check_loopback(address[0])
        try:
            server = TcpServer(self.loop, unit, Registers(device), _identity(device), address)
        except OSError:
            host, taken = address
            raise BenchError(
                f"cannot listen on {host}:{taken}: the port is in use, or the host is no address of this machine; give "
                "another"
            ) from None
        self._servers.append(server)
        self._of_device[id(device)] = server
        self._open.append(server)
        return server.port

    def put_between(self, device: SimulatedDevice, link: Relay) -> None:
        """From now on let requests to a device on TCP pass through `link`, which may damage them."""
        self._of_device[id(device)].link = link

    def make_noisy(self, noise: LineNoise) -> None:
        """From now on let frames of the serial line pass through `noise`, which may damage them."""
        self._terminal.make_noisy(noise)

    def serve_rtu(self, devices: dict[int, SimulatedDevice], timing: LineEffect | None) -> str:
        """Serve devices on one serial line, by unit id. Returns the path of the terminal that a client opens."""
        server = SerialServer(
            self.loop,
            {unit: Registers(device) for unit, device in devices.items()},
            {unit: _identity(device) for unit, device in devices.items()},
            _SerialLine(devices, timing),
        )
        self._servers.append(server)
        self._terminal = Terminal(self.loop, server, at_once=self._stepped)
        self._open.append(self._terminal)
        return self._terminal.path


def _identity(device: SimulatedDevice) -> Identity:
    """A function that returns the identity objects of a device (function 43/14), read anew for each request."""

    def objects() -> dict[int, bytes]:
        identity = device.contract.identity
        texts = {
            0: identity.vendor,
            1: identity.product,
            2: identity.revision,
            4: device.contract.title,
            6: "simulated",
            0x80: device.serial,
        }
        return {number: text.encode() for number, text in texts.items()}

    return objects


class _SerialLine:
    """The serial line itself: absent units are silent, each frame takes time, and who is asked too soon hears nothing.

    A wait here blocks all servers. That is right: the client waits for its reply, and nobody else moves the clock on.
    """

    def __init__(self, devices: dict[int, SimulatedDevice], timing: LineEffect | None) -> None:
        self._units = set(devices)
        self._gaps_ns = {unit: round(1e9 * device.contract.manners.gap) for unit, device in devices.items()}
        self._clock = next(iter(devices.values())).clock
        self._timing = timing
        self._replied_ns = NEVER_YET

    def lets_in(self, unit: int) -> bool:
        gap_ns = self._gaps_ns.get(unit, 0)
        return not gap_ns or self._now_ns() - self._replied_ns >= gap_ns

    def request(self, size: int) -> None:
        self._pass(size)

    def reply(self, unit: int, size: int) -> bool:
        if unit not in self._units:
            return False
        self._pass(size)
        self._replied_ns = self._now_ns()
        return True

    def _now_ns(self) -> int:
        """The time by which clients keep silences; a served clock stands still for longer than these last."""
        return time.monotonic_ns() if self._clock.served else self._clock.now_ns()

    def _pass(self, size: int) -> None:
        if self._timing is not None and self._clock.failure is None:
            with contextlib.suppress(PalpateError):  # the client that waits next is told
                self._clock.wait(self._timing.frame(size))
