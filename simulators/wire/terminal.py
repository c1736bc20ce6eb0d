"""The serial line of simulated devices: a pseudo-terminal, whose other end a client opens."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import termios
from typing import TYPE_CHECKING

from palpate.instrument.bench.links import SHORTEST_SILENCE, SILENCE, character_bits, pseudo_terminal, reply_begins
from palpate.simulators.wire.relay import LineNoise

if TYPE_CHECKING:
    from pymodbus.transport import ModbusProtocol

PIECE = 4096  # bytes
BITS = character_bits(parity=True, stop_bits=2)  # bits of the longest character
SPEEDS = {getattr(termios, name): int(name[1:]) for name in dir(termios) if re.fullmatch(r"B[1-9]\d*", name)}
SLOWEST = 1200  # bit/s, taken for a speed that `termios` does not name


class Terminal(asyncio.Transport):
    """The transport of a serial Modbus server in the running event loop; a client opens `path`.

    It keeps the client's end open too, so that a client may leave and come back. Bytes that the client does not read
    are lost once the terminal is full, as on a real line.

    A pseudo-terminal carries bytes at once. The timing of a real wire at the client's baud rate is therefore made here:
    no answer begins before its request can have been sent completely, and after a silence a new request begins, even
    if the old one is incomplete.
    """

    def __init__(self, server: ModbusProtocol) -> None:
        """Raises BenchError: this machine gives no pseudo-terminal."""
        super().__init__()
        self._server = server
        self._noise: LineNoise | None = None
        self._loop = asyncio.get_running_loop()
        self._own, client, self.path = pseudo_terminal()
        self._descriptors = [self._own, client]
        os.set_blocking(self._own, False)
        self._client = client
        self._heard_at = self._earliest = self._loop.time()
        self._loop.add_reader(self._own, self._heard)
        server.connection_made(self)

    def make_noisy(self, noise: LineNoise) -> None:
        """From now on pass frames through `noise`; call it in the servers' event loop."""
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
        """Close both ends: the server hears nothing more, and the client's line is gone."""
        if self._descriptors:
            self._loop.remove_reader(self._own)
        while self._descriptors:
            os.close(self._descriptors.pop())
