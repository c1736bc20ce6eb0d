"""Temperature sweep: what a change of temperature adds to the films' signals, and what a fitted trend leaves of it.

Thesis 2.1.6 and 6.2.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.estimate import boxcar, rms
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.instrument.uncertainty.interpolation import Interpolation, interpolate
from palpate.procedures.engine.plan import Plan, Step, point_seconds
from palpate.procedures.engine.procedure import Expected, Measurement, Report, RequiredLoads, predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.measurements.prospects import expected_mean, expected_ratio
from palpate.procedures.measurements.settings import DwellTime, Frequency, PeakLoad, SampleName
from palpate.procedures.measurements.work import Sweep, SweepWork
from palpate.procedures.records.columns import Column, columns_of, gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.showing.figure import MARKERS, name_all, new_figure, save, with_u
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import legend, stamped
from palpate.procedures.steps.checks import check_force, check_frequency, check_time
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.standing import BEFORE, LENGTH, RESPONSE, Added, after_change, before_change

# --- the points and the result of a temperature sweep --------------------------------------------------

FEWEST = 3  # least number of different changes for a slope


@dataclass(frozen=True, slots=True)
class FilmWarming:
    """One film after a change of temperature."""

    film: Annotated[str, Column("name of the film")]
    force_N: Annotated[float, Column("force by the fit with a trend, peak to peak", "N")]
    offset_N: Annotated[
        float,
        Column(
            "what the change has added to the film's steady signal, as a force; NaN: it was lost", "N", "offset N",
            "+z.3f", u="offset_u",
        ),
    ]  # fmt: skip
    offset_u: Annotated[float, Column(head="u N", cell="z.3f")]
    trend_N_per_s: Annotated[float, Column("drift of the signal under the load, as a force", "N/s")]
    error_lock_in: Annotated[float, Column("relative error of a lock-in amplifier on the same record")]
    error_rms: Annotated[float, Column("relative error of a voltmeter (RMS) on the same record")]


@dataclass(frozen=True, slots=True)
class TemperaturePoint:
    """One change of temperature, measured while the films warm up."""

    temperature_K: Annotated[float, Column("temperature relative to the start", "K", "K", "g")]
    step_K: Annotated[float, Column("its change from the one before", "K", "change\nK", "+g")]
    offset_after_s: Annotated[float, Column("time from the change until the films' offsets were taken", "s")]
    load_measured_N: columns.MeasuredLoad
    load_measured_u: float
    force_ratio: columns.ForceRatio
    force_ratio_u: columns.ForceRatioU
    error_lock_in: Annotated[
        float,
        Column("relative error of the ratio by a lock-in amplifier", "", "lock-in\nerror %", "+z.3f", 100),
    ]
    error_rms: Annotated[
        float, Column("relative error of the ratio by a voltmeter", "", "voltmeter\nerror %", "+z.2f", 100)
    ]
    films: Annotated[tuple[FilmWarming, ...], Column("each film", after="step_K", each="film")]
    valid: columns.Valid
    settling_s: columns.Settling
    attempts: columns.Attempts
    flags: columns.Flags


@dataclass(frozen=True, slots=True)
class TemperatureResult:
    """The result of a temperature sweep; values are None with fewer than three different valid changes.

    Attributes:
        points: the points.
        offsets: slope of the apparent force right after a change, with its standard uncertainty, by film [N/K].
        ratio_per_K: relative slope of the force ratio by the fit with a trend, with its standard uncertainty [1/K].
        largest_lock_in: largest relative error of the ratio by a lock-in amplifier.
        largest_rms: largest relative error of the ratio by a voltmeter.
        budgets: uncertainty budget of each slope.
    """

    points: list[TemperaturePoint]
    offsets: dict[str, tuple[float, float] | None]
    ratio_per_K: tuple[float, float] | None
    largest_lock_in: float | None
    largest_rms: float | None
    budgets: tuple[Budget, ...] = ()

    def summary(self) -> dict[str, Any]:
        """The result for JSON, without its points."""
        ratio, ratio_u = self.ratio_per_K or (None, None)
        rows = [(film, *(found or (None, None))) for film, found in self.offsets.items()]
        return {
            "offsets": [{"film": film, "offset_N_per_K": slope, "offset_u": u} for film, slope, u in rows],
            "ratio_per_K": ratio,
            "ratio_per_K_u": ratio_u,
            "largest_error_lock_in": self.largest_lock_in,
            "largest_error_rms": self.largest_rms,
        }


def gain_u(design: Design) -> np.ndarray:
    """Relative standard uncertainty of the films' gains, by scatter and calibration, shape (films,)."""
    variance = np.asarray(design.scatter_covariance).diagonal()
    if design.film_covariance is not None:
        variance = variance + np.asarray(design.film_covariance).diagonal()
    found: np.ndarray = np.sqrt(variance)
    return found


def evaluate(points: Sequence[TemperaturePoint], design: Design) -> TemperatureResult:
    """Find the slopes from the valid points."""
    valid = [point for point in points if point.valid]
    warmth = [point.step_K for point in valid]
    if len(set(warmth)) < FEWEST:
        return TemperatureResult(list(points), dict.fromkeys(film.name for film in design.films), None, None, None)

    offsets: dict[str, tuple[float, float] | None] = {}
    budgets = []
    for i, (film, film_u) in enumerate(zip(design.films, map(float, gain_u(design)), strict=True)):
        line = interpolate(warmth, [point.films[i].offset_N for point in valid], 0.0)
        value, line_u = _slope(line)
        # An error of the gain is common to all rows, so residuals miss it.
        offsets[film.name] = value, math.hypot(line_u, film_u * value)
        gain = Component("gain of the film", film_u, sensitivity=value)
        budgets.append(Budget(f"offset of film {film.name}", value, "N/K", (_about(line), gain)))

    mean = math.fsum(point.force_ratio for point in valid) / len(valid)
    u = max(point.force_ratio_u for point in valid) / mean
    line = interpolate(warmth, [point.force_ratio / mean for point in valid], u)
    ratio = _slope(line)
    budgets.append(Budget("change of the force ratio with a trend", ratio[0], "1/K", (_about(line),)))
    return TemperatureResult(
        points=list(points),
        offsets=offsets,
        ratio_per_K=ratio,
        largest_lock_in=max((point.error_lock_in for point in valid), key=abs),
        largest_rms=max((point.error_rms for point in valid), key=abs),
        budgets=tuple(budgets),
    )


def _slope(line: Interpolation) -> tuple[float, float]:
    """The slope of a line and its standard uncertainty."""
    return float(line.coefficients[1]), math.sqrt(float(line.covariance[1, 1]))


def _about(line: Interpolation) -> Component:
    """What the points of a line leave open of its slope."""
    _, u = _slope(line)
    if not line.by_scatter:
        return Component("points of the line", u)
    return Component("scatter about the line", u, degrees_of_freedom=line.degrees_of_freedom, kind="A")


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
        return Plan(self.name, steps, predicted(steps, self._expected(target.design)))

    def _expected(self, design: Design) -> list[Expected]:
        """Uncertainty of the relative change of the ratio [1/K].

        It is that of the line through the ratios over the changes of temperature, whose points scatter as the design
        says [M], with the noise of the films, which is the usual one [A] where none is stated. What a change adds to a
        film's offset depends on the films' surroundings: its uncertainty is found by the run alone.
        """
        point = expected_mean("point", design, expected_ratio(design, self.sample), [self.load], [self.dwell])
        steps = steps_of(self.temperatures)
        line = interpolate(steps, [0.0] * len(steps), point.u / point.value)
        return [Expected("change of the force ratio with a trend", math.sqrt(line.covariance[1, 1]), "1/K")]

    def begin(self, plan: Plan[TemperatureStep], lab: Lab, record: Recorder) -> TemperatureSweepWork:
        return TemperatureSweepWork(lab, record, self)

    def evaluate(self, points: Sequence[TemperaturePoint], plan: Plan[TemperatureStep], lab: Lab) -> TemperatureResult:
        return evaluate(points, lab.design)

    def report(self, result: TemperatureResult, lab: Lab) -> Report:
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
        return self.measurement(_point(self.lab.design, step, added, measured), measured)


def steps_of(temperatures: Sequence[float]) -> tuple[float, ...]:
    """Change of each temperature from the one before; the first is its change from the start [K]."""
    return tuple(after - before for before, after in pairwise((0.0, *temperatures)))


def _point(design: Design, step: TemperatureStep, added: Added, measured: FilmPoint) -> TemperaturePoint:
    fit, forces = measured.fit, measured.forces(design)
    time, volts = measured.record.usable(clipped=True)
    amplitude = np.where(fit.amplitude > 0, fit.amplitude, np.nan)  # 0 for a film that clips all the time
    flags = (*measured.flags, *sorted(added.lost - set(measured.flags)))
    gains_u = gain_u(design)
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
                offset_u=math.hypot(float(added.u[i]), gains_u[i] * float(added.voltage[i])) / film.sensitivity,
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


# --- what it shows -------------------------------------------------------------------------------------


def show_sweep(result: TemperatureResult, design: Design, outcome: Outcome) -> list[object]:
    """Each change with the force ratio and its errors, then the slopes."""
    title = "What a change of temperature adds (errors against the fit with a trend)"
    points = table_of(stamped(outcome["simulated"], title), result.points, columns_of(TemperaturePoint))
    below = [
        f"offset {name:<16} " + ("-" if found is None else f"{found[0]:+z.4f} N/K, u = {found[1]:z.4f} N/K")
        for name, found in result.offsets.items()
    ]
    if result.ratio_per_K is not None:
        slope, u = (100 * value for value in result.ratio_per_K)
        below.append(f"force ratio, with trend  {slope:+z.3f} %/K, u = {u:z.3f} %/K")
    return [points, *legend(points), *below]


def plot_sweep(result: TemperatureResult, design: Design, simulated: bool, folder: Path) -> Path:
    """Plot the apparent force of each film, and the errors of the ratio, against the change; returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"warming films, design {design.name}")
    change = [p.step_K for p in result.points]
    for i, (marker, film) in enumerate(zip(itertools.cycle(MARKERS), design.films)):
        offsets = with_u([p.films[i] for p in result.points], "offset_N")
        left.errorbar(change, *offsets, fmt=marker, ms=5, lw=1, capsize=2, label=film.name)
    left.set(xlabel="change of temperature (K)", ylabel="apparent force (N; bars: u)")
    name_all(left)
    right.plot(change, [100 * p.error_lock_in for p in result.points], "o", ms=5, label="lock-in amplifier")
    right.plot(change, [100 * p.error_rms for p in result.points], "s", ms=5, label="voltmeter (RMS)")
    right.axhline(0, color="k", lw=1, label="fit with trend")
    right.set(xlabel="change of temperature (K)", ylabel="error of the force ratio (%)")
    name_all(right)
    return save(figure, folder)
