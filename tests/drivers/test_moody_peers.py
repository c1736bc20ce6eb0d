"""Devices and gateways that say "later", "taken" or "only so", hang up when nobody asks, or stand before several."""

from __future__ import annotations

import os
import select
import socket
import threading
import tomllib
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest

from palpate.drivers.links.modbus import ModbusLink
from palpate.extend import BenchDescription, Contract, Field, ModbusDevice
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
