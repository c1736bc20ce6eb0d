"""A log on the wire again: the drivers hear what they heard."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.logs.bus_log import BusLog
from palpate.drivers.logs.bus_replay import BusReplay
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.links import MULTICAST
from palpate.instrument.errors import DeviceError, LinkTimeout
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
