"""Sensor nodes, our own and those of makers, bring every sample home, or say that they did not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.drivers.devices import sensor_node
from palpate.drivers.devices.canopen_device import MOST_EMERGENCIES
from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.sensor_node import (
    LATEST_WAITS,
    PIECE,
    CanopenSensorNode,
    Counts,
    MappedNode,
    Recording,
    acquire,
    in_pieces,
    missing_sync,
)
from palpate.extend import Bench, Scene, read_bench, read_scene
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.bench.links import Block
from palpate.instrument.bench.role_maps import NodeSettings
from palpate.instrument.contracts.maps.eds import imported
from palpate.instrument.contracts.own import LONGEST_WHOLE
from palpate.instrument.errors import ConfigError, DeviceError, LinkError, LinkTimeout, RangeError, UnknownName
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.wire.can_bus import hand_over
from palpate.testing import CanopenConformance
from tests.contracts import BASE, I16, TAKEN, U32, pdo, var
from tests.contracts import node as at_node
from tests.drivers.fake_links import Objects, growth, node

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
        assert (found.time.tolist(), found.time.size) == (expected.time.tolist(), round(LONG * RATE))
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
    pieces = in_pieces([node], LONG)
    came = next(iter(pieces))[0].time.size
    with growth() as grown:
        for (piece,) in pieces:
            assert piece.time.tolist() == (np.arange(came + 1, came + 1 + piece.time.size) / RATE).tolist()
            came += piece.time.size
    assert came == round(LONG * RATE)
    assert grown() < 40_000  # bytes, which the last piece takes: the frames of all would take 79,000 more


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
    twice = round(PIECE * RATE) + 25
    came = 0

    def with_one_twice(bus: Any, block: Any) -> None:
        nonlocal came
        numbers = came + 1 + np.arange(len(block.time_ns))
        came += len(numbers)
        times = np.where(numbers == twice, 2, 1)
        columns = [(cob_id, np.repeat(data, times, axis=0)) for cob_id, data in block.columns]
        hand_over(bus, Block(np.repeat(block.time_ns, times), columns))

    monkeypatch.setattr("palpate.simulators.devices.can_segment.hand_over", with_one_twice)
    with pytest.raises(LinkError, match=f"samples are missing from number {twice + 1} on; the bus lost frames"):
        acquire([node], LONG)
    assert sim.can.sync_rate == 0.0


# --- the driver by itself ------------------------------------------------------------------------------


SYNC, PRODUCES = 0x80, 0x4000_0080


# --- transfers -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("data", [b"\0\0\0", b"\0\0\0\0\0"])
def test_an_object_of_another_size_is_not_used(data: bytes) -> None:
    driver, link, _ = node()
    link.held[0x2001, 0] = data
    with pytest.raises(DeviceError, match=f"sample_counter has {len(data)} bytes instead of 4, so it is not used"):
        driver.get("sample_counter")


def test_a_read_is_tried_again_on_an_attended_bench_and_a_write_is_not() -> None:
    driver, link, _ = node()
    noticed = list[str]()
    driver.read_attempts, driver.noticed = 2, noticed.append
    link.failures = [LinkTimeout("silent")]
    driver.get("heartbeat")
    link.failures = [LinkTimeout("silent")]
    with pytest.raises(LinkTimeout):
        driver.set("heartbeat", 2)
    assert ([done[0] for done in link.done], noticed) == (["upload", "upload", "download"], ["silent; asked again"])


def test_settings_are_compared_and_written_again_as_they_were_written() -> None:
    driver, link, _ = node()
    driver.set("heartbeat", 2)
    driver.set_range(4, "500 mV")
    driver.reset_integrators()
    driver.set("sync_cob_id", PRODUCES)
    link.put(heartbeat=65.0, range_4=0, sync_cob_id=SYNC)  # as after a loss of power
    assert driver.differences() == [
        "sensor node 3 at bus: heartbeat is 65, was set to 2",
        "sensor node 3 at bus: range_4 is 0, was set to 500 mV",
    ]
    driver.restore()
    assert (driver.differences(), link.value("sync_cob_id")) == ([], SYNC)


# --- heartbeats and emergencies ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("seconds", "period", "missed"),
    [(6.0, 2.0, False), (6.1, 2.0, True), (1000.0, 0.0, False)],
)
def test_a_node_is_missed_after_three_heartbeats_if_it_has_any(seconds: float, period: float, missed: bool) -> None:
    driver, link, clock = node(heartbeat=period)
    clock.wait(50.0)
    link.send(0x703, b"\x05")  # it is heard again
    assert driver.notices() == []
    clock.wait(seconds)
    assert driver.notices() == ([f"sensor node 3 at bus: no heartbeat for {seconds:g} s"] if missed else [])


@pytest.mark.parametrize(
    ("data", "anew"), [(b"\x00", True), (b"\x80", True), (b"\x05", False), (b"\x7f", False), (b"", False)]
)
def test_a_boot_up_message_says_that_a_node_has_started_anew(data: bytes, anew: bool) -> None:
    """CiA 301: state 0; the highest bit is of another protocol."""
    driver, link, clock = node(heartbeat=2.0)
    link.send(0x703, data)
    assert driver.differences() == (["sensor node 3 at bus: has started anew"] if anew else [])
    clock.wait(10.0)
    assert (driver.notices() != []) == anew  # a boot-up is no heartbeat
    driver.restore()
    assert driver.differences() == []


def test_emergencies_are_told_once_by_their_codes() -> None:
    driver, link, _ = node(heartbeat=0)
    link.send(0x83, bytes.fromhex("01ff040000000000"))
    assert driver.notices() == ["sensor node 3 at bus: emergency 0xFF01"]
    link.send(0x83, bytes.fromhex("0000000000000000"))
    link.send(0x83, bytes.fromhex("10810000"))
    assert driver.notices() == ["sensor node 3 at bus: emergency 0x0000", "sensor node 3 at bus: emergency 0x8110"]
    assert driver.notices() == []
    assert link.done[0] == ("upload", 3, 0x1001, 0, 1)  # an answer follows what was due


# --- samples -------------------------------------------------------------------------------------------


def samples(link: Any, counter: int, *counts: int, saturated: int = 0) -> None:
    link.send(0x183, b"".join(count.to_bytes(2, "little", signed=True) for count in counts))
    link.send(0x283, counter.to_bytes(4, "little") + bytes([saturated]))


def test_samples_are_volts_of_their_channel_s_range_with_their_time_and_saturation() -> None:
    driver, link, _ = node(range_2="500 mV", sync_period=0.002)
    driver.set_range(3, "500 mV")
    driver.arm(2)
    samples(link, 1, 16384, 16384, -16384, -32768)
    samples(link, 2, 0, 1, 2, 3, saturated=0b1010)
    found = driver.collect(2)
    assert (found.node, found.rate, found.time.tolist()) == (3, 500.0, [0.002, 0.004])
    assert found.voltage[:, 0].tolist() == [2.5, 0.25, -0.25, -5.0]
    assert found.voltage[:, 1] == pytest.approx([0.0, 0.5 / 32768, 1 / 32768, 15 / 32768])
    assert found.saturated.tolist() == [[False, False], [False, True], [False, False], [False, True]]


def block(link: Any, counters: list[int]) -> None:
    counts = np.array([[counter, -counter, 0, 7] for counter in counters], "<i2").view(np.uint8)
    stamps = np.array([[*counter.to_bytes(4, "little"), 0b0100] for counter in counters], np.uint8)
    (take,) = link.whole.values()
    take({0x183: counts, 0x283: stamps})


def test_a_block_of_samples_gives_what_its_frames_give_one_by_one() -> None:
    driver, link, _ = node()
    driver.arm(4)
    for counter in (1, 2, 3, 4):
        samples(link, counter, counter, -counter, 0, 7, saturated=0b0100)
    singly = driver.collect(4)
    driver.arm(4)
    samples(link, 1, 1, -1, 0, 7, saturated=0b0100)
    block(link, [2, 3])
    samples(link, 4, 4, -4, 0, 7, saturated=0b0100)
    found = driver.collect(4)
    assert found.voltage.tolist() == singly.voltage.tolist()
    assert found.saturated.tolist() == singly.saturated.tolist()


@pytest.mark.parametrize(
    ("frames", "number"),
    [
        ([(0x183, 8), (0x283, 5)], 2),  # one sample of two
        ([(0x183, 8), (0x283, 5), (0x183, 8)], 2),
        ([(0x283, 5), (0x183, 8), (0x283, 5)], 1),
        ([(0x183, 8), (0x283, 5), (0x183, 7), (0x283, 5)], 2),
        ([(0x183, 8), (0x283, 6), (0x183, 8), (0x283, 5)], 1),
        ([], 1),
    ],
)
def test_frames_that_are_missing_or_odd_are_told_by_the_sample(frames: list[tuple[int, int]], number: int) -> None:
    driver, link, _ = node()
    driver.arm(2)
    for count, (cob_id, size) in enumerate(frames):
        link.send(cob_id, bytes([1 + count // 2] + (size - 1) * [0]))
    with pytest.raises(LinkError, match=f"samples are missing from number {number} on; the bus lost frames, record ag"):
        driver.collect(2)


@pytest.mark.parametrize("in_blocks", [False, True])
@pytest.mark.parametrize(("counters", "number"), [([1, 3], 2), ([2, 3], 1), ([1, 1, 2], 2), ([0, 1], 1), ([1], 2)])
def test_samples_that_are_missing_or_come_twice_are_told_by_the_first(
    counters: list[int], number: int, in_blocks: bool
) -> None:
    driver, link, _ = node()
    driver.arm(2)
    for each in [counters] if in_blocks else [[counter] for counter in counters]:
        block(link, each)
    with pytest.raises(LinkError, match=f"samples are missing from number {number} on"):
        driver.collect(2)


def test_a_node_with_as_many_emergencies_as_are_kept_records_nothing() -> None:
    driver, link, _ = node()
    driver.arm(1)
    for _ in range(MOST_EMERGENCIES - 1):
        link.send(0x83, bytes(8))
    samples(link, 1, 0, 0, 0, 0)
    assert driver.collect(1).voltage.shape == (4, 1)
    for _ in range(2):
        link.send(0x83, bytes(8))
    assert len(driver.emergencies) == MOST_EMERGENCIES
    with pytest.raises(DeviceError, match=f"has sent {MOST_EMERGENCIES} emergencies; find out why, then open it again"):
        driver.collect(1)


# --- sampling ------------------------------------------------------------------------------------------


def sampling(link: Any, clock: VirtualClock, monkeypatch: pytest.MonkeyPatch, late: float = 0.0) -> list[float]:
    """The node takes a sample a millisecond of waiting, but for `late` s of the first wait; returns the waits."""
    waits, taken, wait = list[float](), [0], clock.wait

    def waited(duration: float) -> None:
        waits.append(duration)
        wait(duration)
        if link.value("sync_cob_id") == PRODUCES:
            for _ in range(round(1000 * (duration - (late if len(waits) == 1 else 0.0)))):
                taken[0] += 1
                samples(link, taken[0], taken[0], 0, 0, 0)
            link.put(sample_counter=taken[0])

    monkeypatch.setattr(clock, "wait", waited)
    return waits


@pytest.mark.parametrize(("late", "waits"), [(0.0, [0.02]), (0.005, [0.02, 0.005])])
def test_a_node_produces_sync_while_it_samples_and_not_a_moment_longer(
    late: float, waits: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    driver, link, clock = node()
    waited = sampling(link, clock, monkeypatch, late)
    recording = driver.acquire(0.02)
    assert recording.voltage[0] * 32768 / 5 == pytest.approx(np.arange(1, 21))
    assert waited == pytest.approx(waits)
    written = [done[2:] for done in link.done if done[0] == "download"]
    assert written == [(0x1005, 0, PRODUCES.to_bytes(4, "little")), (0x1005, 0, SYNC.to_bytes(4, "little"))]
    assert [done[2] for done in link.done if done[0] == "command"] == ["OPERATIONAL", "PRE-OPERATIONAL"]


def test_a_node_that_takes_no_samples_is_given_up_after_some_waits_and_left_at_rest() -> None:
    driver, link, clock = node()
    begun = clock.now_ns()
    with pytest.raises(DeviceError, match="20 of 20 samples were not taken; check SYNC and NMT state"):
        driver.acquire(0.02)
    assert clock.now_ns() - begun == pytest.approx((1 + LATEST_WAITS) * 0.02e9)
    assert link.value("sync_cob_id") == SYNC
    assert link.done[-1] == ("command", 3, "PRE-OPERATIONAL")


@pytest.mark.parametrize("duration", [0.0005, 0.0, -1.0, float("nan"), float("inf")])
def test_less_than_a_sample_is_refused_before_anything_is_sent(duration: float) -> None:
    driver, link, _ = node()
    with pytest.raises(RangeError, match="is not finite and at least one sample at 1000 Hz"):
        driver.acquire(duration)
    with pytest.raises(RangeError, match=r"4294967296 samples are more .*, 4294967295; record at most 4\.29497e\+06"):
        driver.acquire(2.0**32 / 1000)
    assert link.done == []


def test_a_sample_rate_is_what_the_node_holds_of_it_or_refused_before_anything_is_sent() -> None:
    driver, link, _ = node()
    for rate in (0.0, float("nan"), 20_000.0, 0.05):
        with pytest.raises(RangeError):
            driver.set_sample_rate(rate)
    assert link.done == []
    driver.set_sample_rate(3000.0)
    assert (link.value("sync_period"), driver.rate) == (333e-6, 1 / 333e-6)
    driver, link, _ = node(sync_period=0.0)
    assert driver.rate == 0.0
    with pytest.raises(DeviceError, match=r"sync_period \(1006h\) is 0, so it .*; set the sample rate first") as caught:
        driver.acquire(1.0)
    assert (caught.value.device, link.done) == (driver.name, [])


# --- nodes of makers, by their maps ------------------------------------------------------------------

SAMPLES_ID = 0x183
VOLTS = 1e-4
DEFAULTS: dict[str, dict[str, Any]] = {
    "canopennode-io": {"emergency_cob_id": 0x83, "device_name": "CANopenNode"},
    "baumer-dsrt": {"emergency_cob_id": 0x83, "device_name": "DSRT", "vendor": 0x5F, "reading_object": 0x7130},
    "baumer-dsrt-24": {"emergency_cob_id": 0x83, "device_name": "DSRT", "vendor": 0x5F, "reading_object": 0x8130},
}


class Bus(Objects):
    """A link with one node, whose frames can have time stamps."""

    bitrate, stamped = 125_000.0, False

    def frame(self, cob_id: int, data: bytes, at: float = 0.0) -> None:
        self.subscribed[cob_id](cob_id, bytearray(data), at)


def mapped(kind: str = "canopennode-io", **settings: Any) -> tuple[MappedNode, Bus]:
    """A driver of node 3."""
    found = device_kind(kind)
    link: Any = Bus(found.contract, **DEFAULTS[kind])
    link.held[0x1800, 1] = (0x4000_0183).to_bytes(4, "little")
    given = NodeSettings(**({"volts_per_unit": VOLTS} | settings))
    driver = MappedNode.at(DevicePlace(link, 3, given, VirtualClock(), found))
    driver.connect()
    return driver, link


def counts(*values: int, size: int = 2) -> bytes:
    return b"".join(value.to_bytes(size, "little", signed=True) for value in values)


# --- what counts mean ----------------------------------------------------------------------------------


def test_counts_are_volts_by_the_bench_file_and_the_end_of_their_range_is_saturated() -> None:
    driver, link = mapped()
    driver.arm(2)
    link.frame(SYNC, b"")
    link.frame(SAMPLES_ID, counts(100, -200, 32767, 32766))
    link.frame(SYNC, b"")
    link.frame(SAMPLES_ID, counts(0, 1, -32767, -32768))
    found = driver.collect(2, 250.0)
    assert (found.node, found.rate, found.time.tolist()) == (3, 250.0, [0.004, 0.008])
    assert found.voltage == pytest.approx(VOLTS * np.array([[100, 0], [-200, 1], [32767, -32767], [32766, -32768]]))
    assert found.saturated.tolist() == [[False, False], [False, False], [True, True], [False, True]]
    assert (driver.ranges, driver.resolution(4)) == ({"fixed": pytest.approx(3.2767)}, pytest.approx(VOLTS))


@pytest.mark.parametrize(
    ("kind", "size", "raw", "strain"), [("baumer-dsrt", 2, -300, -3.0), ("baumer-dsrt-24", 3, -80_000, -800.0)]
)
def test_a_node_tells_its_own_decimals(kind: str, size: int, raw: int, strain: float) -> None:
    driver, link = mapped(kind, sync_node=9)
    driver.arm(1)
    link.frame(SYNC, b"")
    link.frame(SAMPLES_ID, counts(raw, size=size))
    assert driver.collect(1, 100.0).voltage == pytest.approx(VOLTS * strain)
    assert driver.resolution(1) == pytest.approx(VOLTS / 100)
    link.put(decimals=1)  # as writing 2112h does
    with pytest.raises(DeviceError, match="decimals is 1, was 2 before, so the scale of its readings has changed"):
        driver.differences()


def test_a_raw_value_that_says_so_is_no_reading() -> None:
    contract = device_kind("canopennode-io").contract
    fields = tuple(replace(f, missing=(-32768,)) if f.name == "analog_2" else f for f in contract.fields)
    counted = Counts(replace(contract, fields=fields), ("analog_1", "analog_2"))
    counted.read_scales(lambda _name: {})
    found, _ = counted.decoded({"samples": [(1, counts(-32768, -32768, 0, 0)), (2, counts(1, 2, 3, 4))]})
    assert found == pytest.approx(np.array([[-32768, 1], [np.nan, 2]]), nan_ok=True)


def test_a_status_that_is_not_ok_is_noticed() -> None:
    driver, link = mapped("baumer-dsrt", sync_node=9)
    assert driver.notices() == []
    link.put(status="overflow")
    assert driver.notices() == ["Baumer DSRT 22DJ 3 at bus: status is overflow"]


# --- lost samples --------------------------------------------------------------------------------------

GOOD = [SYNC, SAMPLES_ID, SYNC, SAMPLES_ID, SYNC, SAMPLES_ID]


@pytest.mark.parametrize(
    ("frames", "number"),
    [
        ([SYNC, SAMPLES_ID, SYNC, SYNC, SAMPLES_ID], 2),  # lost on the way
        ([SYNC, SAMPLES_ID, SAMPLES_ID, SYNC, SAMPLES_ID, SYNC, SAMPLES_ID], 1),  # comes twice, or a SYNC was lost
        ([SYNC, SAMPLES_ID, SYNC, SYNC, SAMPLES_ID, SAMPLES_ID], 2),  # comes late
        ([SAMPLES_ID, SYNC, SAMPLES_ID, SYNC, SAMPLES_ID], 1),
        ([SYNC, SAMPLES_ID, SYNC, SAMPLES_ID], 3),
        ([SYNC, SAMPLES_ID, SYNC, 7, SYNC, SAMPLES_ID], 2),  # of seven bytes
        ([], 1),
    ],
)
def test_a_sync_without_one_whole_answer_is_told_by_its_number(frames: list[int], number: int) -> None:
    driver, link = mapped()
    for each, wrong in ((GOOD, False), (frames, True)):
        driver.arm(3)
        for frame in each:
            link.frame(frame if frame == SYNC else SAMPLES_ID, bytes({SYNC: 0, SAMPLES_ID: 8}.get(frame, frame)))
        if wrong:
            with pytest.raises(LinkError, match=f"samples are missing from number {number} on; the bus lost frames"):
                driver.collect(3, 250.0)
        else:
            driver.collect(3, 250.0)


def test_a_node_that_sends_without_end_fills_no_memory() -> None:
    driver, link = mapped()
    link.frame(SAMPLES_ID, bytes(8))
    driver.arm(2)
    with growth() as grown:
        for _ in range(2000):
            link.frame(SYNC, b"")
            link.frame(SAMPLES_ID, bytes(8))
    assert grown() < 10_000  # bytes


def test_a_lost_sync_shows_by_the_time_stamps_of_the_others() -> None:
    rng = np.random.default_rng(4)
    stamps = 1e9 + np.arange(2000) / 250 * (1 + 1e-4) + np.abs(rng.normal(0, 1e-3, 2000))  # a PC is late, seldom early
    assert missing_sync(stamps.tolist(), 250.0) is None
    for lost in (slice(700, 701), slice(700, 705)):
        number = missing_sync(np.delete(stamps, lost).tolist(), 250.0)
        assert number == pytest.approx(700, abs=40)


def test_time_stamps_count_where_frames_travel_on_a_wire() -> None:
    driver, link = mapped()
    for stamped in (False, True):
        link.stamped = stamped  # type: ignore[misc]
        driver.arm(200)
        for number in range(200):
            link.frame(SYNC, b"", (number + (number > 99)) / 250)  # SYNC 100 and its answer were lost
            link.frame(SAMPLES_ID, bytes(8))
        if stamped:
            with pytest.raises(LinkError, match="samples are missing from number"):
                driver.collect(200, 250.0)
        else:
            driver.collect(200, 250.0)


# --- refused by name, before anything moves ------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "section", "ask", "says"),
    [
        (
            "canopennode-io",
            {"volts_per_unit": None},
            lambda node: node.ranges,
            "volts_per_unit in .* reads counts; give",
        ),
        (
            "baumer-dsrt",
            {},
            lambda node: node.set_sample_rate(100.0),
            "cannot send SYNC, and a PC's own .*; write sync",
        ),
        ("baumer-dsrt", {"volts_per_unit": None, "sync_node": 9}, lambda node: node.ranges, "the node reads µε; give"),
    ],
)
def test_what_the_bench_file_must_say_is_asked_for_by_name(
    kind: str, section: dict[str, Any], ask: Callable[[MappedNode], object], says: str
) -> None:
    driver, _ = mapped(kind, **section)
    with pytest.raises(ConfigError, match=says):
        ask(driver)


def test_rates_ranges_and_durations_that_it_or_its_bus_has_not_are_refused_and_nothing_is_sent() -> None:
    driver, link = mapped()
    link.done.clear()
    for rate in (1000.1, 0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(RangeError, match="is not above 0 and up to 1000 Hz"):
            driver.set_sample_rate(rate)
    with pytest.raises(UnknownName, match="range of the CANopenNode I/O"):
        driver.set_range(1, "5 V")
    driver.set_range(1, "fixed")
    with pytest.raises(DeviceError, match="no sample rate is set"):
        driver.acquire_with([], 1.0)
    assert link.done == []
    driver.set_sample_rate(1000.0)
    link.done.clear()
    with pytest.raises(RangeError, match=r"1 nodes at 1000 samples/s fill 1\d\d % of a bus of 125000 bit/s"):
        driver.acquire_with([], 1.0)
    for duration in (0.0, float("nan"), 1e9):
        with pytest.raises(RangeError, match="duration"):
            driver.acquire_with([], duration)
    with pytest.raises(ConfigError, match="is on another bus"):
        driver.acquire_with([mapped()[0]], 1.0)
    assert link.done == []


# --- on a bus ------------------------------------------------------------------------------------------

STRAIN = {"kind": "baumer-dsrt", "role": "sensor_node", "volts_per_unit": 1e-2, "sync_node": 3}
DEVICES: dict[str, dict[str, Any]] = {"film_1": STRAIN, "film_2": STRAIN, "clock": {"kind": "canopennode-io"}}


@pytest.fixture(scope="module")
def films() -> Iterator[tuple[SimulatedBench, Any]]:
    scene = read_scene("thesis_single").with_devices(DEVICES)
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as opened:
        yield sim, opened


def test_nodes_that_send_no_sync_sample_at_that_of_another_and_leave_it_off(films: tuple[SimulatedBench, Any]) -> None:
    sim, opened = films
    one, two = opened.device("film_1"), opened.device("film_2")
    one.set_sample_rate(250.0)
    first, second = one.acquire_with([two], 0.4)
    assert first.voltage.shape == second.voltage.shape == (1, 100)
    assert (first.node, second.node, first.rate) == (1, 2, 250.0)
    assert sim.can.sync_rate == 0.0


def half(block: Block) -> Block:
    """The first half of the SYNCs, with what is sent at them."""
    count = (len(block.time_ns) + 1) // 2
    return Block(block.time_ns[:count], [(cob_id, data[:count]) for cob_id, data in block.columns])


def test_sync_that_does_not_come_or_too_seldom_is_noticed(
    films: tuple[SimulatedBench, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = films[1].device("film_1")
    one.set_sample_rate(250.0)
    segment = "palpate.simulators.devices.can_segment.hand_over"
    with monkeypatch.context() as patched:
        patched.setattr(segment, lambda bus, block: hand_over(bus, Block(block.time_ns, block.columns[1:])))
        with pytest.raises(DeviceError, match="no SYNC came; check that node 3 is there"):
            one.acquire_with([], 0.4)
        patched.setattr(segment, lambda bus, block: hand_over(bus, half(block)))
        with pytest.raises(
            LinkError, match=r"SYNCs came in .* were due; the bus lost frames, or another node sends SYNC"
        ):
            one.acquire_with([], 4.0)
    assert one.acquire_with([], 0.1)[0].voltage.shape == (1, 25)


def test_a_tare_by_text_makes_the_reading_zero(
    films: tuple[SimulatedBench, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    sim, opened = films
    one = opened.device("film_1")
    one.set_sample_rate(250.0)
    monkeypatch.setattr(sim.rig, "film_voltages", lambda time_ns, _: np.full((2, len(time_ns)), 1.0))
    before = one.acquire_with([], 0.1)[0].voltage
    one.command("tare")
    assert (before.mean(), one.acquire_with([], 0.1)[0].voltage.mean()) == pytest.approx((1.0, 0.0), abs=0.05)


def test_sync_that_a_killed_program_left_on_is_switched_off(films: tuple[SimulatedBench, Any]) -> None:
    sim, opened = films
    one = opened.device("film_1")
    one.set_sample_rate(250.0)
    one.sync.on()
    assert sim.can.sync_rate == 250.0
    one.set_sample_rate(100.0)
    assert sim.can.sync_rate == 0.0


@pytest.mark.parametrize(
    ("index", "subindex", "content", "why"),
    [
        (0x1A00, 0, "00", "device state"),  # it is on
        (0x1800, 1, "81 02 00 40", "range"),  # moves while it is on
        (0x1800, 1, "81 01 00 80", "range"),  # bit 30 is cleared
        (0x1A00, 1, "10 01 30 71", "device state"),
    ],
)
def test_a_twin_refuses_to_have_its_process_data_changed_out_of_turn(
    films: tuple[SimulatedBench, Any], index: int, subindex: int, content: str, why: str
) -> None:
    one = films[1].device("film_1")
    with pytest.raises(DeviceError, match=why):
        one.link.download("test", one.link.add_node(one.id), index, subindex, bytes.fromhex(content))
    assert one.differences() == []


def test_a_twin_holds_only_what_it_has_and_what_a_frame_can_carry(films: tuple[SimulatedBench, Any]) -> None:
    clock = films[1].device("clock")

    def write(index: int, subindex: int, value: int, size: int = 4) -> None:
        clock.link.download("test", clock.link.add_node(clock.id), index, subindex, value.to_bytes(size, "little"))

    write(0x1800, 1, 0xC000_0183)
    with pytest.raises(DeviceError, match="device state"):
        write(0x1A00, 1, 0x6401_01_10)  # while objects are counted
    write(0x1A00, 0, 0, 1)
    for entry in (0x6401_01_08, 0x6401_05_10, 0x1008_00_20):  # another size, no such object, a text
        with pytest.raises(DeviceError, match="mapped"):
            write(0x1A00, 1, entry)
    for number in range(1, 6):
        write(0x1A00, number, 0x6401_01_10)
    with pytest.raises(DeviceError, match="length"):
        write(0x1A00, 0, 5, 1)
    assert clock.differences() == ["CANopenNode I/O 3 at " + clock.link.name + ": PDO samples is no longer set up"]
    clock.restore()
    assert clock.differences() == []


# --- PDOs of a maker's data sheet ----------------------------------------------------------------------


SYNC_OBJECTS = var("1005", U32, DefaultValue="0x80") + var("1006", U32) + var("2002", I16, "ro")
ROLE = '\n[role.sensor_node]\nchannels = ["reading"]\nsends_sync = true\n'  # without a role a map has no twin
READING = "0x20020010"
NODE = 2  # in the scene, where the node of the films is the first one


def made(folder: Path, text: str, unit: int | None) -> None:
    """Write the map of a maker's sheet."""
    sheet = folder / "widget.eds"
    sheet.write_text(text + SYNC_OBJECTS)
    text = imported(sheet, ("1005", "1006", "2002=reading"), node=unit) + ROLE
    (folder / "widget.toml").write_text(text)


@contextmanager
def served(folder: Path, text: str, unit: int | None = NODE) -> Iterator[Any]:
    """A device of a maker's sheet on a simulated bench, whose driver has connected."""
    made(folder, text, unit)
    scene = read_scene("ideal").with_devices({"widget": {"map": str(folder / "widget.toml")}})
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        yield bench.device("widget")


def write(device: Any, index: int, subindex: int, value: int, size: int = 4) -> None:
    device.link.download("test", device.link.add_node(device.id), index, subindex, value.to_bytes(size, "little"))


def read(device: Any, index: int, subindex: int) -> int:
    return int.from_bytes(device.link.upload("test", device.link.add_node(device.id), index, subindex), "little")


def test_a_fixed_pdo_is_not_written_and_its_twin_refuses_what_the_node_refuses(tmp_path: Path) -> None:
    fixed = pdo(1, "$NODEID+0x280", READING, access="const", at="1")
    with served(tmp_path, BASE + fixed + pdo(0, "$NODEID+0x200", TAKEN, sends=False)) as widget:
        assert read(widget, 0x1801, 1) & 0x7FF == 0x280 + NODE
        assert [read(widget, 0x1A01, sub) for sub in (0, 1)] == [1, int(READING, 16)]
        for index, subindex, size in ((0x1801, 1, 4), (0x1801, 2, 1), (0x1A01, 0, 1), (0x1A01, 1, 4)):
            with pytest.raises(DeviceError, match="Attempt to write a read only object"):
                write(widget, index, subindex, 1, size)
        assert read(widget, 0x1600, 1) == int(TAKEN, 16)  # the other one was set up
        assert widget.differences() == []


def test_a_cob_id_of_one_node_alone_is_written_there_as_it_is(tmp_path: Path) -> None:
    with served(tmp_path, BASE + pdo(0, "0x2A5", READING, at="1")) as widget:
        assert read(widget, 0x1800, 1) & 0x7FF == 0x2A5
        widget.start()
        widget.stop()


def test_a_simulated_bench_gives_a_device_the_node_id_at_which_it_is_known(tmp_path: Path) -> None:
    with served(tmp_path, at_node("7") + BASE + pdo(0, "0x2A5", READING, at="1"), unit=None) as widget:
        assert (widget.id, read(widget, 0x1800, 1) & 0x7FF) == (7, 0x2A5)


def test_a_bench_with_that_device_at_another_node_id_is_refused_before_anything_is_sent(tmp_path: Path) -> None:
    made(tmp_path, at_node("7") + BASE + pdo(0, "0x2A5", READING, at="1"), None)
    bench = tmp_path / "bench.toml"
    usual = 'volts_per_unit = 0.01\n[link.can]\nkind = "canopen"\ninterface = "virtual"\nchannel = "a"\n'
    bench.write_text(f'name = "b"\n[device.widget]\nmap = "widget.toml"\nlink = "can"\nnode = 5\n{usual}')
    with pytest.raises(ConfigError) as refused:
        read_bench(bench)
    assert (
        "widget on can: PDO sends_1 has the COB-ID 0x2A5 at node id 7, and none that is known at node id 5; give the "
        "device node id 7, or import the maker's file anew"
    ) in str(refused.value)


def test_a_twin_refuses_cob_ids_and_transmissions_that_no_pdo_may_have(tmp_path: Path) -> None:
    with served(tmp_path, BASE + pdo(0, "$NODEID+0x180", READING, at="1")) as widget:
        write(widget, 0x1800, 1, 0xC000_0182)
        refused = [(1, 0x4000_0000 | cob_id, 4) for cob_id in (0x2000_0182, 0x0001_0182, 0x80, 0x0, 0x701)]
        for subindex, value, size in (*refused, (2, 0xF1, 1), (2, 0xFB, 1)):
            with pytest.raises(DeviceError, match="range"):
                write(widget, 0x1800, subindex, value, size)
