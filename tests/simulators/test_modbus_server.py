"""The Modbus servers on the wire, byte by byte, as any client meets them."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import tty
from collections.abc import Iterator
from random import Random
from typing import Any

import pytest
from pymodbus.framer import FramerRTU

from palpate.drivers.devices.exciter import SignalGenerator
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.links import TcpLink
from palpate.instrument.contracts.field import PROBE
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire import modbus
from palpate.simulators.wire.modbus import MOST_CONNECTIONS

LOST = 40  # requests after rubbish on a line, at most: 320 bytes


def framed(pdu: bytes, transaction: int = 7, unit: int = 1) -> bytes:
    return transaction.to_bytes(2) + bytes(2) + (len(pdu) + 1).to_bytes(2) + bytes([unit]) + pdu


@pytest.fixture(scope="module")
def served(scene: Scene) -> Iterator[SimulatedBench]:
    with SimulatedBench(scene) as simulated:
        yield simulated


@pytest.fixture
def client(codec: str, served: SimulatedBench) -> Iterator[socket.socket]:
    address = served.description.links["signal_generator"]
    with socket.create_connection((address.host, address.port), timeout=5) as connected:
        yield connected


def replies(client: socket.socket, count: int) -> list[bytes]:
    """The next `count` replies, each with its header."""
    stream = client.makefile("rb")
    heads = [(head := stream.read(6), stream.read(int.from_bytes(head[4:6]))) for _ in range(count)]
    return [head + rest for head, rest in heads]


def asked(client: socket.socket, pdu: str, unit: int = 1) -> str:
    """The answer to one request, both as hexadecimal digits without header."""
    client.sendall(framed(bytes.fromhex(pdu), unit=unit))
    (reply,) = replies(client, 1)
    assert reply[:2] == b"\x00\x07"
    assert reply[6] == unit
    return reply[7:].hex()


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("01 0000 0001", "8101"),  # coils: unknown function
        ("04 0000 0001", "8401"),
        ("08 0000 1234", "8801"),
        ("16 0000 0000 0001", "9601"),
        ("17 0000 0001 0000 0001 02 0001", "9701"),
        ("2a", "aa01"),
        ("64 00", "e401"),
        ("c1 00", "c101"),  # itself an exception
        ("2b 0d 00", "ab01"),  # another encapsulated interface
        ("03 0000 0000", "8303"),  # count 0
        ("03 0000 007e", "8303"),  # 126 registers
        ("03 0000 00", "8303"),  # cut short
        ("03 0000 0001 00", "8303"),  # goes on
        ("10 0000 0000 00", "9003"),
        ("10 0000 007c f8 0000", "9003"),  # 124 registers
        ("10 0000 0002 02 0000", "9003"),  # byte count against count
        ("06 0000", "8603"),
        ("03 7000 0001", "8302"),  # unknown address
        ("03 ffff 0002", "8302"),
        ("06 7000 0001", "8602"),
        ("2b 0e 00 00", "ab03"),  # read device id code 0
        ("2b 0e 05 00", "ab03"),
        ("2b 0e 04 33", "ab02"),  # no such object
    ],
)
def test_what_is_wrong_with_a_request_has_its_exception_code(client: socket.socket, request_: str, answer: str) -> None:
    assert asked(client, request_) == answer


def random_requests(count: int) -> Iterator[bytes]:
    """Requests with the functions that the thin codec has, most of them with something wrong."""
    random = Random(7)
    for _ in range(count):
        function, address = random.choice([3, 3, 4, 6, 16, 16]), random.choice([random.randrange(64), 0x7000, 0xFFFF])
        number = random.choice([0, 1, 2, 3, 4, 8, 123, 124, 125, 126, 255, 65535])
        request = bytes([function]) + address.to_bytes(2) + number.to_bytes(2)
        if function == 16:
            request += bytes([random.choice([2 * number, number]) & 0xFF]) + random.randbytes(min(2 * number, 246))
        yield random.choice([request, request, request[: random.randrange(1, len(request))], request + b"\0"])


def test_both_codecs_give_the_same_answers_to_a_thousand_requests_good_and_bad(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Private, because nobody else chooses a codec."""
    answers = []
    for functions in (modbus.THIN, frozenset[int]()):
        monkeypatch.setattr(modbus, "THIN", functions)
        with SimulatedBench(scene) as simulated:
            address = simulated.description.links["signal_generator"]
            with socket.create_connection((address.host, address.port), timeout=5) as connected:
                stream = connected.makefile("rb")
                heard = []
                for request in random_requests(1000):
                    connected.sendall(framed(request))
                    head = stream.read(6)
                    heard.append((request.hex(), (head + stream.read(int.from_bytes(head[4:6]))).hex()))
        answers.append(heard)
    assert answers[0] == answers[1]


@pytest.mark.parametrize("unit", [2, 17, 247])
def test_an_absent_unit_is_answered_by_the_gateway(client: socket.socket, unit: int) -> None:
    assert asked(client, "03 0000 0001", unit) == "830b"
    assert asked(client, "2b 0e 01 00", unit) == "ab0b"


@pytest.mark.parametrize("unit", [0, 255])
def test_a_device_on_tcp_is_meant_by_0_and_255_as_well(
    client: socket.socket, served: SimulatedBench, unit: int
) -> None:
    address = served.generator.contract["probe"].address
    assert asked(client, f"03 {address:04x} 0002", unit) == f"0304{PROBE:08x}"
    assert asked(client, "2b 0e 04 00", unit).endswith(served.generator.contract.identity.vendor.encode().hex())


@pytest.mark.parametrize(
    ("code", "first", "objects"),
    [(1, 0, [0, 1, 2]), (1, 2, [2]), (1, 0x80, [0, 1, 2]), (2, 0, [0, 1, 2, 4, 6]), (3, 0, [0, 1, 2, 4, 6, 0x80]),
     (3, 0x80, [0x80]), (4, 4, [4])],
)  # fmt: skip
def test_an_identity_is_read_by_category_from_an_object_on(
    client: socket.socket, code: int, first: int, objects: list[int]
) -> None:
    answer = bytes.fromhex(asked(client, f"2b 0e {code:02x} {first:02x}"))
    assert answer[:7] == bytes([0x2B, 0x0E, code, 0x83, 0, 0, len(objects)])
    found, rest = [], answer[7:]
    while rest:
        found.append(rest[0])
        rest = rest[2 + rest[1] :]
    assert found == objects


def test_requests_in_one_segment_are_all_answered_in_their_order(client: socket.socket) -> None:
    address = "0000"
    many = [framed(bytes.fromhex(f"03 {address} 0001"), transaction=n) for n in range(400)]
    client.sendall(b"".join(many))
    assert [int.from_bytes(reply[:2]) for reply in replies(client, len(many))] == list(range(400))


def test_a_request_in_single_bytes_is_answered(client: socket.socket) -> None:
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for byte in framed(bytes.fromhex("03 7000 0001")):
        client.sendall(bytes([byte]))
    assert replies(client, 1)[0][7:].hex() == "8302"


def test_one_register_is_echoed_as_written_though_a_command_falls_back(
    client: socket.socket, served: SimulatedBench
) -> None:
    address = served.generator.contract["phase_reset"].address
    assert asked(client, f"06 {address:04x} 0001") == f"06{address:04x}0001"
    assert served.generator.settings["phase_reset"] == 0.0


# --- the serial line -----------------------------------------------------------------------------------


@pytest.fixture
def line(served: SimulatedBench) -> Iterator[int]:
    descriptor = os.open(served.description.links["line"].port, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(descriptor)
    yield descriptor
    os.close(descriptor)


def checked(frame: str) -> bytes:
    data = bytes.fromhex(frame)
    return data + FramerRTU.compute_CRC(data).to_bytes(2)


def on_line(line: int, frame: str, size: int) -> str:
    """`size` bytes that come for a frame, its check sum added, without theirs."""
    os.write(line, checked(frame))
    data = b""
    while len(data) < size + 2:
        data += os.read(line, size + 2 - len(data))
    assert data == checked(data[:-2].hex())
    return data[:-2].hex()


def test_a_function_that_a_unit_on_the_line_does_not_know_is_refused(line: int) -> None:
    assert on_line(line, "01 64 00", 3) == "01e401"
    assert on_line(line, "02 04 0000 0001", 3) == "028401"


def test_a_broadcast_is_carried_out_by_all_and_answered_by_none(line: int, served: SimulatedBench) -> None:
    """Both units have a register at that address; one takes the value and one does not: neither says so."""
    field = served.positioner.contract["target"]
    data = served.positioner.contract.encode("target", 2e-3).hex()
    before = served.positioner.settings["target"]
    os.write(line, checked(f"00 10 {field.address:04x} {field.size // 2:04x} {field.size:02x} {data}"))
    probe = served.positioner.contract["probe"].address
    assert on_line(line, f"02 03 {probe:04x} 0002", 7) == f"020304{PROBE:08x}"
    assert before != 2e-3
    assert served.positioner.settings["target"] == 2e-3


@pytest.mark.parametrize("rubbish", ["ff" * 300, "01 03 00"])
def test_rubbish_on_the_line_is_passed_over_in_the_end(line: int, served: SimulatedBench, rubbish: str) -> None:
    """Nothing marks a frame's beginning, so the requests that follow may be lost with it, but not many of them."""
    os.write(line, bytes.fromhex(rubbish))
    probe = served.positioner.contract["probe"].address
    answer = checked(f"02 03 04 {PROBE:08x}")
    heard = b""
    for _ in range(LOST):
        os.write(line, checked(f"02 03 {probe:04x} 0002"))
        while select.select([line], [], [], 0.05)[0]:
            heard += os.read(line, 256)
        if answer in heard:
            return
    raise AssertionError(f"only {heard.hex(' ')} is heard")


@pytest.mark.parametrize("part", ["02 10 0010 0004 08 00", "02 03 00", "01", "02 03 0020 0003"])
def test_a_request_that_is_broken_off_does_not_swallow_the_next(line: int, served: SimulatedBench, part: str) -> None:
    """Whether the server hears both at once, as a busy one does, or the silence between them."""
    probe = served.positioner.contract["probe"].address
    for silence in (0.0, 0.02):
        os.write(line, bytes.fromhex(part))
        assert not select.select([line], [], [], silence)[0]
        os.write(line, checked(f"02 03 {probe:04x} 0002"))
        assert select.select([line], [], [], 10.0)[0]
        assert os.read(line, 256) == checked(f"02 03 04 {PROBE:08x}")


# --- clients that ask too much, or nothing -----------------------------------------------------------

READ = bytes.fromhex("03 0000 0002")


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


def is_served(own: SignalGenerator) -> bool:
    return own.get("probe") == PROBE


def test_the_servers_listen_on_loopback(address: TcpLink) -> None:
    assert address.host == "127.0.0.1"


@pytest.mark.parametrize("says", [b"", framed(READ)[:7]], ids=["half-open", "slow"])
def test_clients_that_ask_nothing_make_room_for_those_that_come(
    address: TcpLink, own: SignalGenerator, says: bytes
) -> None:
    assert is_served(own)
    with clients(address, 3 * MOST_CONNECTIONS, says) as many:
        assert is_served(own)
        assert ended(many[0])
        with clients(address, 1, framed(READ)) as (late,):
            assert late.recv(100)[7:] == b"\x03\x04" + PROBE.to_bytes(4, "big")


def test_one_client_too_many_is_refused_and_the_others_stay(address: TcpLink, own: SignalGenerator) -> None:
    assert is_served(own)
    with clients(address, MOST_CONNECTIONS - 1, framed(READ)) as many:
        assert all(client.recv(100) for client in many)
        with clients(address, 1) as (late,):
            assert ended(late)
        assert is_served(own)
        many[0].sendall(framed(READ))
        assert many[0].recv(100)


def test_clients_that_have_asked_once_and_idle_make_room_the_longest_silent_first(
    address: TcpLink, own: SignalGenerator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(modbus, "IDLE", 0.0)
    assert is_served(own)
    with clients(address, MOST_CONNECTIONS - 1, framed(READ)) as many, contextlib.ExitStack() as stack:
        assert all(client.recv(100) for client in many)
        assert is_served(own)  # since when the first of them is the longest silent
        for oldest in many[:2]:
            (late,) = stack.enter_context(clients(address, 1, framed(READ)))
            assert late.recv(100)
            assert ended(oldest)
        assert is_served(own)


def test_clients_that_flood_take_their_turns(address: TcpLink, own: SignalGenerator) -> None:
    flood = framed(READ) * 400
    with clients(address, 3, flood) as many:
        for client in many:
            client.setblocking(False)
        for _ in range(20):
            for client in many:
                with contextlib.suppress(BlockingIOError):
                    client.send(flood)
        assert is_served(own)
        assert is_served(own)


def test_a_client_that_leaves_its_answers_unread_is_cut(
    address: TcpLink, own: SignalGenerator, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert is_served(own)
    with monkeypatch.context() as patch, clients(address, 1, framed(READ)) as (client,):
        assert client.recv(1)  # the server is done with the bench's own client by now
        patch.setattr(modbus, "UNREAD", -1)  # sockets take megabytes before anything waits
        client.sendall(framed(READ) * 100)
        answers = 0
        while not ended(client):
            answers += 1
        assert answers < 100
    assert is_served(own)


def test_a_server_that_may_open_nothing_more_for_a_while_serves_its_clients_and_then_the_new_one(
    address: TcpLink, own: SignalGenerator, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert is_served(own)
    accept, failed = socket.socket.accept, list[int]()

    def exhausted(listening: socket.socket) -> Any:
        if len(failed) < 2:
            failed.append(1)
            raise OSError(errno.EMFILE, "Too many open files")
        return accept(listening)

    monkeypatch.setattr(socket.socket, "accept", exhausted)
    with clients(address, 1, framed(READ)) as (late,):
        assert is_served(own)
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
        assert is_served(own)


def test_a_request_whose_end_comes_after_the_answer_to_the_one_before_is_answered(address: TcpLink) -> None:
    with clients(address, 1, framed(READ, 1) + framed(READ, 2)[:5]) as (client,):
        assert client.recv(13)[:2] == b"\0\1"
        client.sendall(framed(READ, 2)[5:])
        assert client.recv(13)[:2] == b"\0\2"
