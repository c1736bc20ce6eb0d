"""Faults of Modbus links: of a serial line, and of a TCP connection."""

from __future__ import annotations

import fcntl
import os
import struct
import termios
from collections.abc import Sequence
from typing import ClassVar, Literal

from palpate.instrument.bench.links import LINE
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.faults.fault import Fault, Target, Trigger
from palpate.simulators.wire.device import DEVICE_BUSY, DEVICE_FAILURE, ILLEGAL_VALUE
from palpate.simulators.wire.relay import StoppableServer

# --- Faults of the Modbus RTU line: noise and slow devices change its frames ---------------------------
#
# A frame is unit, function, data and two bytes of CRC; a pause ends it.

GLITCH = b"\x00\xff\xf8"  # spurious bytes that a client reads when a device begins to drive the line


class RtuFault(Fault):
    """Changes what the client gets as a reply."""

    targets: ClassVar[tuple[Target, ...]] = (LINE, "modbus-rtu")
    late: ClassVar[bool] = False  # whether the reply comes after the client's time-out
    reaches: ClassVar[bool] = True  # whether the device hears the request

    def received(self, reply: bytes) -> bytes:
        return b""


class BitError(RtuFault):
    """One bit is inverted, so that the CRC does not fit."""

    def received(self, reply: bytes) -> bytes:
        middle = len(reply) // 2
        return reply[:middle] + bytes([reply[middle] ^ 0x08]) + reply[middle + 1 :]


class LostBytes(RtuFault):
    """Two bytes in the middle are missing."""

    def received(self, reply: bytes) -> bytes:
        middle = len(reply) // 2
        return reply[: middle - 1] + reply[middle + 1 :]


class LeadingGlitch(RtuFault):
    """A glitch comes before the reply, when the device begins to drive the line."""

    def received(self, reply: bytes) -> bytes:
        return GLITCH + reply


class LateAnswer(RtuFault):
    """The reply comes after the client's time-out, and would look like the answer to its next request."""

    late: ClassVar[bool] = True


class TwoReplies(RtuFault):
    """The reply comes twice."""

    def received(self, reply: bytes) -> bytes:
        return reply + reply


class Silence(RtuFault):
    """The device does not hear the request."""

    reaches: ClassVar[bool] = False


class NoisyLine:
    """Carries frames between the two ends of a line, with faults. `units` holds the devices' names by unit."""

    def __init__(self, clock: VirtualClock, faults: Sequence[tuple[RtuFault, Trigger]], units: dict[int, str]) -> None:
        self._clock = clock
        self._faults = faults
        self._units = units
        self._struck: RtuFault | None = None
        self._late = b""

    def watch(self, client: int) -> None:
        """Set the client's terminal to tell when it is opened anew, in the first byte of what is read from it."""
        fcntl.ioctl(client, termios.TIOCPKT, struct.pack("i", 1))

    def to_device(self, client: int, heard: bytes) -> bytes:
        """The bytes that the device receives, from those that were read from the client's terminal.

        The client writes a whole frame at once. A client that has given up opens the line anew and clears it; late
        replies come then.
        """
        frame = heard[1:]
        if self._late and heard[0] & termios.TIOCPKT_FLUSHREAD:
            os.write(client, self._late)
            self._late = b""
        if not frame:
            return b""
        self._struck = self._strikes(self._units.get(frame[0], ""))
        return frame if self._struck is None or self._struck.reaches else b""

    def to_client(self, frame: bytes) -> bytes:
        """The bytes that the client receives, from those that a device has written."""
        struck, self._struck = self._struck, None
        if struck is None:
            return frame
        if struck.late:
            self._late = frame
            return b""
        return struck.received(frame)

    def _strikes(self, device: str) -> RtuFault | None:
        now = self._clock.now_ns()
        of_it = [(fault, trigger) for fault, trigger in self._faults if fault.on in (LINE, device)]
        struck = [fault for fault, trigger in of_it if trigger.strikes(now)]
        return struck[0] if struck else None


# --- Faults of a Modbus TCP connection, each of which strikes one reply --------------------------------
#
# A frame is 2 bytes of transaction id, 2 of protocol, 2 of length, then unit, function and data.

TRANSACTION, UNIT, FUNCTION, COUNT = 0, 6, 7, 8  # places in a frame
HEADER = 6  # bytes up to the length field, which the field does not count


class TcpFault(Fault):
    """Changes what the client gets as a reply.

    Attributes:
        forwards: whether the request reaches the device.
        holds: whether the reply is kept until the next request comes.
        then: what happens to the connection afterwards.
    """

    targets: ClassVar[tuple[Target, ...]] = ("modbus-tcp",)
    forwards: ClassVar[bool] = True
    holds: ClassVar[bool] = False
    then: ClassVar[Literal["goes on", "reset", "refused"]] = "goes on"

    def segments(self, request: bytes, reply: bytes) -> list[bytes]:
        """The segments that are sent. `reply` is empty where the request was not forwarded."""
        return []


class NoReply(TcpFault):
    """The device carries out the request and does not answer."""


class LateReply(TcpFault):
    """The reply comes just before the reply to the next request on the same connection."""

    holds: ClassVar[bool] = True


class SplitReply(TcpFault):
    """The reply comes in four segments."""

    def segments(self, request: bytes, reply: bytes) -> list[bytes]:
        return [reply[:3], reply[3:HEADER], reply[HEADER : COUNT + 2], reply[COUNT + 2 :]]


class MergedReplies(TcpFault):
    """An old reply and this one come in one segment."""

    def segments(self, request: bytes, reply: bytes) -> list[bytes]:
        return [_with_transaction(reply, -1) + reply]


class TruncatedReply(TcpFault):
    """The last byte of the reply is missing."""

    def segments(self, request: bytes, reply: bytes) -> list[bytes]:
        return [reply[:-1]]


class WrongTransaction(TcpFault):
    """The reply has another transaction id."""

    def segments(self, request: bytes, reply: bytes) -> list[bytes]:
        return [_with_transaction(reply, 7)]


class WrongUnit(TcpFault):
    """The reply has another unit id."""

    def segments(self, request: bytes, reply: bytes) -> list[bytes]:
        return [reply[:UNIT] + bytes([reply[UNIT] ^ 0x10]) + reply[FUNCTION:]]


class WrongFunction(TcpFault):
    """A reply to a read of input registers (4) instead of holding registers, or the other way round."""

    def segments(self, request: bytes, reply: bytes) -> list[bytes]:
        return [reply[:FUNCTION] + bytes([4 if reply[FUNCTION] == 3 else 3]) + reply[COUNT:]]


class WrongCount(TcpFault):
    """The reply has one register less than was asked for; a write is confirmed for one register less."""

    def segments(self, request: bytes, reply: bytes) -> list[bytes]:
        if reply[FUNCTION] != 3:
            return [reply[:-1] + bytes([(reply[-1] - 1) & 0xFF])]
        body = bytes([reply[COUNT] - 2]) + reply[COUNT + 1 : -2]
        return [reply[:4] + struct.pack(">H", len(body) + 2) + reply[UNIT:COUNT] + body]


class _Exception(TcpFault):
    """The device refuses the request."""

    forwards: ClassVar[bool] = False
    code: ClassVar[int]

    def segments(self, request: bytes, reply: bytes) -> list[bytes]:
        return [request[:4] + bytes([0, 3, request[UNIT], request[FUNCTION] | 0x80, self.code])]


class DeviceBusy(_Exception):
    """The device refuses the request with exception 6, device busy."""

    code: ClassVar[int] = DEVICE_BUSY


class DeviceFailure(_Exception):
    """The device refuses the request with exception 4, device failure."""

    code: ClassVar[int] = DEVICE_FAILURE


class IllegalValue(_Exception):
    """The device refuses the request with exception 3, illegal value."""

    code: ClassVar[int] = ILLEGAL_VALUE


class ConnectionReset(TcpFault):
    """The request is lost and the connection with it."""

    forwards: ClassVar[bool] = False
    then: ClassVar[Literal["goes on", "reset", "refused"]] = "reset"


class ConnectionRefused(TcpFault):
    """The connection is reset, and nobody listens while the fault lasts, or until the bench's clock goes on."""

    forwards: ClassVar[bool] = False
    then: ClassVar[Literal["goes on", "reset", "refused"]] = "refused"


def _with_transaction(frame: bytes, step: int) -> bytes:
    (number,) = struct.unpack_from(">H", frame, TRANSACTION)
    return struct.pack(">H", (number + step) & 0xFFFF) + frame[2:]


class FaultyLink:
    """Applies the faults to the requests of a device's clients. It is an event source of the virtual clock."""

    def __init__(self, clock: VirtualClock, faults: Sequence[tuple[TcpFault, Trigger]]) -> None:
        self._clock = clock
        self._faults = faults
        self._silent: StoppableServer | None = None
        self._listens_again_ns = NEVER
        clock.add(self)

    def struck(self) -> TcpFault | None:
        """The first of the faults that strike the present request. Every fault counts the request."""
        with self._clock.lock:
            now = self._clock.now_ns()
            struck = [fault for fault, trigger in self._faults if trigger.strikes(now)]
        return struck[0] if struck else None

    def refuse(self, server: StoppableServer, lasts_ns: int) -> None:
        """Stop listening for a time, or until the clock goes on."""
        with self._clock.lock:
            if self._silent is None:  # else another connected client was struck before
                server.stop_listening()
            self._silent, self._listens_again_ns = server, self._clock.now_ns() + max(lasts_ns, 1)

    def listen_again(self) -> None:
        """Listen again; called under the clock's lock."""
        self._listens_again_ns = NEVER
        if self._silent is not None:
            self._silent.listen_again()
            self._silent = None

    def next_event_ns(self) -> int:
        return self._listens_again_ns

    def advance(self, start_ns: int, end_ns: int) -> None:
        if end_ns >= self._listens_again_ns:
            self.listen_again()
