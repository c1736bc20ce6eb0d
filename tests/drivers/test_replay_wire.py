"""The devices' ends of a replay: a reply comes once the whole request has arrived, on each link its own."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from palpate.drivers.logs.bus_replay import ReplayWire
from palpate.instrument.bench.links import LOOPBACK

PATIENCE = 10.0  # s until a test gives up


@pytest.fixture
def wire() -> Iterator[ReplayWire]:
    with ReplayWire() as open_:
        yield open_


def connected(port: int) -> socket.socket:
    return socket.create_connection((LOOPBACK, port), timeout=PATIENCE)


def test_a_reply_comes_when_the_last_byte_of_its_request_is_there(wire: ReplayWire) -> None:
    with connected(wire.listen("rack")) as end:
        wire.expect("rack", 5, b"first")
        wire.expect("rack", 3, b"second")
        end.sendall(b"1234")
        end.sendall(b"5678")
        assert read(end, 11) == b"firstsecond"
        wire.expect("rack", 2, b"third")
        end.sendall(b"9a")
        assert read(end, 5) == b"third"


def read(end: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += end.recv(size - len(data))
    return data


def test_a_client_that_connects_anew_begins_a_request_anew(wire: ReplayWire) -> None:
    port = wire.listen("rack")
    wire.expect("rack", 4, b"reply")
    with connected(port) as end:
        end.sendall(b"12")
        end.shutdown(socket.SHUT_WR)
        assert end.recv(1) == b""  # it has noticed
    with connected(port) as end:
        end.sendall(b"1234")
        assert read(end, 5) == b"reply"


def test_nothing_stays_open() -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    with ReplayWire() as wire:
        wire.line("line")
        with connected(wire.listen("rack")):
            pass
    assert len(list(Path("/proc/self/fd").iterdir())) == before
