"""Modbus servers on the wire among clients that mean no good: the bench's own is served all the same."""

from __future__ import annotations

import contextlib
import errno
import socket
import struct
from collections.abc import Iterator
from typing import Any

import pytest

from palpate.drivers.devices.exciter import SignalGenerator
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.links import TcpLink
from palpate.instrument.contracts.field import PROBE
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire import modbus
from palpate.simulators.wire.modbus import MOST_CONNECTIONS

READ = bytes.fromhex("03 0000 0002")


def framed(pdu: bytes, transaction: int = 7) -> bytes:
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, 1) + pdu


@pytest.fixture
def address(codec: str, scene: Scene) -> Iterator[TcpLink]:
    with SimulatedBench(scene) as simulated:
        yield simulated.description.links["signal_generator"]


@pytest.fixture
def own(address: TcpLink) -> Iterator[SignalGenerator]:
    """The bench's own client, connected."""
    link = ModbusLink.tcp(address.model_copy(update={"timeout": 10.0}))
    link.open()
    yield SignalGenerator(link, 1, VirtualClock())
    link.close()


@contextlib.contextmanager
def clients(address: TcpLink, count: int, says: bytes = b"") -> Iterator[list[socket.socket]]:
    with contextlib.ExitStack() as stack:
        found = []
        for _ in range(count):
            client = stack.enter_context(socket.create_connection((address.host, address.port), timeout=10))
            client.sendall(says)
            found.append(client)
        yield found


def ended(client: socket.socket) -> bool:
    try:
        return client.recv(1) == b""
    except ConnectionResetError:
        return True


def served(own: SignalGenerator) -> bool:
    return own.get("probe") == PROBE


def test_the_servers_listen_on_loopback(address: TcpLink) -> None:
    assert address.host == "127.0.0.1"


@pytest.mark.parametrize("says", [b"", framed(READ)[:7]], ids=["half-open", "slow"])
def test_clients_that_ask_nothing_make_room_for_those_that_come(
    address: TcpLink, own: SignalGenerator, says: bytes
) -> None:
    assert served(own)
    with clients(address, 3 * MOST_CONNECTIONS, says) as many:
        assert served(own)
        assert ended(many[0])
        with clients(address, 1, framed(READ)) as (late,):
            assert late.recv(100)[7:] == b"\x03\x04" + PROBE.to_bytes(4, "big")


def test_one_client_too_many_is_refused_and_the_others_stay(address: TcpLink, own: SignalGenerator) -> None:
    assert served(own)
    with clients(address, MOST_CONNECTIONS - 1, framed(READ)) as many:
        assert all(client.recv(100) for client in many)
        with clients(address, 1) as (late,):
            assert ended(late)
        assert served(own)
        many[0].sendall(framed(READ))
        assert many[0].recv(100)


def test_clients_that_have_asked_once_and_idle_make_room_the_longest_silent_first(
    address: TcpLink, own: SignalGenerator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(modbus, "IDLE", 0.0)
    assert served(own)
    with clients(address, MOST_CONNECTIONS - 1, framed(READ)) as many, contextlib.ExitStack() as stack:
        assert all(client.recv(100) for client in many)
        assert served(own)  # since when the first of them is the longest silent
        for oldest in many[:2]:
            (late,) = stack.enter_context(clients(address, 1, framed(READ)))
            assert late.recv(100)
            assert ended(oldest)
        assert served(own)


def test_clients_that_flood_take_their_turns(address: TcpLink, own: SignalGenerator) -> None:
    flood = framed(READ) * 400
    with clients(address, 3, flood) as many:
        for client in many:
            client.setblocking(False)
        for _ in range(20):
            for client in many:
                with contextlib.suppress(BlockingIOError):
                    client.send(flood)
        assert served(own)
        assert served(own)


def test_a_client_that_leaves_its_answers_unread_is_cut(
    address: TcpLink, own: SignalGenerator, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert served(own)
    with monkeypatch.context() as patch, clients(address, 1, framed(READ)) as (client,):
        assert client.recv(1)  # the server is done with the bench's own client by now
        patch.setattr(modbus, "UNREAD", -1)  # sockets take megabytes before anything waits
        client.sendall(framed(READ) * 100)
        answers = 0
        while not ended(client):
            answers += 1
        assert answers < 100
    assert served(own)


def test_a_server_that_may_open_nothing_more_for_a_while_serves_its_clients_and_then_the_new_one(
    address: TcpLink, own: SignalGenerator, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert served(own)
    accept, failed = socket.socket.accept, list[int]()

    def exhausted(listening: socket.socket) -> Any:
        if len(failed) < 2:
            failed.append(1)
            raise OSError(errno.EMFILE, "Too many open files")
        return accept(listening)

    monkeypatch.setattr(socket.socket, "accept", exhausted)
    with clients(address, 1, framed(READ)) as (late,):
        assert served(own)
        assert late.recv(100)[7:] == b"\x03\x04" + PROBE.to_bytes(4, "big")
    assert len(failed) == 2


@pytest.mark.parametrize(
    "rubbish", [bytes(range(256)) * 16, framed(READ)[:4] + b"\xff\xff" + bytes(70_000), b"\0\1\0\0\0\0" * 99]
)
def test_rubbish_and_oversized_frames_end_their_own_connection(
    address: TcpLink, own: SignalGenerator, rubbish: bytes
) -> None:
    with clients(address, 2) as many:
        for client in many:
            with contextlib.suppress(OSError):
                client.sendall(rubbish)
        assert all(map(ended, many))
        assert served(own)


def test_a_request_whose_end_comes_after_the_answer_to_the_one_before_is_answered(address: TcpLink) -> None:
    with clients(address, 1, framed(READ, 1) + framed(READ, 2)[:5]) as (client,):
        assert client.recv(13)[:2] == b"\0\1"
        client.sendall(framed(READ, 2)[5:])
        assert client.recv(13)[:2] == b"\0\2"
