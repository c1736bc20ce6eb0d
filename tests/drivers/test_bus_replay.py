"""A log on the wire again: the drivers hear what they heard."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.logs.bus_log import BusLog, PcapngWriter
from palpate.drivers.logs.bus_replay import BusReplay, ReplayWire
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.links import LOOPBACK, MULTICAST
from palpate.instrument.errors import ConfigError, DeviceError, LinkTimeout
from palpate.procedures.logs import described
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from palpate.simulators.scenes.scene import Scene
from tests.conftest import hasty
from tests.drivers.benches import altered


class Ticking:
    """A clock that is never twice the same, as that of the wall."""

    goes_on = False
    stepper = None

    def __init__(self, sim: SimulatedBench) -> None:
        self._clock = sim.clock
        self._looks = 0

    def now_ns(self) -> int:
        self._looks += 1
        return self._clock.now_ns() + 7 * self._looks

    def wait(self, duration: float) -> None:
        self._clock.wait(duration)


def used(bench: Bench) -> list[Any]:
    """What is heard of all devices, over all links; one of them refuses."""
    with bench:
        node = bench.device("sensor_node_1")
        bench.device("signal_generator").sine(12.5, 0.5)
        bench.device("positioner").move(1e-3)
        recording = node.acquire(0.02)
        voltage = recording.voltage.tobytes()
        with pytest.raises(DeviceError) as refused:
            node.link.upload("it", node.link.add_node(node.id), 0x5000, 0)
        heard = [
            voltage,
            bench.device("signal_generator").read(),
            bench.device("strain_indicator").read(),
            bench.device("positioner").position(),
        ]
        return [*heard, str(refused.value), node.notices(), node.serial, bench.clock.now_ns()]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "trace.blf"


def logged(
    sim: SimulatedBench, log: Path, use: Callable[[Bench], Any] = used, description: BenchDescription | None = None
) -> Any:
    clock = Ticking(sim)
    bench = Bench(description or sim.description, clock, sim.operator)
    with BusLog(bench, clock, log, datetime(2026, 1, 2, tzinfo=UTC)) as recording:
        recording.describe(json.dumps({"bench": bench.description.to_toml()}))
        return use(bench)


def replayed(sim: SimulatedBench, log: Path, use: Callable[[Bench], Any] = used) -> Any:
    with BusReplay(log, described) as replay:
        bench = Bench(replay.description, replay, sim.operator)
        replay.attach(bench)
        return use(bench)


def test_the_drivers_hear_what_they_heard_over_tcp_the_line_and_can(sim: SimulatedBench, log: Path) -> None:
    heard = logged(sim, log)
    sim.generator.write({"frequency": 99.0})  # of the bench itself nothing is asked
    assert replayed(sim, log) == heard


def test_over_multicast_too_each_frame_that_was_sent_stands_once_where_it_was_sent(
    nothing_left_behind: None, scene: Scene, log: Path
) -> None:
    with SimulatedBench(scene, BenchAddresses(interface=MULTICAST)) as sim:
        heard = logged(sim, log)
        assert replayed(sim, log) == heard


@pytest.mark.slow
def test_a_request_that_was_not_answered_is_not_answered(sim: SimulatedBench, log: Path) -> None:
    def use(bench: Bench) -> float:
        with bench:
            bench.device("positioner").unit = 9  # nobody's on that line
            with pytest.raises(LinkTimeout):
                bench.device("positioner").position()
            bench.device("positioner").unit = 2
            bench.device("positioner").move(1e-3)
            return bench.device("positioner").position()

    assert logged(sim, log, use, hasty(sim.description)) == replayed(sim, log, use) == 1e-3


@pytest.mark.parametrize("fed_by", ["owner", "any request"])
def test_signs_of_life_to_the_watchdog_may_come_at_other_times_than_in_the_log(
    sim: SimulatedBench, log: Path, fed_by: str
) -> None:
    """On a wall clock a thread gives them, at times that differ from run to run."""
    sim.description = altered(sim.description, device={"shaker_amplifier": {"watchdog_fed_by": fed_by}})

    def use(bench: Bench, *beats: int) -> list[Any]:
        heard: list[Any] = []
        with bench:
            bench.drive()
            for gain, count in enumerate(beats):
                for _ in range(count):
                    bench.device("shaker_amplifier").live()
                bench.device("shaker_amplifier").set(gain=gain)
                bench.clock.wait(1.5)
                heard += [bench.device("shaker_amplifier").read(), bench.clock.now_ns()]
        return heard

    heard = logged(sim, log, lambda bench: use(bench, 0, 3, 1))
    assert replayed(sim, log, lambda bench: use(bench, 2, 0, 5)) == heard


def test_what_the_log_does_not_hold_at_that_place_is_an_error_that_names_it(sim: SimulatedBench, log: Path) -> None:
    logged(sim, log)

    def other(bench: Bench) -> None:
        with bench:
            bench.device("signal_generator").sine(12.6, 0.5)

    asked = "the replay sends 'signal_generator <- write frequency = 12.6 Hz, .*log goes on with .*frequency = 12.5 Hz"
    with pytest.raises(ConfigError, match=asked):
        replayed(sim, log, other)


def test_a_log_in_which_no_run_began_and_one_that_is_cut_short_are_refused(log: Path) -> None:
    path = log.with_suffix(".pcapng")
    with path.open("wb") as file:
        PcapngWriter(file).end()
    with pytest.raises(ConfigError, match="no run began in this log; replay a log that --log recorded of a"):
        BusReplay(path, described)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ConfigError, match=r"damaged: cut short at byte \d+; only a whole log can be"):
        BusReplay(path, described)


# --- the devices' ends of a replay ---------------------------------------------------------------------


PATIENCE = 10.0  # s until a test gives up


@pytest.fixture
def wire() -> Iterator[ReplayWire]:
    with ReplayWire() as open_:
        yield open_


def connected(port: int) -> socket.socket:
    return socket.create_connection((LOOPBACK, port), timeout=PATIENCE)


def read(end: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += end.recv(size - len(data))
    return data


def test_a_client_that_connects_anew_begins_a_request_anew(wire: ReplayWire) -> None:
    port = wire.listen("rack")
    wire.expect("rack", 4, b"reply")
    with connected(port) as end:
        end.sendall(b"12")
        end.shutdown(socket.SHUT_WR)
        assert end.recv(1) == b""  # it has noticed
    with connected(port) as end:
        end.sendall(b"1234")
        assert read(end, 5) == b"reply"
