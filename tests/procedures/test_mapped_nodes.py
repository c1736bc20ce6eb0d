"""Sensor nodes of makers fill the role of ours in a sweep: they find the same ratio, and lose nothing to their bus."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.procedures.measurements.loads.result import LoadPoint
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.scenes.scene import Scene
from tests.procedures.conftest import IDEAL_CALIBRATION, IDEAL_SCENE, scene_of, sweep

SMALL: dict[str, Any] = {"samples": ("1",), "loads": (2.0,), "dwell": 0.5, "calibration": IDEAL_CALIBRATION}
RANGE = 0.5  # V
IO = {"kind": "canopennode-io", "role": "sensor_node", "volts_per_unit": RANGE / 32768}
STRAIN = {"role": "sensor_node", "volts_per_unit": RANGE / 327.67, "sync_node": 3}
CLOCK = {"kind": "canopennode-io"}  # sends SYNC, and samples no film
NODES: dict[str, dict[str, dict[str, Any]]] = {
    "canopennode-io": {"io": IO},
    "baumer-dsrt": {
        **{f"film_{number}": {"kind": "baumer-dsrt", **STRAIN} for number in (1, 2)},
        "clock": CLOCK,
    },
    "baumer-dsrt-24": {
        "clock": CLOCK,
        **{f"film_{number}": {"kind": "baumer-dsrt-24", **STRAIN, "sync_node": 1} for number in (1, 2)},
    },
}


@pytest.fixture(scope="module")
def ideal(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return scene_of(IDEAL_SCENE, tmp_path_factory.mktemp("ideal"))


@pytest.fixture(scope="module")
def usual(ideal: Scene, tmp_path_factory: pytest.TempPathFactory) -> LoadPoint:
    return measured(ideal, tmp_path_factory.mktemp("usual") / "run")


def measured(scene: Scene, folder: Path) -> LoadPoint:
    """The one point of a sweep; the shaker is off behind it."""
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        (point,) = sweep(bench, folder, **SMALL).points
        assert not sim.rig.coil_voltage().amplitude.any()
    return point


@pytest.mark.parametrize(
    "kind", ["canopennode-io", *(pytest.param(kind, marks=pytest.mark.slow) for kind in list(NODES)[1:])]
)
def test_a_maker_s_node_finds_the_ratio_that_ours_finds_within_one_of_its_counts(
    kind: str, ideal: Scene, usual: LoadPoint, tmp_path: Path
) -> None:
    point, count = measured(ideal.with_devices(NODES[kind]), tmp_path / "run"), RANGE / 32768
    assert point.valid
    assert point.voltage_rigid_V == pytest.approx(usual.voltage_rigid_V, abs=count)
    assert point.voltage_total_V == pytest.approx(usual.voltage_total_V, abs=count)
    assert point.force_ratio == pytest.approx(usual.force_ratio, rel=count / usual.voltage_rigid_V)
