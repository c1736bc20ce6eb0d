"""What the suites for all kinds of devices share: a simulated bench with the device, opened once for all tests."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, TypeVar

import pytest

from palpate.drivers.bench import Bench
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.contracts.contract import Contract, Field, Value
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene

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
