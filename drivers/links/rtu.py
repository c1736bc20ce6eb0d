"""The client's end of a Modbus RTU line: it finds the reply to a request among the bytes that come.

Frames have no number. So a late reply, a repeated one or an adapter's echo is told from the reply by two facts: a reply
cannot come before the request has been on the wire (`earliest_reply`), and it answers this unit, function and number of
registers.

Only a UART keeps the baud rate that it is given: a computer's serial ports, and USB adapters with a UART, which Linux
calls ttyUSB. A USB device of the class CDC (ttyACM) may ignore the baud rate, and so may a pseudo-terminal with a
gateway behind it: their replies can be there at once. For such ports the bound is that of `FASTEST`.
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

from palpate.instrument.bench.links import FASTEST, Stepper, character_bits, earliest_reply, silence

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
