"""What procedures share that measure films under a dynamic load: their work on the bench.

class _Sweeping(Loaded):
    def arrange(self, step):
        self.press(get_sample(step.sample))
    def take(self, step):
        measured = self.measured(step.load_N, step.what, dwell=1.0)
        return Taken(point_of(measured), measured.waveforms(self.lab.design))
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from palpate.drivers.roles import SampleChanger
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.lab.lab import Lab
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import check_loads, preload_for
from palpate.procedures.steps.film_point import DwellChoice, FilmPoint, measure
from palpate.procedures.steps.films import Films
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import LoadServo, check_zero, finish, press, withdraw


class Loaded:
    """Films set up for loads at a frequency, and a servo for the load once the probe presses on something."""

    def __init__(
        self,
        lab: Lab,
        record: Recorder,
        loads: Sequence[float],
        frequency: float,
        samples: Sequence[str] = (),
        extrapolate: bool = False,
    ) -> None:
        """The probe is home and the load cell at its zero when this returns.

        Args:
            loads: N, peak to peak.
            frequency: Hz.
            samples: names of those that will be mounted.
            extrapolate: loads may lie outside the calibrated range.

        Raises:
            UnreachableError, RangeError: as `check_loads`; the outputs have stayed off.
            UnknownName: the bench's sample changer does not hold one of the samples; the outputs have stayed off.
            BenchError: the unloaded cell does not read its zero, or the bench could not.
        """
        check_loads(loads, lab.calibration, extrapolate)
        if changer := lab.bench.maybe(SampleChanger):
            changer.check_holds(samples)
        self.lab, self.record = lab, record
        self.preload = preload_for(loads)
        self.films = Films(lab.bench, lab.design, frequency, self.preload + max(loads) / 2)
        withdraw(lab.bench)
        check_zero(lab.bench, lab.calibration)

    def press(self, sample: Sample) -> None:
        """Have a sample mounted and press on it; outputs are on, at zero. Raises as `press` of the servo."""
        self.hold(press(self.lab.bench, self.lab.calibration, sample, self.preload))

    def hold(self, preloaded: float) -> None:
        """Begin to set loads on top of a static force [N] that has been reached."""
        self.servo = LoadServo(self.lab.bench, self.lab.calibration, self.films.frequency, preloaded)

    def set(self, load: float, what: str) -> None:
        """Drive with a load [N, peak to peak]. Raises as `LoadServo.set`."""
        carry_out(self.lab.bench, what, partial(self.servo.set, load))

    def held(self, load: float, what: str, dwell: float | DwellChoice, compare: bool = True) -> FilmPoint:
        """The films under a load [N, peak to peak] that has been set. Arguments and errors as `measure`."""
        return measure(self.films, self.servo, load, dwell, self.record, what, compare)

    def measured(self, load: float, what: str, dwell: float | DwellChoice, compare: bool = True) -> FilmPoint:
        """The films under a load [N, peak to peak] that is set first. Arguments and errors as `set` and `measure`."""
        self.set(load, what)
        return self.held(load, what, dwell, compare)

    def end(self) -> None:
        """Outputs to zero, the probe home, and the load cell still at its zero. Raises BenchError: it is not."""
        finish(self.lab.bench, self.lab.calibration)
