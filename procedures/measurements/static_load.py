"""The bench work that all procedures with a steady force on a sample share."""

from __future__ import annotations

from palpate.drivers.roles import LoadIndicator
from palpate.instrument.errors import DeviceError
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.engine.plan import Step
from palpate.procedures.lab.lab import Lab
from palpate.procedures.steps.indicator import read_indicator
from palpate.procedures.steps.probe import finish, press


class StaticLoadWork:
    """Presses on a sample with a preload [N]. Each group of steps begins with mounting the sample again."""

    def __init__(self, lab: Lab, sample: str, force: float) -> None:
        self.lab, self.bench = lab, lab.bench
        self.sample, self.force = get_sample(sample), force

    def arrange(self, _step: Step) -> None:
        """Have the sample mounted and press on it. Raises as `press`."""
        press(self.bench, self.lab.calibration, self.sample, self.force)

    def load(self) -> float:
        """Force that the load cell reads now [N]. Raises DeviceError: there is no valid reading."""
        reading = read_indicator(self.bench)
        if not reading.valid:
            name = self.bench.role(LoadIndicator).name
            raise DeviceError(f"{name}: no valid reading under load: {reading.wrong}; check the bridge", device=name)
        return self.lab.calibration.load(reading.reading_mV)[0]

    def end(self) -> None:
        """Move the probe home and check the load cell's zero. Raises BenchError: it has moved."""
        finish(self.bench, self.lab.calibration)
