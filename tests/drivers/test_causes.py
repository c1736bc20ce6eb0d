"""Each cause for which a link does not open, or brings no valid answer, has its own sentence with its own remedy."""

from __future__ import annotations

import errno
import os
import pty
import socket
import struct
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import pytest
import serial

from palpate.drivers.bench import Bench
from palpate.drivers.links import causes
from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink, read_registers
from palpate.drivers.scan import Search, scan_tcp
from palpate.instrument.bench import links as files
from palpate.instrument.bench.links import SerialLine, TcpLink
from palpate.instrument.config import check
from palpate.instrument.errors import ConfigError, LinkError, LinkTimeout
from palpate.simulators.bench import SimulatedBench
from tests.moody import HEADER, Moody, Said, carried_out, framed, on_line

HELD = {0: 0x4148, 1: 0}
Wrong = Callable[[bytes], bytes]


@contextmanager
def opened(link: Any) -> Iterator[Any]:
    """An open link that a bench file calls rack, with an oven at unit 1."""
    link.section, link.devices = "[link.rack]", {1: "[device.oven]"}
    link.open()
    try:
        yield link
    finally:
        link.close()


# --- what comes on TCP ---------------------------------------------------------------------------------


def reply(request: bytes) -> bytes:
    return framed(request, carried_out(HELD, request[HEADER:]))


def at_unit(request: bytes, unit: int) -> bytes:
    return reply(request)[:6] + bytes([unit]) + reply(request)[HEADER:]


def numbered(request: bytes, number: int) -> bytes:
    return struct.pack(">H", number) + reply(request)[2:]


WRONG: dict[str, tuple[Wrong, str]] = {
    "another unit": (lambda r: at_unit(r, 0), r"a reply of unit 0 came, .*write unit = 0 in \[device.oven\]"),
    "another number": (lambda r: numbered(r, 0), r"number 0 came, \d+ was asked: the gateway gives numbers"),
    "an RTU frame": (
        lambda r: on_line(r[6], carried_out(HELD, r[HEADER:])),
        r'gateway speaks RTU over TCP; write kind = "modbus-rtu" and port = "socket://127.0.0.1:\d+" in \[link.rack\]',
    ),
    "a refused RTU frame": (lambda r: on_line(r[6], bytes([r[HEADER] | 0x80, 2])), "gateway speaks RTU over TCP"),
    "a header too short": (lambda r: r[:4] + b"\0\6" + reply(r)[6:], r"a reply of wrong length came"),
    "another function": (lambda r: framed(r, b"\x14\x01\x00"), r"a reply to function 20 came, 3 was asked"),
    "HTTP": (
        lambda _: b"HTTP/1.0 400 Bad Request\r\n\r\n",
        r"an HTTP server answers \('HTTP/1.0 400 Bad Request'\), no Modbus device; correct port in \[link.rack\]",
    ),
    "SSH": (lambda _: b"SSH-2.0-OpenSSH_9.2\r\n", r"a server of text answers \('SSH-2.0-OpenSSH_9.2'\)"),
    "noise": (lambda _: bytes(range(200, 230)), r"30 bytes came \(c8 c9 .*\) that are no reply"),
    "nothing": (lambda _: b"", r"nothing came, although 127.0.0.1:\d+ is connected; check unit in \[device.oven\]"),
}  # fmt: skip


@pytest.mark.usefixtures("nothing_left_behind")
@pytest.mark.parametrize("wrong", WRONG)
def test_what_came_on_tcp_instead_of_a_reply_is_told_with_what_to_do_about_it(wrong: str) -> None:
    answers, said = WRONG[wrong]
    with Moody(lambda request: Said(answers(request))) as peer:
        address = TcpLink.model_validate({"host": "127.0.0.1", "port": peer.port, "timeout": "0.1 s"})
        with (
            opened(ModbusLink.tcp(address)) as link,
            pytest.raises(LinkTimeout, match=f"^oven: no valid answer .*; .*{said}"),
        ):
            link.transact("oven", read_registers, 0, 2, 1)


@pytest.mark.usefixtures("nothing_left_behind")
def test_a_search_on_tcp_tells_the_cause_once_and_speaks_of_no_baud_rate() -> None:
    for wrong, said in (
        ("an RTU frame", "search it by --line socket://127.0.0.1:"),
        ("HTTP", "an HTTP server answers"),
    ):
        with Moody(lambda request, wrong=wrong: Said(WRONG[wrong][0](request))) as peer:
            search = Search()
            at = TcpLink.model_validate({"host": "127.0.0.1", "port": peer.port, "timeout": "0.05 s"})
            scan_tcp(search, at, [1, 2, 3], [])
        assert len(search.heard) == 1
        assert said in search.heard[0]
        assert not any(word in search.heard[0] for word in ("noise", "baud", "parity"))


# --- hosts ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("failure", "said"),
    [
        (socket.gaierror(socket.EAI_NONAME, "unknown"), r"no host is called .*; correct host in \[link.rack\]"),
        (socket.gaierror(socket.EAI_AGAIN, "later"), r"looked up now, .*IP address as host in \[link.rack\]"),
        (ConnectionRefusedError(errno.ECONNREFUSED, "refused"), r"refuses .*correct port in \[link.rack\]"),
        (TimeoutError("timed out"), r"within 1 s; check power and network cable .*host in \[link.rack\]"),
        (OSError(errno.EHOSTUNREACH, "No route to host"), r"no way leads there \(No route to host\)"),
        (OSError(errno.EINVAL, "Invalid argument"), r"Invalid argument; correct host and port in \[link"),
    ],
)  # fmt: skip
def test_why_no_connection_comes_about_is_told(failure: OSError, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """No network of this machine gives all of these when it is asked for them, so the socket module does."""

    def fails(*_: object, **__: object) -> None:
        raise failure

    for link in (ModbusLink.tcp(TcpLink(host="192.0.2.1")), ModbusLink.rtu(SerialLine(port="socket://192.0.2.1:502"))):
        link.section = "[link.rack]"
        with monkeypatch.context() as patch, pytest.raises(LinkError, match=said):
            patch.setattr(socket, "create_connection", fails)
            link.open()


@pytest.mark.parametrize(
    ("host", "bare"),
    [
        ("http://192.168.1.5", 'write host = "192.168.1.5"'),
        ("modbus+tcp://rack:502/", 'write host = "rack" and port = 502'),
        ("192.168.1.5:502", 'write host = "192.168.1.5" and port = 502'),
        ("[::1]", 'write host = "::1"'),
    ],
)
def test_a_url_for_a_host_is_refused_with_the_host_that_is_meant(host: str, bare: str) -> None:
    with pytest.raises(ConfigError, match=rf"link.rack.*is no host alone; {bare}".replace("[", r"\[")):
        check({"host": host}, TcpLink, "link.rack")


@pytest.mark.parametrize("host", ["192.168.1.5", "rack.lab", "::1", "fe80::1%eth0", "a..b"])
def test_a_host_alone_is_taken_as_it_is(host: str) -> None:
    assert TcpLink(host=host).host == host


# --- serial ports --------------------------------------------------------------------------------------


@pytest.fixture
def port() -> Iterator[str]:
    """A pseudo-terminal."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


def why(port: str) -> str:
    """What is told of a port that does not open."""
    with pytest.raises(LinkError) as caught, opened(ModbusLink.rtu(SerialLine(port=port))):
        pass
    return str(caught.value)


def test_a_port_that_another_program_holds_or_that_is_none_or_is_not_there_is_told_apart(
    port: str, tmp_path: Path
) -> None:
    with serial.Serial(port, exclusive=True):
        assert why(port).startswith(f"serial port {port} is held by another program; end that (fuser {port}")
    (tmp_path / "file").touch()
    assert "is no serial port but a file; correct port in [link.rack]" in why(str(tmp_path / "file"))
    assert "is no serial port but a folder" in why(str(tmp_path))
    assert "/dev/null is a device, but no serial port; correct port in [link.rack]" in why("/dev/null")
    assert f"there is no serial port {tmp_path / 'none'}; " in why(str(tmp_path / "none"))
    assert "x://y is no port; in [link.rack] write a device file" in why("x://y")


def test_a_port_without_rights_names_the_group_that_may_open_it(port: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tests may run as root, whom no port refuses, so the system call does."""

    def refused(path: str, *_: object) -> int:
        raise PermissionError(errno.EACCES, "Permission denied", path)

    Path(port).chmod(0o620)
    owned = Path(port).stat()
    group = causes.grp.getgrgid(owned.st_gid).gr_name if owned.st_gid else ""
    with monkeypatch.context() as patch:
        patch.setattr(causes.os, "open", refused)
        said = causes.no_port(port, "any", "[link.rack]")
    assert said.startswith(f"serial port {port} may not be opened by ")
    assert (f"add yourself to group {group} (sudo usermod -aG {group}" if group else "who alone may") in said


def test_a_line_that_brings_nothing_or_nonsense_is_told_with_the_settings_to_check(port: str) -> None:
    line = SerialLine.model_validate({"port": port, "timeout": "0.05 s"})
    with (
        opened(ModbusLink.rtu(line)) as link,
        pytest.raises(
            LinkTimeout, match=r"nothing came; .*unit in \[device.oven\], and baudrate and parity in \[link.rack\]"
        ),
    ):
        link.transact("oven", read_registers, 0, 1, 1)


# --- CAN -----------------------------------------------------------------------------------------------


@pytest.fixture
def bus(request: pytest.FixtureRequest) -> Iterator[tuple[CanLink, can.BusABC]]:
    """A bus of which nobody answers, and another participant on it."""
    channel = f"causes-{request.node.name}"
    link = CanLink(files.CanBus.model_validate({"interface": "virtual", "channel": channel, "timeout": "0.05 s"}))
    link.devices = {5: "[device.films]"}
    with can.Bus(interface="virtual", channel=channel) as other, opened_bus(link):
        yield link, other


@contextmanager
def opened_bus(link: CanLink) -> Iterator[None]:
    link.section = "[link.can]"
    link.open()
    try:
        yield
    finally:
        link.close()


NOT_TAKEN = can.Message(arbitration_id=0x20, is_error_frame=True, is_extended_id=False)  # CAN_ERR_ACK of Linux
DESTROYED = can.Message(arbitration_id=0x88, is_error_frame=True, is_extended_id=False)
OTHERS = can.Message(arbitration_id=0x707, data=b"\x05", is_extended_id=False)


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        ([], r"nothing is heard on virtual:.*bitrate in \[link.can\], and node in \[device.films\]"),
        ([NOT_TAKEN], r"nobody on the bus acknowledges .* alone on it; .*bitrate in \[link.can\]"),
        ([DESTROYED, OTHERS], r"1 error frames came: the bus has another bit rate .*bitrate in \[link"),
        ([OTHERS], r"other nodes talk on virtual:.*check power of this node, and node in \[device.films\]"),
    ],
)  # fmt: skip
def test_a_node_that_does_not_answer_is_told_with_what_else_is_heard(
    frames: list[can.Message], said: str, bus: tuple[CanLink, can.BusABC]
) -> None:
    link, other = bus
    node = link.add_node(5)
    for frame in frames:
        other.send(frame)
    with pytest.raises(LinkTimeout, match=said):
        link.upload("films", node, 0x1000, 0)


@pytest.mark.parametrize(
    ("failure", "said"),
    [
        (can.CanOperationError("off", errno.ENETDOWN), r"is down; bring it up: sudo ip link set .* bitrate 1000000"),
        (OSError(errno.ENODEV, "No such device"), r"is gone: its adapter was pulled out"),
        (can.CanOperationError("full", errno.ENOBUFS), r"takes no more frames: nobody on the bus acknowledges"),
    ],
)  # fmt: skip
def test_a_bus_that_fails_is_told_by_what_the_system_says(
    failure: Exception, said: str, bus: tuple[CanLink, can.BusABC], monkeypatch: pytest.MonkeyPatch
) -> None:
    link, _ = bus

    def fails(*_: object, **__: object) -> None:
        raise failure

    with monkeypatch.context() as patch, pytest.raises(LinkError, match=said):
        patch.setattr(link.network.bus, "send", fails)
        link.send(0x205, b"")


def test_a_can_interface_that_is_not_there_is_told_with_those_that_are(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The machines of the tests have no CAN, so a folder stands for what Linux tells of network interfaces."""
    for name, kind, flags in (("can7", "280", "0x40080"), ("eth0", "1", "0x1003")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(f"{kind}\n")
        (tmp_path / name / "flags").write_text(f"{flags}\n")
    monkeypatch.setattr(causes, "NETWORK", tmp_path)
    told = {
        number: causes.no_bus("socketcan", channel, 500_000, OSError(number, "no"), "[link.can]")
        for number, channel in ((errno.ENODEV, "can0"), (errno.EAFNOSUPPORT, "can0"), (0, "can7"))
    }
    assert "there is no CAN interface can0; there are can7: correct channel in [link.can]" in told[errno.ENODEV]
    assert "this system's kernel has no CAN; load it (sudo modprobe can_raw)" in told[errno.EAFNOSUPPORT]
    assert told[0] == "CAN bus socketcan:can7 is down; bring it up: sudo ip link set can7 up type can bitrate 500000"


def test_an_adapter_without_its_driver_is_told_with_its_interface() -> None:
    link = CanLink(files.CanBus(interface="kvaser", channel="0"))
    with (
        pytest.raises(
            LinkError, match=r"driver software of kvaser adapters is not installed .*interface in \[link.can\]"
        ),
        opened_bus(link),
    ):
        pass


# --- on a bench ----------------------------------------------------------------------------------------


def test_the_links_of_a_bench_know_the_sections_of_its_file(sim: SimulatedBench) -> None:
    bench = Bench(sim.description, sim.clock, sim.operator)
    for name, link in bench.links.items():
        assert link.section == f"[link.{name}]"
        units = {each.unit: f"[device.{each.name}]" for each in sim.description.devices if each.link == name}
        assert link.devices == units
