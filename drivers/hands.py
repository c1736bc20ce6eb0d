"""The operator of a bench with devices that do some of a person's work."""

from __future__ import annotations

from palpate.drivers.roles import Chamber, ProbeStage, SampleChanger
from palpate.instrument.bench.operator import Operator
from palpate.instrument.sensor.sample import Sample


class Hands:
    """A `palpate.instrument.bench.operator.Operator` that passes each task to a device or else to the person."""

    def __init__(
        self, person: Operator, changer: SampleChanger | None, chamber: Chamber | None, stage: ProbeStage | None
    ) -> None:
        self._person = person
        self._changer = changer
        self.set_temperature = chamber.warm if chamber else person.set_temperature
        self.place_probe = stage.place_probe if stage else person.place_probe
        self.place_weight = person.place_weight
        self.turn_load_cell = person.turn_load_cell

    def mount(self, sample: Sample) -> None:
        if self._changer:
            self._changer.mount(sample.name)
        else:
            self._person.mount(sample)

    def lay_on_support(self, sample: Sample | None) -> None:
        if self._changer:
            self._changer.leave()
        self._person.lay_on_support(sample)

    def press_tooth(self, tooth: int) -> None:
        if self._changer:
            self._changer.leave()
        self._person.press_tooth(tooth)
