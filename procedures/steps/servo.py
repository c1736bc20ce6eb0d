"""Bringing the load to where it should be: preload with the positioner, dynamic load with the shaker."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from palpate.drivers.bench import Bench
from palpate.drivers.roles import Exciter, LoadIndicator, Positioner, Reading, SampleChanger
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import BenchError, DeviceError, SafetyError, UnreachableError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.steps.policy import carry_out

READINGS = 4  # averaged: the display's own noise dithers its steps
READING_INTERVAL = 0.1  # s, the display is renewed ten times a second
PATIENCE = 50  # readings that are waited for a stable one: a bench on a busy machine is later than its filters say
TRACK_FILTER = 0.1  # s
TRACK_SETTLING = 0.8  # s, until a filtered reading counts as stable
UNLOADING = 2.0  # s, until nothing of the last load is left in the filter
APPROACH_STEP = 2e-3  # m
CONTACT = 0.3  # N, surely more than noise
ZERO_TOLERANCE = 3.0  # standard uncertainties
PRELOAD_TOLERANCE = 0.05  # of the preload
PRELOAD_STEPS = 40
FIRST_AMPLITUDE = 0.25  # V
LARGEST_GROWTH = 3.0  # of the amplitude, in one servo step
SERVO_STEPS = 10
LOAD_TOLERANCE = 0.01  # of the load; never finer than 0.6 of the indicator's resolution
RESERVE = 0.95  # of the exciter's limit


@dataclass(frozen=True, slots=True)
class IndicatorMean:
    """Mean reading in mV, and whether each of the readings was valid."""

    reading_mV: float
    valid: bool


def steady(bench: Bench, watch: Callable[[float], None] = lambda _: None) -> Reading:
    """The indicator's reading as soon as it is stable; the last one, where it is sick or never becomes stable.

    Args:
        watch: is called with each reading [mV] that is waited through, and raises where the force is too great.
    """
    indicator = bench.role(LoadIndicator)
    reading = indicator.read()
    for _ in range(PATIENCE):
        if reading.stable or reading.sick:
            break
        watch(reading.reading_mV)
        bench.clock.wait(READING_INTERVAL)
        reading = indicator.read()
    return reading


def read_indicator(
    bench: Bench, count: int = READINGS, watch: Callable[[float], None] = lambda _: None
) -> IndicatorMean:
    """Mean of `count` successive displays, each waited for as by `steady`."""
    readings = []
    for number in range(count):
        if number:
            bench.clock.wait(READING_INTERVAL)
        readings.append(steady(bench, watch))
    mean = math.fsum(r.reading_mV for r in readings) / count
    return IndicatorMean(mean, all(r.valid for r in readings))


def check_zero(bench: Bench, calibration: LoadCellCalibration) -> None:
    """Clear the tare, and see that the unloaded cell reads what the calibration says; the probe is home.

    Raises:
        BenchError: it reads something else, so that every load and the force limit would be off.
        DeviceError: it gives no valid reading.
    """
    carry_out(bench, "zero of the load cell", lambda: _check_zero(bench, calibration))


def withdraw(bench: Bench) -> None:
    """Outputs to zero, and the probe home."""
    carry_out(bench, "probe home", lambda: _withdraw(bench))


def finish(bench: Bench, calibration: LoadCellCalibration) -> None:
    """As `withdraw`; then the load cell must still read its zero, or the loads since the start are in doubt.

    Raises:
        BenchError: it does not.
    """
    withdraw(bench)
    bench.clock.wait(UNLOADING)
    try:
        check_zero(bench, calibration)
    except BenchError as error:
        error.add_note("the zero has moved since the start: loads of this run are in doubt")
        raise


def _check_zero(bench: Bench, calibration: LoadCellCalibration) -> None:
    indicator = bench.role(LoadIndicator)
    indicator.clear_tare()
    indicator.track(TRACK_FILTER)
    bench.clock.wait(TRACK_SETTLING)
    reading = read_indicator(bench)
    if not reading.valid:
        name = indicator.name
        raise DeviceError(f"{name}: no valid reading without load; let the bench come to rest, check it", device=name)
    allowed = ZERO_TOLERANCE * math.hypot(calibration.zero_u, calibration.resolution_mV)
    if not abs(reading.reading_mV - calibration.zero_mV) <= allowed:
        raise BenchError(
            f"{indicator.name}: reads {reading.reading_mV:.4g} mV without load, the calibration "
            f"({calibration.source}) says {calibration.zero_mV:.4g} ± {allowed:.2g} mV; take the load off, or run "
            "palpate calibrate load-cell"
        )


def preload(bench: Bench, calibration: LoadCellCalibration, force: float) -> float:
    """Lower the probe until it presses with `force` N; returns the force in N.

    Goes on in steps to contact, then by the slope of the last two readings, never more than one step at once.

    Raises:
        UnreachableError: the positioner's travel ends before.
        SafetyError: the force passes the bench's limit; the probe goes home.
    """
    indicator, positioner = bench.role(LoadIndicator), bench.role(Positioner)
    indicator.track(TRACK_FILTER)
    travel = positioner.travel()
    position, load = 0.0, 0.0

    def within_limit(reading_mV: float) -> None:
        pressed = calibration.load(reading_mV)[0]
        if not pressed <= bench.force_limit:
            positioner.home()
            raise SafetyError(f"preload of {pressed:.3g} N passes the bench's force limit of {bench.force_limit:g} N")

    before: tuple[float, float] | None = None
    for _ in range(PRELOAD_STEPS):
        step = APPROACH_STEP
        if before is not None and abs(load - before[1]) > 2 * calibration.resolution():
            step = (force - load) * (position - before[0]) / (load - before[1])
            step = max(-APPROACH_STEP, min(step, APPROACH_STEP))
        if position + step > travel:
            break
        before = (position, load) if load > CONTACT else None
        position += step
        positioner.move(position)
        bench.clock.wait(TRACK_SETTLING)
        reading = read_indicator(bench, watch=within_limit)
        if not reading.valid:
            name = indicator.name
            raise DeviceError(f"{name}: no valid reading at {1e3 * position:.3f} mm; check the bridge", device=name)
        within_limit(reading.reading_mV)
        load = calibration.load(reading.reading_mV)[0]
        if abs(load - force) <= max(PRELOAD_TOLERANCE * force, 0.6 * calibration.resolution()):
            return load
    raise UnreachableError(
        f"a preload of {force:.3g} N is not reached: {load:.3g} N at {1e3 * position:.3f} mm, and the positioner "
        f"ends at {1e3 * travel:.3f} mm; ask for smaller loads or mount a stiffer sample"
    )


def press(bench: Bench, calibration: LoadCellCalibration, sample: Sample, force: float) -> float:
    """Have a sample mounted, press the probe on it with a static force in N, and switch the outputs on, at zero.

    Returns the force reached. Raises as `preload`, and what the operator raises.
    """
    withdraw(bench)
    mount(bench, sample)
    return lower(bench, calibration, force, f"sample {sample.name}")


def mount(bench: Bench, sample: Sample) -> None:
    """Have a sample mounted by the sample changer, or where there is none by a person; the probe stands at home.

    Raises:
        UnknownName: the changer does not hold it. BenchError: it could not, or nobody does it.
    """
    if bench.maybe(SampleChanger) is None:
        bench.operator.mount(sample)
    else:
        carry_out(bench, f"mounting of sample {sample.name}", lambda: bench.operator.mount(sample))


def lower(bench: Bench, calibration: LoadCellCalibration, force: float, onto: str) -> float:
    """As `press`, on what lies under the probe already, which stands at home."""
    reached = carry_out(bench, f"preload of {show(force, 'N')} on {onto}", lambda: preload(bench, calibration, force))
    carry_out(bench, "outputs on", bench.drive)
    return reached


def _withdraw(bench: Bench) -> None:
    bench.rest()
    bench.role(Positioner).home()


def window(frequency: float) -> float:
    """Over which the indicator takes a peak-to-peak value: three cycles of a frequency in Hz [s]."""
    return min(10.0, max(0.5, 3 / frequency))


class LoadServo:
    """Sets peak-to-peak loads by the exciter's amplitude, and learns the stack's response on the way."""

    def __init__(self, bench: Bench, calibration: LoadCellCalibration, frequency: float, preloaded: float) -> None:
        """`frequency` in Hz; `preloaded` is the static force in N, which counts towards the force limit."""
        self._bench = bench
        self.calibration = calibration
        self._frequency = frequency
        self._preloaded = preloaded
        self._window = window(frequency)
        self._amplitude = 0.0
        self._volts_per_newton: float | None = None
        self._exciter, self._indicator = bench.role(Exciter), bench.role(LoadIndicator)
        self._indicator.peak_to_peak(self._window)
        self._limit = self._exciter.effort_limit()

    def set(self, load: float) -> float:
        """Drive with `load` N peak to peak; returns the measured load.

        Raises:
            SafetyError: the force passes the bench's limit; the outputs are off before this is raised.
            UnreachableError: the exciter cannot give it, or it does not settle.
        """
        tolerance = max(LOAD_TOLERANCE * load, 0.6 * self.calibration.resolution())
        measured = math.nan
        for _ in range(SERVO_STEPS):
            self._step(load)
            measured = self._checked(self._mean())
            if measured > max(3 * self.calibration.resolution(), 0.1 * load):
                self._volts_per_newton = self._amplitude / measured
            if abs(measured - load) <= tolerance:
                return measured
        raise UnreachableError(
            f"{load:g} N peak to peak is not reached in {SERVO_STEPS} steps: {measured:.3g} N at "
            f"{show(self._amplitude, 'V')}; check the mounting of the sample"
        )

    @property
    def amplitude(self) -> float:
        """Of the exciter's sine [V], peak."""
        return self._amplitude

    def watch(self) -> None:
        """Read the force once, between steps of something that takes long.

        Raises:
            SafetyError, DeviceError: the force passes the limit, or no valid reading; outputs are off.
        """
        self._checked(self._mean(1))

    def read(self) -> IndicatorMean:
        """The indicator's reading under the load. Raises SafetyError, DeviceError as `watch`."""
        reading = self._mean()
        self._checked(reading)
        return reading

    def _step(self, load: float) -> None:
        if self._volts_per_newton is None:
            amplitude = LARGEST_GROWTH * self._amplitude or FIRST_AMPLITUDE
        else:
            amplitude = self._volts_per_newton * load
            self._check_reach(load, amplitude)
            if self._amplitude:
                amplitude = min(amplitude, LARGEST_GROWTH * self._amplitude)
        if amplitude > self._exciter.largest:
            raise UnreachableError(
                f"{load:g} N peak to peak is not reached: no load appears at {show(self._amplitude, 'V')} from the "
                "exciter; check amplifier, shaker and mounting"
            )
        self._amplitude = amplitude
        self._exciter.sine(self._frequency, amplitude)
        self._bench.clock.wait(self._window + READING_INTERVAL)

    def _check_reach(self, load: float, amplitude: float) -> None:
        if amplitude > self._exciter.largest:
            raise UnreachableError(
                f"{load:g} N peak to peak needs {amplitude:.3g} V from the exciter, which gives "
                f"{self._exciter.largest:g} V; ask for a smaller load or raise the amplifier's gain"
            )
        if not self._amplitude:
            return
        effort = self._exciter.effort() * amplitude / self._amplitude
        if effort > RESERVE * self._limit:
            raise UnreachableError(
                f"{load:g} N peak to peak needs {effort:.3g} {self._exciter.unit} from the exciter, whose limit is "
                f"{self._limit:g} {self._exciter.unit}; ask for a smaller load or mount a stiffer sample"
            )

    def _mean(self, count: int = READINGS) -> IndicatorMean:
        return read_indicator(self._bench, count, self._unstable)

    def _checked(self, reading: IndicatorMean) -> float:
        """The load in N of a reading that is valid and within the force limit.

        Too much force is too much in a reading that is not stable, too.
        """
        self._within_limit(reading.reading_mV)
        if not reading.valid:
            self._bench.rest()
            name = self._indicator.name
            raise DeviceError(
                f"{name}: no valid reading while driving; outputs are off. Check the bridge and the mounting of the "
                "sample",
                device=name,
            )
        return self.calibration.load(reading.reading_mV)[0]

    def _unstable(self, reading_mV: float) -> None:
        """A load that still changes is one too great, or of a device that has lost its settings, or of a slow bench.

        Raises SafetyError, and what `Bench.check_settings` raises.
        """
        self._within_limit(reading_mV)
        self._bench.check_settings()

    def _within_limit(self, reading_mV: float) -> None:
        if not math.isfinite(reading_mV):
            return
        greatest = self._preloaded + self.calibration.load(reading_mV)[0] / 2
        if greatest > self._bench.force_limit:
            self._bench.rest()
            raise SafetyError(
                f"force of {greatest:.3g} N passes the bench's limit of {self._bench.force_limit:g} N; outputs are off."
                " Check the mounting of the sample"
            )
