"""The bench work that procedures share: films under a dynamic load, and a probe that holds a steady force."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from palpate.drivers.roles import LoadIndicator, SampleChanger
from palpate.instrument.errors import DeviceError
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.procedures.engine.plan import Step
from palpate.procedures.lab.lab import Lab
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import check_loads, preload_for
from palpate.procedures.steps.film_point import DwellChoice, FilmPoint, measure
from palpate.procedures.steps.films import Films
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.probe import check_zero, finish, press, withdraw
from palpate.procedures.steps.servo import LoadServo, read_indicator

# --- The bench work that all procedures with films under a dynamic load share --------------------------
#
# class _Sweeping(DynamicLoadWork):
#     def arrange(self, step):
#         self.press(get_sample(step.sample))
#     def take(self, step):
#         measured = self.measured(step.load_N, step.what, dwell=1.0)
#         return Measurement(point_of(measured), measured.waveforms(self.lab.design))


class DynamicLoadWork:
    """Films set up for loads at a frequency, and a servo for the load once the probe presses on a sample."""

    def __init__(
        self,
        lab: Lab,
        record: Recorder,
        loads: Sequence[float],
        frequency: float,
        samples: Sequence[str] = (),
        extrapolate: bool = False,
    ) -> None:
        """Set the films up, move the probe home, and check the load cell's zero.

        Args:
            lab: the open bench.
            record: the record of the run.
            loads: all loads, peak to peak [N].
            frequency: frequency of the load [Hz].
            samples: names of the samples that will be mounted.
            extrapolate: whether loads may lie outside the calibrated range.

        Raises:
            UnreachableError, RangeError: as `check_loads` raises them, or a device cannot work with loads of this
                frequency; the outputs stay off.
            UnknownName: the bench's sample changer does not hold one of the samples; the outputs stay off.
            BenchError: the unloaded load cell does not read zero, or a device fails.
        """
        check_loads(loads, lab.calibration, extrapolate)
        lab.bench.check_frequency(frequency)
        if changer := lab.bench.maybe(SampleChanger):
            changer.check_holds(samples)
        self.lab, self.record = lab, record
        self.preload = preload_for(loads)
        self.films = Films(lab.bench, lab.design, frequency, self.preload + max(loads) / 2)
        withdraw(lab.bench)
        check_zero(lab.bench, lab.calibration)

    def press(self, sample: Sample) -> None:
        """Have a sample mounted and press on it; the outputs are then on, at zero. Raises as the servo's `press`."""
        self.hold(press(self.lab.bench, self.lab.calibration, sample, self.preload))

    def hold(self, preloaded: float) -> None:
        """Begin to set loads on top of a static force that has been reached [N]."""
        self._set_last: float | None = None
        self.servo = LoadServo(self.lab.bench, self.lab.calibration, self.films.frequency, preloaded)

    def set(self, load: float, what: str, anew: bool = False) -> None:
        """Drive with a load [N, peak to peak]. Arguments and errors as `LoadServo.set`."""
        self._set_last = load
        carry_out(self.lab.bench, what, partial(self.servo.set, load, anew))

    def held(self, load: float, what: str, dwell: float | DwellChoice, compare: bool = True) -> FilmPoint:
        """Measure the films under a load [N, peak to peak] that has been set. Arguments and errors as `measure`."""
        return measure(self.films, self.servo, load, dwell, self.record, what, compare)

    def again(self, load: float, what: str, dwell: float | DwellChoice) -> FilmPoint:
        """Make a new load set of the load [N, peak to peak] that was set last, and measure the films under it.

        It is quicker than `measured`: the drive goes off and back to its known amplitude, and the load cell is read
        once. Raises as `measure`.
        """
        carry_out(self.lab.bench, what, self.servo.again)
        return measure(self.films, self.servo, load, dwell, self.record, what, quick=True)

    def measured(self, load: float, what: str, dwell: float | DwellChoice, compare: bool = True) -> FilmPoint:
        """Set a load [N, peak to peak] and measure the films under it. Arguments and errors as `set` and `measure`."""
        self.set(load, what)
        return self.held(load, what, dwell, compare)

    def load_set(self, load: float, what: str, dwell: float | DwellChoice, compare: bool = True) -> FilmPoint:
        """As `measured`, for a list of loads: the load that was set last becomes a load set of its own."""
        self.set(load, what, anew=load == self._set_last)
        return self.held(load, what, dwell, compare)

    def end(self) -> None:
        """Set the outputs to zero, move the probe home, and check the zero again. Raises BenchError: it has moved."""
        finish(self.lab.bench, self.lab.calibration)


# --- The bench work that all procedures with a steady force on a sample share --------------------------


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
