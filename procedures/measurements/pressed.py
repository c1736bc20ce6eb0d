"""What procedures share that press on a sample with a steady force: their work on the bench."""

from __future__ import annotations

from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.engine.plan import Step
from palpate.procedures.lab.lab import Lab
from palpate.procedures.steps.servo import finish, press, read_indicator


class Pressed:
    """The probe on a sample, with a preload [N]. Each group of steps begins with the sample mounted anew."""

    def __init__(self, lab: Lab, sample: str, force: float) -> None:
        self.lab, self.bench = lab, lab.bench
        self.sample, self.force = get_sample(sample), force

    def arrange(self, _step: Step) -> None:
        """Have the sample mounted and press on it. Raises as `press`."""
        press(self.bench, self.lab.calibration, self.sample, self.force)

    def load(self) -> float:
        """What the load cell reads now [N]. Raises DeviceError."""
        return self.lab.calibration.load(read_indicator(self.bench).reading_mV)[0]

    def end(self) -> None:
        """The probe home, and the load cell still at its zero. Raises BenchError: it is not."""
        finish(self.bench, self.lab.calibration)
