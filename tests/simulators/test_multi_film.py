"""Designs of many films on the bench: each film on its node and channel, and as many nodes as that takes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.sensor_node import acquire
from palpate.drivers.roles import SensorNode
from palpate.instrument.contracts.own import place
from palpate.instrument.errors import ConfigError
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.plan import Question, driven
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from tests.simulators.rigs import SECOND

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
