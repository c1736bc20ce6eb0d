"""A long recording comes in pieces, each checked, and is what a recording at once would be.

Private names are read where only the driver knows what it keeps, and where a frame must be damaged on a bus of blocks.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices import sensor_node
from palpate.drivers.devices.sensor_node import PIECE, Recording, acquire, in_pieces
from palpate.instrument.bench.links import Block
from palpate.instrument.contracts.own import LONGEST_WHOLE
from palpate.instrument.errors import LinkError, RangeError
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire import can_bus
from tests.drivers.test_sensor_node import shake

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
