"""Film calibration against the load cell: a pin presses each tooth alone, over loads and frequencies.

Thesis 5.4 and A3.1.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from palpate.drivers.roles import SensorNode
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit
from palpate.instrument.allocation.repeated import Repeated
from palpate.instrument.allocation.table import RunOption
from palpate.instrument.calibration.films import (
    FEWEST,
    LOAD_CELL,
    REPEATS,
    FilmCalibration,
    FilmReading,
    calibrate_films,
)
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import DeviceError, RangeError
from palpate.instrument.findings.film_forces import NOISE, PRIOR_FREEDOM
from palpate.instrument.quantity import check_tolerance, counted, plus_minus, show
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.signals.estimate import SineFit
from palpate.instrument.uncertainty.budget import Budget
from palpate.procedures.engine.plan import Plan, Step, noise_of, point_seconds
from palpate.procedures.engine.procedure import (
    Expected,
    Finished,
    Measurement,
    Procedure,
    Report,
    RequiredLoads,
    foreseen,
    predicted,
    until_full,
)
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import keep
from palpate.procedures.lab.lab import MOUNTING, Lab, Target
from palpate.procedures.lab.session import CalibrationKeys, Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.measurements.prospects import binding, film_noise, load_cell_of, reading_u, repeated, wanted_of
from palpate.procedures.measurements.settings import (
    DwellTime,
    Extrapolate,
    LoadSets,
    ValidDays,
    check_valid_days,
    tolerance_setting,
)
from palpate.procedures.measurements.work import DynamicLoadWork
from palpate.procedures.records.columns import Column, gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.showing.figure import MARKERS, name_all, new_figure, save, with_u
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.text import new_table, stamped, uncertainty_line
from palpate.procedures.steps.checks import check_force, check_frequency, check_increasing, check_time, set_names
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.flags import causes
from palpate.procedures.steps.probe import lower, withdraw

# --- the points and the result of a film calibration ---------------------------------------------------


@dataclass(frozen=True, slots=True)
class PressedPoint:
    """One tooth pressed alone. Loads and voltages are peak to peak."""

    tooth: Annotated[int, Column("number of the tooth, from 1")]
    frequency_Hz: Annotated[float, Column("frequency of the load", "Hz")]
    load_N: columns.AskedLoad
    indicator_mV: columns.Indicator
    load_measured_N: columns.MeasuredLoad
    load_measured_u: float
    extrapolated: columns.Extrapolated
    voltages_V: columns.Volts
    voltages_u: tuple[float, ...]
    valid: columns.Valid
    flags: columns.Flags


@dataclass(frozen=True, slots=True)
class FilmResult:
    """The calibration and the points that it comes from."""

    calibration: FilmCalibration
    points: Sequence[PressedPoint]

    @property
    def achieved_u(self) -> float:
        """Greatest relative standard uncertainty of a sensitivity."""
        return max(film.sensitivity_u / film.sensitivity_mV_per_N for film in self.calibration.films)

    @property
    def reached(self) -> float:
        """Greatest half-width of the 95 % interval of a sensitivity, relative."""
        return max(budget.expanded() / budget.value for budget in self.budgets)

    @property
    def budgets(self) -> Sequence[Budget]:
        """The budget of each film's sensitivity."""
        return self.calibration.budgets()

    def summary(self) -> dict[str, Any]:
        """The calibration for JSON, without its origin."""
        found = self.calibration.model_dump()
        return {name: found[name] for name in ("films", "covariance", "crosstalk", "crosstalk_u", "frequencies_Hz",
                                               "gain", "least_N", "greatest_N", "load_cell", "expires")}  # fmt: skip


# --- A tolerance of each film's sensitivity: how often the loads are repeated on each tooth ------------
#
# The load sets on a tooth take the loads in turn, in whole rounds at each frequency. The first ones tell how much the
# films' gains scatter, and that tells how many there are in all, as `instrument.allocation.stopping` has it. The
# error of the load cell's curve is common to all of them.

REMEDIES = {
    LOAD_CELL: [
        "or        calibrate the load cell with more weights and runs: palpate calibrate load-cell --runs 3",
        "or        greater --loads, at which its zero counts for less",
        "note      a force ratio does not feel the load cell: it cancels in tooth and base",
    ]
}


def lines_of(
    design: Design, cell: LoadCellCalibration, loads: Sequence[float], frequencies: Sequence[float]
) -> list[BudgetLine]:
    """Lines of the sensitivity of a film by the sets of one frequency; each frequency tells as much of it."""
    worst = max(film.scatter for film in design.films)
    weakest = min(film.sensitivity for film in design.films) * min(loads)
    share = 1 / math.sqrt(len(frequencies))
    cell_u = cell.mean_curve_u(np.asarray(loads, dtype=np.float64))
    return [
        BudgetLine(REPEATS, share * worst, RepeatUnit.SET, PRIOR_FREEDOM),
        BudgetLine(NOISE, share * 2 * noise_of(design) / weakest, RepeatUnit.SECOND),
        BudgetLine(LOAD_CELL, cell_u, RepeatUnit.NOTHING, cell.degrees_of_freedom or math.inf),
    ]


def costs_of(frequencies: Sequence[float], dwell: float) -> Costs:
    """Bench times of a tooth at one frequency, on average; it is pressed once, at the first frequency."""
    first = point_seconds(frequencies[0], dwell, first=True)
    later = [point_seconds(frequency, dwell, first=False) for frequency in frequencies]
    return Costs((first - later[0]) / len(later), 0.0, math.fsum(later) / len(later) - dwell)


# --- the procedure -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PressStep(Step):
    """One load at one frequency on one tooth, which is numbered from 1."""

    tooth: int
    frequency_Hz: float
    load_N: float


FilmPlan = Plan[PressStep, Repeated | None]


@dataclass(frozen=True)
class FilmSeries(Procedure[PressStep, PressedPoint, FilmResult, Repeated | None]):
    """Calibrate the films against the load cell: press on one tooth after the other."""

    name = "calibrate-films"
    point = PressedPoint
    calibrates = True
    calibrating = "films"
    manual_work = "stands the pin on the teeth"

    loads: LoadSets = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
    frequencies: Annotated[tuple[float, ...], Setting("Hz", "Frequencies of the load, with commas.")] = (10.0,)
    dwell: DwellTime = 1.0
    valid_days: ValidDays = 365
    extrapolate: Extrapolate = False
    tolerance: Annotated[
        float | None,
        tolerance_setting("of each film's sensitivity; --loads are repeated until it is reached."),
    ] = None

    def check(self, target: Target) -> None:
        check_nodes(target.design, target.nodes, target.channels)
        if len(set(self.loads)) < FEWEST:
            different = counted(len(set(self.loads)), "load") if self.loads else "no load"
            raise RangeError(f"{different} cannot show linearity and scatter; use at least {FEWEST} different ones")
        check_force(self.loads, target.force_limit)
        check_increasing("loads", self.loads, "N", repeated=True)
        if not self.frequencies or len(set(self.frequencies)) < len(self.frequencies):
            given = ", ".join(f"{frequency:g}" for frequency in self.frequencies) or "none"
            raise RangeError(f"frequencies (Hz): {given}; give at least one, and each only once")
        for frequency in self.frequencies:
            check_frequency(frequency, target)
            check_time(self.dwell, frequency)
        check_valid_days(self.valid_days)
        if self.tolerance is not None:
            check_tolerance(self.tolerance, f"--tolerance {self.tolerance:g}")

    def required_loads(self) -> RequiredLoads:
        return RequiredLoads(self.loads, self.extrapolate)

    def plan(self, target: Target) -> FilmPlan:
        """All points: every load at every frequency on every tooth; with a tolerance, the most load sets."""
        cell = load_cell_of(target)
        if self.tolerance is not None:
            return self._repeated(target.design, cell, self.tolerance)
        teeth = range(1, len(target.design.teeth) + 1)
        sets = list(zip(self.loads, set_names(self.loads), strict=True))
        steps = [
            self._step(n, frequency, load, load_text, first=frequency == self.frequencies[0] and not number)
            for n in teeth
            for frequency in self.frequencies
            for number, (load, load_text) in enumerate(sets)
        ]
        return Plan(self.name, steps, predicted(steps, self._expected(target.design, cell, self.loads)))

    def _expected(self, design: Design, cell: LoadCellCalibration, loads: Sequence[float]) -> list[Expected]:
        """Relative uncertainty of each film's sensitivity by load sets on each tooth at each frequency [N].

        A film's gain scatters from load set to load set as the design says [M], noise is that of usual films [A], and
        each load is off by its reading. The error of the load cell's curve is common to all points.
        """
        common = cell.mean_curve_u(np.asarray(loads, dtype=np.float64))
        found = []
        for film in design.films:
            noise = [film_noise(film, load, self.dwell, noise_of(design)) for load in loads]
            points = [
                math.hypot(film.scatter, each, reading_u(cell, load)) for each, load in zip(noise, loads, strict=True)
            ]
            count = len(points) * len(self.frequencies) * len(film.teeth)
            scatter = math.sqrt(math.fsum(u**2 for u in points) / len(points) / count)
            found.append(Expected(f"sensitivity of film {film.name}", math.hypot(scatter, common)))
        return found

    def _repeated(self, design: Design, cell: LoadCellCalibration, tolerance: float) -> FilmPlan:
        """The most load sets on each tooth for a tolerance: all teeth and frequencies have as many."""
        count, teeth, dwell = len(self.loads), len(design.teeth), self.dwell
        way = RunOption(lines_of(design, cell, self.loads, self.frequencies), costs_of(self.frequencies, dwell), dwell)
        (repeats,) = repeated({"": [way]}, tolerance, count, "each film's sensitivity", REMEDIES).values()
        steps = [
            self._step(n, f, load, f"{load:g} N, set {number}", first=f == self.frequencies[0] and number == 1)
            for n in range(1, teeth + 1)
            for f in self.frequencies
            for number, load in enumerate((self.loads[number % count] for number in range(repeats.most)), 1)
        ]
        plan = repeats.plan
        sets, seconds = plan.sets * len(self.frequencies), plan.seconds * teeth * len(self.frequencies)
        lines = [
            wanted_of("the sensitivity of each film", plus_minus(tolerance, 3)),
            f"plan           {sets} load sets on each tooth, of {show(dwell, 's')}: {duration(seconds)} "
            f"(person {MOUNTING * teeth:g} s)",
            f"expected       {plus_minus(plan.half, 3)}",
            binding(plan),
        ]
        loads = tuple(self.loads) * (plan.sets // count)
        planned = {"sets": sets, **plan.summary(), "seconds": seconds}
        forecast = foreseen(seconds, plan.u, self._expected(design, cell, loads), lines, planned=planned)
        return Plan(self.name, steps, forecast, repeats)

    def course(self, plan: FilmPlan, points: Sequence[PressedPoint], lab: Lab) -> Generator[int, None, str]:
        """Each tooth ends at a frequency once it has the load sets that the tolerance of each of its films needs."""

        def full(_step: PressStep, own: Sequence[PressedPoint]) -> bool:
            return plan.basis is not None and self.has_enough(plan.basis, own, lab.design)

        return until_full(plan.steps, points, lambda step: (step.tooth, step.frequency_Hz), full)

    def has_enough(self, repeats: Repeated, points: Sequence[PressedPoint], design: Design) -> bool:
        """Whether the points of a tooth at one frequency are enough for each of its films."""
        pressed = {point.tooth - 1 for point in points}
        gains = [
            [point.voltages_V[number] / point.load_measured_N for point in points]
            for number, film in enumerate(design.films)
            if pressed & {*film.teeth}
        ]
        return repeats.is_enough(len(points), *gains, sensitivity=1 / math.sqrt(len(self.frequencies)))

    def _step(self, tooth: int, frequency: float, load: float, load_text: str, first: bool) -> PressStep:
        what = f"tooth {tooth}, {frequency:g} Hz, {load_text}"
        seconds = point_seconds(frequency, self.dwell, first)
        return PressStep(self.dwell, seconds, None, tooth, frequency, load, what=what, group=f"press tooth {tooth}")

    def begin(self, plan: FilmPlan, lab: Lab, record: Recorder) -> Pressing:
        return Pressing(lab, record, self)

    def evaluate(self, points: Sequence[PressedPoint], plan: FilmPlan, lab: Lab) -> FilmResult:
        readings = [
            FilmReading(
                p.tooth - 1, p.frequency_Hz, p.load_N, p.load_measured_N, p.load_measured_u, np.array(p.voltages_V)
            )
            for p in points
        ]
        origin = lab.origin(SensorNode, self.valid_days)
        return FilmResult(calibrate_films(lab.design, readings, lab.calibration, origin), points)

    def save_calibration(self, done: Finished[FilmResult]) -> CalibrationKeys:
        found = done.result.calibration
        path = keep(found, done.folder, done.replayed)
        return {"film_calibration": found.source, "film_calibration_file": str(path)}

    def report(self, result: FilmResult, lab: Lab) -> Report:
        return Report(partial(show_films, result, lab.design), partial(plot_films, result, lab.design))


class Pressing(DynamicLoadWork):
    """The bench work: presses one tooth after the other with a pin."""

    def __init__(self, lab: Lab, record: Recorder, series: FilmSeries) -> None:
        super().__init__(lab, record, series.loads, series.frequencies[0], extrapolate=series.extrapolate)
        self._dwell = series.dwell
        self._preloaded = 0.0
        self._driven: tuple[int, float] | None = None

    def arrange(self, step: PressStep) -> None:
        bench = self.lab.bench
        withdraw(bench)
        bench.operator.press_tooth(step.tooth - 1)
        self._preloaded = lower(bench, self.lab.calibration, self.preload, f"tooth {step.tooth}")

    def take(self, step: PressStep) -> Measurement[PressedPoint]:
        if self._driven != (step.tooth, step.frequency_Hz):
            self._driven = step.tooth, step.frequency_Hz
            self.films.set_frequency(step.frequency_Hz)
            self.hold(self._preloaded)
        design = self.lab.design
        measured = self.load_set(step.load_N, step.what, self._dwell, compare=False)
        point = gathered(
            PressedPoint, step, measured,
            extrapolated=not self.lab.calibration.covers(step.load_N),
            voltages_V=tuple(_voltages(design, step.tooth - 1, measured.fit).tolist()),
            voltages_u=tuple((2 * measured.fit.amplitude_u).tolist()),
        )  # fmt: skip
        why = f"{step.what}: the point is not valid, and a calibration needs each. {causes(measured.flags)}"
        return self.measurement(point, measured, None if measured.valid else DeviceError(why))


def _voltages(design: Design, tooth: int, fit: SineFit) -> npt.NDArray[np.float64]:
    """Voltages of all films, peak to peak, shape (films,) [V], while one tooth is pressed.

    For the films of other teeth it is the signed part in phase with the pressed tooth's film. An amplitude is never
    negative, so that noise alone would look like crosstalk.
    """
    own = np.array([tooth in film.teeth for film in design.films])
    part = np.cos(fit.phase - fit.phase[np.argmax(own)])
    return 2 * fit.amplitude * np.where(own, 1.0, part)


# --- what it shows -------------------------------------------------------------------------------------


def show_films(result: FilmResult, design: Design, outcome: Outcome) -> list[object]:
    """Each film's results, the crosstalk between several teeth, and the gain over several frequencies."""
    c = result.calibration
    table = new_table(
        stamped(c.simulated, f"Film calibration, design {c.design}"),
        "film", "mV/N", "u mV/N", "design's mV/N", "clamping", "linearity", "degrees of freedom",
    )  # fmt: skip
    for film, own in zip(c.films, design.films, strict=True):
        table.add_row(
            film.name,
            f"{film.sensitivity_mV_per_N:z.3f}",
            f"{film.sensitivity_u:z.3f}",
            f"{1e3 * own.sensitivity:z.3f}",
            f"{film.clamping:z.3f}",
            f"{100 * film.linearity:z.2f} %",
            f"{film.degrees_of_freedom}",
        )
    tables: list[Any] = [table]
    if len(design.teeth) > 1:
        teeth = range(1, len(design.teeth) + 1)
        crosstalk = new_table(stamped(c.simulated, "Crosstalk"), "film \\ tooth", *map(str, teeth))
        for name, row in zip(_rigid(design), c.crosstalk, strict=True):
            crosstalk.add_row(name, *(f"{value:z.4f}" for value in row))
        tables.append(crosstalk)
    if len(c.frequencies_Hz) > 1:
        gain = new_table(stamped(c.simulated, "Gain"), "film", *(f"{frequency:g} Hz" for frequency in c.frequencies_Hz))
        for film, row in zip(c.films, c.gain, strict=True):
            gain.add_row(film.name, *(f"{value:z.4f}" for value in row))
        tables.append(gain)
    outside = sum(point.extrapolated for point in result.points)
    return [
        *tables,
        *([f"extrapolated   {counted(outside, 'point')} outside the load cell's calibrated range"] if outside else []),
        uncertainty_line("a sensitivity", result.reached, result.achieved_u, outcome["predicted_u"]),
        f"loads          {c.least_N:g} to {c.greatest_N:g} N peak to peak, until {c.expires}",
        f"stored in      {outcome['film_calibration_file']}",
    ]


def _rigid(design: Design) -> list[str]:
    return [film.name for film in design.films if film.kind == FILM_KINDS[0]]


def plot_films(result: FilmResult, design: Design, folder: Path) -> Path:
    """Plot each film's voltages against the load, with its line, and their deviation from it; returns the PNG file."""
    c = result.calibration
    figure, (left, right) = new_figure(c.simulated, 2, f"film calibration, design {c.design}")
    for number, (film, own) in enumerate(zip(c.films, design.films, strict=True)):
        mine = [p for p in result.points if p.tooth - 1 in own.teeth]
        (load, load_u), (volts, u) = with_u(mine, "load_measured_N"), with_u(mine, "voltages_V", 1e3, number)
        marker = MARKERS[number % len(MARKERS)]
        look: dict[str, Any] = {"fmt": marker, "ms": 4, "lw": 1, "capsize": 2}
        left.errorbar(load, volts, u, load_u, **look, label=f"{film.name}: {film.sensitivity_mV_per_N:.3g} mV/N")
        by_line = [100 / (film.sensitivity_mV_per_N * x) for x in load]
        off = [each * y - 100 for each, y in zip(by_line, volts, strict=True)]
        right.errorbar(load, off, [each * y for each, y in zip(by_line, u or (), strict=True)], load_u, **look)
        ends = [0.0, max(load)]
        left.plot(ends, [film.sensitivity_mV_per_N * x for x in ends], "k-", lw=0.7)
    left.set(xlabel="load peak to peak (N)", ylabel="film voltage peak to peak (mV; bars: u)")
    right.axhline(0, color="k", lw=1)
    right.set(xlabel="load peak to peak (N)", ylabel="deviation from the line (%; bars: u)")
    name_all(left, 2)
    return save(figure, folder)
