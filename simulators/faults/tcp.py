"""Faults of a Modbus TCP connection, each of which strikes one reply.

A frame is 2 bytes of transaction id, 2 of protocol, 2 of length, then unit, function and data.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import ClassVar, Literal

from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.faults.fault import Fault, Trigger
from palpate.simulators.faults.places import Target
from palpate.simulators.wire.device import DEVICE_BUSY, DEVICE_FAILURE, ILLEGAL_VALUE
from palpate.simulators.wire.relay import StoppableServer

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
