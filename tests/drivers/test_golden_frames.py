"""Every field against bytes that were written down by hand, in the contract and on the wire.

A scale, sign, width or word order that is wrong in the contract is wrong at both ends of the wire, and
passes every test that only talks to itself.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from palpate.drivers.devices.exciter import ShakerAmplifier
from palpate.extend import Bench, Contract, ModbusDevice, Scene, SimulatedDevice
from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.field import Field, Value
from palpate.instrument.contracts.own import SYNC_COB_ID
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.testing.wire import frames, listen, payloads, transfers
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.devices.exciter import AmplifierOwner

GOLDEN = {
    path.stem: tomllib.loads(path.read_text(encoding="utf-8"))
    for path in (Path(__file__).parents[1] / "golden").glob("*.toml")
}
MODBUS = [contract.name for contract in CONTRACTS.values() if contract.bus == "modbus"]
NODE = CONTRACTS["sensor_node"]
NODE_FRAMES = GOLDEN["sensor_node"]["fields"]
NUMBERS = [name for name, golden in NODE_FRAMES.items() if "value" in golden]
TEXTS = [name for name, golden in NODE_FRAMES.items() if "text" in golden]
UPLOAD_OF_DOWNLOAD = {0x23: 0x43, 0x2B: 0x4B, 0x2F: 0x4F}  # four, two, one byte


def bits(text: str) -> bytes:
    return bytes.fromhex(text)


def physical(field: Field, value: Value | list[str]) -> float:
    """The number behind a choice or a set of bits."""
    if isinstance(value, str):
        return field.choices[value]
    if isinstance(value, list):
        return sum(1 << field.bits[bit] for bit in value)
    return value


def means(contract: Contract, name: str, number: float, value: Value | list[str]) -> bool:
    if isinstance(value, str):
        return contract.choice(name, number) == value
    if isinstance(value, list):
        return contract.set_bits(name, number) == set(value)
    return number == value


def read_exchange(field: Field, golden: dict[str, Any]) -> tuple[bytes, bytes]:
    """Request and response PDU of a read; where the golden frame is a write, the same data comes back."""
    if "write" not in golden:
        return bits(golden["request"]), bits(golden["response"])
    written = bits(golden["write"])
    data = written[6:]
    return b"\x03" + written[1:5], bytes([3, len(data)]) + data


@pytest.fixture
def sim(nothing_left_behind: None, scene: Scene) -> Iterator[SimulatedBench]:
    """A bench with every device that it may have."""
    with SimulatedBench(scene, samples=[get_sample("3")]) as simulated:
        yield simulated


@pytest.fixture
def pair(bench: Bench, sim: SimulatedBench, device: str) -> tuple[ModbusDevice, Any]:
    return bench.device(device), sim.devices[device]


@pytest.fixture
def listener(sim: SimulatedBench) -> Iterator[can.BusABC]:
    """Joins the bus before the drivers do: when a driver has its answer, the listener has it too."""
    with can.Bus(interface="virtual", channel=sim.description.links["can"].channel) as bus:
        yield bus


@pytest.fixture
def node_bench(listener: can.BusABC, bench: Bench) -> Bench:
    frames(listener)
    return bench


@pytest.mark.parametrize("device", CONTRACTS)
def test_every_field_and_every_process_data_object_has_a_golden_frame_and_no_other_has(device: str) -> None:
    contract, golden = CONTRACTS[device], GOLDEN[device]
    assert set(golden["fields"]) == {field.name for field in contract.fields}
    assert set(golden.get("pdo", ())) == {pdo.name for pdo in contract.pdos}


@pytest.mark.parametrize("device", MODBUS)
def test_driver_and_simulator_exchange_the_golden_frames_of_all_registers(
    device: str, pair: tuple[ModbusDevice, SimulatedDevice], monkeypatch: pytest.MonkeyPatch
) -> None:
    driver, simulated = pair
    if isinstance(driver, ShakerAmplifier):
        driver.release()  # an owner writes orders: see below
    taken: list[dict[str, float]] = []
    monkeypatch.setattr(simulated, "write", taken.append)
    wire = listen(driver.link, monkeypatch)
    for field in driver.contract.fields:
        golden = GOLDEN[device]["fields"][field.name]
        if "write" in golden:
            driver.set(**{field.name: golden["text"] if "text" in golden else golden["value"]})
            written = bits(golden["write"])
            assert (wire.requests[-1], wire.replies[-1]) == (written, written[:5]), field.name
        if field.type == "text" and field.access == "ro":
            with monkeypatch.context() as patch:
                patch.setattr(simulated, "read_text", {field.name: golden["text"]}.__getitem__)
                assert driver.get_text(field.name) == golden["text"]
            assert (wire.requests[-1], wire.replies[-1]) == read_exchange(field, golden), field.name
        elif field.access != "wo":
            value = physical(field, golden["value"])
            with monkeypatch.context() as patch:
                patch.setattr(simulated, "read", {field.name: value}.__getitem__)
                patch.setattr(driver, "_last_count", 0)  # as if it were the first: nothing else is read with it
                number = driver.get(field.name)
            assert (wire.requests[-1], wire.replies[-1]) == read_exchange(field, golden), field.name
            assert means(driver.contract, field.name, number, golden["value"])
    assert len(wire.requests) == sum(2 if field.access == "rw" else 1 for field in driver.contract.fields)


def test_the_owner_of_the_amplifier_writes_the_golden_orders(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    amplifier, golden = bench.device("shaker_amplifier"), GOLDEN["shaker_amplifier"]["owner"]
    amplifier.release()
    monkeypatch.setattr(sim.amplifier, "_owner", AmplifierOwner())  # which begins with the golden ticket
    wire = listen(amplifier.link, monkeypatch)
    assert amplifier.claim()
    amplifier.feed()
    amplifier.set(gain=12.34)
    amplifier.enable()
    amplifier.disable()
    amplifier.release()
    assert wire.requests[1:] == [bits(frame) for frame in golden.values()]
    assert wire.replies[1:] == [bits(frame)[:5] for frame in golden.values()]


@pytest.mark.parametrize("device", MODBUS)
def test_the_identity_travels_as_the_golden_frame(
    device: str, pair: tuple[ModbusDevice, SimulatedDevice], monkeypatch: pytest.MonkeyPatch
) -> None:
    driver, _ = pair
    golden = GOLDEN[device]["identity"]
    wire = listen(driver.link, monkeypatch)
    driver.connect()
    assert (wire.requests[0], wire.replies[0]) == (bits(golden["request"]), bits(golden["response"]))
    identity = driver.contract.identity
    assert [golden["objects"][i] for i in "012"] == [identity.vendor, identity.product, identity.revision]
    assert driver.serial == golden["objects"]["128"]
    assert driver.simulated


def test_a_driver_writes_the_golden_frames_of_all_objects(node_bench: Bench, listener: can.BusABC) -> None:
    for name in (name for name in NUMBERS if NODE[name].access != "ro"):
        golden = NODE_FRAMES[name]
        node_bench.device("sensor_node_1").set(name, golden["value"])
        written = bits(golden["write"])
        assert transfers(listener, 1) == ([written], [b"\x60" + written[1:4] + bytes(4)]), name


def test_a_node_answers_with_the_golden_frames_of_all_objects(
    node_bench: Bench, sim: SimulatedBench, listener: can.BusABC
) -> None:
    node = sim.nodes[0]
    for name in (name for name in NUMBERS if NODE[name].access != "wo"):
        golden, field = NODE_FRAMES[name], NODE[name]
        if name.startswith("sample_") and name != "sample_counter":
            node._last = np.full(4, golden["value"])
        else:
            shared = node.id if name in ("tpdo1_cob_id", "tpdo2_cob_id", "emergency_cob_id") else 0
            node.settings[name] = physical(field, golden["value"]) - shared
        number = node_bench.device("sensor_node_1").get(name)
        if "write" in golden:
            written = bits(golden["write"])
            request, response = b"\x40" + written[1:4] + bytes(4), bytes([UPLOAD_OF_DOWNLOAD[written[0]]]) + written[1:]
        else:
            request, response = bits(golden["request"]), bits(golden["response"])
        assert transfers(listener, 1) == ([request], [response]), name
        assert means(NODE, name, number, golden["value"])


def test_a_text_travels_in_the_golden_segments(node_bench: Bench, listener: can.BusABC) -> None:
    """The driver reads a text twice, because its segments do not say which object they belong to."""
    for name in TEXTS:
        golden = NODE_FRAMES[name]
        assert node_bench.device("sensor_node_1")._text(NODE[name].address) == golden["text"]
        segments = tuple(2 * [bits(text) for text in golden[way]] for way in ("requests", "responses"))
        assert transfers(listener, 1) == segments, name


def test_samples_travel_as_the_golden_process_data_objects(
    node_bench: Bench, sim: SimulatedBench, listener: can.BusABC, monkeypatch: pytest.MonkeyPatch
) -> None:
    golden, driver = GOLDEN["sensor_node"]["pdo"], node_bench.device("sensor_node_1")
    saturated = golden["stamp"]["values"]["saturation"]
    volts = [
        volt + (f"channel_{channel}" in saturated) * np.sign(volt)
        for channel, volt in enumerate(golden["samples"]["volts"], 1)
    ]
    monkeypatch.setattr(sim.nodes[0]._inputs, "_added", {})
    monkeypatch.setattr(sim.nodes[0], "film_channels", np.eye(4))
    monkeypatch.setattr(sim.rig, "film_voltages", lambda time_ns, _: np.outer(volts, np.ones(len(time_ns))))
    driver.arm()
    listener.send(can.Message(arbitration_id=SYNC_COB_ID, is_extended_id=False))
    assert driver.get("sample_counter") == golden["stamp"]["values"]["sample_counter"]
    sent = frames(listener)
    for pdo in golden.values():
        assert payloads(sent, pdo["cob_id"]) == [bits(pdo["frame"])]
    recording = driver.collect(1)
    assert recording.voltage[:, 0].tolist() == golden["samples"]["volts"]
    assert [f"channel_{channel}" for channel in range(1, 5) if recording.saturated[channel - 1, 0]] == saturated
