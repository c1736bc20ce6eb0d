"""A lab's own exciter, which has no watchdog: it drives only where the file says so, and is off on every way out."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.exciter import Exciter
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.bench.description import BenchDescription, read_bench
from palpate.instrument.config import check
from palpate.instrument.errors import BenchError, ConfigError, LinkError
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.faults.fault import parse_faults, places
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.device import DEVICE_FAILURE, Refused
from tests.drivers.outside import installed
from tests.drivers.test_bench_ends import Failure

pytestmark = pytest.mark.usefixtures("foreground")
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
