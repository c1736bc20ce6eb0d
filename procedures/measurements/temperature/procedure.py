"""Temperature sweep: what a change of temperature adds to the films' signals, and what a fitted trend leaves of it.

Thesis 2.1.6 and 6.2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Annotated

import numpy as np

from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.estimate import boxcar, rms
from palpate.instrument.uncertainty.interpolation import interpolate
from palpate.procedures.engine.plan import Plan, Step, point_seconds
from palpate.procedures.engine.procedure import Measurement, Report, RequiredLoads
from palpate.procedures.engine.promise import Expected, predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.measurements.prospects import expected_mean, expected_ratio
from palpate.procedures.measurements.settings import DwellTime, Frequency, PeakLoad, SampleName
from palpate.procedures.measurements.sweep import Sweep, SweepWork
from palpate.procedures.measurements.temperature.result import (
    FEWEST,
    FilmWarming,
    TemperaturePoint,
    TemperatureResult,
    evaluate,
    gain_u,
)
from palpate.procedures.records.columns import gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import check_force, check_frequency, check_time
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.standing import BEFORE, LENGTH, RESPONSE, Added, after_change, before_change

# -------------------------------------------------------------------------------------------------------
# What a temperature sweep is expected to give: the uncertainty of the force ratio's change with temperature
#
# It is that of the line through the ratios over the changes of temperature, whose points scatter as the design says
# [M], with the noise of the films, which is the usual one [A] where none is stated. What a change adds to a film's
# offset depends on the films' surroundings: its uncertainty is found by the run alone.


def expected_change(design: Design, ratio: float, load: float, dwell: float, steps: Sequence[float]) -> list[Expected]:
    """Uncertainty of the relative change of the ratio [1/K].

    Args:
        design: design of the sensor.
        ratio: expected force ratio of the sample.
        load: load, peak to peak [N].
        dwell: dwell of each point [s].
        steps: the changes of temperature [K].
    """
    point = expected_mean("point", design, ratio, [load], [dwell])
    line = interpolate(steps, [0.0] * len(steps), point.u / point.value)
    return [Expected("change of the force ratio with a trend", math.sqrt(line.covariance[1, 1]), "1/K")]


# --- the procedure -------------------------------------------------------------------------------------

RANGE = (-20.0, 40.0)  # K relative to the start; PVDF loses its polarisation above about 80 °C [S]
MOST = 50  # greatest number of temperatures
LONGEST_SOAK = 86400.0  # s
SETTING = 10.0  # s that a person takes to set a temperature [A]


@dataclass(frozen=True, slots=True)
class TemperatureStep(Step):
    """One temperature relative to the start, and its change from the one before."""

    temperature_K: float
    step_K: float


@dataclass(frozen=True)
class TemperatureSweep(Sweep[TemperatureStep, TemperaturePoint, TemperatureResult]):
    """Find what warming films add to their signals, and what the fitted trend takes away of it."""

    name = "sweep-temperature"
    point = TemperaturePoint
    manual_work = "warms the sensor"
    automated_by = "chamber"

    temperatures: Annotated[tuple[float, ...], Setting("K", "Temperatures relative to the start, in order.")] = (
        0.0,
        5.0,
        15.0,
        10.0,
    )
    sample: SampleName = "1"
    load: PeakLoad = 2.0
    dwell: DwellTime = 1.0
    frequency: Frequency = 10.0
    soak: Annotated[
        float,
        Setting("s", "Wait before each change; the films reach the temperature that was set before.", default="30 min"),
    ] = 1800.0

    def check(self, target: Target) -> None:
        """Check the settings before anything is sent to a device.

        Raises:
            RangeError: the temperatures make too few different changes or exceed what films bear, the soak is outside
                its limits, the load exceeds the force limit, the frequency or the dwell is outside its limits, or the
                bench has too few sensor nodes.
            UnknownName: there is no such sample.
        """
        check_nodes(target.design, target.nodes, target.channels)
        get_sample(self.sample)
        changes = steps_of(self.temperatures)
        if len(set(changes)) < FEWEST or len(changes) > MOST:
            raise RangeError(
                f"temperatures {list(self.temperatures)} K make {len(set(changes))} different changes; {FEWEST} to "
                f"{MOST} give a slope, such as '0 K, 5 K, 15 K, 10 K'"
            )
        if not 0 <= self.soak <= LONGEST_SOAK:
            raise RangeError(f"soak {self.soak:g} s is outside 0 to {LONGEST_SOAK:g} s; give one inside")
        for temperature in self.temperatures:
            if not RANGE[0] <= temperature <= RANGE[1]:
                raise RangeError(
                    f"temperature {temperature:g} K relative to the start is outside {RANGE[0]:g} to {RANGE[1]:g} K,"
                    " which the films bear; give one inside"
                )
        check_force((self.load,), target.force_limit)
        check_frequency(self.frequency, target)
        check_time(self.dwell, self.frequency)

    def required_loads(self) -> RequiredLoads:
        return RequiredLoads((self.load,), self.extrapolate)

    def plan(self, target: Target) -> Plan[TemperatureStep]:
        """All points: every temperature, in the given order."""
        steps: list[TemperatureStep] = []
        for temperature, change in zip(self.temperatures, steps_of(self.temperatures), strict=True):
            soak = max(self.soak, BEFORE) + RESPONSE + LENGTH
            seconds = soak + SETTING + point_seconds(self.frequency, self.dwell, first=not steps, mounts=target.mounts)
            what, group = show(temperature, "K"), f"mount sample {self.sample}"
            scatter = target.design.ratio_scatter
            steps.append(TemperatureStep(self.dwell, seconds, scatter, temperature, change, what=what, group=group))
        ratio = expected_ratio(target.design, self.sample)
        found = expected_change(target.design, ratio, self.load, self.dwell, steps_of(self.temperatures))
        return Plan(self.name, steps, predicted(steps, found))

    def begin(self, plan: Plan[TemperatureStep], lab: Lab, record: Recorder) -> TemperatureSweepWork:
        return TemperatureSweepWork(lab, record, self)

    def evaluate(self, points: Sequence[TemperaturePoint], plan: Plan[TemperatureStep], lab: Lab) -> TemperatureResult:
        return evaluate(points, lab.design)

    def report(self, result: TemperatureResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.temperature.report import plot_sweep, show_sweep

        simulated = lab.bench.simulated
        return Report(partial(show_sweep, result, lab.design), partial(plot_sweep, result, lab.design, simulated))


class TemperatureSweepWork(SweepWork):
    """The bench work: one load on one sample, measured as soon as each temperature is set."""

    def __init__(self, lab: Lab, record: Recorder, sweep: TemperatureSweep) -> None:
        super().__init__(lab, record, sweep, (sweep.load,), sweep.frequency, (sweep.sample,))
        self._sweep = sweep

    def arrange(self, step: TemperatureStep) -> None:
        self.press(get_sample(self._sweep.sample))

    def take(self, step: TemperatureStep) -> Measurement[TemperaturePoint]:
        bench = self.lab.bench
        carry_out(bench, "outputs off", bench.rest)
        bench.clock.wait(max(self._sweep.soak - BEFORE, 0.0))
        before = before_change(self.films)
        bench.operator.set_temperature(step.temperature_K)
        added = after_change(self.films, before)
        carry_out(bench, "outputs on", bench.drive)
        measured = self.measured(self._sweep.load, step.what, self._sweep.dwell)
        return Measurement(_point(self.lab.design, step, added, measured), measured.waveforms(self.lab.design))


def steps_of(temperatures: Sequence[float]) -> tuple[float, ...]:
    """Change of each temperature from the one before; the first is its change from the start [K]."""
    return tuple(after - before for before, after in pairwise((0.0, *temperatures)))


def _point(design: Design, step: TemperatureStep, added: Added, measured: FilmPoint) -> TemperaturePoint:
    fit, forces = measured.fit, measured.forces(design)
    time, volts = measured.record.usable(clipped=True)
    amplitude = np.where(fit.amplitude > 0, fit.amplitude, np.nan)  # 0 for a film that clips all the time
    flags = (*measured.flags, *sorted(added.lost - set(measured.flags)))
    known = gain_u(design)
    lock_in, voltmeter = (estimator(time, volts, fit.frequency) / amplitude for estimator in (boxcar, rms))
    return gathered(
        TemperaturePoint, step, measured, forces,
        offset_after_s=added.after,
        error_lock_in=_of_ratio(design, lock_in),
        error_rms=_of_ratio(design, voltmeter),
        films=tuple(
            FilmWarming(
                film=film.name,
                force_N=2 * float(fit.amplitude[i]) / film.sensitivity,
                offset_N=float(added.voltage[i]) / film.sensitivity,
                offset_u=math.hypot(float(added.u[i]), known[i] * float(added.voltage[i])) / film.sensitivity,
                trend_N_per_s=float(fit.trend[i]) / film.sensitivity,
                error_lock_in=float(lock_in[i]) - 1,
                error_rms=float(voltmeter[i]) - 1,
            )
            for i, film in enumerate(design.films)
        ),
        valid=not flags,
        flags=flags,
    )  # fmt: skip


def _of_ratio(design: Design, read: np.ndarray) -> float:
    """Relative error of the mean ratio of rigid films to base films, from each film's relative reading."""
    rigid = [float(read[i]) for i, film in enumerate(design.films) if film.kind == FILM_KINDS[0]]
    total = [float(read[i]) for i, film in enumerate(design.films) if film.kind == FILM_KINDS[1]]
    return (math.fsum(rigid) / len(rigid)) / (math.fsum(total) / len(total)) - 1
