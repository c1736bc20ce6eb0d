"""Packages that palpate knows nothing of add an oven and an exciter: from kind to bench file, bus log and faults."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from palpate.drivers.logs.bus_log import BusLog
from palpate.extend import (
    Bench,
    BenchDescription,
    Chamber,
    Exciter,
    ModbusDevice,
    Positioner,
    Scene,
    read_bench,
    read_scene,
)
from palpate.instrument.additions import load
from palpate.instrument.config import check
from palpate.instrument.errors import BenchError, ConfigError, LinkError, SettingsLost, UnknownName
from palpate.procedures.logs import read_log
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.faults.fault import parse_faults, places
from palpate.simulators.wire.device import DEVICE_FAILURE, Refused, SimulatedPlace
from tests.drivers.benches import installed
from tests.drivers.test_bench import Failure

pytestmark = pytest.mark.usefixtures("foreground")


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
            assert (bench.device("oven").temperature(), bench.devices[-1].serial) == (32.5, "SIM-OV-0001")
            sim.devices["oven"].turn({"setpoint": 20.0})
            with pytest.raises(SettingsLost, match=r"oven at .*: setpoint is 20, was set to 32\.5"):
                bench.check_settings()
        assert bench.description.devices == sim.description.devices
    said = [(line.who, line.text) for line in read_log(log) if line.who.startswith("oven")]
    assert ("oven (acme-oven)", "<- write setpoint = 32.5 degC, heater = on") in said
    assert ("oven (acme-oven)", "-> temperature = 32.5 degC") in said


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


# --- an exciter without a watchdog ---------------------------------------------------------------------


ON, OFF = (1.0, 1.0), (0.0, 0.0)


@pytest.fixture(scope="module")
def sim() -> Iterator[SimulatedBench]:
    with installed("exciter"), SimulatedBench(exciting()) as simulated:
        yield simulated


def exciting() -> Scene:
    return read_scene("thesis_single").with_devices({"shaker": {"kind": "acme-exciter"}})


def opened(sim: SimulatedBench) -> Bench:
    """A bench of the exciter alone, which is opened soon."""
    told = tomllib.loads(sim.description.to_toml())
    alone = {key: told[key] for key in ("name", "watchdog", "link", "device")}
    return Bench(check(alone, BenchDescription, "here"), sim.clock, sim.operator)


def drive(bench: Bench) -> None:
    bench.drive()
    bench.role(Exciter).sine(10.0, 1.0)


def output(sim: SimulatedBench) -> tuple[float, float]:
    """Output stage and amplitude."""
    settings = sim.devices["shaker"].settings
    return settings["output"], settings["amplitude"]


def written(sim: SimulatedBench, folder: Path, changes: dict[str, Any]) -> Path:
    """The bench file with other values at its top; None: a key is left out."""
    tables: dict[str, Any] = {**tomllib.loads(sim.description.to_toml()), **changes}
    file = folder / "bench.toml"
    import tomli_w

    file.write_text(tomli_w.dumps({key: value for key, value in tables.items() if value is not None}), encoding="utf-8")
    return file


# --- what the bench file says --------------------------------------------------------------------------


@pytest.mark.parametrize("watchdog", [None, "2 s"])
def test_it_does_not_drive_unless_the_file_says_that_it_has_no_watchdog(
    watchdog: str | None, sim: SimulatedBench, tmp_path: Path
) -> None:
    asked = sim.servers.transactions
    refused = r'bench\.toml: watchdog: shaker has none, so that nothing .* write watchdog = "none" at the top'
    with pytest.raises(ConfigError, match=refused):
        read_bench(written(sim, tmp_path, {"watchdog": watchdog}))
    assert sim.servers.transactions == asked
    assert read_bench(written(sim, tmp_path, {"watchdog": "none"})).to_toml() == sim.description.to_toml()


def test_a_bench_whose_amplifier_has_a_watchdog_cannot_be_without(scene: Scene, tmp_path: Path) -> None:
    with SimulatedBench(scene) as usual:
        with pytest.raises(ConfigError, match='watchdog: shaker_amplifier has one; write its time, such as "2 s"'):
            read_bench(written(usual, tmp_path, {"watchdog": "none"}))
        with pytest.raises(ConfigError, match=r"watchdog.*inf"):
            read_bench(written(usual, tmp_path, {"watchdog": "inf s"}))


def test_a_bench_has_one_exciter_which_is_not_optional(sim: SimulatedBench, tmp_path: Path) -> None:
    usual = tomllib.loads(sim.description.to_toml())
    link = {**usual["link"], "rack": {"kind": "modbus-tcp", "host": "10.0.0.1"}}
    pair = {
        name: {"kind": name, "link": "rack", "unit": unit}
        for unit, name in enumerate(("signal_generator", "shaker_amplifier"), 1)
    }
    both = {"link": link, "device": {**usual["device"], **pair}}
    with pytest.raises(ConfigError, match="shaker drives, and signal_generator with shaker_amplifier as well; a bench"):
        read_bench(written(sim, tmp_path, both))
    with pytest.raises(ConfigError, match=r"device\.shaker: optional: what drives cannot be left out"):
        read_bench(
            written(
                sim,
                tmp_path,
                {"device": {**usual["device"], "shaker": {**usual["device"]["shaker"], "optional": True}}},
            )
        )


def test_a_driver_that_is_no_exciter_or_whose_guard_is_not_that_of_its_contract_is_refused(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    import acme_exciter  # type: ignore[import-not-found]

    with monkeypatch.context() as patch:
        patch.setattr(acme_exciter.AcmeExciter, "guard", object())
        with pytest.raises(ConfigError, match="driver and contract do not agree whether it has a watchdog"):
            opened(sim)

    class Plain(ModbusDevice):
        contract = acme_exciter.CONTRACT

    monkeypatch.setattr(acme_exciter, "AcmeExciter", Plain)
    with pytest.raises(ConfigError, match=r"exciter at .*: its driver is no palpate\.drivers\.roles\.Exciter"):
        opened(sim)


def test_what_it_replaces_cannot_fail(sim: SimulatedBench) -> None:
    on = [{"kind": "no_reply", "on": "signal_generator", "at": "1 s"}]
    with pytest.raises(ConfigError, match="unknown place of a no_reply 'signal_generator'"):
        parse_faults(on, places(sim.scene.nodes, sim.scene.devices), "here")


# --- on every way out ----------------------------------------------------------------------------------


def test_it_drives_and_is_looked_at_while_somebody_waits_and_is_off_in_the_end(sim: SimulatedBench) -> None:
    with opened(sim) as bench:
        drive(bench)
        assert output(sim) == ON
        asked = sim.servers.transactions
        bench.clock.wait(10.0)
        assert sim.servers.transactions == asked + 10
        assert bench.role(Exciter).effort() == pytest.approx(2.0 / sim.rig.scene.rig.coil_resistance, abs=1e-3)
    assert output(sim) == OFF
    assert not sim.rig.coil_voltage().amplitude.any()


def test_one_that_a_killed_program_left_driving_stops_before_any_other_link_is_opened(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cannot() -> None:
        seen.append(output(sim))
        raise LinkError("no such line")

    seen: list[tuple[float, float]] = []
    with sim.clock.lock:
        sim.devices["shaker"].write({"amplitude": 1.0, "output": 1.0})
    bench = Bench(sim.description, sim.clock, sim.operator)
    monkeypatch.setattr(bench.links["line"], "open", cannot)
    with pytest.raises(LinkError, match="no such line"):
        bench.__enter__()
    assert seen == [OFF]


@pytest.mark.parametrize("error", [Failure, KeyboardInterrupt])
def test_it_is_off_after_whatever_is_raised(error: type[BaseException], sim: SimulatedBench) -> None:
    with pytest.raises(error), opened(sim) as bench:
        drive(bench)
        raise error
    assert output(sim) == OFF


def test_where_it_cannot_be_switched_off_a_person_is_told_to(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: object) -> None:
        raise Refused(DEVICE_FAILURE)

    told = r"outputs could not all be switched off: exciter at .*It has no watchdog: switch it off by hand, now"
    with pytest.raises(BenchError, match=told), opened(sim) as bench:
        drive(bench)
        monkeypatch.setattr(sim.devices["shaker"], "write", refuse)


def test_what_goes_on_when_the_program_dies_is_told_before_it_drives(sim: SimulatedBench) -> None:
    with opened(sim) as bench:
        assert bench.cautions == [
            f"{bench.device('shaker').name}: has no watchdog, so that nothing switches it off when this program is"
            " killed or a cable is cut; stay beside it"
        ]
