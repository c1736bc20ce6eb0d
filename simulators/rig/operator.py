"""The simulated operator: does each task without waiting for anybody, and lets the bench's clock run on meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, Protocol

from palpate.instrument.errors import BenchError
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.rig.rig import Rig

MOUNTING = 60.0  # s, for a task under the probe, and to turn the load cell [A]
PLACING = 10.0  # s, to place a weight or to set the temperature [A]


class OwnTime(Protocol):
    """The clock on which the operator's work takes time."""

    lock: AbstractContextManager[Any]

    def wait(self, duration: float) -> None: ...


class SimulatedOperator:
    """A `palpate.instrument.bench.operator.Operator` who changes the simulated rig."""

    def __init__(self, rig: Rig, clock: OwnTime) -> None:
        self._rig = rig
        self._clock = clock

    def mount(self, sample: Sample) -> None:
        self._under_the_probe(lambda: self._rig.mount(sample))

    def lay_on_support(self, sample: Sample | None) -> None:
        self._under_the_probe(lambda: self._rig.lay_on_support(sample))

    def place_probe(self, x: float, y: float) -> None:
        self._under_the_probe(lambda: self._rig.place_probe(x, y))

    def press_tooth(self, tooth: int) -> None:
        self._under_the_probe(lambda: self._rig.press_tooth(tooth))

    def place_weight(self, mass: float) -> None:
        self._clock.wait(PLACING)
        with self._clock.lock:
            self._rig.place_weight(mass)

    def turn_load_cell(self, degrees: float) -> None:
        self._clock.wait(MOUNTING)
        with self._clock.lock:
            self._rig.turn_load_cell(degrees)

    def set_temperature(self, kelvin: float) -> None:
        self._clock.wait(PLACING)
        with self._clock.lock:
            self._rig.set_temperature(kelvin)

    def _under_the_probe(self, put: Callable[[], None]) -> None:
        self._clock.wait(MOUNTING)
        with self._clock.lock:
            if self._rig.position > 0:
                raise BenchError(
                    f"the probe stands at {1e3 * self._rig.position:g} mm: move it home before mounting a sample"
                )
            put()

    def confirm_device(self, what: str, label: str) -> None:
        """A simulated device is what its bench says."""
