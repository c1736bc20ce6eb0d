"""Devices of a lab's own fill the roles that procedures ask for, and carry a sweep with no line changed here."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

import palpate
from palpate.drivers.bench import Bench
from palpate.drivers.roles import Exciter, LoadIndicator
from palpate.instrument.errors import SafetyError
from palpate.procedures.measurements.loads.result import SweepResult
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from tests.drivers.outside import installed
from tests.procedures.conftest import IDEAL_CALIBRATION, IDEAL_SCENE, scene_of, sweep

SMALL: dict[str, Any] = {"samples": ("1",), "loads": (2.0,), "dwell": 0.5, "calibration": IDEAL_CALIBRATION}


@pytest.fixture(scope="module")
def ideal(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return scene_of(IDEAL_SCENE, tmp_path_factory.mktemp("ideal"))


@pytest.fixture(scope="module")
def usual(ideal: Scene, tmp_path_factory: pytest.TempPathFactory) -> float:
    """The force ratio that the usual devices find."""
    with SimulatedBench(ideal) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        return ratio(sweep(bench, tmp_path_factory.mktemp("run") / "usual", **SMALL))


def ratio(result: SweepResult) -> float:
    (point,) = result.points
    assert point.valid
    assert point.load_N == pytest.approx(2.0, rel=0.02)
    return point.force_ratio


@pytest.mark.parametrize("name", ["exciter", "drive"])
def test_an_exciter_drives_a_sweep_and_finds_the_ratio_that_generator_and_amplifier_find(
    name: str, ideal: Scene, usual: float, tmp_path: Path
) -> None:
    with installed(name):
        scene = ideal.with_devices({"shaker": {"kind": f"acme-{name}"}})
        with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
            assert {"signal_generator", "shaker_amplifier"} & sim.devices.keys() == set()
            assert bench.role(Exciter) is bench.device("shaker")
            found = ratio(sweep(bench, tmp_path / "run", **SMALL))
            assert not sim.rig.coil_voltage().amplitude.any()
    assert found == pytest.approx(usual, rel=1e-3)


def test_an_indicator_reads_the_loads_of_a_sweep(
    ideal: Scene, usual: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with installed("gauge"):
        scene = ideal.with_devices({"gauge": {"kind": "acme-gauge", "role": "load_indicator"}})
        with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
            assert bench.role(LoadIndicator) is bench.device("gauge")
            monkeypatch.setattr(bench.device("strain_indicator"), "read", pytest.fail)
            found = ratio(sweep(bench, tmp_path / "run", **SMALL))
    assert found == pytest.approx(usual, rel=1e-3)


def test_the_record_of_a_run_says_that_the_exciter_has_no_watchdog_and_a_trip_ends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    with installed("exciter"):
        scene = tmp_path / "scene.toml"
        file = read_scene("thesis_single").with_devices({"shaker": {"kind": "acme-exciter"}})
        trip = '[[fault]]\nkind = "over_current"\non = "shaker"\nat = "100 s"\n'
        scene.write_text(file.to_toml() + trip, encoding="utf-8")
        with palpate.open_bench(scene=str(scene)) as bench:
            asked = palpate.LoadSweep(samples=("1",), loads=(2.0,), dwell=30.0)
            with pytest.raises(SafetyError, match=r"exciter at .*: has tripped"):
                palpate.run(asked, bench, out=tmp_path / "run")
    run = palpate.read(tmp_path / "run")
    assert tomllib.loads(run.header["bench"])["watchdog"] == "none"
    assert [each["message"] for each in run.events() if "has no watchdog, so that nothing" in each["message"]] != []
