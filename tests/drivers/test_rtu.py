"""Which bytes on a serial line are the reply: not an echo, not noise, not what is late or came too soon."""

from __future__ import annotations

import os
import struct
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from pymodbus.exceptions import ConnectionException
from pymodbus.pdu import DecodePDU

from palpate.drivers.clock import WallClock
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.devices.positioner import MicroPositioner
from palpate.drivers.links.modbus import ModbusLink, ReplyFramer, RtuClient, read_registers
from palpate.instrument.bench.links import FASTEST, SILENCE, SerialLine, earliest_reply, reply_begins
from palpate.instrument.contracts.field import PROBE
from palpate.instrument.errors import LinkTimeout
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from tests.drivers.fake_links import CHARACTER, VirtualLine, checked

UNIT = 2
LIMITS = 0x14


def registers(address: int, count: int, first: int = LIMITS) -> bytes:
    """The reply to a read: each register holds its address, but the first of the limits, which holds `first`."""
    values = [first if at == LIMITS else at for at in range(address, address + count)]
    return checked(bytes([UNIT, 3, 2 * count]) + struct.pack(f">{count}H", *values))


def answered(request: bytes) -> bytes:
    address, count = struct.unpack(">HH", request[2:6])
    return registers(address, count) if request[1] == 3 else checked(request[:6])


@contextmanager
def terminal(says: Callable[[bytes], list[bytes]], baudrate: int = FASTEST) -> Iterator[MicroPositioner]:
    """A driver on a pseudo-terminal, at whose other end each request is answered with these pieces."""
    own, theirs = os.openpty()
    tty.setraw(theirs)

    def serve() -> None:
        while (request := os.read(own, 256)) != b"end":
            WallClock().wait(reply_begins(len(request), FASTEST, 11))  # as a line does
            for piece in says(request):
                os.write(own, piece)

    link = ModbusLink.rtu(SerialLine(port=os.ttyname(theirs), baudrate=baudrate))
    link.open()
    server = threading.Thread(target=serve, daemon=True)
    server.start()
    try:
        yield MicroPositioner(link, UNIT, VirtualClock())
    finally:
        link.close()
        os.write(theirs, b"end")
        server.join()
        os.close(theirs)
        os.close(own)


def read(driver: ModbusDevice) -> list[float]:
    """Three fields of the positioner as the terminal's registers hold them."""
    return driver.get_many("limit_low", "limit_high")


HELD = [pytest.approx(1e-6 * (0x14 << 16 | 0x15)), pytest.approx(1e-6 * (0x16 << 16 | 0x17))]


@pytest.fixture(autouse=True)
def _without_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.instrument.contracts.contract.Contract.misread", lambda *_: "")


def line(device: Callable[[bytes], list[tuple[float, bytes]]], **settings: int) -> tuple[MicroPositioner, VirtualLine]:
    client = VirtualLine(device, **settings)
    return MicroPositioner(ModbusLink("virtual line", client), UNIT, VirtualClock()), client


# --- an adapter that adds to what the device says --------------------------------------------------------

ADDED: dict[str, Callable[[bytes], list[bytes]]] = {
    "echo": lambda request: [request + answered(request)],
    "echo in pieces": lambda request: [request[:3], request[3:] + answered(request)[:4], answered(request)[4:]],
    "noise": lambda request: [b"\x00" + answered(request)],
    "noise like a beginning": lambda request: [bytes([UNIT, 3]), answered(request)],
    "noise like a unit": lambda request: [bytes([UNIT]) + answered(request)],
    "noise and echo": lambda request: [b"\xff" + request + b"\x00" + answered(request)],
    "noise behind": lambda request: [answered(request) + b"\xf8"],
}


@pytest.mark.parametrize("added", ADDED)
def test_what_an_adapter_adds_to_a_reply_is_passed_over(added: str) -> None:
    with terminal(ADDED[added]) as driver:
        for _ in range(3):
            assert read(driver) == HELD
            driver.set(target=2e-3, speed=1e-3, command="move")


# --- replies that are late -----------------------------------------------------------------------------


def test_where_nothing_but_what_is_too_soon_comes_the_message_says_so_and_what_to_do() -> None:
    driver, _ = line(lambda _: [(-SILENCE * CHARACTER / 9600, registers(LIMITS, 4))], baudrate=9600)
    with pytest.raises(LinkTimeout, match=r"13 bytes came sooner than 9600 bit/s.* give the line its true baudrate"):
        read(driver)


@pytest.mark.parametrize("baudrate", [1200, 9600, 115200])
def test_a_device_that_keeps_no_silence_is_understood_byte_by_byte_or_all_at_once(baudrate: int) -> None:
    """Its reply begins as the request ends, and its clock is 2 % fast."""
    driver, client = line(lambda request: [], baudrate=baudrate)
    for pieces in (1, 13):

        def device(request: bytes, pieces: int = pieces) -> list[tuple[float, bytes]]:
            reply, character = answered(request), 0.98 * CHARACTER / baudrate
            step = -(-len(reply) // pieces)
            sent = len(request) + SILENCE
            return [
                ((len(request) + at + step) * character - sent * CHARACTER / baudrate, reply[at : at + step])
                for at in range(0, len(reply), step)
            ]

        client.device = device
        assert read(driver) == HELD
    assert client.too_soon == 0


@pytest.mark.parametrize(
    ("port", "speed"), [("/dev/ttyUSB1", 9600), ("/dev/ttyACM0", FASTEST), ("socket://10.0.0.1:502", FASTEST)]
)
def test_only_a_uart_is_held_to_its_baud_rate(port: str, speed: int) -> None:
    assert RtuClient(port, baudrate=9600).speed == speed


def test_a_reply_that_was_read_too_late_to_tell_is_used() -> None:
    """A busy machine may look only when the reply has long come: it is not thrown away."""

    class Late(VirtualLine):
        looks = iter([0.0, 0.0])

        def _now(self) -> float:
            return next(self.looks, 1.0)

    link = ModbusLink("virtual line", Late(lambda request: [(-1e-6, answered(request))]))
    assert read(MicroPositioner(link, UNIT, VirtualClock())) == HELD


def test_a_reply_that_is_repeated_when_the_next_has_been_asked_does_not_answer_it() -> None:
    """A slow adapter does so 3 ms later: it gives the reply to the read before, then the one to this read."""
    before: list[bytes] = []

    def device(request: bytes) -> list[bytes]:
        address, count = struct.unpack(">HH", request[2:6])
        reply = registers(address, count, first=len(before) + 1)
        before.append(reply)
        return [*before[-2:-1], reply]

    with terminal(device) as driver:
        for number in range(1, 21):
            low, _ = driver.get_many("limit_low", "limit_high")
            assert round(1e6 * low) >> 16 == number


def test_a_part_of_an_echo_whose_check_sum_fits_by_chance_is_no_confirmation() -> None:
    """The register is such that the confirmation of its write has the check sum 02 xx, and xx is written."""
    framer = ReplyFramer(DecodePDU(False))
    heads = (bytes([unit, 16, 0, address, 0, 1]) for unit in range(1, 248) for address in range(256))
    confirmation = next(frame for frame in map(checked, heads) if frame[-2] == 2)
    framer.request = checked(confirmation + b"\x00")
    assert framer.decode(framer.request[:8])[3] == b""
    framer.request = checked(confirmation[:-1] + bytes([confirmation[-1] ^ 1, 0]))
    assert framer.decode(confirmation)[3] == confirmation[1:-2]


@pytest.mark.parametrize("baudrate", [9600, 57600])
def test_a_simulated_line_answers_no_sooner_than_a_wire_of_its_clients_baud_rate(
    baudrate: int, sim: SimulatedBench
) -> None:
    link = ModbusLink.rtu(sim.description.links["line"].model_copy(update={"baudrate": baudrate}))
    link.open()
    positioner = MicroPositioner(link, 2, sim.clock)
    assert [positioner.get("probe") for _ in range(3)] == [PROBE] * 3
    link.close()


# --- a line that several devices share -------------------------------------------------------------------


@pytest.mark.parametrize(("baudrate", "least"), [(1200, 3.5 * 10 / 1200), (9600, 3.5 * 10 / 9600), (115200, 1.75e-3)])
def test_a_request_to_another_device_begins_when_the_line_was_silent_long_enough(baudrate: int, least: float) -> None:
    """The least silence: "MODBUS over serial line" 1.02, 2.5.1.1. The line adds a byte of noise behind a reply."""
    begun: list[float] = []
    ended: list[float] = []

    def said(request: bytes) -> list[tuple[float, bytes]]:
        begun.append(client.now)
        reply = checked(bytes([request[0], 3, 2, 0, request[0]]))
        ended.append(client.now + client.wire(len(request) + SILENCE) + client.wire(len(reply) + 1))
        return [(0.0, reply + b"\xf8")]

    client = VirtualLine(said, baudrate=baudrate)
    link = ModbusLink("virtual line", client)
    for unit in (1, 2):
        reply: Any = link.transact(f"unit {unit}", read_registers, 0, 1, unit)
        assert reply.registers == [unit]
    assert begun[1] - ended[0] == pytest.approx(least)


# --- the client's end ----------------------------------------------------------------------------------


READ = checked(bytes.fromhex("02 03 0014 0002"))
WRITE = checked(bytes.fromhex("02 10 0014 0001 02 0007"))
IDENTITY = checked(bytes.fromhex("02 2b 0e 01 00"))
REPLY = checked(bytes.fromhex("02 03 04 12345678"))
CONFIRMED = checked(bytes.fromhex("02 10 0014 0001"))
REFUSED = checked(bytes.fromhex("02 83 02"))
SAID = checked(bytes.fromhex("02 2b 0e 01 01 00 00 01 00 02 4142"))
LONGEST_READ = checked(bytes.fromhex("02 03 0000 007d"))  # 125 registers
LONGEST_REPLY = checked(b"\x02\x03\xfa" + bytes(range(250)))
NONE = (0, 0, 0, b"")


# --- which bytes are the reply -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("request_", "data", "ends"),
    [
        (READ, REPLY, 9),
        (READ, REFUSED, 5),
        (WRITE, CONFIRMED, 8),
        (IDENTITY, SAID, 14),
        (READ, READ + REPLY, 17),  # behind its echo
        (READ, b"\0" + REPLY + b"\xff", 10),
        (READ, REPLY + REPLY, 9),  # repeated
        (READ, b"\xff" + READ + b"\x02\x03" + REPLY, 20),
        (READ, REPLY[:4] + REPLY, 13),
        (LONGEST_READ, LONGEST_REPLY, 255),
    ],
)
def test_a_reply_is_found_among_other_bytes_with_the_place_where_it_ends(
    request_: bytes, data: bytes, ends: int
) -> None:
    framer = ReplyFramer(DecodePDU(False))
    framer.request = request_
    for behind in (b"", b"\0"):
        used, unit, transaction, pdu = framer.decode(data + behind)
        assert (used, unit, transaction) == (ends, 2, 0)
        assert checked(bytes([unit]) + pdu) in data


@pytest.mark.parametrize(
    ("request_", "data"),
    [
        (b"", REPLY),  # nothing was asked
        (READ, b""),
        (READ, REPLY[:-1]),
        (READ, REPLY[:-1] + bytes([REPLY[-1] ^ 1])),
        (READ, checked(b"\x03" + REPLY[1:-2])),  # of another unit
        (READ, checked(bytes.fromhex("02 04 04 12345678"))),  # of another function
        (READ, checked(bytes.fromhex("02 84 02"))),  # another one was refused
        (READ, checked(bytes.fromhex("02 03 02 1234"))),  # of another length
        (READ, REPLY + checked(bytes.fromhex("02 03 04 12345679"))),  # two that differ
        (READ, REPLY + REFUSED),
        (WRITE, checked(bytes.fromhex("02 10 0015 0001"))),  # of another register
        (WRITE, checked(bytes.fromhex("02 10 0014 0002"))),  # of another number of registers
        (WRITE, WRITE),  # its echo
        (IDENTITY, SAID[:-3]),
        (IDENTITY, REPLY),
        (checked(bytes.fromhex("02 63 00 00 00 00")), checked(bytes.fromhex("02 63 00 00 00"))),  # of no known function
    ],
)
def test_what_does_not_answer_the_request_is_no_reply(request_: bytes, data: bytes) -> None:
    framer = ReplyFramer(DecodePDU(False))
    if request_:
        framer.request = request_
    assert framer.decode(data) == NONE


COILS, COILS_REPLY = checked(bytes.fromhex("02 01 0000 0009")), checked(bytes.fromhex("02 01 02 ff01"))
DISCRETE, DISCRETE_REPLY = checked(bytes.fromhex("02 02 0005 0001")), checked(bytes.fromhex("02 02 01 01"))
INPUTS, INPUTS_REPLY = checked(bytes.fromhex("02 04 0000 0001")), checked(bytes.fromhex("02 04 02 1234"))
SOME, SOME_CONFIRMED = checked(bytes.fromhex("02 0f 0000 0002 01 03")), checked(bytes.fromhex("02 0f 0000 0002"))
COIL, REGISTER = checked(bytes.fromhex("00 05 0195 ff00")), checked(bytes.fromhex("02 06 0014 0007"))


@pytest.mark.parametrize(
    ("request_", "reply"),
    [(COILS, COILS_REPLY), (DISCRETE, DISCRETE_REPLY), (INPUTS, INPUTS_REPLY), (SOME, SOME_CONFIRMED)],
)
def test_each_function_has_its_reply_also_behind_an_echo(request_: bytes, reply: bytes) -> None:
    framer = ReplyFramer(DecodePDU(False))
    framer.request = request_
    for before in (b"", b"\xff", request_):
        assert (framer.decode(before + reply)[3], framer.decode(before + reply[:-1])) == (reply[1:-2], NONE)
    assert framer.decode(checked(reply[:2] + b"\x04" + bytes(4))) == NONE  # another number


@pytest.mark.parametrize("request_", [COIL, REGISTER])
def test_a_single_write_is_confirmed_by_its_own_bytes_unless_the_line_gives_them_back(request_: bytes) -> None:
    framer = ReplyFramer(DecodePDU(False))
    framer.request = request_
    assert framer.decode(request_)[3] == request_[1:-2]
    assert framer.decode(checked(request_[:4] + b"\x12\x34")) == NONE  # another value
    framer.request = READ
    framer.decode(READ + REPLY)
    framer.request = request_
    assert framer.decode(request_) == NONE  # it is the echo
    assert framer.decode(request_ + request_)[:2] == (16, request_[0])
    refused = checked(bytes([request_[0], request_[1] | 0x80, 4]))
    assert framer.decode(request_ + refused)[3] == refused[1:-2]
    framer.early = request_[:5]  # a part of the echo came too soon
    assert (framer.decode(request_[5:]), framer.decode(request_[5:] + request_)[3]) == (NONE, request_[1:-2])
    framer.early, framer.request = b"", READ
    framer.decode(REPLY)  # the echo is off
    framer.request = request_
    assert framer.decode(request_)[3] == request_[1:-2]


# --- sending and hearing -------------------------------------------------------------------------------


def hearing(*coming: tuple[float, bytes], **settings: Any) -> VirtualLine:
    """A line to which bytes come at given times [s], whatever is asked."""
    client = VirtualLine(lambda _request: [], 9600, 0.5, **settings)
    for at, data in coming:
        client.comes(at, data)
    return client


def test_what_came_unasked_is_thrown_away_and_the_request_is_sent() -> None:
    client = hearing((-1.0, b"old"), (-0.5, b"older"))
    assert client.send(READ) == len(READ)
    assert (client.recv(None), client.replies.request, client.too_soon) == (b"", READ, 0)


@pytest.mark.parametrize(
    ("settings", "bits"),
    [
        ({}, 10),
        ({"parity": "E"}, 11),
        ({"stopbits": 2}, 11),
        ({"parity": "O", "stopbits": 2}, 12),
    ],
)
def test_a_reply_is_heard_from_the_first_moment_on_at_which_the_wire_can_bring_it(
    settings: dict[str, Any], bits: int
) -> None:
    first = earliest_reply(len(READ), 9600, bits)
    assert first > 0
    client = hearing((0.9 * first, b"soon"), (0.99 * first, b"er"), (1.01 * first, REPLY), **settings)
    client.send(READ)
    assert (client.recv(None), client.too_soon) == (REPLY, 6)
    client.send(READ)
    assert client.too_soon == 0


@pytest.mark.parametrize("use", ["send", "recv"])
def test_a_line_that_is_gone_is_closed_and_told_as_a_lost_connection(use: str) -> None:
    closed: list[str] = []
    client = hearing((-1.0, b""))  # it can be read, and gives nothing
    client.close = lambda: closed.append("closed")  # type: ignore[method-assign]
    client.connect = lambda: False  # type: ignore[method-assign]
    with pytest.raises(ConnectionException):
        client.send(READ) if use == "send" else client.recv(None)
    assert closed == ["closed"]
