"""The dynamic load: the amplitude of the exciter is set by what the load cell reads."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NoReturn

from palpate.drivers.devices.exciter import Exciter
from palpate.drivers.roles import LoadIndicator, is_difference, made_u, why_invalid
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import DeviceError, SafetyError, UnreachableError
from palpate.instrument.quantity import show

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench
    from palpate.drivers.roles import Reading

# --- Reading the load indicator: when a display counts, and the mean of several ------------------------

READINGS = 4  # are averaged: the display's own noise dithers its steps
READING_INTERVAL = 0.1  # s; the display is renewed ten times a second
PATIENCE = 50  # readings to wait for a stable one: on a busy machine the bench is later than its filters say
TRACK_FILTER = 0.1  # s
TRACK_SETTLING = 0.8  # s, until a filtered reading counts as stable


@dataclass(frozen=True, slots=True)
class IndicatorMean:
    """A mean reading [mV]. It is valid if every one of its readings was.

    Attributes:
        wrong: why it is not valid; empty: it is.
        difference: whether it is the difference of two loads, so that it holds no zero.
        u_mV: standard uncertainty from how its readings were made, the same in all of them, beside that of the display.
    """

    reading_mV: float
    wrong: str = ""
    difference: bool = False
    u_mV: float = 0.0

    @property
    def valid(self) -> bool:
        return not self.wrong


def steady(bench: Bench, watch: Callable[[float], None] = lambda _: None) -> Reading:
    """Wait until the indicator's reading is stable and return it. A sick device's reading is returned at once.

    After `PATIENCE` readings the last one is returned, stable or not.

    Args:
        bench: the open bench.
        watch: is called with each reading [mV] that is not stable, and raises where the force is too great.
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
    """Mean of `count` successive displays. Each is waited for as in `steady`."""
    readings = []
    for number in range(count):
        if number:
            bench.clock.wait(READING_INTERVAL)
        readings.append(steady(bench, watch))
    mean = math.fsum(r.reading_mV for r in readings) / count
    u_mV = math.fsum(made_u(r) for r in readings) / count
    wrong = next(filter(None, map(why_invalid, readings)), "")
    return IndicatorMean(mean, wrong, is_difference(readings[0]), u_mV)


# --- the servo -----------------------------------------------------------------------------------------

FIRST_AMPLITUDE = 0.25  # V
LARGEST_GROWTH = 3.0  # of the amplitude, in one servo step
SERVO_STEPS = 10
LOAD_TOLERANCE = 0.01  # of the load; never finer than 0.6 of the indicator's resolution
RESERVE = 0.95  # of the exciter's limit
RELEASED = 1.0  # cycles without a drive between two load sets


def window(frequency: float) -> float:
    """Time over which the indicator takes a peak-to-peak value [s]: three cycles of a frequency [Hz], within limits."""
    return min(10.0, max(0.5, 3 / frequency))


class LoadServo:
    """Sets peak-to-peak loads by the exciter's amplitude, and learns the stack's response on the way."""

    def __init__(self, bench: Bench, calibration: LoadCellCalibration, frequency: float, preloaded: float) -> None:
        """Prepare the indicator for peak-to-peak readings.

        Args:
            bench: the open bench, with its outputs on.
            calibration: calibration of the load cell.
            frequency: frequency of the loads [Hz].
            preloaded: static force that the probe presses with [N]; it counts towards the force limit.

        Raises RangeError: a device cannot work with loads of this frequency.
        """
        self._bench = bench
        self.calibration = calibration
        self._frequency = frequency
        self._preloaded = preloaded
        self._window = window(frequency)
        self._amplitude = 0.0
        self._volts_per_newton: float | None = None
        self._exciter, self._indicator = bench.role(Exciter), bench.role(LoadIndicator)
        bench.check_frequency(frequency)
        self._indicator.peak_to_peak(self._window)
        self._limit = self._exciter.effort_limit()

    def set(self, load: float, anew: bool = False) -> float:
        """Drive until the load cell reads `load` [N, peak to peak]. Returns the measured load [N].

        Args:
            load: the load.
            anew: whether the drive goes off first, so that the load that it has already becomes a new load set.

        Raises:
            SafetyError: the force passes the bench's limit; the outputs are off.
            DeviceError: the indicator gives no valid reading; the outputs are off.
            UnreachableError: the exciter cannot give this load, or the load does not settle.
        """
        tolerance = max(LOAD_TOLERANCE * load, 0.6 * self.calibration.resolution())
        measured = math.nan
        if anew:
            self._release()
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

    def again(self) -> None:
        """Make a new load set of the load that was set last: the drive goes off, then back to its known amplitude.

        The load cell need not tell the amplitude anew. Look at the force with `glance` while the films settle.
        """
        self._release()
        self._exciter.sine(self._frequency, self._amplitude)

    def _release(self) -> None:
        """Switch the drive off for a moment."""
        self._exciter.sine(self._frequency, 0.0)
        self._bench.clock.wait(RELEASED / self._frequency)

    @property
    def amplitude(self) -> float:
        """Peak of the exciter's sine [V]."""
        return self._amplitude

    def watch(self) -> None:
        """Read the force once. Call it from time to time while something takes long.

        Raises:
            SafetyError: the force passes the bench's limit; the outputs are off.
            DeviceError: the indicator gives no valid reading; the outputs are off.
        """
        self._checked(self._mean(1))

    def glance(self) -> None:
        """As `watch`, but take the present reading, whether it is stable already or not."""
        reading = self._indicator.read()
        whole = self._whole(IndicatorMean(reading.reading_mV, reading.sick, is_difference(reading)))
        self._within_limit(whole.reading_mV)
        if not whole.valid:
            self._give_up(whole.wrong)

    def read(self, count: int = READINGS) -> IndicatorMean:
        """Mean of `count` readings of the indicator under the load. Raises SafetyError, DeviceError as `watch`."""
        reading = self._mean(count)
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
                "exciter; check it, the shaker and the mounting"
            )
        self._amplitude = amplitude
        self._exciter.sine(self._frequency, amplitude)
        self._bench.clock.wait(self._window + READING_INTERVAL)

    def _check_reach(self, load: float, amplitude: float) -> None:
        if amplitude > self._exciter.largest:
            raise UnreachableError(
                f"{load:g} N peak to peak needs {amplitude:.3g} V from the exciter, which gives "
                f"{self._exciter.largest:g} V; ask for a smaller load or raise the exciter's gain"
            )
        if not self._amplitude:
            return
        effort = self._exciter.effort() * amplitude / self._amplitude
        if effort > RESERVE * self._limit:
            raise UnreachableError(
                f"{load:g} N peak to peak needs {effort:.3g} {self._exciter.unit} from the exciter, above "
                f"{100 * RESERVE:g} % of its limit of {self._limit:g} {self._exciter.unit}; ask for a smaller load or "
                "mount a stiffer sample"
            )

    def _mean(self, count: int = READINGS) -> IndicatorMean:
        return self._whole(read_indicator(self._bench, count, self._unstable))

    def _whole(self, mean: IndicatorMean) -> IndicatorMean:
        """A mean reading with the zero of the calibration in it, which a difference of two loads lacks."""
        if not mean.difference:
            return mean
        return replace(mean, reading_mV=mean.reading_mV + self.calibration.zero_mV)

    def _checked(self, reading: IndicatorMean) -> float:
        """The load [N] of a reading. Raises SafetyError, DeviceError as `watch`.

        The force limit holds for readings that are not valid, too.
        """
        self._within_limit(reading.reading_mV)
        if not reading.valid:
            self._give_up(reading.wrong)
        return self.calibration.load(reading.reading_mV)[0]

    def _give_up(self, why: str) -> NoReturn:
        """Switch the outputs off, because the load is not known. Raises DeviceError."""
        self._bench.rest()
        name = self._indicator.name
        raise DeviceError(
            f"{name}: no valid reading while driving: {why}; outputs are off. Check the bridge and the mounting of the "
            "sample",
            device=name,
        )

    def _unstable(self, reading_mV: float) -> None:
        """Look for the cause while a reading [mV] is not stable: too much force, or a device that lost its settings.

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
