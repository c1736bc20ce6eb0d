"""Devices of a lab's own fill the roles that procedures ask for, and carry a sweep with no line changed here."""

from __future__ import annotations

import tomllib
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import palpate
from palpate.drivers.bench import Bench
from palpate.drivers.devices.exciter import Exciter
from palpate.drivers.roles import LoadIndicator, Positioner, SensorNode
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.config import check
from palpate.instrument.errors import BenchError, ConfigError, RangeError, SafetyError
from palpate.procedures.lab.chosen import Chosen
from palpate.procedures.lab.lab import Target
from palpate.procedures.logs import read_log
from palpate.procedures.measurements.loads import SweepResult
from palpate.procedures.study.description import StudyFile, study_of
from palpate.procedures.testing.wire import Traffic
from palpate.procedures.virtual.study_cell import StudyComputation
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
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


@pytest.mark.parametrize("name", [pytest.param("exciter", marks=pytest.mark.slow), "drive"])
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


def test_a_failed_test_tells_what_a_drive_said_with_its_own_names() -> None:
    with installed("drive"):
        scene = read_scene("thesis_single").with_devices({"shaker": {"kind": "acme-drive"}})
        with SimulatedBench(scene) as sim:
            bench = Bench(sim.description, sim.clock, sim.operator)
            traffic = Traffic(bench)
            with bench:
                bench.role(Exciter).drive()
                bench.device("sensor_node_1").acquire(0.01)
                told = traffic.report()
    assert "torque drive 2: NMT OPERATIONAL" in told
    assert "torque drive 2: send controlword = on, amplitude = 0 V" in told
    assert "statusword = " in told
    assert "sensor node 2" not in told


@pytest.mark.parametrize(
    ("package", "role", "usual_device"),
    [
        ("gauge", LoadIndicator, "strain_indicator"),
        pytest.param("logger", SensorNode, "sensor_node_1", marks=pytest.mark.slow),
    ],
)
def test_a_device_to_which_the_scene_gives_a_role_measures_in_a_sweep_and_stands_in_for_the_usual_one(
    package: str, role: type[LoadIndicator | SensorNode], usual_device: str, ideal: Scene, usual: float, tmp_path: Path
) -> None:
    with installed(package):
        kind = device_kind(f"acme-{package}")
        scene = ideal.with_devices({package: {"kind": kind.name, "role": kind.roles[0]}})
        with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
            assert bench.all(role) == [bench.device(package)]
            assert (
                check(tomllib.loads(sim.description.to_toml()), BenchDescription, "again").to_toml()
                == sim.description.to_toml()
            )
            assert usual_device not in sim.devices
            found = ratio(sweep(bench, tmp_path / "run", **SMALL))
    assert found == pytest.approx(usual, rel=1e-3)


@pytest.mark.parametrize(
    "kind",
    [
        "nanotec-c5-e",
        pytest.param("oriental-motor-blvd-krd", marks=pytest.mark.slow),
        pytest.param("oriental-motor-blvd-krd-can", marks=pytest.mark.slow),
        pytest.param("leadshine-cs2rs", marks=pytest.mark.slow),
    ],
)
def test_a_positioner_of_a_maker_carries_a_sweep_that_finds_the_ratio_that_our_own_finds(
    kind: str, ideal: Scene, usual: float, tmp_path: Path
) -> None:
    stage = {"kind": kind, "role": "positioner", "metres_per_step": 1e-6, "travel": "25 mm"}  # as fine as the usual one
    scene = ideal.with_devices({"stage": stage})
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        assert bench.role(Positioner) is bench.device("stage")
        found = ratio(sweep(bench, tmp_path / "run", **SMALL))
        assert found == pytest.approx(usual, rel=4e-3)  # a count of the node, 15 µV, in the smaller signal, 3.8 mV
        assert bench.role(Positioner).position() == 0.0


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


@pytest.mark.slow
def test_a_bus_log_of_a_drive_on_canopen_can_be_replayed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path))
    log = tmp_path / "log.pcapng"
    with installed("drive"):
        scene = written(tmp_path, {"shaker": {"kind": "acme-drive"}})
        with palpate.open_bench(scene=str(scene), log=log) as bench:
            sweep = palpate.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.5)
            done = palpate.run(sweep, bench, out=tmp_path / "run")
        said = [line.text for line in read_log(log) if line.who == "node 2"]
        assert "controlword = on, amplitude = 0 V" in said
        assert palpate.replay(log, tmp_path / "again").run.digest() == done.run.digest()


@pytest.mark.slow
def test_a_load_cell_is_calibrated_with_an_indicator_whose_settings_the_certificate_lists(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path))
    with installed("gauge"):
        scene = written(tmp_path, {"gauge": {"kind": "acme-gauge", "role": "load_indicator"}})
        with palpate.open_bench(scene=str(scene)) as bench:
            palpate.run(palpate.LoadCellSeries(loads=(2.0, 4.0, 6.0)), bench, out=tmp_path / "run")
    certificate = (tmp_path / "run" / "certificate.md").read_text(encoding="utf-8")
    assert "SIM-FG-0001" in certificate
    assert "full scale" not in certificate  # which is a setting of the strain indicator


class Hot(Exception):
    """A failure while the oven heats."""


@pytest.mark.parametrize("fails", [False, True])
def test_a_chamber_that_was_heated_is_off_at_the_end_also_after_a_failure(ideal: Scene, fails: bool) -> None:
    with installed("oven"), SimulatedBench(ideal.with_devices({"oven": {"kind": "acme-oven"}})) as sim:
        oven = sim.devices["oven"]
        bench = Bench(sim.description, sim.clock, sim.operator)
        with pytest.raises(Hot) if fails else nullcontext(), bench:
            bench.operator.set_temperature(15.0)
            assert oven.settings["heater"]
            if fails:
                raise Hot
        assert not oven.settings["heater"]


def test_a_chamber_that_a_person_heats_is_left_alone(ideal: Scene) -> None:
    with installed("oven"), SimulatedBench(ideal.with_devices({"oven": {"kind": "acme-oven"}})) as sim:
        oven = sim.devices["oven"]
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


def of_bench(kind: str, role: str) -> Target:
    """What is known of a real bench with this device, before it is opened."""
    on = {"link.it": {"kind": "modbus-tcp", "host": "127.0.0.1", "port": 9}}
    on |= {"device.it": {"kind": kind, "link": "it", "unit": 1}}
    if role == "positioner":
        on = {"link.it": {"kind": "modbus-rtu", "port": "/dev/none"}, "device.it": on["device.it"]}
    tables: dict[str, Any] = {"name": "b", "watchdog": "none" if role == "exciter" else "2 s"}
    for place, table in on.items():
        section, _, name = place.partition(".")
        tables[section] = {name: table}
    return Chosen(check(tables, BenchDescription, "bench.toml"), None).target


def of_scene(ideal: Scene, kind: str, role: str) -> Target:
    """What is known of a simulated bench with this device."""
    return Chosen(None, ideal.with_devices({"it": {"kind": kind, "role": role}})).target


def test_settings_are_held_to_the_limits_of_the_bench_s_own_kinds_before_it_opens(
    ideal: Scene, install: Install, tmp_path: Path
) -> None:
    names = (
        "fine-exciter",
        "coarse-exciter",
        "silent-exciter",
        "long-positioner",
        "short-positioner",
        "mute-positioner",
    )
    install(
        "acme", "palpate.devices", {n: f"acme_limited:{n.split('-')[0].upper()}" for n in names}, acme_limited=LIMITED
    )
    found = {n: [of_bench(n, n.split("-")[1]), of_scene(ideal, n, n.split("-")[1])] for n in names}
    assert [[each.frequency_step for each in found[n]] for n in names[:3]] == [[1e-4] * 2, [0.5] * 2, [None] * 2]
    assert [[each.travel for each in found[n]] for n in names[3:]] == [[0.1] * 2, [1e-3] * 2, [None] * 2]
    usual = Chosen(None, ideal).target
    assert (usual.frequency_step, usual.travel) == (1e-3, 25e-3)

    between = palpate.LoadSweep(samples=("1",), loads=(2.0,), frequency=10.0002)
    between.check(found["fine-exciter"][1])
    between.check(found["silent-exciter"][1])
    with pytest.raises(RangeError, match=r"lies between the exciter's steps of 0.001 Hz; take 10 Hz"):
        between.check(usual)
    with pytest.raises(RangeError, match=r"frequency 10.2 Hz lies between the exciter's steps of 0.5 Hz; take 10 Hz"):
        replace(between, frequency=10.2).check(found["coarse-exciter"][1])
    test = palpate.ModulusTest("1")
    test.check(found["long-positioner"][1])
    test.check(found["mute-positioner"][1])
    with pytest.raises(RangeError, match=r"is 3 mm thick, beyond the positioner's travel of 1 mm"):
        test.check(found["short-positioner"][1])


def test_a_study_is_held_to_the_exciter_of_its_scene(ideal: Scene, install: Install, tmp_path: Path) -> None:
    install("acme", "palpate.devices", {"coarse-exciter": "acme_limited:COARSE"}, acme_limited=LIMITED)
    scene = written(tmp_path, {"it": {"kind": "coarse-exciter"}})
    file = {"name": "s", "frequency": "10.2 Hz", "axes": {"scene": [str(scene)]}}
    with pytest.raises(ConfigError, match=r"^s.toml: frequency 10.2 Hz lies between the exciter's steps of 0.5 Hz"):
        StudyComputation.of(study_of(check(file, StudyFile, "s.toml"), "s.toml"), "s.toml")
