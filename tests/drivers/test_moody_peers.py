"""Devices and gateways that say "later", "taken" or "only so", hang up when nobody asks, or stand before several."""

from __future__ import annotations

import errno
import os
import pty
import select
import socket
import struct
import threading
import tomllib
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
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
from palpate.extend import BenchDescription, Contract, Field, ModbusDevice
from palpate.instrument.bench import links as files
from palpate.instrument.bench.links import SerialLine, TcpLink
from palpate.instrument.config import check
from palpate.instrument.contracts.declaration import Command, Condition, Manners
from palpate.instrument.errors import ConfigError, DeviceError, IdentityError, LinkError, LinkTimeout
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from tests.benchmarks.faults import MOODS, in_process
from tests.contracts import modbus_contract
from tests.drivers.benches import altered, drive, driving, open_bench
from tests.moody import ACKNOWLEDGED, BUSY, HEADER, WRITES, Moody, Said, carried_out, framed, on_line, refusal

pytestmark = pytest.mark.usefixtures("nothing_left_behind")

LOAD, COUNT, SETTING, ORDER, STATE = 10, 12, 20, 21, 30  # registers
FIELDS = (
    Field("load", LOAD, "float32", "load", "N"),
    Field("count", COUNT, "uint32", "count"),
    Field("setting", SETTING, "uint16", "setting", access="rw"),
    Field("order", ORDER, "uint16", "order", access="wo"),
    Field("state", STATE, "uint16", "state"),
)
GO, DROP = Command("go", "order", 3, done=Condition("state", (1,)), seconds=2.0), Command("drop", "order", 4)
HELD = {LOAD: 0x4148, LOAD + 1: 0, COUNT + 1: 7, SETTING: 5, STATE: 1}  # 12.5 N
LIMIT = 0.5  # s for which it may be busy
Answers = Callable[[bytes], Said]


def contract(*commands: Command, **manners: Any) -> Contract:
    return modbus_contract(
        *FIELDS, known_by="nothing", commands=commands, manners=Manners(**({"busy": LIMIT} | manners))
    )


class Held:
    """What a plain device holds, and what it answers."""

    def __init__(self) -> None:
        self.registers = dict(HELD)

    def __call__(self, request: bytes) -> Said:
        return Said(framed(request, carried_out(self.registers, request[HEADER:])))


@contextmanager
def asked(answers: Answers, its: Contract | None = None, *, timeout: str = "5 s") -> Iterator[tuple[Any, Moody, Any]]:
    """The driver of a device on TCP that answers so, the device, and the clock, which moves by waits alone."""
    clock = VirtualClock()
    with Moody(answers) as peer:
        link = ModbusLink.tcp(
            TcpLink.model_validate({"host": "127.0.0.1", "port": peer.port, "timeout": timeout}), clock
        )
        link.open()
        try:
            yield _driver(link, clock, its or contract()), peer, clock
        finally:
            link.close()


def _driver(link: ModbusLink, clock: VirtualClock, its: Contract) -> Any:
    """A driver that asks again and notes incidents, as on a bench that records them."""
    driver: Any = ModbusDevice(link, 1, clock, its)
    driver.incidents = []
    driver.read_attempts, driver.noticed = 2, driver.incidents.append
    return driver


# --- busy ----------------------------------------------------------------------------------------------


def busy(times: int, held: Held) -> Answers:
    """A device that answers each request so many times that it is busy, before it carries it out."""
    left = {"": times}

    def answers(request: bytes) -> Said:
        left[""] -= 1
        if left[""] >= 0:
            return Said(refusal(request, BUSY))
        left[""] = times
        return held(request)

    return answers


def test_a_busy_device_is_asked_again_for_a_reading_and_told_again_until_it_takes_it() -> None:
    held = Held()
    with asked(busy(4, held)) as (driver, peer, clock):
        assert driver.get("load") == 12.5
        driver.set(setting=9)
        assert (held.registers[SETTING], len(peer.writes)) == (9, 5)
        assert (clock.now_ns(), driver.incidents) == (2 * (10 + 20 + 40 + 80) * 1_000_000, [])


@pytest.mark.parametrize("use", [lambda driver: driver.get("load"), lambda driver: driver.set(setting=9)])
def test_a_device_that_is_busy_for_too_long_is_told_with_the_limit_and_where_it_is_set(use: Any) -> None:
    with asked(busy(10**6, Held())) as (driver, _, clock):
        driver.read_attempts = 1
        with pytest.raises(DeviceError, match=r"exception 6, .*, for 0\.5 s.* raise busy in \[manners\]") as caught:
            use(driver)
        assert (caught.value.code, clock.now_ns()) == (BUSY, pytest.approx(1e9 * LIMIT))


def test_a_device_that_may_never_be_busy_is_asked_once() -> None:
    with asked(busy(1, Held()), contract(busy=0.0)) as (driver, peer, clock):
        with pytest.raises(DeviceError, match="device busy"):
            driver.set(setting=9)
        assert (len(peer.writes), clock.now_ns()) == (1, 0)
    with pytest.raises(ConfigError, match=r"busy = 61 is outside 0 to 60"):
        Manners(busy=61.0)


def test_what_must_be_done_meanwhile_is_done_after_each_wait_for_a_busy_device() -> None:
    with asked(busy(3, Held())) as (driver, _, clock):
        done = list[int]()
        driver.afterwards = lambda: done.append(clock.now_ns() // 1_000_000)
        driver.get("load")
        assert done == [10, 30, 70, 70]


# --- acknowledged --------------------------------------------------------------------------------------


def acknowledges(held: Held, looks: int = 0) -> Answers:
    """A device that acknowledges writes, and carries them out after so many reads."""
    due = list[bytes]()
    left = {"": 0}

    def answers(request: bytes) -> Said:
        pdu = request[HEADER:]
        if pdu[0] in WRITES:
            due.append(pdu)
            left[""] = looks
        elif due:
            left[""] -= 1
        while due and left[""] <= 0:
            carried_out(held.registers, due.pop())
        return Said(refusal(request, ACKNOWLEDGED)) if pdu[0] in WRITES else held(request)

    return answers


@pytest.mark.parametrize("looks", [0, 3])
@pytest.mark.parametrize("attempts", [1, 2])
def test_a_setting_that_is_acknowledged_is_read_back_until_it_is_there(looks: int, attempts: int) -> None:
    held = Held()
    with asked(acknowledges(held, looks)) as (driver, peer, _):
        driver.read_attempts = attempts
        driver.set(setting=9)
        assert held.registers[SETTING] == 9
        assert driver.differences() == driver.incidents == []
        assert len(peer.writes) == 1


def test_a_setting_that_is_acknowledged_and_never_there_is_told_and_not_written_again() -> None:
    with asked(acknowledges(Held(), 10**6)) as (driver, peer, _):
        with pytest.raises(DeviceError, match=r"acknowledged setting = 9 .*, but setting is 5 after 0\.5 s"):
            driver.set(setting=9)
        assert len(peer.writes) == 1


def test_an_order_that_is_acknowledged_is_given_once_and_its_end_awaited() -> None:
    held = Held()
    with asked(acknowledges(held), contract(GO)) as (driver, peer, _):
        driver.command("go")
        assert (held.registers[ORDER], len(peer.writes), driver.incidents) == (3, 1, [])
        held.registers[STATE] = 0
        with pytest.raises(DeviceError, match=r"'go' was not done within 2 s: state reads 0, should read 1"):
            driver.command("go")
        assert len(peer.writes) == 2


def test_an_acknowledged_order_whose_end_nothing_tells_is_taken_and_noted() -> None:
    with asked(acknowledges(Held()), contract(DROP)) as (driver, peer, _):
        driver.command("drop")
        assert [text.partition(": ")[2] for text in driver.incidents] == [
            "acknowledged order = 4 (-inf to inf): it is taken, its end is not known"
        ]
        assert len(peer.writes) == 1


# --- gateways ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "kind", "said"),
    [
        (10, LinkError, r"no path to unit 1 \(exception 10\), so nothing was carried out; .*correct unit"),
        (11, LinkTimeout, r"no answer from unit 1 \(exception 11\); a write may have been carried out; .*unit"),
    ],
)  # fmt: skip
def test_a_gateway_that_does_not_reach_its_device_says_which_and_the_connection_stays(
    code: int, kind: type[LinkError], said: str
) -> None:
    with asked(lambda request: Said(refusal(request, code))) as (driver, peer, _):
        for use in (lambda: driver.get("load"), lambda: driver.set(setting=9)):
            with pytest.raises(kind, match=said) as caught:
                use()
            assert type(caught.value) is kind
            assert caught.value.code == code
        assert (len(peer.writes), peer.connections) == (1, 1)


def test_a_write_that_a_gateway_got_no_answer_to_is_read_back() -> None:
    held = Held()

    def answers(request: bytes) -> Said:
        reply = held(request)
        return Said(refusal(request, 11)) if request[HEADER] in WRITES else reply

    with asked(answers) as (driver, peer, _):
        driver.set(setting=9)
        assert len(peer.writes) == len(driver.incidents) == 1
        assert driver.incidents[0].endswith("read back, it was carried out")


# --- another firmware ------------------------------------------------------------------------------------


@pytest.mark.parametrize("silent", [False, True])
def test_a_device_without_an_identity_that_answers_reads_is_told_as_another_firmware(silent: bool) -> None:
    """A missing answer may be a lost one, so it stops no run for good; a refusal is an answer."""
    held = Held()

    def answers(request: bytes) -> Said:
        if request[HEADER] != 0x2B:
            return held(request)
        return Said(b"" if silent else refusal(request, 1))

    its = modbus_contract(*FIELDS)
    with asked(answers, its, timeout="0.05 s") as (driver, _, _clock):
        kind = LinkTimeout if silent else IdentityError
        with pytest.raises(kind, match=r"function 43/14.*another device or firmware; check its address"):
            driver.identify()


# --- connections that end ------------------------------------------------------------------------------


def test_a_connection_that_was_closed_meanwhile_is_opened_anew_and_the_request_sent_once() -> None:
    held = Held()
    with asked(lambda request: Said(held(request).frame, ends=True)) as (driver, peer, _):
        for number in range(1, 4):
            driver.set(setting=number)
            assert held.registers[SETTING] == number == driver.get("setting")
        assert (len(peer.writes), len(peer.frames), peer.connections) == (3, 6, 6)
        assert driver.incidents == []


def test_a_request_is_sent_over_a_new_connection_where_bytes_came_that_nobody_asked_for() -> None:
    """The second reply belongs to nobody: neither to the request before it nor to the one after it."""
    held = Held()
    twice = iter([True])

    def answers(request: bytes) -> Said:
        reply = held(request).frame
        return Said(reply + reply if next(twice, False) else reply)

    with asked(answers) as (driver, _, _clock):
        assert [driver.get("load"), driver.get("count"), driver.get("setting")] == [12.5, 7.0, 5.0]
        assert driver.incidents == []


def test_a_connection_that_ends_instead_of_an_answer_has_a_read_asked_again_and_no_write() -> None:
    held = Held()
    ends = iter([True, False, True])

    def answers(request: bytes) -> Said:
        reply = held(request)
        return Said(b"", ends=True) if next(ends, False) else reply

    with asked(answers) as (driver, peer, _):
        assert driver.get("load") == 12.5
        assert [text.partition("; ")[2] for text in driver.incidents] == [
            "see whether another program holds its only connection, or whether it has restarted; asked again"
        ]
        with pytest.raises(LinkError, match=r"closed the connection instead of answering"):
            driver.set(order=1)
        assert len(peer.writes) == 1


def test_at_the_end_of_a_bench_its_outputs_go_off_though_a_device_is_away_for_a_moment(sim: SimulatedBench) -> None:
    with open_bench(sim) as bench:
        drive(bench)
        for name in ("signal_generator", "shaker_amplifier"):
            sim.injection.give_by_hand({"kind": "connection_refused", "on": name, "at": "0 s", "lasts": "1 s"})
    assert not driving(sim)


@pytest.mark.slow
def test_a_sweep_among_devices_of_every_mood_has_no_incident_gives_no_order_twice_and_ends_off() -> None:
    found = in_process(1, MOODS)
    assert all(found["done"][mood] for mood in MOODS)
    assert {key: found[key] for key in ("error", "incidents", "twice", "left")} == {
        "error": "", "incidents": [], "twice": 0, "left": 0.0,
    }  # fmt: skip


# --- whole blocks --------------------------------------------------------------------------------------


def only(held: dict[int, int], *blocks: tuple[int, int], code: int = 2) -> Answers:
    """A device on a line that gives its own blocks alone."""

    def answers(request: bytes) -> Said:
        pdu = request[1:-2]
        asked_for = int.from_bytes(pdu[1:3]), int.from_bytes(pdu[3:5])
        if pdu[0] in (3, 4) and asked_for not in blocks:
            return Said(on_line(request[0], bytes([pdu[0] | 0x80, code])))
        return Said(on_line(request[0], carried_out(held, pdu)))

    return answers


@pytest.mark.parametrize("code", [2, 3])
def test_a_device_that_gives_whole_blocks_only_is_asked_for_them_after_one_refusal(code: int) -> None:
    clock = VirtualClock()
    with Moody(only(HELD, (LOAD, 2), (COUNT, 2), (SETTING, 1), code=code), rtu=True) as peer:
        link = ModbusLink.rtu(SerialLine.model_validate({"port": f"socket://127.0.0.1:{peer.port}"}), clock)
        link.open()
        driver = _driver(link, clock, contract())
        assert [driver.get("load") for _ in range(4)] == [12.5] * 4
        assert [driver.get_many("load", "count") for _ in range(2)] == [[12.5, 7.0]] * 2
        assert driver.get_many("count", "load") == [7.0, 12.5]
        counts = [int.from_bytes(pdu[3:5]) for pdu in peer.pdus]
        assert counts == [2, 4, 2, 2, 2, *(4, 2, 2), *(2, 2), *(4, 2, 2)]
        with pytest.raises(DeviceError, match=f"exception {code}, .* to a read of state"):
            driver.get("state")
        link.close()
        assert driver.incidents == [text for text in driver.incidents if "state" in text]


# --- gateways ------------------------------------------------------------------------------------------


HEAD = 6  # bytes of a Modbus TCP frame before the unit id


@contextmanager
def served(attend: Callable[[socket.socket], None]) -> Iterator[int]:
    """A TCP port whose one client `attend` serves; a second one at the same time is turned away."""
    turn = threading.Lock()
    clients: list[threading.Thread] = []

    def one(client: socket.socket) -> None:
        with turn, client:
            attend(client)

    def listen() -> None:
        while True:
            try:
                client, _ = listening.accept()
            except OSError:  # the test is over
                return
            if turn.locked():
                client.close()
                continue
            clients.append(threading.Thread(target=one, args=(client,)))
            clients[-1].start()

    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = threading.Thread(target=listen)
        thread.start()
        yield listening.getsockname()[1]
        listening.shutdown(socket.SHUT_RDWR)
    for each in (thread, *clients):
        each.join()


def frames(end: socket.socket) -> Iterator[bytes]:
    data = b""
    while more := end.recv(4096):
        data += more
        while len(data) >= HEAD and len(data) >= (size := HEAD + int.from_bytes(data[4:HEAD], "big")):
            yield data[:size]
            data = data[size:]


def behind(*ports: int) -> Callable[[socket.socket], None]:
    """A gateway to devices at these ports, whose unit ids are 1, 2, ... behind it."""

    def attend(client: socket.socket) -> None:
        with ExitStack() as stack:
            ends = [stack.enter_context(socket.create_connection(("127.0.0.1", port))) for port in ports]
            answers = [frames(end) for end in ends]
            for frame in frames(client):
                unit = frame[HEAD]
                ends[unit - 1].sendall(frame[:HEAD] + b"\x01" + frame[HEAD + 1 :])
                answer = next(answers[unit - 1])
                client.sendall(answer[:HEAD] + bytes([unit]) + answer[HEAD + 1 :])

    return attend


def through(path: str) -> Callable[[socket.socket], None]:
    """A device server that passes the bytes of a serial line through."""

    def attend(client: socket.socket) -> None:
        line = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(line)
        try:
            while True:
                ready, _, _ = select.select([client, line], [], [])
                if line in ready:
                    client.sendall(os.read(line, 4096))
                if client in ready:
                    if not (data := client.recv(4096)):
                        return
                    os.write(line, data)
        finally:
            os.close(line)

    return attend


def test_devices_behind_a_gateway_that_takes_one_client_are_driven(sim: SimulatedBench) -> None:
    ports = [sim.description.links[name].port for name in ("signal_generator", "shaker_amplifier")]
    with served(behind(*ports)) as port:
        tables = tomllib.loads(sim.description.to_toml())
        del tables["link"]["shaker_amplifier"]
        tables["link"]["signal_generator"]["port"] = port
        tables["device"]["shaker_amplifier"] |= {"link": "signal_generator", "unit": 2}
        with open_bench(sim, check(tables, BenchDescription, "bench.toml")) as bench:
            bench.drive()
            bench.device("signal_generator").sine(10.0, 1.0)
            assert (sim.generator.settings["amplitude"], sim.amplifier.settings["enable"]) == (1.0, 1.0)
    assert not sim.amplifier.settings["enable"]


def test_two_links_to_one_address_are_refused_before_anything_is_opened(sim: SimulatedBench) -> None:
    port = sim.description.links["signal_generator"].port
    twice = altered(sim.description, link={"shaker_amplifier": {"host": "localhost", "port": port}})
    asked = sim.servers.transactions
    with pytest.raises(ConfigError, match=rf"signal_generator both lead to TCP port {port} of 127\.0\.0\.1; write one"):
        open_bench(sim, twice).__enter__()
    line = altered(sim.description, link={"line": {"port": f"socket://127.0.0.1:{port}"}})
    with pytest.raises(ConfigError, match=f"line and link.signal_generator both lead to TCP port {port} of"):
        open_bench(sim, line).__enter__()
    assert sim.servers.transactions == asked


@pytest.mark.parametrize("unit", [0, 255])
def test_a_device_answers_at_the_unit_that_means_the_address_itself(sim: SimulatedBench, unit: int) -> None:
    itself = altered(sim.description, device={"signal_generator": {"unit": unit}, "shaker_amplifier": {"unit": unit}})
    with open_bench(sim, itself) as bench:
        bench.drive()
        bench.device("signal_generator").sine(10.0, 1.0)
        assert (sim.generator.settings["amplitude"], sim.amplifier.settings["enable"]) == (1.0, 1.0)


def test_a_line_whose_bytes_come_over_tcp_is_a_line(sim: SimulatedBench) -> None:
    with served(through(sim.line)) as port:
        over_tcp = altered(sim.description, link={"line": {"port": f"socket://127.0.0.1:{port}"}})
        with open_bench(sim, over_tcp) as bench:
            bench.device("positioner").move(1e-3)
            assert bench.device("positioner").position() == pytest.approx(1e-3)
            assert bench.device("strain_indicator").serial


# --- causes ------------------------------------------------------------------------------------------

HOLDS = {0: 0x4148, 1: 0}
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
    return framed(request, carried_out(HOLDS, request[HEADER:]))


def at_unit(request: bytes, unit: int) -> bytes:
    return reply(request)[:6] + bytes([unit]) + reply(request)[HEADER:]


def numbered(request: bytes, number: int) -> bytes:
    return struct.pack(">H", number) + reply(request)[2:]


WRONG: dict[str, tuple[Wrong, str]] = {
    "another unit": (lambda r: at_unit(r, 0), r"a reply of unit 0 came, .*write unit = 0 in \[device.oven\]"),
    "another number": (lambda r: numbered(r, 0), r"number 0 came, \d+ was asked: the gateway gives numbers"),
    "an RTU frame": (
        lambda r: on_line(r[6], carried_out(HOLDS, r[HEADER:])),
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
def test_a_url_for_a_host_is_refused_with_the_host_that_is_meant_and_a_host_taken_as_it_is(
    host: str, bare: str
) -> None:
    for taken in ("192.168.1.5", "rack.lab", "::1", "fe80::1%eth0", "a..b"):
        assert TcpLink(host=taken).host == taken
    with pytest.raises(ConfigError, match=rf"link.rack.*is no host alone; {bare}".replace("[", r"\[")):
        check({"host": host}, TcpLink, "link.rack")


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
