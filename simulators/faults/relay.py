"""Stands between client and server of a Modbus TCP device that has faults, and lets them happen to the frames."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
from collections.abc import Sequence

from simulators.clock import NEVER, VirtualClock
from simulators.faults.fault import Trigger
from simulators.faults.tcp import HEADER, TcpFault

_LINGER = struct.pack("ii", 1, 0)  # closing resets the connection


class Relay:
    """One frame at a time, as the client asks; it waits for nothing but bytes. Lives on the virtual clock."""

    def __init__(self, clock: VirtualClock, faults: Sequence[tuple[TcpFault, Trigger]]) -> None:
        self._clock = clock
        self._faults = faults
        self._device = ("", 0)
        self._address = ("", 0)
        self._server: asyncio.Server | None = None
        self._listens_again_ns = NEVER
        clock.add(self)

    async def start(self, device: tuple[str, int], address: tuple[str, int]) -> int:
        """Relay what comes to `address` to that of the device; returns the port that clients connect to.

        Raises OSError: the address cannot be listened on.
        """
        self._loop = asyncio.get_running_loop()
        self._device = device
        end = _listening(address)
        self._address = (address[0], end.getsockname()[1])
        await self._attend(end)
        return self._address[1]

    async def shutdown(self) -> None:
        if self._server is not None:
            self._server.close()

    async def _attend(self, end: socket.socket) -> None:
        self._server = await asyncio.start_server(self._serve, sock=end)

    def next_event_ns(self) -> int:
        return self._listens_again_ns

    def advance(self, start_ns: int, end_ns: int) -> None:
        """Listens at once, and waits for nobody: the servers' thread may be waiting for the clock."""
        if end_ns >= self._listens_again_ns:
            self._listens_again_ns = NEVER
            asyncio.run_coroutine_threadsafe(self._attend(_listening(self._address)), self._loop)

    async def _serve(self, client: asyncio.StreamReader, to_client: asyncio.StreamWriter) -> None:
        try:
            device, to_device = await asyncio.open_connection(*self._device)
        except OSError:
            to_client.close()
            return
        try:
            # cancelled where the bench is closed before its client: of that asyncio would tell on stderr
            with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
                late = b""
                while True:
                    request = await _frame(client)
                    struck = self._struck()
                    reply = b""
                    if struck is None or struck.forwards:
                        to_device.write(request)
                        reply = await _frame(device)
                    if struck is not None and struck.then != "goes on":
                        self._cut(to_client, struck)
                        return
                    segments = [reply] if struck is None else struck.segments(request, reply)
                    for segment in [late, *segments]:
                        to_client.write(segment)
                        await to_client.drain()
                        await asyncio.sleep(0)
                    late = reply if struck is not None and struck.holds else b""
        finally:
            to_client.close()
            to_device.close()

    def _struck(self) -> TcpFault | None:
        """The first of the faults that strike this request; each of them counts it."""
        now = self._clock.now_ns()
        struck = [fault for fault, trigger in self._faults if trigger.strikes(now)]
        return struck[0] if struck else None

    def _cut(self, to_client: asyncio.StreamWriter, fault: TcpFault) -> None:
        if fault.then == "refused" and self._server is not None:
            self._server.close()
            self._listens_again_ns = self._clock.now_ns() + max(fault.lasts_ns, 1)
        end: socket.socket = to_client.get_extra_info("socket")
        end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGER)
        to_client.close()


def _listening(address: tuple[str, int]) -> socket.socket:
    family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
    return socket.create_server(address, family=family)


async def _frame(reader: asyncio.StreamReader) -> bytes:
    header = await reader.readexactly(HEADER)
    return header + await reader.readexactly(int.from_bytes(header[4:6], "big"))
