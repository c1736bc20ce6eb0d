"""What a device gives is held to its contract, as what it is given is."""

from __future__ import annotations

from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.instrument.errors import DeviceError
from palpate.simulators.bench import SimulatedBench

MODBUS = [
    ("strain_indicator", "mode", 9.0, r"mode = 9 is no choice; valid: track \(0\), peak_to_peak \(1\)"),
    ("strain_indicator", "decimals", 400.0, "decimals = 400 is outside 0 to 9"),
    ("strain_indicator", "command_result", 77.0, r"command_result = 77 is no choice; valid: none \(0\)"),
    ("shaker_amplifier", "temperature", 3200.0, "temperature = 3200 degC is outside -40 to 150 degC"),
    ("positioner", "limit_high", -1.0, "limit_high = -1 m is outside 0 to 0.025 m"),
    ("signal_generator", "frequency", 30_000.0, "frequency = 30000 Hz is outside 0 to 20000 Hz"),
]
CANOPEN = [
    ("range_1", 9.0, r"range_1 = 9 is no choice; valid: 5 V \(0\), 500 mV \(1\)"),
    ("heartbeat", 65.0, "heartbeat = 65 s is outside 0 to 60 s"),
    ("sync_period", 11.0, "sync_period = 11 s is outside 0.0001 to 10 s"),
    ("emergency_cob_id", 1.0, "emergency_cob_id = 2 is outside 129 to "),
]


def test_a_modbus_value_outside_its_contract_is_refused_with_device_field_value_limit_and_remedy(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    for device, field, value, message in MODBUS:
        driver, simulated = bench.device(device), sim.devices[device]
        with monkeypatch.context() as patch:
            read = simulated.read
            patch.setattr(simulated, "read", lambda name, f=field, v=value, r=read: v if name == f else r(name))
            with pytest.raises(
                DeviceError, match=f"^{driver.name}: reads {message}.*; not used. Set it within"
            ) as seen:
                driver.get(field)
        assert seen.value.device == driver.name


def test_an_object_outside_its_contract_is_refused_where_the_node_is_opened(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    for field, value, message in CANOPEN:
        with monkeypatch.context() as patch:
            patch.setitem(sim.can.nodes[0].settings, field, value)
            with pytest.raises(DeviceError, match=f"^sensor node 1 at .*: reads {message}"):
                bench.device("sensor_node_1").connect()


def test_a_fault_bit_that_the_contract_does_not_name_is_a_fault(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    amplifier: Any = sim.amplifier
    read = amplifier.read
    monkeypatch.setattr(amplifier, "read", lambda name: 512.0 if name == "faults_latched" else read(name))
    assert bench.device("shaker_amplifier").read().faults_latched == {"bit 9"}
