"""The bench opens with what the bench file says or not at all."""

from __future__ import annotations

import inspect
import re
from dataclasses import replace
from typing import Any

import pytest
from pymodbus.pdu import ModbusPDU

from palpate.drivers import bench as bench_module
from palpate.drivers import bench as fitted
from palpate.drivers import ownership
from palpate.drivers.bench import Bench
from palpate.instrument.bench.kinds import KINDS
from palpate.instrument.contracts.contract import Identity
from palpate.instrument.errors import BenchError, IdentityError, LinkError, SafetyError
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from tests.drivers.benches import altered, driving, is_closed, open_bench

# --- opening -------------------------------------------------------------------------------------------


def test_an_opened_bench_has_its_outputs_off_and_its_watchdog_set(sim: SimulatedBench) -> None:
    sim.generator.settings.update(amplitude=3.0, output=1.0)
    sim.amplifier.settings.update(enable=1.0)
    with open_bench(sim):
        assert not driving(sim)
        assert sim.amplifier.settings["watchdog"] == sim.description.watchdog == 2.0


def test_the_devices_are_those_of_the_bench_file(bench: Bench) -> None:
    assert [device.serial for device in bench.devices] == [
        "SIM-SG-0001", "SIM-PA-0001", "SIM-SI-0001", "SIM-MP-0001", "20260101",
    ]  # fmt: skip


@pytest.mark.parametrize("index", range(4))
def test_another_device_at_an_address_is_refused_and_the_rest_closed_again(
    index: int, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated = [sim.generator, sim.amplifier, sim.indicator, sim.positioner][index]
    stranger = replace(simulated.contract, identity=Identity("Acme", "XY-9", "1.0"))
    monkeypatch.setattr(simulated, "contract", stranger)
    bench = open_bench(sim)
    with pytest.raises(IdentityError, match=f"{stranger.title} at .*Acme XY-9 1.0"):
        bench.__enter__()
    assert is_closed(bench)
    monkeypatch.undo()
    with bench:
        assert bench.simulated


def test_a_port_that_nobody_listens_on_is_named_and_the_rest_closed_again(
    sim: SimulatedBench, closed_port: int
) -> None:
    description = sim.description
    elsewhere = altered(description, link={"shaker_amplifier": {"port": closed_port}})
    bench = open_bench(sim, elsewhere)
    with pytest.raises(
        LinkError,
        match=rf"nothing answers at 127.0.0.1:{closed_port}: .*refuses .*correct port in \[link.shaker_amplifier\]",
    ):
        bench.__enter__()
    assert is_closed(bench)


def test_a_bench_whose_opening_fails_leaves_the_outputs_off(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bench that was left driving must not go on because one device of it cannot be opened."""
    sim.generator.settings.update(amplitude=3.0, output=1.0)
    sim.amplifier.settings.update(enable=1.0)
    sim.nodes[0].settings["product"] = 7.0
    with pytest.raises(IdentityError):
        open_bench(sim).__enter__()
    assert not driving(sim)


def test_a_stranger_is_not_written_to(sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch) -> None:
    stranger = replace(sim.amplifier.contract, identity=Identity("Acme", "XY-9", "1.0"))
    monkeypatch.setattr(sim.amplifier, "contract", stranger)
    written: list[Any] = []
    monkeypatch.setattr(sim.amplifier, "write", written.append)
    with pytest.raises(IdentityError):
        open_bench(sim).__enter__()
    assert written == []


def test_an_amplifier_that_tripped_is_refused_with_its_fault(sim: SimulatedBench) -> None:
    sim.amplifier._latched = 0b1
    with pytest.raises(SafetyError, match=r"shaker amplifier .* tripped on over_current"):
        open_bench(sim).__enter__()


# --- simulated or not ----------------------------------------------------------------------------------


def test_a_simulated_bench_says_so_over_the_wire(bench: Bench) -> None:
    assert bench.simulated
    assert all(device.simulated for device in bench.devices)


def test_devices_that_do_not_call_themselves_simulated_are_taken_for_real(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def real(sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending and hasattr(pdu, "information"):
            del pdu.information[6]
        return pdu

    for device in (
        bench.device("signal_generator"),
        bench.device("shaker_amplifier"),
        bench.device("strain_indicator"),
        bench.device("positioner"),
    ):
        monkeypatch.setattr(device.link.client.transaction, "trace_pdu", real)
        device.connect()
        assert not device.simulated
    assert bench.simulated
    read = sim.nodes[0].read
    monkeypatch.setattr(sim.nodes[0], "read", lambda f: "1.0" if f.name == "hardware_version" else read(f))
    bench.device("sensor_node_1").connect()
    assert not bench.simulated


def test_mounting_a_sample_needs_the_probe_at_home(bench: Bench) -> None:
    bench.operator.mount(SAMPLES["2"])
    bench.device("positioner").move(5e-3)
    with pytest.raises(BenchError, match="stands at 5 mm: move it home"):
        bench.operator.mount(SAMPLES["3"])


def test_the_bench_names_no_device() -> None:
    """It is made of what its file lists: no kind, and no module of a kind, stands in its source."""
    for module in (bench_module, fitted, ownership):
        source = inspect.getsource(module)
        assert [name for name in KINDS if name in source] == []
        assert set(re.findall(r"devices\.(\w+) import", source)) <= {"device", "exciter", "exciter_kinds"}
