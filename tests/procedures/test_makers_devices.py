"""Devices of makers and of a lab's own in the place of ours: they find what ours find, or say why not."""

from __future__ import annotations

import math
import re
import tomllib
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import palpate
from palpate import BenchError, ConfigError, RangeError, Run
from palpate.extend import (
    Bench,
    BenchDescription,
    DeviceError,
    Exciter,
    LoadIndicator,
    Positioner,
    SafetyError,
    Scene,
    SensorNode,
    Target,
    read_scene,
)
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.config import check
from palpate.procedures.lab.chosen import Chosen
from palpate.procedures.logs import read_log
from palpate.procedures.measurements.loads import LoadPoint, SweepResult
from palpate.procedures.study.description import StudyFile, study_of
from palpate.procedures.virtual.study_cell import StudyComputation
from palpate.simulators.bench import SimulatedBench
from tests.conftest import Install
from tests.drivers.benches import installed
from tests.fault_matrix import real_bench, scene, undisturbed
from tests.procedures.conftest import (
    IDEAL_CALIBRATION,
    IDEAL_SCENE,
    OFF,
    Palpate,
    happens_in,
    outputs,
    scene_of,
    sweep,
)
from tests.procedures.test_pages import ROOT

SMALL: dict[str, Any] = {"samples": ("1",), "loads": (2.0,), "dwell": 0.5, "calibration": IDEAL_CALIBRATION}
RANGE = 0.5  # V
COUNT = RANGE / 32768  # V, of each node
STRAIN = {"role": "sensor_node", "volts_per_unit": RANGE / 327.67}
CLOCK = {"kind": "canopennode-io"}  # sends SYNC, and samples no film
INDICATOR = {"role": "load_indicator", "span": 10.306}  # mV of the load cell for one newton, as the display shows
STAGE = {"role": "positioner", "metres_per_step": 1e-6, "travel": "25 mm"}  # as fine as the usual one
FLINTEC: dict[str, Any] = {"cell": {"kind": "flintec-dad-141", **INDICATOR, "filter": 0}}
LAUMAS: dict[str, Any] = {"cell": {"kind": "laumas-tlb4", **INDICATOR, "bandwidth": "80 Hz"}}
WHOLE = dict(read_scene("real_bench").file.device or {})
PLAIN: dict[str, dict[str, Any]] = {
    "canopennode-io": {"io": {"kind": "canopennode-io", "role": "sensor_node", "volts_per_unit": COUNT}},
    "flintec-dad-141": FLINTEC,
    "nanotec-c5-e": {"stage": {"kind": "nanotec-c5-e", **STAGE}},
}
MORE: dict[str, dict[str, Any]] = {
    "baumer-dsrt": {
        **{f"film_{number}": {"kind": "baumer-dsrt", **STRAIN, "sync_node": 3} for number in (1, 2)}, "clock": CLOCK,
    },
    "baumer-dsrt-24": {
        "clock": CLOCK, **{f"film_{number}": {"kind": "baumer-dsrt-24", **STRAIN, "sync_node": 1} for number in (1, 2)},
    },
    "laumas-tlb4": LAUMAS,
    "seneca-z-sg2": {
        "cell": {"kind": "seneca-z-sg2", **INDICATOR, "bandwidth": "60 Hz", "rate": "151 Hz", "resolution": 0.001},
    },
    "oriental-motor-blvd-krd": {"stage": {"kind": "oriental-motor-blvd-krd", **STAGE}},
    "oriental-motor-blvd-krd-can": {"stage": {"kind": "oriental-motor-blvd-krd-can", **STAGE}},
    "leadshine-cs2rs": {"stage": {"kind": "leadshine-cs2rs", **STAGE}},
    "all of them": WHOLE,
    "two makers' on one line": {
        **WHOLE, "stage": {**WHOLE["stage"], "kind": "oriental-motor-blvd-krd", "metres_per_step": 1e-6},
    },
    "other two on one line": {**WHOLE, "stage": {**WHOLE["stage"], "kind": "leadshine-cs2rs", "metres_per_step": 1e-7}},
}  # fmt: skip


@pytest.fixture(scope="module")
def ideal(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return scene_of(IDEAL_SCENE, tmp_path_factory.mktemp("ideal"))


@pytest.fixture(scope="module")
def usual(ideal: Scene, tmp_path_factory: pytest.TempPathFactory) -> LoadPoint:
    return measured(ideal, tmp_path_factory.mktemp("usual") / "run")


def measured(scene: Scene, folder: Path) -> LoadPoint:
    """The one point of a sweep; behind it the shaker is off and the probe is home."""
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        (point,) = sweep(bench, folder, **SMALL).points
        assert not sim.rig.coil_voltage().amplitude.any()
        assert bench.role(Positioner).position() == 0.0
    return point


@pytest.mark.parametrize("kind", [*PLAIN, *(pytest.param(kind, marks=pytest.mark.slow) for kind in MORE)])
def test_it_finds_the_ratio_that_ours_finds_within_one_count_of_a_film(
    kind: str, ideal: Scene, usual: LoadPoint, tmp_path: Path
) -> None:
    devices = (PLAIN | MORE)[kind]
    point = measured(ideal.with_devices(devices), tmp_path / "run")
    assert point.valid
    assert point.force_ratio == pytest.approx(usual.force_ratio, rel=COUNT / usual.voltage_rigid_V)
    assert point.load_measured_N == pytest.approx(usual.load_measured_N, rel=0.01)  # what the servo allows
    if {"cell", "load_cell"} & devices.keys():
        assert point.load_measured_u > usual.load_measured_u  # what its filter loses
    else:
        found, ours = ((each.voltage_rigid_V, each.voltage_total_V) for each in (point, usual))
        assert found == pytest.approx(ours, abs=COUNT)


@pytest.mark.slow
@pytest.mark.parametrize("procedure", ["sweep position", "calibrate load-cell", "test modulus", "characterise"])
def test_a_procedure_finds_on_real_bench_what_it_finds_on_ours(procedure: str) -> None:
    """All values stand without a mark, and differ from ours by what both may."""
    theirs, ours = (undisturbed(procedure, of=of)[0] for of in (real_bench, scene))
    assert theirs.keys() == ours.keys()
    for name, each in theirs.items():
        assert each.valid, name
        assert each.value == pytest.approx(ours[name].value, abs=math.hypot(each.allowed, ours[name].allowed)), name


@pytest.mark.slow
def test_a_frequency_sweep_goes_as_far_as_its_devices_can_and_no_further(palpate: Palpate) -> None:
    sweep = ("sweep", "frequency", "--scene", "real_bench", "--json", "--frequencies")
    found = palpate(*sweep, "2 Hz, 5 Hz, 10 Hz").object["points"]
    assert [(each["frequency_Hz"], each["valid"]) for each in found] == [(2.0, True), (5.0, True), (10.0, True)]
    said = palpate(*sweep, "2 Hz, 5 Hz, 20 Hz", "--out", "refused")
    assert "load_cell: its readings (filter_level = 0: 17 Hz, 600 a second) lose up to 48 %" in said.complaint
    assert not Path("refused").exists()


def test_none_of_the_devices_of_real_bench_is_ours_and_their_links_can_be_moved() -> None:
    with SimulatedBench(read_scene("real_bench")) as sim:
        description = sim.description
    kinds = [each.kind.name for each in description.devices]
    assert kinds == ["maxon-epos4", "flintec-dad-141", "nanotec-c5-e", "canopennode-io"]
    assert [each.inventory != "" for each in description.devices] == [False, True, False, False]
    moved = description.moved({"can": {"channel": "elsewhere"}, "line": {"port": "/dev/elsewhere"}})
    assert (moved.links["can"].channel, moved.links["line"].port) == ("elsewhere", "/dev/elsewhere")  # type: ignore[union-attr]


@pytest.mark.slow
def test_a_sweep_on_real_bench_is_logged_shown_and_replayed_to_the_byte(palpate: Palpate) -> None:
    sweep = ("sweep", "loads", "--scene", "real_bench", "--samples", "1", "--dwell", "0.2 s", "--loads", "2 N")
    assert palpate(*sweep, "--log", "trace.pcapng", "--out", "first").status == 0
    assert "decimals = 3, display_step = 0.001 d" in "\n".join(line.text for line in read_log(Path("trace.pcapng")))
    assert palpate("bus", "replay", "trace.pcapng", "--out", "second").status == 0
    assert Run.open(Path("first")).digest() == Run.open(Path("second")).digest()


# --- load indicators -----------------------------------------------------------------------------------


def test_the_filter_of_the_factory_is_refused_before_anything_moves(ideal: Scene, tmp_path: Path) -> None:
    moved: list[object] = []
    factory = {"kind": "flintec-dad-141", **INDICATOR, "gage_factor": 8.98}
    with SimulatedBench(ideal.with_devices({"cell": factory})) as sim:
        sim.rig.set_position = moved.append  # type: ignore[method-assign]
        sim.rig.mount = moved.append  # type: ignore[method-assign]
        with Bench(sim.description, sim.clock, sim.operator) as bench:
            indicator = bench.role(LoadIndicator)
            assert (indicator.serial, indicator.gage_factor) == ("14110001", 8.98)
            with pytest.raises(RangeError, match=r"filter_level = 3: 4 Hz.*write filter = 0"):
                sweep(bench, tmp_path / "run", calibration=IDEAL_CALIBRATION)
            assert (moved, outputs(sim)) == ([], OFF)


def test_kilograms_where_newtons_were_set_are_refused_when_the_bench_is_opened(ideal: Scene) -> None:
    with SimulatedBench(ideal.with_devices(LAUMAS)) as sim:
        sim.devices["cell"].settings["unit"] = 0.0
        bench = Bench(sim.description, sim.clock, sim.operator)
        with pytest.raises(DeviceError, match="unit is 'kg', the contract reads 'N'; set the device to N"), bench:
            pass


@pytest.mark.slow
def test_a_scale_that_changes_in_a_run_stops_it_by_name(ideal: Scene, tmp_path: Path) -> None:
    with SimulatedBench(ideal.with_devices(LAUMAS)) as sim:
        cell, driven = sim.devices["cell"], []

        def turned() -> None:
            cell.settings["division"] = 12.0
            driven.append(outputs(sim)[0])

        happens_in(sim, 92.0, turned)
        bench = Bench(sim.description, sim.clock, sim.operator)
        with pytest.raises(BenchError, match="division is 12, was 15 before, so the scale"), bench:
            sweep(bench, tmp_path / "run", calibration=IDEAL_CALIBRATION)
        assert (driven, outputs(sim)) == ([True], OFF)


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
    assert (said.status, said.err, "valid points" in said.out) == (0, "", True)


@pytest.mark.slow
def test_a_certificate_lists_the_settings_that_a_makers_indicator_has(palpate: Palpate) -> None:
    said = palpate("calibrate", "load-cell", "--scene", "real_bench", "--json").object
    certificate = Path(said["certificate"]).read_text(encoding="utf-8")
    assert "| indicator: span | 10.306 |\n| indicator: filter | 0 |\n" in certificate
    assert "None" not in certificate


# --- Devices of a lab's own fill the roles that procedures ask for, and carry a sweep with no l --------


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
    package: str, role: type[Any], usual_devices: set[str], ideal: Scene, usual: LoadPoint, tmp_path: Path
) -> None:
    with installed(package):
        kind = device_kind(f"acme-{package}")
        scene = ideal.with_devices({package: {"kind": kind.name, "role": kind.roles[0]}})
        with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
            assert bench.all(role) == [bench.device(package)]
            written = sim.description.to_toml()
            assert check(tomllib.loads(written), BenchDescription, "again").to_toml() == written
            assert usual_devices & sim.devices.keys() == set()
            assert ratio(sweep(bench, tmp_path / "run", **SMALL)) == pytest.approx(usual.force_ratio, rel=1e-3)
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
