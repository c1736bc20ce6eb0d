"""Load sweeps with load indicators of makers in the place of ours."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.roles import LoadIndicator, SensorNode
from palpate.instrument.errors import BenchError, DeviceError, RangeError
from palpate.procedures.measurements.loads import SweepResult
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.guests import guests
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from tests.fault_matrix import ONCE, STAYS, Cell, play
from tests.fault_procedures import scene as without_scatter
from tests.pages import ROOT
from tests.procedures.conftest import IDEAL_CALIBRATION, OFF, Palpate, happens_in, outputs, sweep
from tests.shares import first_of

SPAN = 10.306  # mV of the load cell for one newton, as the display shows
SECTIONS = {
    "flintec-dad-141": {"filter": 0},
    "laumas-tlb4": {"bandwidth": "80 Hz"},
    "seneca-z-sg2": {"bandwidth": "60 Hz", "rate": "151 Hz", "resolution": 0.001},
}
FLINTEC, LAUMAS, SENECA = SECTIONS


def with_indicator(scene: Scene, kind: str, **section: object) -> Scene:
    """A scene in which a maker's load indicator stands in for ours."""
    table = {"kind": kind, "role": "load_indicator", "span": SPAN, **(section or SECTIONS[kind])}
    return replace(scene, devices=guests({"cell": table}, "scene"))


def swept(scene: Scene, folder: Path, loads: tuple[float, ...], dwell: float) -> tuple[SweepResult, float]:
    """A sweep on the bench of a scene, and the step of its films' converter [V]."""
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        found = sweep(bench, folder, ("1",), loads, dwell, calibration=IDEAL_CALIBRATION)
        return found, bench.role(SensorNode).resolution(1)


def compared(kind: str, folder: Path, loads: tuple[float, ...], dwell: float) -> None:
    """Compare a sweep with a maker's indicator with one with ours: the same ratios within one count of a film."""
    ours, count = swept(read_scene("ideal"), folder / "ours", loads, dwell)
    theirs, _ = swept(with_indicator(read_scene("ideal"), kind), folder / "theirs", loads, dwell)
    for own, other in zip(ours.points, theirs.points, strict=True):
        assert own.valid
        assert other.valid
        step = count / own.voltage_rigid_V + count / own.voltage_total_V
        assert step < 0.01
        assert abs(other.force_ratio / own.force_ratio - 1) <= step
        assert abs(other.load_measured_N - own.load_measured_N) <= 0.01 * own.load_N  # what the servo allows
        assert other.load_measured_u > own.load_measured_u


@pytest.mark.parametrize("kind", first_of(list(SECTIONS)))
def test_a_sweep_with_any_of_them_gives_the_ratio_of_our_own_indicator(kind: str, tmp_path: Path) -> None:
    compared(kind, tmp_path, (2.0,), 0.2)


def test_the_filter_of_the_factory_is_refused_before_anything_moves(tmp_path: Path) -> None:
    scene = with_indicator(read_scene("ideal"), FLINTEC, gage_factor=8.98)
    moved: list[object] = []
    with SimulatedBench(scene) as sim:
        sim.rig.set_position = moved.append  # type: ignore[method-assign]
        sim.rig.mount = moved.append  # type: ignore[method-assign]
        with Bench(sim.description, sim.clock, sim.operator) as bench:
            indicator = bench.role(LoadIndicator)
            assert (indicator.serial, indicator.gage_factor) == ("14110001", 8.98)
            with pytest.raises(RangeError, match=r"filter_level = 3: 4 Hz.*write filter = 0"):
                sweep(bench, tmp_path / "run", calibration=IDEAL_CALIBRATION)
            assert outputs(sim) == OFF
    assert moved == []


def test_kilograms_where_newtons_were_set_are_refused_when_the_bench_is_opened() -> None:
    with SimulatedBench(with_indicator(read_scene("ideal"), LAUMAS)) as sim:
        sim.devices["cell"].settings["unit"] = 0.0
        bench = Bench(sim.description, sim.clock, sim.operator)
        with pytest.raises(DeviceError, match="unit is 'kg', the contract reads 'N'; set the device to N"), bench:
            pass


@pytest.mark.slow
def test_a_scale_that_changes_in_a_run_stops_it_by_name(tmp_path: Path) -> None:
    with SimulatedBench(with_indicator(read_scene("ideal"), LAUMAS)) as sim:
        cell, driven = sim.devices["cell"], []

        def turned() -> None:
            cell.settings["division"] = 12.0
            driven.append(outputs(sim)[0])

        happens_in(sim, 92.0, turned)
        bench = Bench(sim.description, sim.clock, sim.operator)
        with pytest.raises(BenchError, match="division is 12, was 15 before, so the scale"), bench:
            sweep(bench, tmp_path / "run", calibration=IDEAL_CALIBRATION)
        assert driven == [True]
        assert outputs(sim) == OFF


def with_the_dad_141(procedure: str) -> Scene:
    return with_indicator(without_scatter(procedure), FLINTEC)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "on", "lasts", "more", "verdicts"),
    [
        ("late_answer", "cell", ONCE, (), {"right"}),
        ("leading_glitch", "line", STAYS, (), {"right"}),
        ("front_panel", "cell", ONCE, (("setting", "filter_level"), ("value", 5.0)), {"right"}),
    ],
)
def test_faults_of_its_line_end_in_a_right_result_or_a_clear_stop_with_outputs_at_zero(
    fault: str, on: str, lasts: str, more: tuple[tuple[str, object], ...], verdicts: set[str], nothing_left_behind: None
) -> None:
    outcome = play(Cell("sweep loads", fault, on, lasts, more), with_the_dad_141)
    assert outcome.verdict in verdicts, outcome


@pytest.mark.slow
def test_a_scene_with_the_map_of_the_documentation_is_swept(palpate: Palpate) -> None:
    page = (ROOT / "docs" / "how-to" / "map.md").read_text(encoding="utf-8").split("```\n")[1::2]
    (section,) = (block for block in page if block.startswith("[device.load_cell]"))
    scene = (ROOT / "simulators" / "scenes" / "real_bench.toml").read_text(encoding="utf-8")
    before, old, after = re.split(r"(\[device\.load_cell\].*?\n\n)", scene, maxsplit=1, flags=re.DOTALL)
    assert "flintec" in old
    Path("my_indicator.toml").write_text(page[0] + page[1], encoding="utf-8")
    Path("my_scene.toml").write_text(before + section + "\n" + after, encoding="utf-8")
    said = palpate("sweep", "loads", "--scene", "my_scene.toml", "--samples", "1", "--loads", "2 N")
    assert (said.status, said.err) == (0, "")
    assert "valid points" in said.out


@pytest.mark.slow
def test_a_certificate_lists_the_settings_that_a_makers_indicator_has(palpate: Palpate) -> None:
    said = palpate("calibrate", "load-cell", "--scene", "real_bench", "--json").object
    certificate = Path(said["certificate"]).read_text(encoding="utf-8")
    assert "| indicator: span | 10.306 |\n| indicator: filter | 0 |\n" in certificate
    assert "None" not in certificate
