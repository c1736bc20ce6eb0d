"""What the suites for all kinds of devices share: a simulated bench with the device, opened once for all tests."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import can
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.canopen_device import CanopenDevice
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.bench.description import read_bench
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.config import read_data
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import Field, Value
from palpate.instrument.errors import BenchError
from palpate.procedures.testing.wire import Wire, transfers
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.fault import places, struck
from palpate.simulators.planning.settle import read_scene, with_faults
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.canopen_device import SimulatedNode
from palpate.simulators.wire.device import SimulatedDevice

# --- Test values of a contract's field: at its limits, between them, and just beyond them --------------

RAW_LIMITS = {
    "uint8": (0, 2**8 - 1), "int8": (-(2**7), 2**7 - 1), "uint16": (0, 2**16 - 1), "int16": (-(2**15), 2**15 - 1),
    "uint32": (0, 2**32 - 1), "int32": (-(2**31), 2**31 - 1),
}  # fmt: skip


def settings(contract: Contract) -> list[Field]:
    """Numeric fields that keep what is written; a command register does not, because it returns to idle."""
    return [f for f in contract.fields if f.access == "rw" and "idle" not in f.choices and f.type != "text"]


def writable(contract: Contract) -> list[Field]:
    """Fields that can be written."""
    return [f for f in contract.fields if f.access != "ro"]


def inside(field: Field) -> list[Value]:
    """Allowed values: every choice, or both limits and a value between them."""
    if field.choices:
        return list(field.choices)
    if field.type == "text":
        return ["", "x" * field.length, "weiß 日本"]
    assert field.minimum is not None
    assert field.maximum is not None
    middle = round((0.4 * field.minimum + 0.6 * field.maximum) / field.scale) / (1 / field.scale)
    return [field.minimum, field.maximum, middle]


def outside(field: Field) -> list[Value]:
    """Values to refuse: one step beyond each limit, and values that are no finite number."""
    if field.type == "text":
        return ["x" * (field.length + 1), "ß" * (field.length // 2) + "x", "a\0b", "\x1b[2J", "\udcff"]
    beyond: list[Value] = [math.nan, math.inf, -math.inf, "nonsense"]
    if field.choices:
        return [*beyond, min(field.choices.values()) - 1, max(field.choices.values()) + 1]
    assert field.minimum is not None
    assert field.maximum is not None
    return [*beyond, field.minimum - abs(field.scale), field.maximum + abs(field.scale)]


def outside_raw(field: Field) -> list[tuple[int, bool]]:
    """Raw values to refuse: one step beyond each limit if the type can hold that; with each, whether it is too high."""
    if field.type == "text":
        return [(int.from_bytes(data.ljust(field.length, b"\0")), True) for data in (b"\xff", b"\x1b[2J", b"a\0b")]
    limits = list(field.choices.values()) or [round(x / field.scale) for x in (field.minimum or 0, field.maximum or 0)]
    low, high = RAW_LIMITS[field.type]
    beyond = [(min(limits) - 1, False), (max(limits) + 1, True)]
    return [(raw, too_high) for raw, too_high in beyond if low <= raw <= high]


def number(field: Field, value: Value) -> float:
    """The number of a value, which may be the name of a choice."""
    return field.choices[value] if isinstance(value, str) else value


# --- A scene whose bench has one additional device, for the conformance suites -------------------------

NAME = "device"


@functools.cache
def guest_scene(kind: str) -> Scene:
    """The scene thesis_single with an additional device of a kind, in its first role; none if `kind` is empty."""
    scene = read_scene("thesis_single")
    if not kind:
        return scene
    roles = device_kind(kind).roles
    return scene.with_devices({NAME: {"kind": kind, **({"role": roles[0]} if roles else {})}})


# --- the shared bench ----------------------------------------------------------------------------------

T = TypeVar("T")


def first(found: Sequence[T], what: str) -> T:
    """The first element; skips the test if there is none, because the device cannot be tested for this."""
    if not found:
        pytest.skip(f"the contract has no {what}")
    return found[0]


class Conformance:
    """A driver and its simulator on a bench."""

    kind: ClassVar[str] = ""  # device kind of an installed package; tests of palpate's own devices override `ends`

    @staticmethod
    def ends(bench: Bench, sim: SimulatedBench) -> tuple[Any, Any]:
        """The driver and the simulator that are tested."""
        return bench.device(NAME), sim.devices[NAME]

    @pytest.fixture(scope="class")
    @classmethod
    def sim(cls) -> Iterator[SimulatedBench]:
        with SimulatedBench(guest_scene(cls.kind)) as simulated:
            yield simulated

    @pytest.fixture(scope="class")
    @classmethod
    def listener(cls, sim: SimulatedBench) -> Iterator[Any]:
        """A listener that joins the link before the drivers do, where a suite needs one."""
        yield None

    @pytest.fixture(scope="class")
    @classmethod
    def bench(cls, sim: SimulatedBench, listener: Any) -> Iterator[Bench]:
        """One bench for all tests of a device; each test leaves it unchanged."""
        with Bench(sim.description, sim.clock, sim.operator) as opened:
            yield opened

    @pytest.fixture
    def simulated(self, bench: Bench, sim: SimulatedBench) -> Any:
        return self.ends(bench, sim)[1]


# --- Tests driver and simulator against golden frames, which were written by hand from the device's manual


class GoldenFrames:
    """Added to a Modbus conformance suite: each register must travel as in the golden frames.

    A scale, sign or width that is wrong in the contract is wrong in driver and simulator, and passes every other test.

    Attributes:
        golden: a TOML file with a frame for each field of the contract.
    """

    golden: ClassVar[Path]

    def test_every_register_travels_as_its_golden_frame(
        self, device: ModbusDevice, simulated: SimulatedDevice, wire: Wire, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        fields: dict[str, Any] = read_data(self.golden)["fields"]
        assert set(fields) == {field.name for field in device.contract.fields}
        for name, golden in fields.items():
            field, value = device.contract[name], golden["value"]
            if field.bits:
                value = sum(1 << field.bits[bit] for bit in value)
            if "write" in golden:
                device.set(**{name: value})
                assert wire.requests[-1] == bytes.fromhex(golden["write"]), name
            else:
                with monkeypatch.context() as patch:
                    patch.setattr(simulated, "read", {name: value}.__getitem__)
                    patch.setattr(device, "_last_count", 0)  # so that the driver reads this register alone
                    assert device.get(name) == value
                frames = (wire.requests[-1], wire.replies[-1])
                assert frames == (bytes.fromhex(golden["request"]), bytes.fromhex(golden["response"])), name


class CanopenGoldenFrames:
    """Added to the CANopen conformance suite: each object must travel in the SDO frames that stand in `golden`."""

    golden: ClassVar[Path]

    def test_every_object_travels_as_its_golden_frames(
        self,
        node: CanopenDevice,
        simulated: SimulatedNode,
        listener: can.BusABC,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        fields: dict[str, Any] = read_data(self.golden)["fields"]
        assert set(fields) == {field.name for field in node.contract.fields}
        for name, golden in fields.items():
            field, value = node.contract[name], golden.get("value")
            if "text" in golden:
                assert node._text(field.address) == golden["text"]
                requests, answers = transfers(listener, node.id)  # what is read twice travels alike
                assert requests[: len(golden["requests"])] == _frames(golden["requests"])
                assert answers[: len(golden["responses"])] == _frames(golden["responses"])
            elif "write" in golden:
                node.set(name, value)
                assert transfers(listener, node.id)[0] == _frames([golden["write"]]), name
            else:
                number = sum(1 << field.bits[bit] for bit in value) if field.bits else value
                raw = round(number / field.scale)
                with monkeypatch.context() as patch:
                    patch.setattr(simulated, "read", lambda _field, raw=raw: raw)
                    assert node.get(name) == number
                assert transfers(listener, node.id) == (_frames([golden["request"]]), _frames([golden["response"]])), (
                    name
                )


def _frames(texts: list[str]) -> list[bytes]:
    return [bytes.fromhex(text) for text in texts]


# --- Tests that a device kind of an installed package must pass on a bench with the usual devices ------

STRIKES = 4  # number of the request that a fault strikes; the first ones identify the device
LONG = 10.0  # s, in which a node sends more heartbeats than that


class OnTheBench:
    """A bench file finds the device, and each fault that can strike it causes at most an error that names it."""

    kind: ClassVar[str]

    def test_a_bench_file_finds_it(self, tmp_path: Path) -> None:
        file = tmp_path / "bench.toml"
        with SimulatedBench(guest_scene(self.kind)) as sim:
            file.write_text(sim.description.patient().to_toml(), encoding="utf-8")
            with Bench(read_bench(file), sim.clock, sim.operator) as bench:
                assert bench.device(NAME).serial
                assert bench.simulated

    def test_what_can_go_wrong_with_it_is_noticed_and_named(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from palpate.simulators.faults import inject

        monkeypatch.setattr(inject, "TIMEOUT", "0.3 s")
        scene = guest_scene(self.kind)
        standing = [place for place in places(0, scene.devices) if place.name == NAME]
        kinds = [kind for kind in FAULTS if kind != "front_panel" and struck(fault_class(kind).targets, standing)]
        assert kinds, f"no fault can strike a {self.kind}"
        for kind in kinds:
            faulty = with_faults(scene, [{"kind": kind, "on": NAME, "transaction": STRIKES}])
            with SimulatedBench(faulty) as sim:
                try:
                    with Bench(sim.description, sim.clock, sim.operator) as bench:
                        bench.clock.wait(LONG)
                        for _ in range(2 * STRIKES):
                            bench.device(NAME).get("probe")
                except BenchError as error:
                    assert device_kind(self.kind).contract.title in str(error), kind
                assert sim.injection.given[0].summary().endswith("once"), kind
