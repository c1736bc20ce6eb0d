"""The devices' ends of the Modbus links of a bench that is replayed, on real sockets and pseudo-terminals."""

from __future__ import annotations

import os
import selectors
import socket
import threading
from collections import deque
from contextlib import ExitStack
from typing import Self

from palpate.drivers.clock import WallClock
from palpate.instrument.bench.serial_line import FASTEST, character_bits, reply_begins
from palpate.instrument.bench.this_machine import LOOPBACK, check_loopback, pseudo_terminal
from palpate.instrument.own_process import Ends, close_in_child, watched

CHUNK = 4096  # bytes read at once
BITS = character_bits(parity=True, stop_bits=2)  # bits of the longest character


class ReplayWire:
    """Ends of links by their names. Each sends its reply once the whole request has arrived."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        close_in_child(self._selector, watched)
        self._due: dict[str, deque[tuple[int, bytes]]] = {}
        self._got: dict[str, int] = {}
        self._lines: set[str] = set()
        self._stack = ExitStack()
        self._ends = Ends()
        self._thread = threading.Thread(target=self._run, name="bus replay", daemon=True)

    def __enter__(self) -> Self:
        ours, self._stop = socket.socketpair()
        for end in (ours, self._stop):
            self._stack.enter_context(end)
        self._selector.register(ours, selectors.EVENT_READ, None)
        self._thread.start()
        self._ends.callback(self._end)
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    def _end(self) -> None:
        self._stop.send(b".")
        self._thread.join()
        for key in list(self._selector.get_map().values()):
            if isinstance(key.fileobj, socket.socket):
                key.fileobj.close()
        self._selector.close()
        self._stack.close()

    def listen(self, name: str) -> int:
        """Listen on a new TCP port for a link; returns the port."""
        check_loopback(LOOPBACK)
        server = socket.create_server((LOOPBACK, 0))
        self._add(server, name)
        port: int = server.getsockname()[1]
        return port

    def line(self, name: str) -> str:
        """Make a serial line; returns the path of the client's end."""
        master, slave, path = pseudo_terminal()
        for descriptor in (master, slave):
            self._stack.callback(os.close, descriptor)
        self._add(master, name)
        self._lines.add(name)
        return path

    def _add(self, end: socket.socket | int, name: str) -> None:
        self._due[name], self._got[name] = deque(), 0
        self._selector.register(end, selectors.EVENT_READ, name)

    def expect(self, name: str, size: int, reply: bytes) -> None:
        """Expect a request of `size` bytes, and answer it with this reply."""
        self._due[name].append((size, reply))

    def _run(self) -> None:
        while True:
            for key, _ in self._selector.select():
                if key.data is None:
                    return
                if isinstance(key.fileobj, socket.socket) and key.fileobj.getsockopt(
                    socket.SOL_SOCKET, socket.SO_ACCEPTCONN
                ):
                    connection, _ = key.fileobj.accept()
                    self._got[key.data] = 0
                    self._selector.register(connection, selectors.EVENT_READ, key.data)
                elif not self._serve(key.fd, key.data) and isinstance(key.fileobj, socket.socket):
                    self._selector.unregister(key.fileobj)
                    key.fileobj.close()

    def _serve(self, end: int, name: str) -> bool:
        """Read the bytes that have arrived and send the replies that are due. Returns whether the end is still open."""
        try:
            data = os.read(end, CHUNK)
            self._got[name] += len(data)
            due = self._due[name]
            while due and self._got[name] >= due[0][0]:
                size, reply = due.popleft()
                self._got[name] -= size
                if name in self._lines:
                    WallClock().wait(reply_begins(size, FASTEST, BITS))  # the client drops a reply that comes sooner
                os.write(end, reply)
        except OSError:  # the other side is closed
            return False
        return bool(data)
