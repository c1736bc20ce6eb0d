"""The serial line of simulated devices: a pseudo-terminal, whose other end a client opens."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import termios
import time

from palpate.instrument.bench.links import SHORTEST_SILENCE, SILENCE, character_bits, pseudo_terminal, reply_begins
from palpate.simulators.wire.loop import Loop
from palpate.simulators.wire.modbus_server import SerialServer
from palpate.simulators.wire.relay import LineNoise

PIECE = 4096  # bytes
BITS = character_bits(parity=True, stop_bits=2)  # bits of the longest character
SPEEDS = {getattr(termios, name): int(name[1:]) for name in dir(termios) if re.fullmatch(r"B[1-9]\d*", name)}
SLOWEST = 1200  # bit/s, taken for a speed that `termios` does not name


class Terminal:
    """The line of a serial Modbus server; a client opens `path`.

    It keeps the client's end open too, so that a client may leave and come back. Bytes that the client does not read
    are lost once the terminal is full, as on a real line.

    A pseudo-terminal carries bytes at once. The timing of a real wire at the client's baud rate is therefore made here:
    no answer begins before its request can have been sent completely, and after a silence a new request begins, even
    if the old one is incomplete. A client in whose waits the line is served knows that, and is answered at once,
    through a pair of sockets.
    """

    def __init__(self, loop: Loop, server: SerialServer, *, at_once: bool) -> None:
        """Raises BenchError: this machine gives no pseudo-terminal."""
        self._loop, self._server = loop, server
        self._at_once = at_once
        self._noise: LineNoise | None = None
        self._own, self._client, self.path = pseudo_terminal()
        os.set_blocking(self._own, False)
        self._heard_at = self._earliest = time.monotonic()
        self._near: socket.socket | None = None
        loop.watch(self._own, self._heard)
        if at_once:
            loop.ports[self.path] = self._connected

    def make_noisy(self, noise: LineNoise) -> None:
        """From now on pass frames through `noise`."""
        noise.watch(self._own)
        self._noise = noise
        self._leave()  # a client that is connected notes that before its next request, and opens the terminal

    def _connected(self) -> socket.socket | None:
        """The client's end of a pair of sockets in place of the terminal; None: noise needs that.

        Each write to a terminal wakes a thread of the kernel, which takes the processor from this one.
        """
        if self._noise is not None:
            return None
        self._leave()
        near, far = socket.socketpair()
        near.setblocking(False)
        self._near = near
        self._loop.watch(near.fileno(), lambda: self._heard_near(near))
        return far

    def _heard_near(self, near: socket.socket) -> None:
        try:
            data = near.recv(PIECE)
        except BlockingIOError:
            return
        except OSError:  # it was left with an answer unread
            data = b""
        if data:
            self._server.heard(data, lambda answer: _send(near.fileno(), answer), anew=True)
        else:
            self._leave()

    def _leave(self) -> None:
        if self._near is not None:
            self._loop.forget(self._near.fileno())
            self._near.close()
        self._near = None

    def _heard(self) -> None:
        try:
            data = os.read(self._own, PIECE)
        except BlockingIOError:
            return
        if self._noise is not None:
            data = self._noise.to_device(self._own, data)
        if data:
            self._server.heard(data, self._answer, anew=self._keep_time(len(data)))

    def _keep_time(self, size: int) -> bool:
        """Take note of when bytes have come; returns whether the line was silent before them."""
        now, speed = time.monotonic(), SPEEDS.get(termios.tcgetattr(self._client)[5], SLOWEST)
        anew = now - self._heard_at > max(SILENCE * BITS / speed, SHORTEST_SILENCE)
        self._heard_at = now
        self._earliest = now if self._at_once else now + reply_begins(size, speed, BITS)
        return anew

    def _answer(self, data: bytes) -> None:
        sent = data if self._noise is None else self._noise.to_client(data)
        if time.monotonic() < self._earliest:
            self._loop.at(self._earliest, lambda: _send(self._own, sent))
        else:
            _send(self._own, sent)

    def close(self) -> None:
        """Close both ends: the server hears nothing more, and the client's line is gone."""
        self._leave()
        self._loop.ports.pop(self.path, None)
        if self._own >= 0:
            self._loop.forget(self._own)
            os.close(self._client)
            os.close(self._own)
        self._own = -1


def _send(end: int, data: bytes) -> None:
    if end >= 0:  # else it was closed meanwhile
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            os.write(end, data)
