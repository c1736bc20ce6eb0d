"""The client's end of a serial line by itself: bytes in, replies and counts out."""

from __future__ import annotations

import os
from typing import Any

import pytest
from pymodbus.exceptions import ConnectionException
from pymodbus.pdu import DecodePDU

from palpate.drivers.links.modbus import LARGEST_REPLY, ReplyFramer, RtuClient
from palpate.instrument.bench.links import earliest_reply
from tests.drivers.virtual_line import checked

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
        assert framer.decode(before + reply)[3] == reply[1:-2]
        assert framer.decode(before + reply[:-1]) == NONE
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
    assert framer.decode(request_[5:]) == NONE
    assert framer.decode(request_[5:] + request_)[3] == request_[1:-2]
    framer.early, framer.request = b"", READ
    framer.decode(REPLY)  # the echo is off
    framer.request = request_
    assert framer.decode(request_)[3] == request_[1:-2]


# --- sending and hearing -------------------------------------------------------------------------------


class Client(RtuClient):
    """A client with a clock of its own, to which bytes come at given times [s]."""

    def __init__(self, *coming: tuple[float, bytes], **settings: Any) -> None:
        super().__init__("/dev/ttyS0", **{"baudrate": 9600, "timeout": 0.5, **settings})
        self.now = 100.0
        self.coming = [(100.0 + at, data) for at, data in coming]
        self.sent: list[bytes] = []
        self.reads = 0

    def _patience(self) -> float:
        return 0.5

    def _now(self) -> float:
        return self.now

    def _ready(self, within: float) -> bool:
        if self.coming and self.coming[0][0] <= self.now + within:
            self.now = max(self.now, self.coming[0][0])
            return True
        self.now += within
        return False

    def _read(self) -> bytes:
        self.reads += 1
        return self.coming.pop(0)[1]

    def _write(self, request: bytes) -> int:
        self.sent.append(request)
        return len(request)


def test_what_came_unasked_is_thrown_away_and_the_request_is_sent() -> None:
    client = Client((-1.0, b"old"), (-0.5, b"older"))
    assert client.send(READ) == len(READ)
    assert (client.sent, client.coming, client.replies.request, client.too_soon) == ([READ], [], READ, 0)


def test_a_device_that_talks_for_ever_does_not_keep_a_request_from_being_sent() -> None:
    client = Client(*[(-1.0, bytes(LARGEST_REPLY // 4))] * 10)
    client.send(READ)
    assert (client.reads, client.sent) == (4, [READ])


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
    client = Client((0.9 * first, b"soon"), (0.99 * first, b"er"), (1.01 * first, REPLY), **settings)
    client.send(READ)
    assert client.recv(None) == REPLY
    assert client.too_soon == 6
    client.send(READ)
    assert client.too_soon == 0


def test_no_more_is_thrown_away_for_one_request_than_the_largest_reply() -> None:
    client = Client()
    client.send(READ)
    client.coming = [(100.0, bytes(LARGEST_REPLY // 4))] * 10
    assert client.recv(None) == bytes(LARGEST_REPLY // 4)
    assert (client.reads, client.too_soon) == (5, LARGEST_REPLY)


def test_a_line_that_is_silent_is_waited_for_as_long_as_its_time_out() -> None:
    client = Client()
    client.send(READ)
    assert client.recv(None) == b""
    assert client.now == pytest.approx(100.0 + earliest_reply(len(READ), 9600, 10) + 0.5)


@pytest.mark.parametrize("use", ["send", "recv"])
def test_a_line_that_is_gone_is_closed_and_told_as_a_lost_connection(use: str) -> None:
    closed: list[str] = []
    client = Client((-1.0, b""))  # it can be read, and gives nothing
    client.close = lambda: closed.append("closed")  # type: ignore[method-assign]
    client.connect = lambda: False  # type: ignore[method-assign]
    with pytest.raises(ConnectionException):
        client.send(READ) if use == "send" else client.recv(None)
    assert closed == ["closed"]


def test_a_line_that_is_not_open_is_a_lost_connection() -> None:
    client = RtuClient("/dev/ttyS0", baudrate=9600)
    for use in (lambda: client.send(READ), lambda: client.recv(None)):
        with pytest.raises(ConnectionException):
            use()
    assert client.retries == 0


class Port:
    """An open serial port on a pipe, which takes some bytes later."""

    timeout = 0.25

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.later = b""

    def fileno(self) -> int:
        return self._descriptor

    def write(self, data: bytes) -> int:
        self.later += data
        return len(data)


@pytest.mark.parametrize("taken", [3, 8])
def test_a_request_that_the_system_takes_in_part_is_sent_to_its_end(
    taken: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    client: Any = RtuClient("/dev/ttyS0", baudrate=9600, timeout=0.25)
    reads, writes = os.pipe()
    try:
        client.socket = port = Port(writes)
        write = os.write
        monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, data[:taken]))
        assert client._write(READ) == len(READ)
        assert os.read(reads, 100) + port.later == READ
        client.socket = Port(reads)
        assert (client._patience(), client._ready(0.0)) == (0.25, False)
        write(writes, REPLY)
        assert client._ready(0.0)
        assert client._read() == REPLY
    finally:
        client.socket = None
        os.close(reads)
        os.close(writes)
