"""The end of a serial line at which simulated devices sit: a pseudo-terminal, whose other end a client opens."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import termios
import tty
from typing import TYPE_CHECKING

from palpate.instrument.bench.serial_line import SHORTEST_SILENCE, SILENCE, character_bits, reply_begins
from palpate.simulators.wire.relay import Noise

if TYPE_CHECKING:
    from pymodbus.transport import ModbusProtocol

PIECE = 4096  # bytes
BITS = character_bits(parity=True, stop_bits=2)  # of the longest character
SPEEDS = {getattr(termios, name): int(name[1:]) for name in dir(termios) if re.fullmatch(r"B[1-9]\d*", name)}
SLOWEST = 1200  # bit/s, for a speed that has no name


class Terminal(asyncio.Transport):
    """What a server of the running loop reads from and writes to; `path` is the client's end.

    The client's end is held open here as well, so that a client may leave and come back. What a client leaves unread
    until the terminal is full is lost, as on a line.

    A terminal takes bytes at once, so what a wire does to time at the client's baud rate is done here: no answer begins
    before its request can have been sent, and after a silence a new request begins, whatever there is of the old one.
    """

    def __init__(self, server: ModbusProtocol) -> None:
        super().__init__()
        self._server = server
        self._noise: Noise | None = None
        self._loop = asyncio.get_running_loop()
        self._own, client = os.openpty()
        self._descriptors = [self._own, client]
        tty.setraw(client)
        os.set_blocking(self._own, False)
        self.path = os.ttyname(client)
        self._client = client
        self._heard_at = self._earliest = self._loop.time()
        self._loop.add_reader(self._own, self._heard)
        server.connection_made(self)

    def make_noisy(self, noise: Noise) -> None:
        """From now on frames pass through `noise`; called in the servers' loop."""
        noise.watch(self._own)
        self._noise = noise

    def _heard(self) -> None:
        data = os.read(self._own, PIECE)
        if self._noise is not None:
            data = self._noise.to_device(self._own, data)
        if data:
            self._keep_time(len(data))
            self._server.data_received(data)

    def _keep_time(self, size: int) -> None:
        now, speed = self._loop.time(), SPEEDS.get(termios.tcgetattr(self._client)[5], SLOWEST)
        if now - self._heard_at > max(SILENCE * BITS / speed, SHORTEST_SILENCE):
            self._server.recv_buffer = b""
        self._heard_at, self._earliest = now, now + reply_begins(size, speed, BITS)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send to the client."""
        sent = bytes(data) if self._noise is None else self._noise.to_client(bytes(data))
        if self._loop.time() < self._earliest:
            self._loop.call_at(self._earliest, self._send, sent)
        else:
            self._send(sent)

    def _send(self, data: bytes) -> None:
        if self._descriptors:
            with contextlib.suppress(BlockingIOError):
                os.write(self._own, data)

    def close(self) -> None:
        """Hear nothing more; the line is gone for its client."""
        if self._descriptors:
            self._loop.remove_reader(self._own)
        while self._descriptors:
            os.close(self._descriptors.pop())
