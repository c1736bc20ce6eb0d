"""Buses: what a frame takes and whose clock pays for it, and which film is sampled by which node and channel."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.sensor_node import acquire
from palpate.drivers.roles import SensorNode
from palpate.instrument.contracts.own import bus_load, place, stuff_bits
from palpate.instrument.errors import ConfigError, LinkError
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.bounds import bound_of
from palpate.simulators.physics.effect import Bound, Case, Effect
from palpate.simulators.planning.plan import Question, case_of, driven
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from tests.simulators.rigs import SECOND, an_effect

US = 1000  # ns


@contextmanager
def opened(scene: Scene, *effects: tuple[str, Effect], nodes: int = 1) -> Iterator[Bench]:
    """The thesis' bench with these effects only."""
    with (
        SimulatedBench(replace(scene, effects=dict(effects), nodes=nodes)) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
    ):
        yield bench


# --- CAN frames ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("size", "microseconds"), [(0, 55), (5, 105), (8, 135)])
def test_a_frame_takes_its_47_bits_its_data_and_the_most_that_can_be_stuffed(size: int, microseconds: int) -> None:
    assert an_effect("can_timing").frame_ns(size) == microseconds * US
    assert an_effect("can_timing", bitrate="125 kbit/s").frame_ns(size) == 8 * microseconds * US


def test_the_mean_of_stuffed_bits_is_that_of_random_data() -> None:
    bits = np.random.default_rng(1).integers(0, 2, 34 + 64 + 98 * 3000)
    stuffed, run, last = 0, 0, 2
    for bit in bits.tolist():
        run, last = (run + 1, last) if bit == last else (1, bit)
        if run == 5:
            stuffed, run, last = stuffed + 1, 1, 1 - bit
    assert stuff_bits(8, "mean") / 98 == pytest.approx(stuffed / len(bits), rel=0.03)
    assert stuff_bits(8) == 24
    assert an_effect("can_timing", stuffing="mean").frame_ns(8) == round((111 + 98 / 30) * US)


def test_frames_go_out_by_their_identifiers_and_the_last_are_lost() -> None:
    frames = [(0x181, 8), (0x281, 5), (0x182, 8), (0x282, 5)]
    timing = an_effect("can_timing")
    assert timing.burst(frames, 1000 * US) == ([0, 2, 1, 3], 535 * US)
    assert timing.burst(frames, 535 * US) == ([0, 2, 1, 3], 535 * US)
    assert timing.burst(frames, 535 * US - 1) == ([0, 2, 1], 535 * US - 1)
    assert timing.burst(frames, 200 * US) == ([0], 200 * US)
    assert timing.burst([], 1000 * US) == ([], 55 * US)


# --- CAN bus -------------------------------------------------------------------------------------------


def test_a_request_to_a_node_takes_two_frames_of_the_benchs_clock_and_none_without_the_effect(scene: Scene) -> None:
    for effects, took in (((), 0), ((("can_timing", an_effect("can_timing", bitrate="500 kbit/s")),), 2 * 270 * US)):
        with opened(scene, *effects) as bench:
            start = bench.clock.now_ns()
            bench.device("sensor_node_1").get("sample_counter")
            assert bench.clock.now_ns() - start == took
            bench.device("sensor_node_1").set_range(1, "500 mV")
            assert bench.clock.now_ns() - start == 2 * took


def test_a_request_waits_until_the_samples_are_through(scene: Scene) -> None:
    with opened(scene, ("can_timing", an_effect("can_timing")), nodes=2) as bench:
        node = bench.device("sensor_node_1")
        for each in bench.all(SensorNode):
            each.arm()
        node.set("sync_cob_id", 0x4000_0080)
        started = bench.clock.now_ns()
        bench.clock.wait(1e-3)  # to the SYNC: 55 + 2 (135 + 105) us of frames begin
        assert node.get("sample_counter") == 1
        assert bench.clock.now_ns() - started == (1000 + 535 + 270) * US
        node.set("sync_cob_id", 0x80)


def test_five_nodes_at_1_khz_overload_1_mbit_and_the_driver_sees_who_lost_frames(scene: Scene) -> None:
    timing = ("can_timing", an_effect("can_timing"))
    assert bus_load(5, 1000.0, 1e6) > 1 > bus_load(5, 780.0, 1e6)
    with opened(scene, timing, nodes=5) as bench:
        for node in bench.all(SensorNode)[1:]:
            node.arm()
        with pytest.raises(LinkError, match=r"sensor node 3 .* missing from number 1 on; the bus lost frames"):
            acquire(bench.all(SensorNode), 0.02)
        bench.device("sensor_node_1").set_sample_rate(780.0)
        assert {recording.voltage.shape for recording in acquire(bench.all(SensorNode), 0.02)} == {(4, 16)}
    with opened(scene, nodes=5) as bench:
        assert len(acquire(bench.all(SensorNode), 0.02)) == 5


# --- serial line ---------------------------------------------------------------------------------------


def test_a_frame_on_the_line_takes_11_bits_a_character_and_is_followed_by_silence() -> None:
    slow, fast = an_effect("serial_timing", baudrate="9600 bit/s"), an_effect("serial_timing", baudrate="115.2 kbit/s")
    assert slow.frame(8) == pytest.approx((8 + 3.5) * 11 / 9600, rel=1e-12)
    assert fast.frame(8) == pytest.approx(8 * 11 / 115_200 + 1.75e-3, rel=1e-12)


@pytest.mark.parametrize("baudrate", ["9600 bit/s", "115200 bit/s"])
def test_a_transaction_takes_request_and_reply_of_the_benchs_clock(scene: Scene, baudrate: str) -> None:
    timing = an_effect("serial_timing", baudrate=baudrate)
    with opened(scene, ("serial_timing", timing)) as bench:
        assert bench.description.links["line"].baudrate == int(timing.baudrate)
        start = bench.clock.now_ns()
        bench.device("positioner").get("position")  # two registers: 8 bytes out, 9 back
        read = bench.clock.now_ns()
        assert read - start == pytest.approx(1e9 * (timing.frame(8) + timing.frame(9)), abs=2)
        bench.device("positioner").set(speed=1e-3)
        registers = bench.device("positioner").contract["speed"].size // 2
        write = timing.frame(9 + 2 * registers) + timing.frame(8)
        assert bench.clock.now_ns() - read == pytest.approx(1e9 * write, abs=2)
        tcp = bench.clock.now_ns()
        bench.device("signal_generator").get("frequency")
        assert bench.clock.now_ns() == tcp
    with opened(scene) as bench:
        bench.device("positioner").get("position")
        assert bench.clock.now_ns() == 0


# --- bounds --------------------------------------------------------------------------------------------


def test_timing_changes_no_result_unless_samples_are_lost() -> None:
    def case(design: str) -> Case:
        return case_of(get_design(design), "column", {}, Question())

    assert bound_of(case("single"), an_effect("serial_timing")) == Bound(0.0, 0.0)
    assert bound_of(case("array_16"), an_effect("can_timing")) == Bound(0.0, 0.0)
    crowded = replace(case("array_16"), rate=1000.0)
    assert place(17) == (5, 1)
    assert bound_of(crowded, an_effect("can_timing")) == Bound(math.inf, math.inf)


# --- films of several nodes --------------------------------------------------------------------------

STEP = 0.5 / 32768  # V, of the sensitive range


def scene_of(tmp_path: Path, design: str, more: str = "") -> Scene:
    path = tmp_path / f"{design}.toml"
    path.write_text(f'name = "try"\npurpose = "a test"\ndesign = "{design}"\nmodel = "column"\n{more}')
    return read_scene(str(path))


def test_fewer_nodes_than_the_films_need_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nodes: 4 cannot take the 17 films of design 'array_16'; give 5 or more"):
        scene_of(tmp_path, "array_16", "nodes = 4")


@pytest.mark.parametrize("design", ["common_base", "different_base", "array", "array_16"])
def test_every_film_is_recorded_on_its_node_and_channel_and_nothing_elsewhere(design: str, tmp_path: Path) -> None:
    scene = scene_of(tmp_path, design)
    # each film gives its own voltage, so that none can stand for another
    films = tuple(replace(film, sensitivity=1e-3 * (3 + film.channel)) for film in scene.design.films)
    scene = replace(scene, design=replace(scene.design, films=films))
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        for node in bench.all(SensorNode):
            for channel in range(1, 5):
                node.set_range(channel, "500 mV")
        bench.operator.mount(SAMPLES["1"])
        bench.device("positioner").move(20e-3, speed=5e-3)
        recordings = acquire(bench.all(SensorNode), 0.002)
        expected = sim.rig.film_voltages(np.array([sim.clock.now_ns()]))[:, 0]
    seen = np.zeros((len(recordings), 4))
    for number, film in enumerate(films):
        node_number, channel = place(film.channel)
        voltage = recordings[node_number - 1].voltage[channel - 1]
        assert voltage == pytest.approx(np.full(2, expected[number]), abs=STEP)
        assert np.abs(voltage).min() > 3 * STEP
        seen[node_number - 1, channel - 1] = 1
    for recording, used in zip(recordings, seen, strict=True):
        assert not recording.voltage[used == 0].any()
    assert len({round(float(v), 12) for v in expected}) == len(films)


def test_films_that_fit_on_one_node_stand_on_every_node(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "different_base", "nodes = 3")
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        bench.operator.mount(SAMPLES["1"])
        bench.device("positioner").move(20e-3, speed=5e-3)
        first, *others = acquire(bench.all(SensorNode), 0.002)
    assert np.abs(first.voltage).min() > 0
    assert all(other.voltage.tobytes() == first.voltage.tobytes() for other in others)


def test_teeth_that_share_a_load_share_it_alike(tmp_path: Path) -> None:
    for design in ("common_base", "array_16"):
        scene = scene_of(tmp_path, design)
        rig = driven(scene, Question())
        times = SECOND + np.arange(0, SECOND, SECOND // 100)
        volts = rig.film_voltages(times)
        forces = volts / np.array([[film.sensitivity] for film in scene.design.films])
        assert forces[-1] == pytest.approx(rig.cell_force(times), rel=1e-9)
        assert forces[:-1] == pytest.approx(np.tile(forces[0], (len(forces) - 1, 1)), rel=1e-9)
        assert (forces[:-1].sum(axis=0) / forces[-1]).max() < 0.6
