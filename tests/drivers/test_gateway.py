"""Gateways: several devices behind one TCP address, and a serial line whose bytes come over TCP."""

from __future__ import annotations

import os
import select
import socket
import threading
import tomllib
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import pytest

from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.config import check
from palpate.instrument.errors import ConfigError
from palpate.simulators.bench import SimulatedBench
from tests.drivers.benches import altered, open_bench

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
