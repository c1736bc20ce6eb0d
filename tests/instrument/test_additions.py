"""What installed packages add: a broken one is named, and hinders nobody who does not ask for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.kinds import all_kinds, device_kind
from palpate.instrument.config import check
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.procedures.engine.catalogue import procedure_class
from palpate.procedures.engine.run import open_and_run
from palpate.procedures.lab.chosen import Chosen
from palpate.procedures.measurements.loads import LoadSweep
from palpate.procedures.study.description import StudyFile, study_of
from palpate.procedures.virtual.study_cell import StudyComputation
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.plan import Question, plan
from palpate.simulators.scenes.scene import Scene
from tests.conftest import Install

OVEN = """
from palpate.instrument.bench.kinds import DeviceKind
from palpate.instrument.contracts.contract import Contract, Identity, probe
CONTRACT = Contract("{name}", "oven", "modbus", Identity("Acme", "{product}", "1.0"), (probe(0),))
KIND = DeviceKind(CONTRACT, ("modbus-tcp",), "nowhere:Driver", "{module}:Simulated")
from palpate.simulators.wire.device import SimulatedDevice
class Simulated(SimulatedDevice):
    contract = CONTRACT
"""


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("def broken(:", "SyntaxError: "),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("raise ValueError('what a day')", "ValueError: what a day"),
        ("", "AttributeError: module .* has no attribute 'KIND'"),
    ],
)
def test_a_package_that_cannot_be_imported_is_named_and_hinders_no_other(text: str, why: str, install: Install) -> None:
    install("broken", "palpate.devices", {"broken-oven": "broken_oven:KIND"}, broken_oven=text)
    install(
        "good",
        "palpate.devices",
        {"good-oven": "good_oven:KIND"},
        good_oven=OVEN.format(name="good-oven", product="GO", module="good_oven"),
    )
    assert device_kind("good-oven").name == "good-oven"
    with pytest.raises(
        ConfigError, match=rf"^kind of device 'broken-oven' of broken 1.2 \(broken_oven:KIND\): .*{why}"
    ):
        device_kind("broken-oven")
    with pytest.raises(UnknownName, match=r"did you mean 'good-oven'.*broken-oven"):
        device_kind("good-ovne")


def test_two_packages_with_one_name_are_both_named_and_hinder_no_other(install: Install) -> None:
    install("first", "palpate.devices", {"twin-oven": "twin_a:KIND"})
    install(
        "second",
        "palpate.devices",
        {"twin-oven": "twin_b:KIND", "own-oven": "own_oven:KIND"},
        own_oven=OVEN.format(name="own-oven", product="OO", module="own_oven"),
    )
    with pytest.raises(ConfigError, match=r"^kind of device 'twin-oven': first 1.2 and second 1.2 both have one; unin"):
        device_kind("twin-oven")
    assert device_kind("own-oven").name == "own-oven"
    assert device_kind("positioner").name == "positioner"


def test_a_name_of_ours_cannot_be_taken(install: Install) -> None:
    install("rogue", "palpate.devices", {"positioner": "rogue:KIND"})
    install("rogues", "palpate.procedures", {"sweep-loads": "rogue:Sweep"})
    with pytest.raises(ConfigError, match=r"^kind of device 'positioner' of rogue 1.2: palpate has one of that name"):
        all_kinds()
    with pytest.raises(ConfigError, match=r"^procedure 'sweep-loads' of rogues 1.2: palpate has one of that name"):
        procedure_class("sweep-loads")


@pytest.mark.parametrize(
    ("group", "name", "what"),
    [
        ("palpate.devices", "positioner", "kind of device"),
        ("palpate.designs", "single", "design"),
        ("palpate.effects", "charge_amplifier", "effect"),
        ("palpate.procedures", "sweep-loads", "procedure"),
    ],
)
def test_a_run_does_not_begin_where_a_package_has_the_name_of_something_that_it_uses(
    group: str, name: str, what: str, install: Install, scene: Scene, tmp_path: Path
) -> None:
    install("rogue", group, {name: "rogue:THING"})
    with pytest.raises(ConfigError, match=rf"^{what} '{name}' of rogue 1.2: palpate has one of that name; uninstall"):
        open_and_run(LoadSweep(), Chosen(None, scene), out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


TAKEN = "effect '{}' of rogue 1.2: palpate has one of that name; uninstall that package"


@pytest.mark.slow
def test_what_a_scene_holds_tells_of_effects_with_a_name_of_ours(install: Install, scene: Scene) -> None:
    install("rogue", "palpate.effects", {"charge_amplifier": "rogue:Effect", "hysteresis": "rogue:Effect"})
    warned = plan(scene, Question("2", 3.0, dwell=0.5)).warnings
    assert {TAKEN.format("charge_amplifier"), TAKEN.format("hysteresis")} <= {*warned}


def test_a_study_refuses_an_effect_with_a_name_of_ours(install: Install) -> None:
    install("rogue", "palpate.effects", {"charge_amplifier": "rogue:Effect"})
    study = study_of(StudyFile(name="s", axes={"seed": [1]}), "s.toml")
    with pytest.raises(ConfigError, match=TAKEN.format("charge_amplifier")):
        StudyComputation.of(study, "s.toml").packages(study)


def test_what_is_no_kind_and_what_is_no_procedure_is_refused(install: Install) -> None:
    install("lost", "palpate.devices", {"lost-oven": "lost_thing:THING"}, lost_thing="THING = 3\nclass Odd: ...")
    install("losttoo", "palpate.procedures", {"lost": "lost_thing:THING", "odd": "lost_thing:Odd"})
    with pytest.raises(
        ConfigError, match=r"'lost-oven' of lost 1.2 .*is no DeviceKind whose contract is called 'lost-"
    ):
        device_kind("lost-oven")
    for name in ("lost", "odd"):
        with pytest.raises(ConfigError, match=rf"procedure '{name}' of losttoo 1.2 .*is no Procedure that is called"):
            procedure_class(name)
    assert procedure_class("sweep-loads") is LoadSweep


def test_two_devices_that_identify_themselves_alike_cannot_be_on_one_bench(install: Install, scene: Scene) -> None:
    for name in ("one", "two"):
        module = f"alike_{name}"
        text = OVEN.format(name=f"{name}-oven", product="SAME", module=module)
        install(name, "palpate.devices", {f"{name}-oven": f"{module}:KIND"}, **{module: text})
    alike = "kinds of device 'one-oven' and 'two-oven' both identify themselves as Acme SAME; give one another product"
    with SimulatedBench(scene.with_devices({"a": {"kind": "one-oven"}})) as sim:
        tables = sim.description.model_dump(mode="json", exclude_none=True)
    tables["device"]["b"] = {**tables["device"]["a"], "kind": "two-oven", "unit": 2}
    with pytest.raises(ConfigError, match=alike):
        check(tables, BenchDescription, "bench.toml")
    with pytest.raises(ConfigError, match=alike):
        all_kinds()
