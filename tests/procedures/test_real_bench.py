"""The bench of twins of devices that can be bought: it measures what ours measures, and survives the same faults."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.procedures.logs import read_log
from palpate.procedures.measurements.loads import LoadPoint
from palpate.procedures.records.run import Run
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from tests.fault_matrix import ONCE, STAYS, Cell, cells, play
from tests.fault_procedures import real_bench
from tests.procedures.conftest import IDEAL_CALIBRATION, IDEAL_SCENE, Palpate, scene_of, sweep

SWEEP = ("sweep", "loads", "--scene", "real_bench", "--samples", "1", "--dwell", "0.2 s", "--quiet")
SMALL: dict[str, Any] = {"samples": ("1",), "loads": (2.0,), "dwell": 0.5, "calibration": IDEAL_CALIBRATION}
COUNT = 0.5 / 32768  # V, of either node
RIGHT = "right"
KNOWN = {
    Cell("sweep loads", "silence", "load_cell", ONCE): RIGHT,
    Cell("sweep loads", "bit_error", "line", ONCE): RIGHT,
    Cell("sweep loads", "power_cycle", "load_cell", ONCE): RIGHT,
    Cell("sweep loads", "stuck_reading", "load_cell", STAYS): "stopped",
    Cell("sweep loads", "zero_drift", "load_cell", STAYS): "stopped",
    Cell("sweep loads", "not_a_number", "load_cell", ONCE): RIGHT,
    Cell("sweep loads", "no_heartbeat", "films", STAYS): RIGHT,
    Cell("sweep loads", "saturated_film", "films", STAYS): "marked",
    Cell("sweep loads", "node_reboot", "exciter", ONCE): "stopped",
}


def measured(scene: Scene, folder: Path) -> LoadPoint:
    """The one point of a sweep; the shaker is off behind it."""
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        (point,) = sweep(bench, folder, **SMALL).points
        assert bench.simulated
        assert not sim.rig.coil_voltage().amplitude.any()
    return point


@pytest.mark.slow
def test_without_scatter_and_noise_the_ratio_is_ours_to_one_count_of_the_coarser_device(tmp_path: Path) -> None:
    ideal = scene_of(IDEAL_SCENE, tmp_path)
    makers = replace(ideal, devices=read_scene("real_bench").devices)
    ours, theirs = (measured(scene, tmp_path / name) for name, scene in (("ours", ideal), ("theirs", makers)))
    assert theirs.valid
    assert theirs.force_ratio == pytest.approx(ours.force_ratio, rel=COUNT / ours.voltage_rigid_V)


def test_none_of_its_devices_is_ours() -> None:
    with SimulatedBench(read_scene("real_bench")) as sim:
        devices = sim.description.devices
    assert [each.kind.name for each in devices] == ["maxon-epos4", "flintec-dad-141", "nanotec-c5-e", "canopennode-io"]
    assert [each.inventory != "" for each in devices] == [False, True, False, False]


@pytest.mark.slow
def test_a_sweep_is_logged_shown_and_replayed_to_the_byte(palpate: Palpate) -> None:
    said = palpate(*SWEEP, "--loads", "2 N", "--log", "trace.pcapng", "--out", "first")
    assert said.status == 0, said.err
    assert "decimals = 3, display_step = 0.001 d" in "\n".join(line.text for line in read_log(Path("trace.pcapng")))
    said = palpate("bus", "replay", "trace.pcapng", "--out", "second", "--quiet")
    assert said.status == 0, said.err
    assert Run.open(Path("first")).digest() == Run.open(Path("second")).digest()


@pytest.mark.slow
def test_its_matrix_of_faults_strikes_each_of_its_devices_and_links() -> None:
    whole = list(cells(("sweep loads",), real_bench))
    assert {cell.on for cell in whole} == {"exciter", "load_cell", "stage", "films", "line", "can", "sample_changer"}
    ours = {kind for kind in FAULTS if {*fault_class(kind).targets} <= {"strain_indicator", "sensor_node"}}
    assert {cell.kind for cell in whole} == {*FAULTS} - ours


@pytest.mark.slow
@pytest.mark.parametrize(("cell", "verdict"), KNOWN.items(), ids=lambda each: getattr(each, "name", each))
def test_a_fault_ends_in_a_right_result_or_a_clear_stop_with_the_shaker_off(cell: Cell, verdict: str) -> None:
    outcome = play(cell, real_bench)
    assert outcome.verdict == verdict, outcome.said


def test_its_links_can_be_moved_for_a_replay() -> None:
    with SimulatedBench(read_scene("real_bench")) as sim:
        moved = sim.description.moved({"can": {"channel": "elsewhere"}, "line": {"port": "/dev/elsewhere"}})
    assert (moved.links["can"].channel, moved.links["line"].port) == ("elsewhere", "/dev/elsewhere")  # type: ignore[union-attr]
