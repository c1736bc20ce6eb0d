"""A Modbus link when the other end is silent, late or wrong: what is told, and what is done before the next request."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Any

import pytest
from pymodbus.exceptions import ConnectionException, ModbusException, ModbusIOException
from pymodbus.pdu import ExceptionResponse
from pymodbus.pdu.register_message import ReadHoldingRegistersResponse

from palpate.drivers.links import modbus
from palpate.drivers.links.modbus import (
    LARGEST_FRAME,
    LARGEST_REPLY,
    ModbusLink,
    RtuClient,
    TcpClient,
)
from palpate.extend import Bench, ModbusDevice
from palpate.instrument.bench.links import SerialLine, TcpLink
from palpate.instrument.contracts.field import PROBE
from palpate.instrument.errors import DeviceError, LinkError, LinkTimeout
from palpate.procedures.testing.wire import impatient
from palpate.simulators.bench import SimulatedBench
from tests.shares import first_of

Request = Callable[..., Any]
REPLY = ReadHoldingRegistersResponse(registers=[1])


class Tcp(TcpClient):
    """A client without a network, which notes when it is connected and closed."""

    def __init__(self, connects: Callable[[], bool] = lambda: True) -> None:
        super().__init__("192.0.2.1", timeout=1.5)
        self.done: list[str] = []
        self.connects = connects

    def connect(self) -> bool:
        self.done.append("connect")
        return self.connects()

    def close(self) -> None:
        self.done.append("close")


class Line(RtuClient):
    """A serial line that says these pieces, then nothing."""

    def __init__(self, *pieces: bytes | Exception) -> None:
        super().__init__("/dev/ttyUSB0", baudrate=9600, timeout=1.5)
        self.done: list[str] = []
        self.pieces = list(pieces)

    def connect(self) -> bool:
        self.done.append("connect")
        return True

    def close(self) -> None:
        self.done.append("close")

    def recv(self, size: int | None) -> bytes:
        self.done.append("listen")
        piece = self.pieces.pop(0) if self.pieces else b""
        if isinstance(piece, Exception):
            raise piece
        return piece


def fails(error: BaseException) -> Request:
    def request(_client: object) -> Any:
        raise error

    return request


def answers(reply: Any = REPLY) -> Request:
    return lambda _client: reply


# --- settings ------------------------------------------------------------------------------------------


def test_a_link_has_the_settings_of_its_address_and_asks_once() -> None:
    link = ModbusLink.tcp(TcpLink.model_validate({"host": "192.0.2.1", "port": 1502, "timeout": "500 ms"}))
    settings = link.client.comm_params
    assert (link.name, settings.host, settings.port) == ("192.0.2.1:1502", "192.0.2.1", 1502)
    assert (settings.timeout_connect, link.client.retries, link.serial) == (0.5, 0, False)


def test_a_line_has_the_settings_of_its_section_and_asks_once() -> None:
    said = {"port": "/dev/ttyS9", "baudrate": 4800, "parity": "E", "stopbits": 2, "timeout": "500 ms"}
    link = ModbusLink.rtu(SerialLine.model_validate(said))
    settings = link.client.comm_params
    assert (link.name, settings.host, settings.baudrate) == ("/dev/ttyS9", "/dev/ttyS9", 4800)
    assert (settings.parity, settings.stopbits, settings.timeout_connect) == ("E", 2, 0.5)
    assert (link.client.retries, link.serial) == (0, True)


# --- failures ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "kind", "message"),
    [
        (
            ConnectionException("gone"),
            LinkError,
            "rack closed the connection instead of answering; see whether another program holds its only connection, "
            "or whether it has restarted",
        ),
        (
            ModbusIOException("none"),
            LinkTimeout,
            "no valid answer on rack within 1.5 s; nothing came, although rack is connected; check unit in the bench "
            "file, and behind a gateway power and cable of the device",
        ),
        (ModbusException("odd"), LinkError, "rack failed: Modbus Error: odd; check cable and power"),
        (OSError("pulled out"), LinkError, "rack failed: pulled out; check cable and power"),
    ],
)
def test_each_failure_names_device_and_link_and_the_next_request_connects_afresh(
    error: Exception, kind: type[LinkError], message: str
) -> None:
    client = Tcp()
    link = ModbusLink("rack", client)
    with pytest.raises(kind, match=f"^oven: {re.escape(message)}$") as caught:
        link.transact("oven", fails(error))
    assert type(caught.value) is kind
    assert client.done == []
    assert link.transact("oven", answers()) is REPLY
    assert link.transact("oven", answers()) is REPLY
    assert client.done == ["close", "connect"]


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (1, "illegal function"), (2, "illegal address"), (3, "illegal value"), (4, "device failure"),
        (7, "negative acknowledge"), (8, "memory parity error"), (9, "unknown"),
    ],
)  # fmt: skip
def test_an_exception_response_is_told_by_its_name_in_the_standard(code: int, words: str) -> None:
    """Modbus application protocol V1.1b3, chapter 7; it is an answer, so the connection is kept."""
    client = Tcp()
    link = ModbusLink("rack", client)
    with pytest.raises(DeviceError, match=f"^oven: answered exception {code}, {words}$") as caught:
        link.transact("oven", answers(ExceptionResponse(3, code)))
    assert caught.value.code == code
    link.transact("oven", answers())
    assert client.done == []


# --- silence on a line ---------------------------------------------------------------------------------


def test_a_line_is_listened_to_until_it_is_silent_before_it_is_used_again() -> None:
    client = Line(b"late", b"r")
    link = ModbusLink("line", client)
    link.open()
    assert client.done == ["connect"]
    link.distrust()
    link.transact("oven", answers())
    assert (client.done, client.pieces) == (["connect", "close", "connect", "listen", "listen", "listen"], [])


def test_a_line_may_say_as_much_as_a_frame_holds_and_no_more() -> None:
    link = ModbusLink("line", Line(bytes(LARGEST_FRAME)))
    link.distrust()
    link.open()
    link = ModbusLink("line", Line(bytes(LARGEST_FRAME), b"x"))
    link.distrust()
    with pytest.raises(LinkError, match=r"^line: the line does not fall silent; look for a device that babbles$"):
        link.open()


@pytest.mark.parametrize(
    ("link", "says"),
    [
        (ModbusLink("line", Line(ConnectionException("gone"))), r"^line is lost; check the adapter's plug and cable$"),
        (ModbusLink.tcp(TcpLink(host="a..b")), r"^a\.\.b:502 is no address: .*label empty.*; correct it in the bench "),
    ],
)
def test_a_link_that_does_not_open_or_is_lost_while_it_is_listened_to_is_told(link: ModbusLink, says: str) -> None:
    link.distrust()
    with pytest.raises(LinkError, match=says):
        link.open()


# --- frames --------------------------------------------------------------------------------------------

IDENTITY = "2b0e03030000"  # function, interface, category, conformity, no more follows


@pytest.mark.parametrize(
    ("frame", "taken"),
    [
        ("03 04 12345678", True),
        ("03 03 123456", False),  # an odd number of bytes
        ("03 04 1234567890", False),  # goes on
        ("03 06 12345678", False),  # cut short
        ("10 0010 0002", True),
        ("10 0010 0002 00", False),
        ("83 02", True),
        (f"{IDENTITY} 02 00 02 4142 01 01 43", True),
        (f"{IDENTITY} 01 00 02 4142 01 01 43", False),  # counts one object, brings two
        (f"{IDENTITY} 02 00 02 4142 00 01 43", False),  # the same object twice
        (f"{IDENTITY} 01 00 03 4142", False),  # its text is cut short
        ("15 937403000203000e0201ff", False),  # records of a file, for which nobody asks: pymodbus cannot encode them
    ],
)
def test_a_frame_is_taken_where_it_says_what_was_said_and_nothing_else(frame: str, taken: bool) -> None:
    decoder = modbus.StrictDecoder(is_server=False)
    assert (decoder.decode(bytes.fromhex(frame)) is not None) == taken


def test_more_bytes_than_a_reply_can_have_are_refused_whether_somebody_listens_or_not() -> None:
    client = Tcp()
    link = ModbusLink("rack", client)
    for _ in range(2):
        trace = client.transaction.trace_packet
        assert trace(False, bytes(LARGEST_REPLY)) == bytes(LARGEST_REPLY)
        with pytest.raises(ModbusIOException, match=f"more than {LARGEST_REPLY} bytes"):
            trace(False, bytes(LARGEST_REPLY + 1))
        link.tap(lambda _sent, _data: None)


def test_a_device_gets_its_silence_and_its_patience_and_no_other_request_does() -> None:
    waited, patience = list[float](), list[float]()

    class Slow:
        def now_ns(self) -> int:
            return 0

        def wait(self, duration: float) -> None:
            waited.append(duration)

    link = ModbusLink.tcp(TcpLink(host="127.0.0.1", timeout="0.5 s"), Slow())

    def request(client: Any) -> Any:
        patience.append(client.comm_params.timeout_connect)
        patience.append(client.transaction.comm_params.timeout_connect)
        return REPLY

    link.transact("oven", request, gap=0.005, responds=2.0)
    link.transact("oven", request, responds=0.1)  # the link waits longer anyway
    link.transact("oven", request)
    assert (waited, patience) == ([0.005], [2.0, 2.0, 0.5, 0.5, 0.5, 0.5])


# --- on a simulated bench ------------------------------------------------------------------------------


def receive(link: ModbusLink, monkeypatch: pytest.MonkeyPatch, change: Callable[[bytes], bytes]) -> None:
    """Let `change` happen to each reply on its way to the driver."""
    monkeypatch.setattr(
        link.client.transaction, "trace_packet", lambda sending, data: data if sending else change(data)
    )


@pytest.mark.usefixtures("in_threads")
def test_a_serial_port_that_somebody_else_has_open_is_a_link_error_that_says_so(
    bench: Bench, sim: SimulatedBench
) -> None:
    port = sim.description.links["line"].port
    with pytest.raises(LinkError, match=f"serial port {port} is held by another program; end that .fuser {port}"):
        ModbusLink.rtu(sim.description.links["line"]).open()


def test_a_request_that_a_signal_breaks_off_leaves_its_reply_to_nobody(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    positioner = bench.device("positioner")
    client = positioner.link.client
    connect = client.connect

    def interrupted(_size: int | None) -> bytes:
        raise KeyboardInterrupt

    with impatient(positioner.link), ExitStack() as stall:

        def reconnect() -> bool:
            connected: bool = connect()
            stall.close()
            return connected

        stall.enter_context(sim.clock.lock)
        with monkeypatch.context() as patch:
            patch.setattr(client, "recv", interrupted)
            with pytest.raises(KeyboardInterrupt):
                positioner.get("limit_high")
        monkeypatch.setattr(client, "connect", reconnect)
        positioner.link.open()
    assert positioner.get("limit_low") == 0.0


@pytest.mark.parametrize("cut", first_of([9, 10, 12]))
def test_a_reply_that_says_it_is_complete_and_is_not_is_no_reading(
    cut: int, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def truncate(data: bytes) -> bytes:
        return data[:4] + (cut - 6).to_bytes(2) + data[6:cut]

    with impatient(bench.device("signal_generator").link), monkeypatch.context() as broken:
        receive(bench.device("signal_generator").link, broken, truncate)
        for ask in (bench.device("signal_generator").connect, lambda: bench.device("signal_generator").get("probe")):
            with pytest.raises((LinkError, DeviceError)):
                ask()
    assert bench.device("signal_generator").get("probe") == PROBE


def test_a_failure_is_told_by_its_exception_only(
    closed_port: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without a handler of its own a library's warnings go to stderr, beside the one message that belongs there."""
    monkeypatch.setattr(logging.root, "handlers", [])
    link = ModbusLink.tcp(TcpLink(host="127.0.0.1", port=closed_port))
    with pytest.raises(LinkError):
        link.open()
    for name in ("canopen.sdo.client", "can.bus"):
        logging.getLogger(name).error("told by an exception too")
    assert capsys.readouterr().err == ""


def test_threads_take_turns_on_a_link(bench: Bench) -> None:
    """The line carries one request at a time, whoever asks whom."""
    wanted: list[tuple[ModbusDevice, str]] = [
        (bench.device("strain_indicator"), "gage_factor"),
        (bench.device("strain_indicator"), "full_scale"),
        (bench.device("positioner"), "limit_high"),
        (bench.device("positioner"), "speed"),
    ]
    with ThreadPoolExecutor(len(wanted)) as pool:
        answers = list(pool.map(lambda one: {one[0].get(one[1]) for _ in range(25)}, wanted))
    assert answers == [{8.98}, {200.0}, {0.025}, {0.001}]
