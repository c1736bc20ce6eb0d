"""A Modbus device or gateway on a real socket that behaves as it is told: it is busy, hangs up, or answers nonsense."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Self

from palpate.instrument.contracts.maps.golden_frames import crc

HEADER, TAIL = 7, 2  # bytes before the function code on TCP, and of the check sum on a line
READS, WRITES = (3, 4), (6, 16)
REFUSED = 0x80
ACKNOWLEDGED, BUSY = 5, 6


@dataclass(frozen=True, slots=True)
class Said:
    """What it sends in answer to a request, and whether it then closes the connection, with the last byte of that."""

    frame: bytes
    ends: bool = False


class Moody:
    """A context manager: listens on `port` and answers each frame by `answers`, one after the other.

    Attributes:
        frames: the frames that it got, as they came.
        connections: number of connections that it has accepted.
    """

    def __init__(self, answers: Callable[[bytes], Said], *, rtu: bool = False) -> None:
        """`rtu`: frames have no header and a check sum, as those of a serial line."""
        self.frames: list[bytes] = []
        self.connections = 0
        self._answers, self._rtu = answers, rtu
        self._turn = threading.Lock()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self._open: list[socket.socket] = []
        self._threads = [threading.Thread(target=self._listen)]

    def __enter__(self) -> Self:
        self._threads[0].start()
        return self

    def __exit__(self, *_: object) -> None:
        for end in (self._listening, *self._open):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()
        for thread in self._threads:
            thread.join()

    @property
    def pdus(self) -> list[bytes]:
        """The requests without what is around them."""
        return [frame[1:-TAIL] if self._rtu else frame[HEADER:] for frame in self.frames]

    @property
    def writes(self) -> list[bytes]:
        """Those of the requests that write."""
        return [pdu for pdu in self.pdus if pdu[0] in WRITES]

    def _listen(self) -> None:
        with suppress(OSError):
            while True:
                connection, _ = self._listening.accept()
                self._open.append(connection)
                self.connections += 1
                self._threads.append(threading.Thread(target=self._serve, args=(connection,)))
                self._threads[-1].start()

    def _serve(self, connection: socket.socket) -> None:
        with suppress(OSError), connection:
            waiting = b""
            while came := connection.recv(4096):
                waiting += came
                while size := self._size(waiting):
                    frame, waiting = waiting[:size], waiting[size:]
                    with self._turn:
                        self.frames.append(frame)
                        said = self._answers(frame)
                    if said.ends:
                        connection.send(said.frame, socket.MSG_MORE)  # goes out with the end, in one segment
                        connection.shutdown(socket.SHUT_WR)
                        return
                    connection.sendall(said.frame)

    def _size(self, data: bytes) -> int:
        """Size of the request at the beginning of these bytes; 0: it is not complete."""
        if self._rtu:
            function = data[1] if len(data) > 1 else 0
            size = 7 if function == 0x2B else 9 + data[6] if function == 16 and len(data) > 6 else 8
        else:
            size = 6 + int.from_bytes(data[4:6]) if len(data) >= 6 else 0
        return size if size and len(data) >= size else 0


def framed(request: bytes, pdu: bytes) -> bytes:
    """A reply on TCP with the transaction number and unit id of its request."""
    return request[:4] + struct.pack(">H", len(pdu) + 1) + request[6:HEADER] + pdu


def refusal(request: bytes, code: int) -> bytes:
    """An exception response on TCP."""
    return framed(request, bytes([request[HEADER] | REFUSED, code]))


def on_line(unit: int, pdu: bytes) -> bytes:
    """A frame of a serial line."""
    frame = bytes([unit]) + pdu
    return frame + crc(frame)


def carried_out(registers: dict[int, int], pdu: bytes) -> bytes:
    """What a plain device answers to reads (3, 4) and writes (6, 16) of registers."""
    address, count = struct.unpack(">HH", pdu[1:5])
    if pdu[0] in READS:
        return struct.pack(f">BB{count}H", pdu[0], 2 * count, *(registers.get(address + at, 0) for at in range(count)))
    if pdu[0] == WRITES[0]:
        registers[address] = count
    else:
        registers.update(enumerate(struct.unpack(f">{count}H", pdu[6:]), address))
    return pdu[:5]
