"""The server of a live page: only for this machine, only for the page itself, and never waited for."""

from __future__ import annotations

import errno
import resource
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from palpate.drivers.clock import WallClock
from palpate.instrument.errors import BenchError, RecordError, UsageError
from palpate.procedures.live.control import PageControl
from palpate.procedures.live.feed import Feed

ADDRESS = "127.0.0.1"
LOOK = 0.05  # s between two looks for what is new
MOST_CONNECTIONS = 128  # or a quarter of the files that this process may open
BUFFER = 65536  # bytes that the system keeps for a page that does not read
PATIENCE = 10.0  # s that a page may leave the first messages unread, or take for a request
FAREWELL = 0.5  # s in which pages get the last messages
PAGE = Path(__file__).parent / "page"
FILES = {
    "/": ("page.html", "text/html"),
    "/page.css": ("page.css", "text/css"),
    "/page.js": ("page.js", "text/javascript"),
    "/scope.js": ("scope.js", "text/javascript"),
    "/uPlot.js": ("uplot/uPlot.iife.min.js", "text/javascript"),
    "/uPlot.css": ("uplot/uPlot.min.css", "text/css"),
}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
TOKEN = "X-Palpate-Token"


class _PageServer(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True
    request_queue_size = MOST_CONNECTIONS

    def __init__(self, port: int, feed: Feed, control: PageControl | None) -> None:
        allowed = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        most = MOST_CONNECTIONS if allowed < 0 else min(MOST_CONNECTIONS, allowed // 4)
        self._free = threading.BoundedSemaphore(most)  # so that pages leave the run enough files
        self._feed = feed
        super().__init__((ADDRESS, port), partial(_Handler, feed, control))
        self.hosts = {f"{name}:{self.server_port}" for name in (ADDRESS, "localhost")}

    def service_actions(self) -> None:
        """Called at each look, and after each request."""
        self._feed.look()

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a page that went away, or that never reads."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "palpate", ""
    timeout = PATIENCE
    server: _PageServer

    def __init__(self, feed: Feed, control: PageControl | None, *of: Any) -> None:
        self._feed, self._control = feed, control
        super().__init__(*of)

    def log_message(self, *_of: object) -> None:
        """Say nothing on the terminal of the run."""

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?")
        if not self._from_here(self.headers.get("Origin")):
            return
        if path in FILES:
            name, kind = FILES[path]
            self._answer(HTTPStatus.OK, (PAGE / name).read_bytes(), kind)
        elif path == "/events":
            self._stream()
        elif path == "/trace" and self._feed.stored:
            self._stored(query.removeprefix("point="))
        else:
            self._refuse(HTTPStatus.NOT_FOUND, f"there is no {path} here; open http://{min(self.server.hosts)}/")

    def do_POST(self) -> None:
        self.close_connection = True  # a body is not read
        if not self._from_here(self.headers.get("Origin", "none")):
            return
        action = self.path.removeprefix("/")
        if self._control is None or action not in self._feed.controls:
            self._refuse(HTTPStatus.NOT_FOUND, f"this run cannot be told to {action} from here")
        elif not self._control.allows(self.headers.get(TOKEN, "")):
            self._refuse(HTTPStatus.FORBIDDEN, "wrong token; take the one that palpate printed in the terminal")
        else:
            (self._control.stop if action == "stop" else self._control.toggle)()
            self._answer(HTTPStatus.OK, b"asked", "text/plain")

    def _from_here(self, origin: str | None) -> bool:
        """Whether the page itself asks: under an address of this server, and not by the page of another one."""
        host = self.headers.get("Host", "")
        if host not in self.server.hosts:
            self._refuse(HTTPStatus.FORBIDDEN, f"Host is {host!r}; open http://{min(self.server.hosts)}/")
        elif origin is not None and origin not in {f"http://{each}" for each in self.server.hosts}:
            self._refuse(HTTPStatus.FORBIDDEN, f"Origin is {origin!r}; only the page of palpate itself may ask")
        else:
            return True
        return False

    def _stream(self) -> None:
        self.close_connection = True
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
        self._head(HTTPStatus.OK, "text/event-stream")
        self.end_headers()
        self._feed.stream(self.connection)

    def _stored(self, point: str) -> None:
        try:
            self._answer(HTTPStatus.OK, self._feed.stored_trace(int(point)), "application/json")
        except (ValueError, RecordError) as error:
            self._refuse(HTTPStatus.NOT_FOUND, str(error))

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self._answer(status, why.encode("utf-8", "replace"), "text/plain")

    def _answer(self, status: HTTPStatus, body: bytes, kind: str) -> None:
        self._head(status, kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _head(self, status: HTTPStatus, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        for name, value in HEADERS.items():
            self.send_header(name, value)


@contextmanager
def serving(feed: Feed, port: int = 0, control: PageControl | None = None) -> Iterator[str]:
    """Serve the page of a feed while the block runs; gives its address. `port`: 0: any free one.

    Raises UsageError: the port is taken; BenchError: this machine cannot serve.
    """
    try:
        server = _PageServer(port, feed, control)
    except OSError as error:
        if error.errno in (errno.EADDRINUSE, errno.EACCES):
            raise UsageError(
                f"--port {port}: {error.strerror}; name another one, or leave --port out for any free one"
            ) from None
        raise BenchError(f"the live page cannot be served: {error.strerror}; leave --live out") from None
    thread = threading.Thread(target=partial(server.serve_forever, LOOK), name="live page", daemon=True)
    thread.start()
    try:
        yield f"http://{ADDRESS}:{server.server_port}/"
    finally:
        clock = WallClock()
        while feed.waits() and clock.now_ns() < 1e9 * FAREWELL:
            clock.wait(LOOK)
        feed.close()
        server.shutdown()
        server.server_close()
