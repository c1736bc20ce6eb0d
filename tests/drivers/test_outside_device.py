"""A package that palpate knows nothing of adds a device: from its kind to bench file, bus log, faults and registers."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.logs.bus_log import BusLog
from palpate.drivers.roles import Chamber, Positioner
from palpate.instrument.additions import load
from palpate.instrument.bench.description import BenchDescription, read_bench
from palpate.instrument.config import check
from palpate.instrument.errors import BenchError, ConfigError, SettingsLost, UnknownName
from palpate.procedures.logs import read_log
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import with_faults
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.device import SimulatedPlace
from tests.drivers.outside import installed


@pytest.fixture
def oven() -> Iterator[None]:
    with installed("oven"):
        yield


@pytest.fixture
def with_oven(oven: None, scene: Scene) -> Scene:
    return scene.with_devices({"oven": {"kind": "acme-oven"}})


def test_a_bench_file_finds_it_the_operator_warms_with_it_and_the_log_names_its_registers(
    with_oven: Scene, nothing_left_behind: None, tmp_path: Path
) -> None:
    file, log = tmp_path / "bench.toml", tmp_path / "log.pcapng"
    with SimulatedBench(with_oven) as sim:
        file.write_text(sim.description.patient().to_toml(), encoding="utf-8")
        bench = Bench(read_bench(file), sim.clock, sim.operator)
        with BusLog(bench, sim.clock, log, datetime(2026, 11, 22, tzinfo=UTC)), bench:
            bench.operator.set_temperature(12.5)
            assert bench.role(Chamber) is bench.device("oven")
            assert bench.device("oven").temperature() == 32.5
            assert bench.devices[-1].serial == "SIM-OV-0001"
            sim.devices["oven"].turn({"setpoint": 20.0})
            with pytest.raises(SettingsLost, match=r"oven at .*: setpoint is 20, was set to 32\.5"):
                bench.check_settings()
        assert bench.description.devices == sim.description.devices
    said = [(line.who, line.text) for line in read_log(log) if line.who.startswith("oven")]
    assert ("oven (acme-oven)", "<- write setpoint = 32.5 degC, heater = on") in said
    assert ("oven (acme-oven)", "-> temperature = 32.5 degC") in said


def test_its_faults_strike_it_and_what_it_cannot_have_is_refused(with_oven: Scene) -> None:
    stuck = with_faults(with_oven, [{"kind": "stuck_reading", "on": "oven", "at": "1 s"}])
    with SimulatedBench(stuck) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        sim.clock.wait(2.0)
        bench.device("oven").warm(5.0)
        assert bench.device("oven").temperature() == 20.0
    for kind in ("over_current", "bit_error", "node_reboot", "bridge_open"):
        with pytest.raises(ConfigError, match=f"unknown place of a {kind} 'oven'"):
            with_faults(with_oven, [{"kind": kind, "on": "oven", "at": "1 s"}])


def test_a_device_that_is_optional_may_be_absent_and_another_may_not(with_oven: Scene, closed_port: int) -> None:
    with SimulatedBench(with_oven) as sim:
        tables: dict[str, Any] = tomllib.loads(sim.description.to_toml())
        tables["link"]["oven"]["port"] = closed_port
        absent = check(tables, BenchDescription, "here")
        with pytest.raises(BenchError, match="nothing answers at"), Bench(absent, sim.clock, sim.operator):
            pass
        tables["device"]["oven"]["optional"] = True
        person = Mock(sim.operator)
        with Bench(check(tables, BenchDescription, "here"), sim.clock, person) as bench:
            assert bench.maybe(Chamber) is None
            assert bench.role(Positioner) is bench.device("positioner")
            assert bench.cautions[0].startswith(f"oven is not used: nothing answers at 127.0.0.1:{closed_port}")
            with pytest.raises(BenchError, match="has no chamber; add a"):
                bench.role(Chamber)
            with pytest.raises(UnknownName, match="unknown device of this bench 'oven'"):
                bench.device("oven")
            bench.operator.set_temperature(12.5)
            person.set_temperature.assert_called_once_with(12.5)


def test_a_simulated_device_finds_the_one_that_the_scene_gives_a_role_and_is_told_where_nobody_fills_it(
    with_oven: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_oven = with_oven.with_devices(
        {"spare": {"kind": "acme-oven"}, "oven": {"kind": "acme-oven", "role": "chamber"}}
    )
    places: list[SimulatedPlace] = []
    oven = load(with_oven.devices[0].kind.simulator or "", "oven")
    made = oven.at
    monkeypatch.setattr(oven, "at", lambda place: (places.append(place), made(place))[1])
    with SimulatedBench(with_oven) as sim:
        assert places[0].find("chamber") is sim.devices["oven"]
        with pytest.raises(BenchError, match="the simulated bench has no probe_stage; list a device"):
            places[0].find("probe_stage")


def test_a_can_bus_whose_devices_are_all_optional_may_be_absent(scene: Scene) -> None:
    with SimulatedBench(scene) as sim:
        tables: dict[str, Any] = tomllib.loads(sim.description.to_toml())
        tables["link"] = {"far": {"kind": "canopen", "interface": "socketcan", "channel": "none"}}
        tables["device"] = {"spare": {"kind": "sensor_node", "link": "far", "node": 9, "optional": True}}
        with Bench(check(tables, BenchDescription, "here"), sim.clock, sim.operator) as bench:
            assert bench.cautions[0].startswith("spare is not used: CAN bus socketcan:none cannot be opened")
            bench.check_settings()


WRONG = {
    'kind = "acme-ovne"': "device.oven: unknown kind of device 'acme-ovne' (did you mean 'acme-oven'?)",
    'kind = "acme-oven"\nlink = "line"': "device.oven: link: a acme-oven needs a link of kind modbus-tcp",
    'kind = "acme-oven"\nlimt = 3': "device.oven: limt: unknown key",
    'kind = "acme-oven"\nrole = "positioner"': "device.oven: unknown role of a acme-oven 'positioner'; valid: chamber",
    'kind = "acme-oven"\nnode = 4': "device.oven: a device on link oven needs a unit and must have no node",
}


@pytest.mark.parametrize("section", WRONG)
def test_a_wrong_section_is_named_with_key_and_remedy(section: str, with_oven: Scene) -> None:
    with SimulatedBench(with_oven) as sim:
        tables: dict[str, Any] = tomllib.loads(sim.description.to_toml())
    tables["device"]["oven"] |= tomllib.loads(section)
    with pytest.raises(ConfigError) as caught:
        check(tables, BenchDescription, "bench.toml")
    assert str(caught.value).startswith(f"bench.toml: {WRONG[section]}")


def test_two_that_could_fill_a_role_need_a_word_of_who_does(oven: None, scene: Scene) -> None:
    two = {"one": {"kind": "acme-oven"}, "two": {"kind": "acme-oven"}}
    with pytest.raises(ConfigError, match='one and two can each be the chamber; write role = "chamber" below one'):
        SimulatedBench(scene.with_devices(two)).__enter__()
    two["two"]["role"] = "chamber"
    with SimulatedBench(scene.with_devices(two)) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        assert bench.role(Chamber) is bench.device("two")
        assert [bench.device(name).serial for name in two] == ["SIM-OV-0001", "SIM-OV-0002"]
