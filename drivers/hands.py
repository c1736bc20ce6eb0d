"""The operator of a bench with devices that do some of a person's work."""

from __future__ import annotations

from typing import Any

from palpate.drivers.fitted import Fitted
from palpate.drivers.roles import Chamber, ProbeStage, SampleChanger
from palpate.drivers.safe_end import insist
from palpate.instrument.bench.operator import Operator, mount_anew
from palpate.instrument.sensor.sample import Sample


class Hands:
    """A `palpate.instrument.bench.operator.Operator` that passes each task to a device or else to the person.

    The device is looked up at each task, because an optional device may be left out when the bench is opened.
    """

    def __init__(self, person: Operator, bench: Fitted) -> None:
        self._person, self._bench = person, bench
        self._warmed: Any = None  # the chamber, once it was told to warm
        self.place_weight = person.place_weight
        self.turn_load_cell = person.turn_load_cell

    def mount(self, sample: Sample) -> None:
        if changer := self._bench.maybe(SampleChanger):
            changer.mount(sample.name)
        else:
            self._person.mount(sample)

    def mount_anew(self, sample: Sample) -> None:
        """As `mount`, for a sample that may lie there already. A changer leaves it alone then."""
        if self._bench.maybe(SampleChanger):
            self.mount(sample)
        else:
            mount_anew(self._person, sample)

    def lay_on_support(self, sample: Sample | None) -> None:
        self._free_changer()
        self._person.lay_on_support(sample)

    def press_tooth(self, tooth: int) -> None:
        self._free_changer()
        self._person.press_tooth(tooth)

    def place_probe(self, x: float, y: float) -> None:
        (self._bench.maybe(ProbeStage) or self._person).place_probe(x, y)

    def set_temperature(self, kelvin: float) -> None:
        if chamber := self._bench.maybe(Chamber):
            self._warmed = chamber
            chamber.warm(kelvin)
        else:
            self._person.set_temperature(kelvin)

    def confirm_device(self, what: str, label: str) -> None:
        self._person.confirm_device(what, label)

    @property
    def has_warmed(self) -> bool:
        """Whether a chamber was told to warm the sensor."""
        return self._warmed is not None

    def chamber_off(self, within: float) -> str:
        """Switch off the chamber that has warmed the sensor; returns a message if that fails, else an empty text.

        `within`: time for which that is tried again [s].
        """
        self._warmed.broken = ""
        for failure in insist([self._warmed.off], self._bench.clock, within):
            return f"{self._warmed.name} could not be switched off: {failure}; switch it off by hand, now"
        return ""

    def _free_changer(self) -> None:
        if changer := self._bench.maybe(SampleChanger):
            changer.leave()
