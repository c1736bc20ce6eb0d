"""Devices of a lab's own fill the roles that procedures ask for, and carry a sweep with no line changed here."""

from __future__ import annotations

import tomllib
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import palpate
from palpate import BenchError, ConfigError, RangeError
from palpate.extend import (
    Bench,
    BenchDescription,
    Exciter,
    LoadIndicator,
    SafetyError,
    Scene,
    SensorNode,
    Target,
    read_scene,
)
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.config import check
from palpate.procedures.lab.chosen import Chosen
from palpate.procedures.measurements.loads import SweepResult
from palpate.procedures.study.description import StudyFile, study_of
from palpate.procedures.virtual.study_cell import StudyComputation
from palpate.simulators.bench import SimulatedBench
from tests.conftest import Install
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


@pytest.mark.parametrize(
    ("package", "role", "usual_devices"),
    [
        pytest.param("exciter", Exciter, {"signal_generator", "shaker_amplifier"}, marks=pytest.mark.slow),
        ("drive", Exciter, {"signal_generator", "shaker_amplifier"}),
        ("gauge", LoadIndicator, {"strain_indicator"}),
        pytest.param("logger", SensorNode, {"sensor_node_1"}, marks=pytest.mark.slow),
    ],
)
def test_a_device_to_which_the_scene_gives_a_role_measures_in_a_sweep_and_stands_in_for_the_usual_one(
    package: str, role: type[Any], usual_devices: set[str], ideal: Scene, usual: float, tmp_path: Path
) -> None:
    with installed(package):
        kind = device_kind(f"acme-{package}")
        scene = ideal.with_devices({package: {"kind": kind.name, "role": kind.roles[0]}})
        with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
            assert bench.all(role) == [bench.device(package)]
            written = sim.description.to_toml()
            assert check(tomllib.loads(written), BenchDescription, "again").to_toml() == written
            assert usual_devices & sim.devices.keys() == set()
            assert ratio(sweep(bench, tmp_path / "run", **SMALL)) == pytest.approx(usual, rel=1e-3)
            assert not sim.rig.coil_voltage().amplitude.any()


def written(folder: Path, devices: dict[str, dict[str, Any]], faults: str = "") -> Path:
    """A file of the thesis' scene with these devices and faults."""
    scene = folder / "scene.toml"
    scene.write_text(read_scene("thesis_single").with_devices(devices).to_toml() + faults, encoding="utf-8")
    return scene


@pytest.mark.slow
def test_a_record_names_each_device_of_a_kind_and_says_which_is_absent_and_that_the_exciter_has_no_watchdog(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path))
    devices: dict[str, dict[str, Any]] = {
        "shaker": {"kind": "acme-exciter"},
        "left": {"kind": "acme-oven"},
        "right": {"kind": "acme-oven", "role": "chamber"},
        "spare": {"kind": "acme-oven", "optional": True},
    }
    faults = """
[[fault]]
kind = "connection_refused"
on = "spare"
transaction = 1
[[fault]]
kind = "over_current"
on = "shaker"
at = "100 s"
"""
    with installed("exciter", "oven"), palpate.open_bench(scene=str(written(tmp_path, devices, faults))) as bench:
        asked = palpate.LoadSweep(samples=("1",), loads=(2.0,), dwell=30.0)
        with pytest.raises(SafetyError, match=r"exciter at .*: has tripped"):
            palpate.run(asked, bench, out=tmp_path / "run")
    run = palpate.read(tmp_path / "run")
    assert tomllib.loads(run.header["bench"])["watchdog"] == "none"
    cautions = [each["message"] for each in run.events() if each["kind"] == "caution"]
    assert [text.partition(":")[0] for text in cautions] == ["spare is not used", "exciter at 127.0.0.1"]
    ovens = {name: serial for name, serial in run.header["devices"].items() if name.startswith("oven at")}
    assert sorted(ovens.values()) == ["SIM-OV-0001", "SIM-OV-0002"]


class Hot(Exception):
    """A failure while the oven heats."""


def test_a_chamber_that_was_heated_is_off_at_the_end_also_after_a_failure_and_a_person_s_is_left_alone(
    ideal: Scene,
) -> None:
    with installed("oven"), SimulatedBench(ideal.with_devices({"oven": {"kind": "acme-oven"}})) as sim:
        oven = sim.devices["oven"]
        for fails in (False, True):
            bench = Bench(sim.description, sim.clock, sim.operator)
            with pytest.raises(Hot) if fails else nullcontext(), bench:
                bench.operator.set_temperature(15.0)
                assert oven.settings["heater"]
                if fails:
                    raise Hot
            assert not oven.settings["heater"]
        oven.settings["heater"] = 1
        with Bench(sim.description, sim.clock, sim.operator):
            pass
        assert oven.settings["heater"]


def test_a_chamber_that_cannot_be_switched_off_is_named(ideal: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    def off() -> None:
        raise ZeroDivisionError("a defect of its driver")

    with installed("oven"), SimulatedBench(ideal.with_devices({"oven": {"kind": "acme-oven"}})) as sim:
        bench = Bench(sim.description, sim.clock, sim.operator)
        with (
            pytest.raises(BenchError, match=r"^oven .*could not be switched off: a defect of its driver; .* by hand"),
            bench,
        ):
            monkeypatch.setattr(bench.device("oven"), "off", off)
            bench.operator.set_temperature(15.0)


LIMITED = """
from dataclasses import replace
from palpate.instrument.bench.kinds import KINDS, DeviceKind
from palpate.instrument.contracts.contract import Contract, Identity, probe
DRIVER = "palpate.drivers.devices.modbus_device:ModbusDevice"
def kind(name, link, role, **limits):
    contract = Contract(name, name, "modbus", Identity("Acme", name, "1.0"), (probe(0),))
    return DeviceKind(contract, (link,), DRIVER, "nowhere:Simulated", roles=(role,), **limits)
FINE = kind("fine-exciter", "modbus-tcp", "exciter", frequency_step=1e-4)
COARSE = kind("coarse-exciter", "modbus-tcp", "exciter", frequency_step=0.5)
SILENT = kind("silent-exciter", "modbus-tcp", "exciter")
LONG = kind("long-positioner", "modbus-rtu", "positioner", travel=0.1)
SHORT = kind("short-positioner", "modbus-rtu", "positioner", travel=1e-3)
MUTE = kind("mute-positioner", "modbus-rtu", "positioner")
"""


def targets(ideal: Scene, kind: str) -> list[Target]:
    """What is known of a real and of a simulated bench with this device, before they are opened."""
    role = kind.partition("-")[2]
    link: dict[str, Any] = {"kind": "modbus-tcp", "host": "127.0.0.1", "port": 9}
    if role == "positioner":
        link = {"kind": "modbus-rtu", "port": "/dev/none"}
    device = {"it": {"kind": kind, "link": "it", "unit": 1}}
    watchdog = "none" if role == "exciter" else "2 s"
    bench = check({"name": "b", "watchdog": watchdog, "link": {"it": link}, "device": device}, BenchDescription, "b")
    return [Chosen(bench, None).target, Chosen(None, ideal.with_devices({"it": {"kind": kind, "role": role}})).target]


def test_settings_are_held_to_the_limits_of_the_bench_s_own_kinds_before_it_opens(
    ideal: Scene, install: Install
) -> None:
    steps = {"fine-exciter": 1e-4, "coarse-exciter": 0.5, "silent-exciter": None}
    travels = {"long-positioner": 0.1, "short-positioner": 1e-3, "mute-positioner": None}
    places = {name: f"acme_limited:{name.split('-')[0].upper()}" for name in steps | travels}
    install("acme", "palpate.devices", places, acme_limited=LIMITED)
    found = {name: targets(ideal, name) for name in places}
    assert {name: [each.frequency_step for each in found[name]] for name in steps} == {
        n: 2 * [s] for n, s in steps.items()
    }
    assert {name: [each.travel for each in found[name]] for name in travels} == {n: 2 * [t] for n, t in travels.items()}
    usual = Chosen(None, ideal).target
    assert (usual.frequency_step, usual.travel) == (1e-3, 25e-3)
    between, test = palpate.LoadSweep(samples=("1",), loads=(2.0,), frequency=10.0002), palpate.ModulusTest("1")
    for asked, able in ((between, "fine"), (between, "silent"), (test, "long"), (test, "mute")):
        asked.check(found[f"{able}-{'exciter' if asked is between else 'positioner'}"][1])
    with pytest.raises(RangeError, match=r"lies between the exciter's steps of 0.001 Hz; take 10 Hz"):
        between.check(usual)
    with pytest.raises(RangeError, match=r"frequency 10.2 Hz lies between the exciter's steps of 0.5 Hz; take 10 Hz"):
        replace(between, frequency=10.2).check(found["coarse-exciter"][1])
    with pytest.raises(RangeError, match=r"is 3 mm thick, beyond the positioner's travel of 1 mm"):
        test.check(found["short-positioner"][1])


def test_a_study_is_held_to_the_exciter_of_its_scene(ideal: Scene, install: Install, tmp_path: Path) -> None:
    install("acme", "palpate.devices", {"coarse-exciter": "acme_limited:COARSE"}, acme_limited=LIMITED)
    scene = written(tmp_path, {"it": {"kind": "coarse-exciter"}})
    file = {"name": "s", "frequency": "10.2 Hz", "axes": {"scene": [str(scene)]}}
    with pytest.raises(ConfigError, match=r"^s.toml: frequency 10.2 Hz lies between the exciter's steps of 0.5 Hz"):
        StudyComputation.of(study_of(check(file, StudyFile, "s.toml"), "s.toml"), "s.toml")
