"""A load sweep on a bench whose stack is shaken by a drive that follows set-points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.procedures.measurements.loads.result import SweepResult
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.scenes.scene import Scene
from tests.procedures.conftest import IDEAL_CALIBRATION, IDEAL_SCENE, scene_of, sweep

SMALL: dict[str, Any] = {"samples": ("1",), "loads": (2.0,), "dwell": 0.5, "calibration": IDEAL_CALIBRATION}
DRIVE: dict[str, dict[str, Any]] = {"drive": {"kind": "maxon-epos4", "full_scale": 0.5}}


@pytest.fixture(scope="module")
def ideal(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return scene_of(IDEAL_SCENE, tmp_path_factory.mktemp("ideal"))


def swept(scene: Scene, folder: Path, **settings: Any) -> SweepResult:
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        found = sweep(bench, folder, **settings)
    assert not sim.rig.coil_voltage().amplitude.any()
    return found


def test_a_drive_that_follows_set_points_finds_the_ratio_that_generator_and_amplifier_find(
    ideal: Scene, tmp_path: Path
) -> None:
    (usual,) = swept(ideal, tmp_path / "usual", **SMALL).points
    (found,) = swept(ideal.with_devices(DRIVE), tmp_path / "drive", **SMALL).points
    assert found.valid
    assert found.load_N == pytest.approx(2.0, rel=0.02)
    assert found.force_ratio == pytest.approx(usual.force_ratio, rel=1e-3)
