"""A Modbus link when the other end does not answer, answers late, wrong or by half; and what comes after."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.exciter import SignalGenerator
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.links import TcpLink
from palpate.instrument.contracts.field import PROBE
from palpate.instrument.errors import DeviceError, LinkError
from palpate.procedures.testing.wire import impatient
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.scenes.scene import Scene
from tests.shares import first_of


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
