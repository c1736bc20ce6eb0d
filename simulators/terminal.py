"""The end of a serial line at which simulated devices sit: a pseudo-terminal, whose other end a client opens."""

from __future__ import annotations

import asyncio
import contextlib
import os
import tty
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pymodbus.transport import ModbusProtocol

    from simulators.faults.rtu import NoisyLine

PIECE = 4096  # bytes


class Terminal(asyncio.Transport):
    """What a server of the running loop reads from and writes to; `path` is the client's end.

    The client's end is held open here as well, so that a client may leave and come back. What a client leaves unread
    until the terminal is full is lost, as on a line.
    """

    def __init__(self, server: ModbusProtocol, noise: NoisyLine | None = None) -> None:
        super().__init__()
        self._server, self._noise = server, noise
        self._loop = asyncio.get_running_loop()
        self._own, client = os.openpty()
        self._descriptors = [self._own, client]
        tty.setraw(client)
        os.set_blocking(self._own, False)
        self.path = os.ttyname(client)
        if noise is not None:
            noise.watch(self._own)
        self._loop.add_reader(self._own, self._heard)
        server.connection_made(self)

    def _heard(self) -> None:
        data = os.read(self._own, PIECE)
        if self._noise is not None:
            data = self._noise.to_device(self._own, data)
        if data:
            self._server.data_received(data)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send to the client."""
        sent = bytes(data) if self._noise is None else self._noise.to_client(bytes(data))
        with contextlib.suppress(BlockingIOError):
            os.write(self._own, sent)

    def close(self) -> None:
        """Hear nothing more; the line is gone for its client."""
        if self._descriptors:
            self._loop.remove_reader(self._own)
        while self._descriptors:
            os.close(self._descriptors.pop())
