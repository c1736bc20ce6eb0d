"""What the suites for all kinds of devices share: a simulated bench with the device, opened once for all tests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, TypeVar

import pytest

from palpate.drivers.bench import Bench
from palpate.procedures.testing.guest import NAME, guest_scene
from palpate.simulators.bench import SimulatedBench

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
