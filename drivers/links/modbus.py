"""Modbus links; the only import of pymodbus in the drivers."""

from __future__ import annotations

import logging
import os
import re
import select
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any, Self

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException, ModbusIOException
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.mei_message import ReadDeviceInformationResponse

from palpate.drivers.clock import Clock, WallClock
from palpate.drivers.links import causes
from palpate.instrument.bench.links import (
    FASTEST,
    SerialLine,
    Stepper,
    TcpLink,
    character_bits,
    earliest_reply,
    silence,
)
from palpate.instrument.contracts.declaration import USUAL
from palpate.instrument.errors import DeviceError, LinkError, LinkTimeout
from palpate.instrument.own_process import OwnLock, close_in_child

# --- the client of an RTU line -------------------------------------------------------------------------

# Frames have no number. So a late reply, a repeated one or an adapter's echo is told from the reply by two facts: a
# reply cannot come before the request has been on the wire (`earliest_reply`), and it answers this unit, function and
# number of registers.
#
# Only a UART keeps the baud rate that it is given: a computer's serial ports, and USB adapters with a UART, which Linux
# calls ttyUSB. A USB device of the class CDC (ttyACM) may ignore the baud rate, and so may a pseudo-terminal with a
# gateway behind it: their replies can be there at once. For such ports the bound is that of `FASTEST`.


READS_BITS, READS_REGISTERS, WRITES_ONE, WRITES_SOME = (1, 2), (3, 4), (5, 6), (15, 16)  # functions
REFUSED = 0x80  # bit of a function code that marks a refusal
LARGEST_REPLY = 4096  # greatest number of bytes for one request, with late replies
CHECK_SUM, OF_REFUSAL, OF_CONFIRMATION = 2, 5, 8  # bytes of a check sum, a refusal, a confirmation
HEAD = 3  # bytes of a reply to a read before its registers
TERMINALS = "/dev/pts/"  # pseudo-terminals, which have no wire
UART = re.compile(r"/dev/tty(S|USB|AMA|O|SC|THS|mxc|PS|UL|LP|HS|sWK|XRUSB)\d+")  # device files of Linux


def readable(descriptor: int, within: float, stepper: Stepper | None) -> bool:
    """Wait until something can be read, for at most so long [s]; returns whether it can. See `BenchClock.stepper`."""
    if stepper is not None:
        return stepper.ready(descriptor, within)
    looked = select.poll()
    looked.register(descriptor, select.POLLIN)
    return bool(looked.poll(1e3 * within))


class ReplyFramer(FramerRTU):
    """Finds the reply to `request` in the bytes that came. An echo of the request, noise and other replies are skipped.

    pymodbus' own framer takes the first frame whose check sum fits, and none at all after a surplus byte.
    """

    request = b""
    early = b""  # what came since the request, too soon for a reply
    echoes = False  # whether the line gives back what is sent, as far as the last read has shown

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        """Decode as pymodbus asks for. Two replies that differ count as none, because either may be the true one."""
        at, found = self._behind_echo(data), dict[bytes, int]()
        while at <= len(data) - OF_REFUSAL:
            if frame := self._reply(data[at:]):
                found.setdefault(frame, at)
            at += len(frame) or 1
        if len(found) != 1:
            return 0, 0, 0, self.EMPTY
        ((frame, at),) = found.items()
        return at + len(frame), frame[0], 0, frame[1:-CHECK_SUM]

    def _behind_echo(self, data: bytes) -> int:
        """Where in the data the echo of the request ends; 0: there is none.

        The confirmation of a single coil or register is equal to its request. It counts as an echo if the line has
        given back the read before it.
        """
        if not self.request:
            return 0
        if self._confirmed_alike and not self.echoes:
            return 0
        came = self.early + data
        at = came.find(self.request)
        if not self._confirmed_alike:
            self.echoes = at >= 0
        return 0 if at < 0 else max(at + len(self.request) - len(self.early), 0)

    @property
    def _confirmed_alike(self) -> bool:
        return self.request[1] in WRITES_ONE

    def _reply(self, data: bytes) -> bytes:
        """The complete reply at the beginning of these bytes; empty: there is none."""
        frame = data[: self._size(data)]
        # a part of the echo is not a reply
        whole = len(frame) >= OF_REFUSAL and (self._confirmed_alike or self.request[: len(frame)] != frame)
        return frame if whole and self.check_CRC(frame[:-CHECK_SUM], int.from_bytes(frame[-CHECK_SUM:])) else b""

    def _size(self, data: bytes) -> int:
        """Size of the reply at the beginning of these bytes; 0: there is none, or it is incomplete."""
        request = self.request
        if not request or data[0] != request[0] or data[1] & ~REFUSED != request[1]:
            return 0
        if data[1] & REFUSED:
            size = OF_REFUSAL
        elif data[1] in READS_REGISTERS:
            size = HEAD + data[2] + CHECK_SUM if data[2] == 2 * int.from_bytes(request[4:6]) else 0
        elif data[1] in READS_BITS:
            size = HEAD + data[2] + CHECK_SUM if data[2] == -(-int.from_bytes(request[4:6]) // 8) else 0
        elif data[1] in (*WRITES_ONE, *WRITES_SOME):
            size = OF_CONFIRMATION if data[2:6] == request[2:6] else 0
        else:
            kind = self.decoder.lookupPduClass(data)
            size = kind.calculateRtuFrameSize(data) if kind else 0
        return size if size <= len(data) else 0


class RtuClient(ModbusSerialClient):
    """pymodbus' serial client, woken as soon as a reply comes; pymodbus' own looks for one every millisecond.

    `too_soon` counts the bytes that came after the last request, before a wire of `speed` bit/s could have brought its
    reply. They are thrown away. Devices that answer while this end steps them use no wire: their replies come at once.
    """

    def __init__(self, port: str, stepper: Stepper | None = None, **settings: Any) -> None:
        super().__init__(port, retries=0, **settings)
        self.replies = ReplyFramer(DecodePDU(False))
        self.framer = self.transaction.framer = self.replies
        self.too_soon = 0
        self._earliest = 0.0
        line = self.comm_params
        self._bits = character_bits(line.parity != "N", line.stopbits)
        self._free_at = 0.0  # when the line has been silent for long enough
        terminal = os.path.realpath(port).startswith(TERMINALS)
        self.silence = 0.0 if terminal else silence(line.baudrate, self._bits)
        self.speed = line.baudrate if UART.fullmatch(os.path.realpath(port)) else FASTEST
        self._stepper = stepper
        # a gateway on the network can answer by itself, as soon as it is asked
        self._has_wire = "://" not in port and stepper is None

    def connect(self) -> bool:
        """Connect, if it is not connected; returns whether it is."""
        if self.socket is None and self._stepper is not None:
            self.socket = self._stepper.connected(self.comm_params.host)  # type: ignore[assignment]
        return self.socket is not None or super().connect()

    def send(self, request: bytes, addr: tuple[Any, ...] | None = None) -> int:
        """Throw away bytes that came unasked, keep the silence between frames, and hand the request to the system.

        pymodbus' own client keeps no silence: on a slow line a device would take the request for the end of the reply
        before it, which may come from another device. A port that was lost since the last request, as an adapter that
        was plugged out and in, or a gateway behind `socket://` that closes when nobody asks, is opened anew first.
        """
        try:
            self._clear()
        except OSError:  # nothing was sent yet
            if self.socket is None:
                raise self._lost() from None
            self.close()  # type: ignore[no-untyped-call]
            if not self.connect():
                raise ConnectionException(str(self)) from None
        try:
            self.replies.request = request
            self.replies.early = b""
            self.too_soon = 0
            wire = earliest_reply(len(request), self.speed, self._bits) if self._has_wire else 0.0
            self._earliest = self._now() + wire
            return self._write(request)
        except OSError:
            raise self._lost() from None

    def _clear(self) -> None:
        """Throw away what came unasked, and keep the silence. Raises OSError: the port is lost."""
        unasked = 0
        while unasked < LARGEST_REPLY and self._ready(max(self._free_at - self._now(), 0.0)):
            unasked += len(self._heard())

    def recv(self, size: int | None) -> bytes:
        """Bytes that have come, as soon as there are any; empty after the time-out.

        The caller joins the pieces of a reply.

        """
        try:
            while (left := self._earliest - self._now()) > 0 and self.too_soon < LARGEST_REPLY:
                if self._ready(left):
                    heard = self._heard()
                    if self._now() > self._earliest:  # now it can no longer be told whether they came too soon
                        return heard
                    self.too_soon += len(heard)
                    self.replies.early += heard
            return self._heard() if self._ready(self._patience()) else b""
        except OSError:
            raise self._lost() from None

    def _heard(self) -> bytes:
        """Read what is there. Raises OSError: nothing is there although the port is ready, because it was unplugged."""
        if heard := self._read():
            self._free_at = self._now() + self.silence
            return heard
        raise OSError

    def _lost(self) -> ConnectionException:
        self.close()  # type: ignore[no-untyped-call]
        return ConnectionException(str(self))

    # --- the line itself -------------------------------------------------------------------------------

    def _line(self) -> Any:
        """The open port. Raises OSError: it is not open."""
        if self.socket is None:
            raise OSError
        return self.socket

    def _patience(self) -> float:
        timeout: float = self.comm_params.timeout_connect
        return timeout

    def _now(self) -> float:
        return time.monotonic()

    def _ready(self, within: float) -> bool:
        return readable(self._line().fileno(), within, self._stepper)

    def _read(self) -> bytes:
        return os.read(self._line().fileno(), LARGEST_REPLY)

    def _write(self, request: bytes) -> int:
        line = self._line()
        sent = os.write(line.fileno(), request)
        return sent if sent == len(request) else sent + (line.write(request[sent:]) or 0)


# --- Requests that a Modbus device may be sent, for `ModbusLink.transact` ------------------------------

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


READERS: dict[int, Callable[..., ModbusPDU]] = {1: read_coils, 2: read_discrete, 3: read_registers, 4: read_inputs}
WRITERS: dict[int, Callable[..., ModbusPDU]] = {5: write_coil, 6: write_register, 15: write_coils, 16: write_registers}


def only_reads(request: Callable[..., ModbusPDU]) -> bool:
    """Whether a request changes nothing, so that it can be sent again."""
    return request is read_identity or request in READERS.values()


def confirms(reply: Any, function: int, address: int, values: list[Any]) -> bool:
    """Whether a reply confirms that these values were written with this function from this address on."""
    if reply.function_code != function or reply.address != address:
        return False
    if function in (15, 16):
        return bool(reply.count == len(values))
    return bool((reply.bits if function == 5 else reply.registers) == values)  # they come back as they were sent


# --- The client's end of a Modbus TCP connection -------------------------------------------------------


class TcpClient(ModbusTcpClient):
    """pymodbus' client, which also looks for the end of the connection before it sends anything.

    Gateways and small devices close a connection on which nobody has asked anything for a while. A request that is sent
    into it is lost, and whether it was carried out can no longer be told. So the end is looked for first, and the
    request is sent once, over a new connection. The same is done where bytes have come that nobody asked for: they
    cannot be the reply to a request that is yet to be sent.

    `failure` is why the last attempt to connect failed; None: it did not.
    """

    failure: OSError | None = None

    def __init__(self, host: str, stepper: Stepper | None = None, **settings: Any) -> None:
        super().__init__(host, retries=0, **settings)
        self._stepper = stepper

    def connect(self) -> bool:
        """Connect, if it is not connected; returns whether it is. Raises ValueError: no host can have this name."""
        if self.socket is not None:
            return True
        where = self.comm_params
        self.failure = None
        try:
            self.socket = socket.create_connection((where.host, where.port), timeout=where.timeout_connect)
        except OSError as error:
            self.failure = error
        return self.socket is not None

    def send(self, request: bytes, addr: tuple[Any, ...] | None = None) -> int:
        """Send a request, once. Raises ConnectionException: there is no connection, or it broke."""
        if self.socket is not None and self._over(self.socket):
            self.close()  # type: ignore[no-untyped-call]
            if not self.connect():
                raise ConnectionException(str(self))
        sent: int = super().send(request, addr)
        return sent

    def recv(self, size: int | None) -> bytes:
        """Bytes that have come, as soon as there are any; empty after the time-out. The caller joins the pieces.

        Raises ConnectionException: the connection is closed; OSError: it broke.
        """
        if self.socket is None:
            raise ConnectionException(str(self))
        if not readable(self.socket.fileno(), self.comm_params.timeout_connect, self._stepper):
            return b""
        if not (data := self.socket.recv(size or LARGEST_REPLY)):
            self.close()  # type: ignore[no-untyped-call]
            raise ConnectionException(str(self))
        return data

    def _over(self, connection: socket.socket) -> bool:
        """Whether the other end has closed the connection, or has sent what nobody asked for."""
        return readable(connection.fileno(), 0.0, self._stepper)


# --- the link ------------------------------------------------------------------------------------------

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # its warnings would go to stderr; we raise

ACKNOWLEDGED, BUSY, NO_PATH, NO_TARGET = 5, 6, 10, 11  # codes of exceptions
EXCEPTIONS = {
    1: "illegal function", 2: "illegal address", 3: "illegal value", 4: "device failure",
    ACKNOWLEDGED: "acknowledge", BUSY: "device busy", 7: "negative acknowledge", 8: "memory parity error",
}  # fmt: skip
SOON, SELDOM = 0.01, 0.1  # shortest and longest time until a busy device is asked again [s]
LARGEST_FRAME = 256  # bytes on a serial line


class StrictDecoder(DecodePDU):
    """A decoder that refuses odd byte counts, cut-off texts and surplus data, which pymodbus' own accepts."""

    def decode(self, frame: bytes) -> ModbusPDU | None:
        """The reply, if encoding it again gives the same bytes; each object of an identity must come once."""
        reply = super().decode(frame)
        if isinstance(reply, ReadDeviceInformationResponse):
            if not all(isinstance(text, bytes) for text in reply.information.values()):
                return None
            reply.number_of_objects = 0  # encoding counts them again
        try:
            return reply if reply is not None and frame == bytes([reply.function_code]) + reply.encode() else None
        except (struct.error, ValueError, ModbusException):  # raised for functions that are never requested
            return None


def _bounded(data: bytes) -> bytes:
    """Pass received bytes of a reply on. Raises ModbusIOException: there are more than any reply has."""
    if len(data) > LARGEST_REPLY:
        raise ModbusIOException(f"more than {LARGEST_REPLY} bytes")
    return data


class ModbusLink:
    """One TCP connection or one serial line, shared by the devices on it under one lock.

    pymodbus is asked for no retries: a write that timed out may have been carried out, so whether to
    repeat it is the caller's decision. After a time-out, or a signal in the middle, a reply may still be on
    its way; on a serial line it would answer the next request. The link is therefore opened afresh, and a
    serial line is listened to until it has been silent for a whole time-out before it is used again.
    """

    def __init__(self, name: str, client: TcpClient | RtuClient, clock: Clock | None = None) -> None:
        """Make a link, closed. `clock`: by it silences are kept and busy devices waited for; None: wall clock."""
        self.name = name
        self.section = "the bench file"  # where its address is said, and below by unit id where each device's is
        self.devices: dict[object, str] = {}
        self.client = client
        self._clock = clock or WallClock()
        self._lock = OwnLock()
        close_in_child(client, lambda found: [found.socket.fileno()] if found.socket else [])
        self._reply_due = False
        self._heard: Callable[[bool, bytes], object] = lambda _sent, _data: None
        self._sent = self._came = b""
        client.transaction.framer.decoder = StrictDecoder(is_server=False)
        client.transaction.trace_packet = self._trace

    @property
    def serial(self) -> bool:
        """Whether it is a serial line."""
        return isinstance(self.client, RtuClient)

    def tap(self, heard: Callable[[bool, bytes], object]) -> None:
        """From now on call `heard` with each request before it is sent (True), and with all bytes of its reply."""
        self._heard = heard

    def _trace(self, sending: bool, data: bytes) -> bytes:
        """Take note of what pymodbus sends, and of all that it has received since and not used."""
        if sending:
            self._sent, self._came = data, b""
            self._heard(True, data)
            return data
        self._came = data
        return _bounded(data)

    @classmethod
    def tcp(cls, address: TcpLink, clock: Clock | None = None, stepper: Stepper | None = None) -> Self:
        client = TcpClient(address.host, stepper, port=address.port, timeout=address.timeout)
        return cls(f"{address.host}:{address.port}", client, clock)

    @classmethod
    def rtu(cls, line: SerialLine, clock: Clock | None = None, stepper: Stepper | None = None) -> Self:
        client = RtuClient(
            line.port, stepper,
            baudrate=line.baudrate, parity=line.parity, stopbits=line.stopbits, timeout=line.timeout,
        )  # fmt: skip
        return cls(line.port, client, clock)

    def open(self) -> None:
        """Connect. Raises LinkError: nothing answers at the address."""
        with self._lock:
            self._connect()

    def close(self) -> None:
        with self._lock:
            self._drop()

    def _drop(self) -> None:
        self.client.close()  # type: ignore[no-untyped-call]

    def _connect(self) -> None:
        if self._reply_due:
            self._drop()
        try:
            connected = self.client.connect()
        except ValueError as error:  # the host name is malformed
            raise LinkError(f"{self.name} is no address: {error}; correct it in {self.section}") from None
        if not connected:
            raise LinkError(self._why_closed())
        if self._reply_due and isinstance(self.client, RtuClient):
            self._await_silence(self.client)
        self._reply_due = False

    def _why_closed(self) -> str:
        """Why the link cannot be opened, with the remedy."""
        if why := causes.exhausted():
            return f"{self.name} {why}"
        client, line = self.client, self.client.comm_params
        if isinstance(client, TcpClient):
            return causes.no_connection(line.host, line.port, client.failure, self._timeout, self.section)
        if "://" in self.name:
            return causes.no_gateway(self.name, self._timeout, self.section)
        setting = f"{line.baudrate} bit/s with parity {line.parity} and {line.stopbits} stop bits"
        return causes.no_port(self.name, setting, self.section)

    def _why_none(self, unit: object) -> str:
        """Why no valid answer came, with the remedy."""
        client = self.client
        device = self.devices.get(unit, "the bench file")
        if isinstance(client, TcpClient):
            return causes.wrong_on_tcp(self._sent, self._came, self.name, self.section, device)
        if client.too_soon:
            return (
                f"{client.too_soon} bytes came sooner than {client.speed} bit/s can bring them; look for a device that "
                "talks unasked, and give the line its true baudrate"
            )
        return causes.wrong_on_line(self._came, self.name, self.section, device)

    def _why_lost(self) -> str:
        """Why the connection is lost, with the remedy."""
        client = self.client
        if client.failure is not None if isinstance(client, TcpClient) else not client.connect():
            return self._why_closed()
        if self.serial and "://" not in self.name:
            return f"serial port {self.name} was lost and is there again; check the adapter's plug and cable"
        return (
            f"{self.name} closed the connection instead of answering; see whether another program holds its only "
            "connection, or whether it has restarted"
        )

    def _await_silence(self, line: RtuClient) -> None:
        heard = 0
        try:
            while heard <= LARGEST_FRAME:
                late = line.recv(None)
                if not late:
                    return
                heard += len(late)
        except ConnectionException as error:
            raise LinkError(f"{self.name} is lost; check the adapter's plug and cable") from error
        raise LinkError(f"{self.name}: the line does not fall silent; look for a device that babbles")

    @property
    def _timeout(self) -> float:
        timeout: float = self.client.comm_params.timeout_connect
        return timeout

    @contextmanager
    def _patient(self, timeout: float) -> Iterator[None]:
        """A context in which a reply may take so long [s]."""
        params, before = (self.client.comm_params, self.client.transaction.comm_params), self._timeout
        try:
            for each in params:
                each.timeout_connect = timeout
            yield
        finally:
            for each in params:
                each.timeout_connect = before

    def distrust(self) -> None:
        """Called when a reply did not belong to its request. The true one may still come, as after a time-out."""
        self._reply_due = True

    def transact(
        self,
        who: str,
        request: Callable[..., ModbusPDU],
        *args: object,
        gap: float = 0.0,
        responds: float = 0.0,
        busy: float = USUAL.busy,
        meanwhile: Callable[[], object] = lambda: None,
    ) -> ModbusPDU:
        """Send one request and return its reply, which is never an exception response.

        A device that answers that it is busy has not carried the request out, so it is asked again, also to write.

        Args:
            who: name of the device, for messages.
            request: makes the request, such as `read_registers`.
            args: its arguments; the last one is the unit id.
            gap: silence that the device wants before the request [s], which is waited by the bench's clock.
            responds: time that the device may take until it replies, if it is longer than the link's time-out [s].
            busy: time for which it may answer that it is busy [s].
            meanwhile: called after each wait for a busy device; the link is free for other requests then.

        Raises:
            LinkTimeout, LinkError: no reply, or no connection; also where a gateway says so of the device behind it.
            DeviceError: the device answered with an exception response. Code 5 says that it has taken a write, and goes
                on working at it.
        """
        later = (BUSY, ACKNOWLEDGED) if only_reads(request) else (BUSY,)
        left, pause = busy, SOON
        while (reply := self._exchange(who, request, args, gap, responds)).isError():
            if reply.exception_code not in later or left <= 0:
                raise self._refusal(who, reply.exception_code, args[-1] if args else 0, busy)
            self._clock.wait(min(pause, left))
            left -= pause
            pause = min(2 * pause, SELDOM)
            meanwhile()
        return reply

    def _refusal(self, who: str, code: int, unit: object, busy: float) -> LinkError | DeviceError:
        """The error for an exception response."""
        device = self.devices.get(unit, "the bench file")
        if code == NO_PATH:
            return LinkError(
                f"{who}: the gateway {self.name} has no path to unit {unit} (exception 10), so nothing was carried "
                f"out; set the path up in the gateway, or correct unit in {device}",
                code=code,
            )
        if code == NO_TARGET:
            return LinkTimeout(
                f"{who}: the gateway {self.name} got no answer from unit {unit} (exception 11); a write may have been "
                f"carried out; check power and cable of the device behind it, and unit in {device}",
                code=code,
            )
        text = f"{who}: answered exception {code}, {EXCEPTIONS.get(code, 'unknown')}"
        if code == BUSY:
            text += (
                f", for {busy:g} s, so nothing was carried out; raise busy in [manners] of its map if it needs longer"
            )
        return DeviceError(text, code=code)

    def _exchange(
        self, who: str, request: Callable[..., ModbusPDU], args: tuple[object, ...], gap: float, responds: float
    ) -> ModbusPDU:
        """Send one request, once, and return its reply, which may be an exception response. Raises as `transact`."""
        with self._lock:
            if self._reply_due:
                try:
                    self._connect()
                except LinkError as error:
                    raise LinkError(f"{who}: {error}") from None
            if gap:
                self._clock.wait(gap)
            self._reply_due = True
            self._sent = self._came = b""
            patience = max(responds, self._timeout)
            try:
                with self._patient(patience) if responds else nullcontext():
                    reply = request(self.client, *args)
            except (ConnectionException, ConnectionError) as error:
                raise LinkError(f"{who}: {self._why_lost()}") from error
            except ModbusIOException as error:
                raise LinkTimeout(
                    f"{who}: no valid answer on {self.name} within {patience:g} s; "
                    f"{self._why_none(args[-1] if args else 0)}"
                ) from error
            except (ModbusException, OSError) as error:
                raise LinkError(f"{who}: {self.name} failed: {error}; check cable and power") from error
            finally:
                if came := self._came:
                    self._came = b""
                    self._heard(False, came)
            self._reply_due = False
            return reply
