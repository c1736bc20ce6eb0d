"""Replays a bus log: stands in for the devices, and gives each request the answer that the log holds for it.

The program that made the log runs again. Each of its requests, and each reading of its clock, must be the next one in
the log. All messages that the log holds up to the following one are then sent over real sockets, a pseudo-terminal and
a CAN bus.
"""

from __future__ import annotations

import json
import os
import selectors
import socket
import struct
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Self

import can

from palpate.drivers.bench import Bench
from palpate.drivers.clock import WallClock
from palpate.drivers.links.can import HEARTBEAT
from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.logs.bus_log import (
    CLOCK,
    NODE_ID,
    RUN,
    WHOLE_FORMAT,
    Link,
    Packet,
    called,
    can_links,
    kind_called,
    logged,
    modbus_links,
    packed,
    read_pcapng,
    unpacked,
)
from palpate.instrument.bench.description import recorded_bench
from palpate.instrument.bench.links import (
    FASTEST,
    LOOPBACK,
    SerialLine,
    TcpLink,
    character_bits,
    check_loopback,
    pseudo_terminal,
    reply_begins,
)
from palpate.instrument.contracts.own import SHAKER_AMPLIFIER
from palpate.instrument.errors import ConfigError, LinkError, UsageError
from palpate.instrument.own_process import Ends, close_in_child, watched

# -------------------------------------------------------------------------------------------------------
# The devices' ends of the Modbus links of a bench that is replayed, on real sockets and pseudo-terminals

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


# --- the replay ----------------------------------------------------------------------------------------

TRANSACTION, MBAP = 2, 7  # bytes of a frame on TCP: its transaction number; the whole MBAP header
AMPLIFIER = SHAKER_AMPLIFIER
ALIVE = b"\x10" + AMPLIFIER["token"].address.to_bytes(2) + b"\0\4\x08"  # a write of token and counter
FIRST = bytes([0, 0, 0, 1])  # the first counter of a token
LOOK = b"\3" + AMPLIFIER["status"].address.to_bytes(2) + b"\0\1"  # a read of the status alone
LOOKED = b"\3\2\0\0"  # the answer to it


class BusReplay:
    """A context manager inside which the devices of a log answer at the addresses of `description`.

    It is also the clock of the bench that is opened on it; call `attach` with that bench before opening it. Requests
    that feed the amplifier's watchdog may come at any time, and are always confirmed; heartbeats of this program may
    come at any time, too.

    Attributes:
        path: the log.
        goes_on: True, as for a wall clock, so that nobody reads it to feed the watchdog.
        run: header of the recorded run.
        description: description of the recorded bench; inside the context with its present addresses.
    """

    goes_on = True
    stepper = None

    def __init__(self, path: Path, describe: Callable[[Packet], str]) -> None:
        """Read a log.

        Args:
            path: the log; for a CAN log, the pcapng file beside it is read.
            describe: describes a packet for people, in messages.

        Raises:
            UsageError: the file cannot be read.
            ConfigError: it is damaged, or no run began in it.
        """
        self.path = path if path.suffix.lower() == WHOLE_FORMAT else logged(path).with_suffix(WHOLE_FORMAT)
        self._describe = describe
        packets = self._read()
        header = next((packet.data for packet in packets if packet.who == RUN), None)
        if header is None:
            raise ConfigError(f"{self.path}: no run began in this log; replay a log that --log recorded of a whole run")
        try:
            self.run: dict[str, Any] = json.loads(header)
            bench: str = self.run["bench"]
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(
                f"{self.path}: the run in this log was recorded by another version of palpate ({error}); replay it "
                "with that version"
            ) from None
        self._packets = list(_without_heartbeats(packet for packet in packets if packet.who != RUN))
        self._at = 0
        self.description = recorded_bench(bench, str(self.path))
        self._stack = Ends()

    def _read(self) -> list[Packet]:
        try:
            return list(read_pcapng(logged(self.path)))
        except OSError as error:
            raise UsageError(f"{self.path}: cannot be read: {error.strerror or error}; check the name") from error
        except (ValueError, struct.error) as error:
            raise ConfigError(f"{self.path}: damaged: {error}; only a whole log can be replayed") from error

    def __enter__(self) -> Self:
        recorded = self.description
        with Ends() as stack:
            channel = f"replay-{os.getpid()}-{id(self)}"
            self._bus = can.Bus(interface="virtual", channel=channel)
            stack.callback(self._bus.shutdown)
            self._wire = stack.enter_context(ReplayWire())
            places: dict[str, dict[str, Any]] = {}
            for name, link in recorded.links.items():
                if isinstance(link, TcpLink):
                    places[name] = {"host": LOOPBACK, "port": self._wire.listen(name)}
                elif isinstance(link, SerialLine):
                    places[name] = {"port": self._wire.line(name), "baudrate": FASTEST}
                else:
                    places[name] = {"interface": "virtual", "channel": channel}
            self.description = recorded.moved(places)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def attach(self, bench: Bench) -> None:
        """Listen to the requests on the links of a bench that is not open yet.

        An optional device with which the log has no traffic was absent, and is left out.
        """
        recorded = {packet.who for packet in self._packets}
        for device in bench.devices:
            if called(bench.named(device)) not in recorded:
                bench.leave_out(device, LinkError("the log holds no traffic with it"))
        for name, modbus, kind, whom in modbus_links(bench):
            self._answer(name, modbus, kind, whom)
        for link, of in can_links(bench):
            link.tap(partial(self._heard_frame, of))

    def now_ns(self) -> int:
        """The time that the program read at this place of the log [ns]."""
        at = self._next(Packet(0, CLOCK, Link.NOTE, True, b""))
        return int(self._packets[at].data)

    def wait(self, duration: float) -> None:
        """Return at once: the time has passed in the log."""

    def _answer(self, name: str, link: ModbusLink, kind: Link, whom: Callable[[bytes], str]) -> None:
        def heard(sending: bool, data: bytes) -> None:
            if sending:
                who = whom(data)
                sent = Packet(0, who, kind, True, data)
                reply = _confirmed(data) if _is_heartbeat(sent) else self._reply(self._next(sent))
                if reply and kind is Link.TCP:
                    reply = data[:TRANSACTION] + reply[TRANSACTION:]
                self._wire.expect(name, len(data), reply)

        link.tap(heard)

    def _heard_frame(self, whom: Callable[[bytes], str], sending: bool, frame: can.Message) -> None:
        data = packed(frame)
        if sending and not _is_beat(data):
            self._next(Packet(0, whom(data), Link.CAN, True, data))

    def _next(self, did: Packet) -> int:
        """Index in the log of the program's present action. Raises ConfigError: the log has another action there."""
        self._hear()
        at = self._at
        if at == len(self._packets) or not _same(self._packets[at], did):
            goes_on = "ends here" if at == len(self._packets) else f"goes on with {self._describe(self._packets[at])!r}"
            raise ConfigError(
                f"{self.path}: the replay sends {self._describe(did)!r}, but the log {goes_on}; only a run that was "
                "not paused or stopped and lost no connection can be replayed, with the version that recorded it"
            )
        self._at += 1
        self._hear()
        return at

    def _hear(self) -> None:
        """Send the recorded CAN frames that came before the program's next action."""
        while self._at < len(self._packets) and not self._packets[self._at].sent:
            if self._packets[self._at].link is Link.CAN:
                self._bus.send(unpacked(self._packets[self._at].data))
            self._at += 1

    def _reply(self, at: int) -> bytes:
        """The recorded answer to a request; empty where there was none."""
        who = self._packets[at].who
        for later in range(at + 1, len(self._packets)):
            if self._packets[later].who == who:
                return b"" if self._packets[later].sent else self._packets[later].data
        return b""


def _same(recorded: Packet, did: Packet) -> bool:
    """Whether two actions are the same. Readings of the clock and numbers of requests on TCP may differ."""
    if (recorded.link, recorded.who) != (did.link, did.who):
        return False
    begins = TRANSACTION if did.link is Link.TCP else 0
    return did.link is Link.NOTE or recorded.data[begins:] == did.data[begins:]


def _is_heartbeat(packet: Packet) -> bool:
    """Whether a packet only feeds the amplifier's watchdog. The first one of a token also claims the amplifier."""
    if kind_called(packet.who) != AMPLIFIER.name:
        return False
    request = packet.data[MBAP:]
    return packet.sent and (request == LOOK or (request.startswith(ALIVE) and request[-4:] != FIRST))


def _is_beat(frame: bytes) -> bool:
    """Whether a frame that this program sends is its own heartbeat, by which a node watches it."""
    found = unpacked(frame)
    return not found.is_extended_id and found.arbitration_id & ~NODE_ID == HEARTBEAT


def _confirmed(request: bytes) -> bytes:
    """The answer to a heartbeat."""
    reply = request[MBAP:][:5] if request[MBAP:].startswith(ALIVE) else LOOKED
    return request[:4] + (len(reply) + 1).to_bytes(2) + request[6:MBAP] + reply


def _without_heartbeats(packets: Iterable[Packet]) -> Iterator[Packet]:
    unheard = False  # True: the next reply answers a heartbeat, and is left out, too
    for packet in packets:
        of_amplifier = kind_called(packet.who) == AMPLIFIER.name
        if of_amplifier and packet.sent:
            unheard = _is_heartbeat(packet)
        beat = packet.link is Link.CAN and packet.sent and _is_beat(packet.data)
        if not (beat or (of_amplifier and unheard)):
            yield packet
