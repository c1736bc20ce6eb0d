"""The client's end of a Modbus RTU line: which of the bytes that come are the reply to what was asked.

Frames have no number, so a late reply, a repeated one or an adapter's echo must be told from the reply by what a wire
can do: it cannot come before the request has been sent (`earliest_reply`), and it answers this unit, function and
number of registers.

Only a UART keeps the baud rate that it is given: the serial ports of a computer, and USB adapters with a UART in them,
which Linux calls ttyUSB. A USB device of the class CDC (ttyACM) may ignore it, and so may a pseudo-terminal with a
gateway behind it: their replies can be there at once. On such a port the bound is that of `FASTEST`.
"""

from __future__ import annotations

import os
import re
import select
import time
from typing import Any

from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ConnectionException
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU

from palpate.instrument.bench.serial_line import FASTEST, character_bits, earliest_reply

READ, WRITE = 3, 16  # functions
REFUSED = 0x80  # bit of a function
LARGEST_REPLY = 4096  # bytes that may come for one request, late replies among them
CHECK_SUM, OF_REFUSAL, OF_CONFIRMATION = 2, 5, 8  # bytes
HEAD = 3  # bytes of a reply to a read before its registers
UART = re.compile(r"/dev/tty(S|USB|AMA|O|SC|THS|mxc|PS|UL|LP|HS|sWK|XRUSB)\d+")  # device files of Linux


class ReplyFramer(FramerRTU):
    """Finds the reply to `request` among what came: an echo of the request, noise and other replies are passed over.

    pymodbus' own takes the first frame whose check sum fits, and none at all after a byte too many.
    """

    request = b""

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        """As pymodbus wants it. Two replies that differ are none: nobody knows which is the one."""
        echo = data.find(self.request) if self.request else -1
        first = 0 if echo < 0 else echo + len(self.request)
        at, found = first, dict[bytes, int]()
        while at <= len(data) - OF_REFUSAL:
            if frame := self._reply(data[at:]):
                found.setdefault(frame, at)
            at += len(frame) or 1
        if len(found) != 1:
            return 0, 0, 0, self.EMPTY
        ((frame, at),) = found.items()
        return at + len(frame), frame[0], 0, frame[1:-CHECK_SUM]

    def _reply(self, data: bytes) -> bytes:
        """The reply that these bytes begin with, whole; empty: none."""
        frame = data[: self._size(data)]
        whole = len(frame) >= OF_REFUSAL and self.request[: len(frame)] != frame  # a part of the echo is no reply
        return frame if whole and self.check_CRC(frame[:-CHECK_SUM], int.from_bytes(frame[-CHECK_SUM:])) else b""

    def _size(self, data: bytes) -> int:
        """Bytes of the reply that begins so; 0: no reply to the request does, or not all of it is there."""
        request = self.request
        if not request or data[0] != request[0] or data[1] & ~REFUSED != request[1]:
            return 0
        if data[1] & REFUSED:
            size = OF_REFUSAL
        elif data[1] == READ:
            size = HEAD + data[2] + CHECK_SUM if data[2] == 2 * int.from_bytes(request[4:6]) else 0
        elif data[1] == WRITE:
            size = OF_CONFIRMATION if data[2:6] == request[2:6] else 0
        else:
            kind = self.decoder.lookupPduClass(data)
            size = kind.calculateRtuFrameSize(data) if kind else 0
        return size if size <= len(data) else 0


class RtuClient(ModbusSerialClient):
    """pymodbus' serial client, which sleeps in steps of 1 ms to see whether a reply has come, woken by it.

    `too_soon` counts the bytes that came for the last request before a wire of `speed` bit/s could have brought its
    reply: they are thrown away.
    """

    def __init__(self, port: str, **settings: Any) -> None:
        super().__init__(port, retries=0, **settings)
        self.replies = ReplyFramer(DecodePDU(False))
        self.framer = self.transaction.framer = self.replies
        self.too_soon = 0
        self._earliest = 0.0
        line = self.comm_params
        self._bits = character_bits(line.parity != "N", line.stopbits)
        self.speed = line.baudrate if UART.fullmatch(os.path.realpath(port)) else FASTEST

    def send(self, request: bytes, addr: tuple[Any, ...] | None = None) -> int:
        """What has come unasked is thrown away. Once the system has taken the request there is nothing to wait for."""
        try:
            unasked = 0
            while unasked < LARGEST_REPLY and self._ready(0.0):
                unasked += len(self._heard())
            self.replies.request = request
            self.too_soon = 0
            self._earliest = self._now() + earliest_reply(len(request), self.speed, self._bits)
            return self._write(request)
        except OSError:
            raise self._lost() from None

    def recv(self, size: int | None) -> bytes:
        """What has come, once anything has; nothing after the time-out. A reply in pieces is put together above."""
        try:
            while (left := self._earliest - self._now()) > 0 and self.too_soon < LARGEST_REPLY:
                if self._ready(left):
                    heard = self._heard()
                    if self._now() > self._earliest:  # by how much it was too soon, if at all, nobody knows
                        return heard
                    self.too_soon += len(heard)
            return self._heard() if self._ready(self._patience()) else b""
        except OSError:
            raise self._lost() from None

    def _heard(self) -> bytes:
        """Raises OSError: ready to be read, and nothing to read: it was unplugged."""
        if heard := self._read():
            return heard
        raise OSError

    def _lost(self) -> ConnectionException:
        self.close()  # type: ignore[no-untyped-call]
        return ConnectionException(str(self))

    # --- the line itself -------------------------------------------------------------------------------

    def _line(self) -> Any:
        """Raises OSError: it is not open."""
        if self.socket is None:
            raise OSError
        return self.socket

    def _patience(self) -> float:
        timeout: float = self._line().timeout
        return timeout

    def _now(self) -> float:
        return time.monotonic()

    def _ready(self, within: float) -> bool:
        return bool(select.select([self._line()], [], [], within)[0])

    def _read(self) -> bytes:
        return os.read(self._line().fileno(), LARGEST_REPLY)

    def _write(self, request: bytes) -> int:
        line = self._line()
        sent = os.write(line.fileno(), request)
        return sent if sent == len(request) else sent + (line.write(request[sent:]) or 0)
