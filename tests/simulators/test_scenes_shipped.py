"""The scenes that come with palpate: each says what it is for, runs, and shows what it is for."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.sensor_node import SampleBlock, SimulatedSensorNode
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.planning.plan import Question, driven
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.waveforms import Waveforms, waveforms
from palpate.simulators.rig import Rig
from palpate.simulators.scenes.scene import Scene

SCENES = (
    "array_16", "everything", "humid_body", "ideal", "long_drift", "noisy_lab", "overdriven", "poor_seating",
    "real_bench", "thesis_common_base", "thesis_different_base", "thesis_single", "unknown_curve",
)  # fmt: skip
PERIOD_NS = 4_000_000  # of the samples
SETTLED = 500  # samples


@functools.cache
def looked_at(name: str) -> Waveforms:
    return waveforms(read_scene(name), Question(), 2)


def sampled(scene: Scene, size: int = 500) -> list[tuple[bytes, bytes]]:
    """Counts and flags of each node in 2 s, taken in blocks of some size."""
    rig = driven(scene, Question())
    nodes = [SimulatedSensorNode(VirtualClock(), number, number, rig) for number in range(1, scene.nodes + 1)]
    times = PERIOD_NS * (SETTLED + np.arange(500))
    taken: list[list[SampleBlock]] = [[] for _ in nodes]
    for block in (times[i : i + size] for i in range(0, 500, size)):
        films = rig.film_voltages(block)
        for node, its in zip(nodes, taken, strict=True):
            its.append(node.sample(block, node.film_channels @ films, PERIOD_NS))
    return [(b"".join(s.counts.tobytes() for s in its), b"".join(s.saturation.tobytes() for s in its)) for its in taken]


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_runs_and_each_of_its_films_gives_a_signal(name: str) -> None:
    scene = read_scene(name)
    seen = sampled(scene)
    assert len(seen) == scene.nodes
    for counts, _flags in seen:
        assert len(counts) == 500 * 4 * 2
        assert np.frombuffer(counts, "<i2").reshape(-1, 4).any()
    waves = looked_at(name)
    for quantity in (waves.coil, waves.force, waves.before, waves.films, waves.samples):
        assert np.isfinite(quantity).all()
    assert (np.ptp(waves.samples, axis=1) > 0).all()


@pytest.mark.parametrize("name", ["everything", "array_16"])
def test_the_samples_of_a_scene_do_not_depend_on_the_blocks_they_are_asked_for_in(name: str) -> None:
    scene = read_scene(name)
    assert sampled(scene, 77) == sampled(scene)


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_written_out_reads_back_as_itself(name: str, tmp_path: Path) -> None:
    scene = read_scene(name)
    path = tmp_path / "again.toml"
    path.write_text(scene.to_toml(), encoding="utf-8")
    assert read_scene(str(path)) == scene


def harmonics(wave: Floats) -> Floats:
    """Amplitudes over the fundamental's of a wave of two periods."""
    lines = np.abs(np.fft.rfft(wave[:-1]))[::2]
    return np.asarray(lines[1:] / lines[1])


def test_ideal_is_a_sine_of_the_load_with_the_force_ratio_of_the_thesis() -> None:
    scene, waves = read_scene("ideal"), looked_at("ideal")
    assert not scene.effects
    assert np.ptp(waves.force) == pytest.approx(3.0, rel=1e-4)
    assert harmonics(waves.force)[1:].max() < 1e-9
    rigid, total = (np.ptp(v) / f.sensitivity for v, f in zip(waves.films, scene.design.films, strict=True))
    assert rigid / total == pytest.approx(scene.design.thesis_force_ratio["2"], rel=1e-9)


def test_everything_calls_for_every_effect_that_does_not_exclude_another() -> None:
    effects = read_scene("everything").effects
    left = set(EFFECTS) - set(effects)
    assert all(set(effects) & set(effect_class(name).excludes) for name in left), left


def test_overdriven_clips_at_the_rail_and_its_force_has_harmonics() -> None:
    waves = looked_at("overdriven")
    rail = getattr(read_scene("overdriven").effects["amplifier_clip"], "rail", 0.0)
    assert np.ptp(waves.coil) == pytest.approx(2 * rail, rel=1e-12)
    assert harmonics(waves.force)[2] > 0.01
    assert np.ptp(waves.force) < 0.96 * 3.0


def test_the_bench_settles_in_humid_body_although_the_leak_grows() -> None:
    clock = VirtualClock()
    rig = Rig(read_scene("humid_body"), clock)
    clock.add(rig)
    rig.set_position(1e-3)
    clock.wait(30.0)
    assert rig.settled_for_ns() == 30 * 10**9
