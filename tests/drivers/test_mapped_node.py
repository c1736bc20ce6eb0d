"""Sensor nodes of makers: whose SYNC they take, what counts mean, and that no sample is lost unseen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.sensor_node import Counts, MappedNode, missing_sync
from palpate.extend import Bench, read_bench, read_scene
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.bench.links import Block
from palpate.instrument.bench.role_maps import NodeSettings
from palpate.instrument.contracts.maps.eds import imported
from palpate.instrument.errors import ConfigError, DeviceError, LinkError, RangeError, UnknownName
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.wire.can_bus import hand_over
from tests.drivers.fake_links import Objects
from tests.memory import growth
from tests.sheets import BASE, I16, TAKEN, U32, pdo, var
from tests.sheets import node as at_node

SYNC, SAMPLES = 0x80, 0x183
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


def node(kind: str = "canopennode-io", **settings: Any) -> tuple[MappedNode, Bus]:
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
    driver, link = node()
    driver.arm(2)
    link.frame(SYNC, b"")
    link.frame(SAMPLES, counts(100, -200, 32767, 32766))
    link.frame(SYNC, b"")
    link.frame(SAMPLES, counts(0, 1, -32767, -32768))
    found = driver.collect(2, 250.0)
    assert (found.node, found.rate, found.time.tolist()) == (3, 250.0, [0.004, 0.008])
    assert found.voltage == pytest.approx(VOLTS * np.array([[100, 0], [-200, 1], [32767, -32767], [32766, -32768]]))
    assert found.saturated.tolist() == [[False, False], [False, False], [True, True], [False, True]]
    assert (driver.ranges, driver.resolution(4)) == ({"fixed": pytest.approx(3.2767)}, pytest.approx(VOLTS))


@pytest.mark.parametrize(
    ("kind", "size", "raw", "strain"), [("baumer-dsrt", 2, -300, -3.0), ("baumer-dsrt-24", 3, -80_000, -800.0)]
)
def test_a_node_tells_its_own_decimals(kind: str, size: int, raw: int, strain: float) -> None:
    driver, link = node(kind, sync_node=9)
    driver.arm(1)
    link.frame(SYNC, b"")
    link.frame(SAMPLES, counts(raw, size=size))
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
    driver, link = node("baumer-dsrt", sync_node=9)
    assert driver.notices() == []
    link.put(status="overflow")
    assert driver.notices() == ["Baumer DSRT 22DJ 3 at bus: status is overflow"]


# --- lost samples --------------------------------------------------------------------------------------

GOOD = [SYNC, SAMPLES, SYNC, SAMPLES, SYNC, SAMPLES]


@pytest.mark.parametrize(
    ("frames", "number"),
    [
        ([SYNC, SAMPLES, SYNC, SYNC, SAMPLES], 2),  # lost on the way
        ([SYNC, SAMPLES, SAMPLES, SYNC, SAMPLES, SYNC, SAMPLES], 1),  # comes twice, or a SYNC was lost
        ([SYNC, SAMPLES, SYNC, SYNC, SAMPLES, SAMPLES], 2),  # comes late
        ([SAMPLES, SYNC, SAMPLES, SYNC, SAMPLES], 1),
        ([SYNC, SAMPLES, SYNC, SAMPLES], 3),
        ([SYNC, SAMPLES, SYNC, 7, SYNC, SAMPLES], 2),  # of seven bytes
        ([], 1),
    ],
)
def test_a_sync_without_one_whole_answer_is_told_by_its_number(frames: list[int], number: int) -> None:
    driver, link = node()
    for each, wrong in ((GOOD, False), (frames, True)):
        driver.arm(3)
        for frame in each:
            link.frame(frame if frame == SYNC else SAMPLES, bytes({SYNC: 0, SAMPLES: 8}.get(frame, frame)))
        if wrong:
            with pytest.raises(LinkError, match=f"samples are missing from number {number} on; the bus lost frames"):
                driver.collect(3, 250.0)
        else:
            driver.collect(3, 250.0)


def test_a_node_that_sends_without_end_fills_no_memory() -> None:
    driver, link = node()
    link.frame(SAMPLES, bytes(8))
    driver.arm(2)
    with growth() as grown:
        for _ in range(2000):
            link.frame(SYNC, b"")
            link.frame(SAMPLES, bytes(8))
    assert grown() < 10_000  # bytes


def test_a_lost_sync_shows_by_the_time_stamps_of_the_others() -> None:
    rng = np.random.default_rng(4)
    stamps = 1e9 + np.arange(2000) / 250 * (1 + 1e-4) + np.abs(rng.normal(0, 1e-3, 2000))  # a PC is late, seldom early
    assert missing_sync(stamps.tolist(), 250.0) is None
    for lost in (slice(700, 701), slice(700, 705)):
        number = missing_sync(np.delete(stamps, lost).tolist(), 250.0)
        assert number == pytest.approx(700, abs=40)


def test_time_stamps_count_where_frames_travel_on_a_wire() -> None:
    driver, link = node()
    for stamped in (False, True):
        link.stamped = stamped  # type: ignore[misc]
        driver.arm(200)
        for number in range(200):
            link.frame(SYNC, b"", (number + (number > 99)) / 250)  # SYNC 100 and its answer were lost
            link.frame(SAMPLES, bytes(8))
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
    driver, _ = node(kind, **section)
    with pytest.raises(ConfigError, match=says):
        ask(driver)


def test_rates_ranges_and_durations_that_it_or_its_bus_has_not_are_refused_and_nothing_is_sent() -> None:
    driver, link = node()
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
        driver.acquire_with([node()[0]], 1.0)
    assert link.done == []


# --- on a bus ------------------------------------------------------------------------------------------

STRAIN = {"kind": "baumer-dsrt", "role": "sensor_node", "volts_per_unit": 1e-2, "sync_node": 3}
DEVICES: dict[str, dict[str, Any]] = {"film_1": STRAIN, "film_2": STRAIN, "clock": {"kind": "canopennode-io"}}


@pytest.fixture(scope="module")
def bench() -> Iterator[tuple[SimulatedBench, Any]]:
    scene = read_scene("thesis_single").with_devices(DEVICES)
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as opened:
        yield sim, opened


def test_nodes_that_send_no_sync_sample_at_that_of_another_and_leave_it_off(bench: tuple[SimulatedBench, Any]) -> None:
    sim, opened = bench
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
    bench: tuple[SimulatedBench, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = bench[1].device("film_1")
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
    bench: tuple[SimulatedBench, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    sim, opened = bench
    one = opened.device("film_1")
    one.set_sample_rate(250.0)
    monkeypatch.setattr(sim.rig, "film_voltages", lambda time_ns, _: np.full((2, len(time_ns)), 1.0))
    before = one.acquire_with([], 0.1)[0].voltage
    one.command("tare")
    assert (before.mean(), one.acquire_with([], 0.1)[0].voltage.mean()) == pytest.approx((1.0, 0.0), abs=0.05)


def test_sync_that_a_killed_program_left_on_is_switched_off(bench: tuple[SimulatedBench, Any]) -> None:
    sim, opened = bench
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
    bench: tuple[SimulatedBench, Any], index: int, subindex: int, content: str, why: str
) -> None:
    one = bench[1].device("film_1")
    with pytest.raises(DeviceError, match=why):
        one.link.download("test", one.link.add_node(one.id), index, subindex, bytes.fromhex(content))
    assert one.differences() == []


def test_a_twin_holds_only_what_it_has_and_what_a_frame_can_carry(bench: tuple[SimulatedBench, Any]) -> None:
    clock = bench[1].device("clock")

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
