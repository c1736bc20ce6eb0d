"""Sensor nodes of makers fill the role of ours in a sweep: they find the same ratio, and lose nothing to their bus."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import palpate
from palpate.drivers.bench import Bench
from palpate.procedures.measurements.loads import LoadPoint
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


FAULT = '\n[[fault]]\nkind = "{}"\non = "{}"\n{}\n'


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "fault", "told"),
    [
        ("canopennode-io", ("lost_frame", "io", "transaction = 300"), "samples are missing from number"),
        ("canopennode-io", ("duplicated_frame", "io", "transaction = 300"), "samples are missing from number"),
        ("canopennode-io", ("node_reboot", "io", 'at = "84 s"'), "PDO samples is no longer set up"),
        ("baumer-dsrt", ("delayed_frame", "film_2", "transaction = 200"), "samples are missing from number"),
        ("baumer-dsrt", ("node_reboot", "film_2", 'at = "84 s"'), "has started anew"),
        (
            "baumer-dsrt",
            ("node_reboot", "clock", 'at = "84 s"'),
            "node 3, which sends SYNC, no longer holds its period",
        ),
    ],
)
def test_a_fault_of_the_bus_or_of_a_node_costs_a_repeated_step_and_no_sample(
    kind: str, fault: tuple[str, str, str], told: str, ideal: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path))
    scene, asked = tmp_path / "scene.toml", palpate.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.5)
    found = []
    for number, faults in enumerate(("", FAULT.format(*fault))):
        scene.write_text(ideal.with_devices(NODES[kind]).to_toml() + faults, encoding="utf-8")
        with palpate.open_bench(scene=str(scene)) as bench:
            (point,) = palpate.run(asked, bench, out=tmp_path / str(number)).result.points
        assert point.valid
        found.append(point.force_ratio)
    incidents = [each["message"] for each in palpate.read(tmp_path / "1").events() if each["kind"] == "incident"]
    assert told in incidents[0]
    assert found[1] == pytest.approx(found[0], rel=4e-3)  # at another time, so at another phase of its counts
