"""A sensor node's driver brings every sample home, or says that it did not."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices import sensor_node
from palpate.drivers.devices.sensor_node import PIECE, CanopenSensorNode, Recording, acquire, in_pieces
from palpate.instrument.bench.links import Block
from palpate.instrument.contracts.own import LONGEST_WHOLE
from palpate.instrument.errors import LinkError, RangeError
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire import can_bus
from palpate.testing import CanopenConformance

SATURATED = bytes.fromhex("01 FF 04 00 00 00 00 00")  # code FF01h, voltage bit of the error register


class TestSensorNode(CanopenConformance):
    @staticmethod
    def ends(bench: Bench, sim: SimulatedBench) -> tuple[CanopenSensorNode, SimulatedSensorNode]:
        return bench.device("sensor_node_1"), sim.nodes[0]


def put_on_films(sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch, total: float) -> None:
    """Let the film of channel 2 give `total` V, the other none."""
    volts = np.array([total if film.name == "total" else 0.0 for film in sim.scene.design.films])
    monkeypatch.setattr(sim.rig, "film_voltages", lambda time_ns, _: np.outer(volts, np.ones(len(time_ns))))


def shake(bench: Bench) -> None:
    """A sample under the probe, pressed and shaken at 10 Hz."""
    bench.operator.mount(SAMPLES["2"])
    bench.device("positioner").move(15e-3, speed=5e-3)
    bench.drive()
    bench.device("signal_generator").sine(10.0, 1.0)


def test_twenty_nodes_at_1_kHz_lose_no_sample(scene: Scene, nothing_left_behind: None) -> None:
    with (
        SimulatedBench(replace(scene, nodes=20)) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
    ):
        recordings = acquire(bench.all(CanopenSensorNode), 1.0)
        assert [recording.node for recording in recordings] == list(range(1, 21))
        for recording, node in zip(recordings, bench.all(CanopenSensorNode), strict=True):
            assert recording.voltage.shape == recording.saturated.shape == (4, 1000)
            assert node.get("sample_counter") == 1000
        assert recordings[0].time[[0, -1]].tolist() == [0.001, 1.0]
        assert len({recording.voltage.tobytes() for recording in recordings}) == 20


# --- saturation ----------------------------------------------------------------------------------------


def test_a_saturated_channel_is_flagged_and_reported_once(
    sim: SimulatedBench, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_on_films(sim, monkeypatch, total=-6.0)
    node = bench.device("sensor_node_1")
    recording = node.acquire(0.01)
    assert recording.saturated.tolist() == [[False] * 10, [True] * 10, [False] * 10, [False] * 10]
    assert recording.voltage[1].tolist() == [-5.0] * 10
    assert node.contract.set_bits("saturation", node.get("saturation")) == {"channel_2"}
    assert node.contract.set_bits("error_register", node.get("error_register")) == {"voltage"}
    assert node.emergencies == [SATURATED]
    node.acquire(1.2)  # in two stretches: a heartbeat stands between
    assert node.emergencies == [SATURATED] * 2  # starting clears the error


def test_the_last_count_before_the_rail_is_not_saturated(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        SimulatedBench(replace(scene, effects={"adc": scene.effects["adc"]})) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
    ):
        node = bench.device("sensor_node_1")
        for total, saturated in ((32767 * 5 / 32768, False), (5.0, True), (-5.0, False), (-32769 * 5 / 32768, True)):
            put_on_films(sim, monkeypatch, total)
            assert node.acquire(0.001).saturated[1].tolist() == [saturated], total
        assert len(node.emergencies) == 2


def test_resetting_the_integrators_starts_the_films_from_zero(scene: Scene) -> None:
    with (
        SimulatedBench(
            replace(scene, effects={k: v for k, v in scene.effects.items() if k == "charge_amplifier"})
        ) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
    ):
        bench.operator.mount(SAMPLES["2"])
        bench.device("positioner").move(20e-3, speed=5e-3)
        node = bench.device("sensor_node_1")
        assert node.acquire(0.001).voltage[1, 0] > 0.05  # the step of the preload has not drained yet
        node.reset_integrators()
        assert abs(node.acquire(0.001).voltage[1, 0]) < 1e-3


# --- what is noticed -----------------------------------------------------------------------------------


def test_an_emergency_that_comes_during_a_look_is_told_at_the_next(bench: Bench) -> None:
    node = bench.device("sensor_node_1")

    class Coming(list[bytes]):
        def __getitem__(self, which: Any) -> Any:
            found = super().__getitem__(which)
            if len(self) == 1:
                node.link.network.notify(0x81, bytearray(SATURATED), 0.0)
            return found

    node.emergencies = Coming([SATURATED])
    assert [len(node.notices()) for _look in range(3)] == [1, 1, 0]


# --- the same again ------------------------------------------------------------------------------------


def record(scene: Scene) -> list[Recording]:
    with (
        SimulatedBench(replace(scene, nodes=2)) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
    ):
        shake(bench)
        bench.clock.wait(0.5)
        return acquire(bench.all(CanopenSensorNode), 0.2)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(scene: Scene) -> None:
    first, again, other = (record(scene.with_seed(seed)) for seed in (7, 7, 8))
    for one, same, different in zip(first, again, other, strict=True):
        assert one.voltage.tobytes() == same.voltage.tobytes()
        assert (one.voltage != different.voltage).any(axis=1).tolist() == [True, True, False, False]
    assert first[0].voltage.tobytes() != first[1].voltage.tobytes()


# --- long recordings -----------------------------------------------------------------------------------


RATE, LONG = 100.0, LONGEST_WHOLE + 5.5


def recorded(scene: Scene, whole: bool, monkeypatch: pytest.MonkeyPatch) -> list[Recording]:
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        nodes: Any = [bench.device(f"sensor_node_{number}") for number in (1, 2)]
        nodes[0].set_sample_rate(RATE)
        shake(bench)
        with monkeypatch.context() as patched:
            if whole:
                patched.setattr(sensor_node, "LONGEST_WHOLE", LONG)
            return acquire(nodes, LONG)


def test_a_long_recording_is_what_it_would_be_at_once(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(scene, nodes=2)
    pieces, whole = (recorded(scene, at_once, monkeypatch) for at_once in (False, True))
    for found, expected in zip(pieces, whole, strict=True):
        assert (found.node, found.rate) == (expected.node, expected.rate)
        assert found.time.tolist() == expected.time.tolist()
        assert found.time.size == round(LONG * RATE)
        assert found.voltage.shape == expected.voltage.shape
        # the converter's input is computed in other pieces, so a sample may be rounded to the next step
        assert (found.voltage == expected.voltage).mean() > 0.999
        assert np.abs(found.voltage - expected.voltage).max() < 2 * 5.0 / 32768
        assert found.voltage[1].std() > 0.001
        assert not found.saturated.any()


def test_a_short_recording_is_one_piece(bench: Bench) -> None:
    node: Any = bench.device("sensor_node_1")
    node.set_sample_rate(RATE)
    assert [each[0].time.size for each in in_pieces([node], LONGEST_WHOLE)] == [round(LONGEST_WHOLE * RATE)]


def test_nothing_of_a_piece_is_kept_and_their_times_go_on(bench: Bench) -> None:
    node: Any = bench.device("sensor_node_1")
    node.set_sample_rate(RATE)
    sizes, times = [], []
    for (piece,) in in_pieces([node], LONG):
        sizes.append((piece.time.size, len(node._data), len(node._sizes)))
        times += piece.time.tolist()
    one = round(PIECE * RATE)
    many, rest = divmod(round(LONG * RATE), one)
    assert sizes == [*many * [(one, 0, 0)], (rest, 0, 0)]
    assert times == (np.arange(1, round(LONG * RATE) + 1) / RATE).tolist()


def test_who_stops_in_the_middle_leaves_sync_off(sim: SimulatedBench, bench: Bench) -> None:
    node: Any = bench.device("sensor_node_1")
    node.set_sample_rate(RATE)
    pieces = in_pieces([node], LONG)
    assert [each[0].time.size for each in islice(pieces, 2)] == 2 * [round(PIECE * RATE)]
    assert sim.can.sync_rate == RATE
    pieces.close()  # type: ignore[attr-defined]
    assert sim.can.sync_rate == 0.0
    assert acquire([node], 0.1)[0].time.size == 10


def test_a_sample_that_comes_twice_in_a_later_piece_is_told_by_its_number(
    sim: SimulatedBench, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    node: Any = bench.device("sensor_node_1")
    node.set_sample_rate(RATE)
    carry, twice = can_bus._Virtual.hand_over, round(PIECE * RATE) + 25
    came = 0

    def with_one_twice(bus: Any, block: Any) -> None:
        nonlocal came
        numbers = came + 1 + np.arange(len(block.time_ns))
        came += len(numbers)
        times = np.where(numbers == twice, 2, 1)
        columns = [(cob_id, np.repeat(data, times, axis=0)) for cob_id, data in block.columns]
        carry(bus, Block(np.repeat(block.time_ns, times), columns))

    monkeypatch.setattr(can_bus._Virtual, "hand_over", with_one_twice)
    with pytest.raises(LinkError, match=f"samples are missing from number {twice + 1} on; the bus lost frames"):
        acquire([node], LONG)
    assert sim.can.sync_rate == 0.0


def test_nothing_is_sent_for_a_recording_that_cannot_be(sim: SimulatedBench, bench: Bench) -> None:
    with pytest.raises(RangeError, match="duration nan s is not finite"):
        list(in_pieces([bench.device("sensor_node_1")], float("nan")))
    assert sim.can.sync_rate == 0.0
