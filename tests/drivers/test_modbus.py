"""A Modbus link when the other end does not answer, answers late, wrong or by half; and what comes after."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest
from pymodbus.pdu import ModbusPDU

from palpate.drivers.bench import Bench
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.devices.source import SignalGenerator
from palpate.drivers.links.modbus import LARGEST_FRAME, ModbusLink
from palpate.instrument.bench.links import SerialLine, TcpLink
from palpate.instrument.contracts.contract import PROBE
from palpate.instrument.errors import DeviceError, LinkError, LinkTimeout
from palpate.procedures.testing.wire import Wire, impatient, listen
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.scenes.scene import Scene
from tests.shares import first_of


def receive(link: ModbusLink, monkeypatch: pytest.MonkeyPatch, change: Callable[[bytes], bytes]) -> None:
    """Let `change` happen to each reply on its way to the driver."""
    monkeypatch.setattr(
        link.client.transaction, "trace_packet", lambda sending, data: data if sending else change(data)
    )


def exchange(link: ModbusLink, monkeypatch: pytest.MonkeyPatch, reply: ModbusPDU) -> None:
    """Let every reply be `reply`."""

    def other(sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        reply.dev_id, reply.transaction_id = pdu.dev_id, pdu.transaction_id
        return pdu if sending else reply

    monkeypatch.setattr(link.client.transaction, "trace_pdu", other)


def test_a_closed_port_is_a_link_error_that_names_the_address(closed_port: int) -> None:
    link = ModbusLink.tcp(TcpLink(host="127.0.0.1", port=closed_port))
    with pytest.raises(
        LinkError, match=f"nothing answers at 127.0.0.1:{closed_port}: .*refuses .*correct port in the bench file"
    ):
        link.open()


def test_a_serial_port_that_does_not_exist_is_a_link_error_that_names_it() -> None:
    with pytest.raises(LinkError, match=r"there is no serial port /dev/no-such-port; .*correct port in the bench file"):
        ModbusLink.rtu(SerialLine(port="/dev/no-such-port")).open()


def test_a_serial_port_that_somebody_else_has_open_is_a_link_error_that_says_so(
    bench: Bench, sim: SimulatedBench
) -> None:
    port = sim.description.links["line"].port
    with pytest.raises(LinkError, match=f"serial port {port} is held by another program; end that .fuser {port}"):
        ModbusLink.rtu(sim.description.links["line"]).open()


@pytest.mark.usefixtures("nothing_left_behind")
def test_a_server_that_goes_away_is_a_link_error(scene: Scene) -> None:
    with SimulatedBench(scene) as sim:
        address = sim.description.links["signal_generator"]
        generator = SignalGenerator(ModbusLink.tcp(address), 1, sim.clock)
        generator.link.open()
        generator.connect()
    with pytest.raises(LinkError, match=f"signal generator at {address.host}:{address.port}"):
        generator.get("frequency")
    with pytest.raises(LinkError, match=f"{address.host}:{address.port}"):
        generator.get("frequency")
    generator.link.close()


def test_a_late_reply_of_any_length_is_listened_to_in_pieces(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """A slow line delivers a long reply byte by byte."""
    line = bench.device("positioner").link
    with impatient(line), monkeypatch.context() as patch, pytest.raises(LinkTimeout):
        receive(line, patch, lambda _: b"")
        bench.device("positioner").get("position")
    pieces = [b"\x02"] * (LARGEST_FRAME - 1) + [b""]
    with monkeypatch.context() as patch:
        patch.setattr(line.client, "recv", lambda _size: pieces.pop(0))
        line.open()
    assert pieces == []
    assert bench.device("positioner").get("probe") == PROBE


@pytest.mark.parametrize("signal", [KeyboardInterrupt, SystemExit])
def test_a_request_that_a_signal_breaks_off_leaves_its_reply_to_nobody(
    signal: type[BaseException], bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    positioner = bench.device("positioner")
    client = positioner.link.client
    connect = client.connect

    def interrupted(_size: int | None) -> bytes:
        raise signal

    with impatient(positioner.link), ExitStack() as stall:

        def reconnect() -> bool:
            connected: bool = connect()
            stall.close()
            return connected

        stall.enter_context(sim.clock.lock)
        with monkeypatch.context() as patch:
            patch.setattr(client, "recv", interrupted)
            with pytest.raises(signal):
                positioner.get("limit_high")
        monkeypatch.setattr(client, "connect", reconnect)
        positioner.link.open()
    assert positioner.get("limit_low") == 0.0


def test_noise_on_the_line_is_a_time_out_and_no_reading(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    line = bench.device("strain_indicator").link
    with impatient(line), monkeypatch.context() as noisy:
        receive(line, noisy, lambda data: data[:-3] + bytes([data[-3] ^ 1]) + data[-2:])
        with pytest.raises(LinkTimeout):
            bench.device("strain_indicator").get("probe")
        line.open()
    assert bench.device("strain_indicator").get("probe") == PROBE


@pytest.mark.parametrize("cut", first_of([9, 10, 12]))
def test_a_reply_that_says_it_is_complete_and_is_not_is_no_reading(
    cut: int, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def truncate(data: bytes) -> bytes:
        return data[:4] + (cut - 6).to_bytes(2) + data[6:cut]

    with monkeypatch.context() as broken:
        receive(bench.device("signal_generator").link, broken, truncate)
        for ask in (bench.device("signal_generator").connect, lambda: bench.device("signal_generator").get("probe")):
            with pytest.raises((LinkError, DeviceError)):
                ask()
    assert bench.device("signal_generator").get("probe") == PROBE


def test_fields_that_stand_together_travel_in_one_request(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    wire: Wire = listen(bench.device("signal_generator").link, monkeypatch)
    bench.device("signal_generator").sine(10.0, 1.5, offset=-0.5)
    assert [request[0] for request in wire.requests] == [16]
    bench.device("signal_generator").read()
    assert [request[0] for request in wire.requests] == [16, 3]


def test_devices_on_one_line_are_told_apart_by_their_unit(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    units = []

    def trace(sending: bool, data: bytes) -> bytes:
        if sending:
            units.append(data[0])
        return data

    monkeypatch.setattr(bench.device("strain_indicator").link.client.transaction, "trace_packet", trace)
    assert bench.device("strain_indicator").get("gage_factor") == 8.98
    assert bench.device("positioner").get("speed") == 1e-3
    assert units == [1, 2]


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


def test_a_message_names_the_link_that_failed(in_threads: None, bench: Bench, sim: SimulatedBench) -> None:
    port = re.escape(sim.description.links["line"].port)
    with impatient(bench.device("strain_indicator").link), sim.clock.lock, pytest.raises(LinkTimeout, match=port):
        bench.device("strain_indicator").read()


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
