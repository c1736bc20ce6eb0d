"""Sensor nodes on the bus: CiA 301 timing on the virtual clock, samples on SYNC, and what acquiring them notices."""

from __future__ import annotations

from collections.abc import Iterator

import can
import pytest

from palpate.drivers.bench import Bench
from palpate.instrument.contracts.own import SYNC_COB_ID, SYNC_PRODUCER
from palpate.instrument.errors import DeviceError, LinkError
from palpate.procedures.testing.wire import frames, payloads
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.can_segment import CanSegment
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.rig import Rig
from palpate.simulators.scenes.scene import Scene

BOOT_UP, PRE_OPERATIONAL, OPERATIONAL, STOPPED = b"\x00", b"\x7f", b"\x05", b"\x04"
HEARTBEAT, EMERGENCY = 0x700, 0x80
SATURATED = bytes.fromhex("01 FF 04 00 00 00 00 00")  # code FF01h, voltage bit of the error register


@pytest.fixture
def listener(sim: SimulatedBench) -> Iterator[can.BusABC]:
    with can.Bus(interface="virtual", channel=sim.description.links["can"].channel) as bus:
        yield bus


def sync(listener: can.BusABC) -> None:
    listener.send(can.Message(arbitration_id=SYNC_COB_ID, is_extended_id=False))


# --- communication by CiA 301 --------------------------------------------------------------------------


def test_a_node_boots_up_when_it_is_switched_on(scene: Scene) -> None:
    clock = VirtualClock()
    rig = Rig(scene, clock)
    segment = CanSegment(clock, rig, "virtual", "boot-up")
    for node_id in (5, 9):
        segment.add(SimulatedSensorNode(clock, node_id, 1, rig))
    with can.Bus(interface="virtual", channel="boot-up") as listener, segment:
        started = frames(listener)
    assert payloads(started, HEARTBEAT + 5) == payloads(started, HEARTBEAT + 9) == [BOOT_UP]


def test_the_heartbeat_follows_its_period_and_tells_the_state(
    sim: SimulatedBench, bench: Bench, listener: can.BusABC
) -> None:
    node = bench.device("sensor_node_1")
    node.set("heartbeat", 0.1)
    node.arm()
    node.get("probe")
    sim.clock.wait(0.35)
    assert payloads(frames(listener), HEARTBEAT + 1) == [OPERATIONAL] * 3
    node.set("heartbeat", 0.0)
    sim.clock.wait(5.0)
    assert payloads(frames(listener), HEARTBEAT + 1) == []


def test_a_refused_heartbeat_period_changes_nothing(sim: SimulatedBench, bench: Bench, listener: can.BusABC) -> None:
    node = bench.device("sensor_node_1")
    with pytest.raises(DeviceError, match="0x06090031"):
        node.link.download(node.name, node.link.add_node(node.id), 0x1017, 0, (60_001).to_bytes(2, "little"))
    sim.clock.wait(1.0)
    assert payloads(frames(listener), HEARTBEAT + 1) == [PRE_OPERATIONAL]


# --- SYNC ----------------------------------------------------------------------------------------------


def test_the_producer_sends_sync_from_one_period_on_until_it_is_told_to_stop(
    sim: SimulatedBench, bench: Bench, listener: can.BusABC
) -> None:
    node = bench.device("sensor_node_1")
    node.set_sample_rate(100.0)
    sim.clock.wait(0.0034)
    node.set("sync_cob_id", SYNC_PRODUCER | SYNC_COB_ID)
    sim.clock.wait(0.0099)
    assert payloads(frames(listener), SYNC_COB_ID) == []
    sim.clock.wait(0.0902)
    assert payloads(frames(listener), SYNC_COB_ID) == [b""] * 10
    node.set("sync_cob_id", SYNC_COB_ID)
    sim.clock.wait(1.0)
    assert payloads(frames(listener), SYNC_COB_ID) == []


def test_a_node_samples_at_the_sync_of_a_master(sim: SimulatedBench, bench: Bench, listener: can.BusABC) -> None:
    node = bench.device("sensor_node_1")
    node.arm()
    for number in (1, 2, 3):
        sim.clock.wait(0.01)
        sync(listener)
        assert node.get("sample_counter") == number
    assert node.collect(3).voltage.shape == (4, 3)


def test_the_sample_counter_goes_on_from_zero_after_its_largest_number(
    sim: SimulatedBench, bench: Bench, listener: can.BusABC
) -> None:
    node = bench.device("sensor_node_1")
    node.arm()
    assert node.get("sample_counter") == 0
    sim.nodes[0].settings["sample_counter"] = 2.0**32 - 3
    node.set("sync_cob_id", SYNC_PRODUCER | SYNC_COB_ID)
    sim.clock.wait(0.005)
    assert node.get("sample_counter") == 2
    stamps = [int.from_bytes(data[:4], "little") for data in payloads(frames(listener), 0x281)]
    assert stamps == [2**32 - 2, 2**32 - 1, 0, 1, 2]
    with pytest.raises(LinkError, match="missing from number 1 on"):
        node.collect(5)
