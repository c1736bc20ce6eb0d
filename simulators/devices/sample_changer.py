"""Simulated sample changer: puts the ordered sample under the probe, and reads the tag of the sample there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from palpate.instrument.contracts.own import PLACES, SAMPLE_CHANGER, TRAVEL
from palpate.instrument.errors import RangeError
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.rig import Rig
from palpate.simulators.wire.device import (
    DEVICE_BUSY,
    DEVICE_FAILURE,
    ILLEGAL_VALUE,
    Refused,
    SimulatedDevice,
    SimulatedPlace,
)


class SimulatedSampleChanger(SimulatedDevice):
    """The sample changer. A new sample is mounted when the carriage stops; until then nothing lies under the probe.

    The rig knows the sample under the probe. The tag reader therefore also sees a sample that was mounted by hand.
    """

    contract = SAMPLE_CHANGER

    @classmethod
    def at(cls, place: SimulatedPlace) -> Self:
        return cls(place.clock, place.serial, place.rig, place.samples)

    def __init__(self, clock: VirtualClock, serial: str, rig: Rig, samples: Sequence[Sample]) -> None:
        """Raises RangeError: there are more samples than places."""
        if len(samples) > PLACES:
            raise RangeError(
                f"{len(samples)} samples do not fit into the {PLACES} places of a sample changer; give fewer"
            )
        super().__init__(clock, serial)
        self._rig = rig
        self._places = {f"place_{number}": sample for number, sample in enumerate(samples, 1)}
        self._ordered: Sample | None = None
        self._end_ns = NEVER

    def read(self, name: str) -> float:
        if name == "exchanges":
            return self._rig.exchanges
        if name == "status":
            bits = self.contract["status"].bits
            return float(
                ((self._ordered is not None) << bits["moving"]) | ((self._rig.position > 0) << bits["probe_down"])
            )
        return super().read(name)

    def read_text(self, name: str) -> str:
        found = self._rig.sample if name == "mounted" else self._places.get(name)
        return found.name if found else ""

    def write_text(self, name: str, text: str) -> None:
        sample = next((sample for sample in self._places.values() if sample.name == text), None)
        if self._ordered is not None:
            raise Refused(DEVICE_BUSY)
        if sample is None:
            raise Refused(ILLEGAL_VALUE)
        if self._rig.position > 0:
            raise Refused(DEVICE_FAILURE)
        if self._rig.sample == sample:
            return
        self._rig.take_off()
        self._ordered = sample
        self._end_ns = self.clock.now_ns() + round(TRAVEL / self.settings["speed"] * 1e9)

    def reset(self) -> None:
        """Power-on stops the carriage: a sample on its way is not mounted."""
        self._ordered, self._end_ns = None, NEVER
        super().reset()

    def next_event_ns(self) -> int:
        return self._end_ns

    def advance(self, start_ns: int, end_ns: int) -> None:
        if end_ns >= self._end_ns and self._ordered is not None:
            sample, self._ordered, self._end_ns = self._ordered, None, NEVER
            self._rig.mount(sample)
