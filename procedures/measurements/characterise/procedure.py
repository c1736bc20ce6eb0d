"""The characterisation of a sensor (thesis 2.1): loads up, loads down, then one load that is held."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np

from palpate.drivers.roles import SensorNode
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget, falling
from palpate.instrument.allocation.repeated import Repeated
from palpate.instrument.allocation.stopping import enough
from palpate.instrument.allocation.table import FIRST, MOST_SETS, Allocation, RunOption, allocation
from palpate.instrument.arrays import Floats
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.contracts.own import FULL_SCALE_COUNTS, HEADROOM, RANGE_VOLTS
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import NOISE, PRIOR_FREEDOM, SCATTER
from palpate.instrument.quantity import as_typed, check_tolerance, counted, plus_minus, show
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.noise import of_greatest
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.engine.plan import Plan, Predicted, Step, noise_of, point_seconds
from palpate.procedures.engine.procedure import (
    RELATIVE,
    Expected,
    Measurement,
    Procedure,
    Report,
    RequiredLoads,
    foreseen,
    predicted,
    until_full,
)
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.measurements.characterise.report import (
    DEFINITIONS,
    HOLDING,
    LEAST_DRIFT_POINTS,
    LEAST_LOADS,
    LOADING,
    RESOLUTION,
    SCALED,
    SNR,
    SPATIAL_RESOLUTION,
    UNLOADING,
    CharacteriseResult,
    FilmsPoint,
    Sources,
    cell_component,
    components,
    evaluate,
    factor,
    noise_component,
)
from palpate.procedures.measurements.prospects import (
    binding,
    ended_by,
    expected_ratio,
    film_noise,
    load_on,
    probable_cell_of,
    reading_u,
    repeated,
    share,
    too_long,
    wanted_of,
)
from palpate.procedures.measurements.settings import (
    DwellTime,
    Frequency,
    PeakLoads,
    SampleName,
    bench_time,
    tolerance_setting,
)
from palpate.procedures.measurements.work import DynamicLoadWork, Laps
from palpate.procedures.records.columns import gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.showing.plan import duration
from palpate.procedures.steps.checks import (
    check_bench_time,
    check_force,
    check_frequency,
    check_increasing,
    check_time,
    preload_for,
)
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import CHARGE_AMPLIFIER, SAMPLES_PER_CYCLE, check_nodes

# -------------------------------------------------------------------------------------------------------
# What a characterisation is expected to give: the uncertainty of each figure of merit, by its budget's
# components
#
# A film's gain scatters from load to load as the design says [M], noise is that of the bench file, or of usual films
# [A], and of the converter's steps, and each load is off by its reading. Linearity, hysteresis and drift are expected
# to be what scatter and noise make of them.

ROUNDED = 0.12  # relative scatter of a record's noise that is all rounding: an offset passes steps, or stands still [M]


@dataclass(frozen=True, slots=True)
class Conditions:
    """Under which conditions a sensor is characterised.

    Attributes:
        design: the sensor.
        ratio: expected force ratio of the sample.
        loads: increasing loads, peak to peak [N].
        frequency: frequency of the load [Hz].
        dwell: dwell of each point [s].
        cell: calibration of the load cell.
    """

    design: Design
    ratio: float
    loads: tuple[float, ...]
    frequency: float
    dwell: float
    cell: LoadCellCalibration

    @property
    def samples(self) -> int:
        """Number of samples in each record."""
        return round(SAMPLES_PER_CYCLE * self.frequency * self.dwell)

    def force(self, film: Film, load: float) -> float:
        """Force on a film under a load [N, peak to peak]."""
        return load_on(self.design, film, self.ratio, load)

    def noise(self, film: Film) -> Floats:
        """Expected error of each load [N] by the film's noise and the converter's steps."""
        steps = math.sqrt(2 / self.samples) * self.rounding(film)
        forces = [self.force(film, load) for load in self.loads]
        relative = [
            math.hypot(
                film_noise(film, force, self.dwell, noise_of(self.design)), steps / (film.sensitivity * force / 2)
            )
            for force in forces
        ]
        return np.array(self.loads) * relative

    def rounding(self, film: Film) -> float:
        """Standard uncertainty of a sample by rounding to the converter's steps [V].

        They are those of the range that the films are set to for these loads, as `Films` chooses it.
        """
        largest = preload_for(self.loads) + max(self.loads) / 2
        finest, widest = min(RANGE_VOLTS), max(RANGE_VOLTS)
        range_ = finest if HEADROOM * film.sensitivity * largest <= finest else widest
        return range_ / FULL_SCALE_COUNTS / math.sqrt(12)

    def apart(self, film: Film) -> Floats:
        """Expected standard deviation of a load set about the line, as an error of each load [N]."""
        loads = np.array(self.loads)
        found: Floats = np.sqrt((film.scatter * loads) ** 2 + self.noise(film) ** 2 + reading_u(self.cell, 1.0) ** 2)
        return found


def expected_figures(
    of: Conditions,
    rounds: int,
    times: Sequence[float],
    force_limit: float,
    slopes: Sequence[float] | None = None,
) -> list[Expected]:
    """The uncertainty of each figure of merit.

    Args:
        of: the conditions.
        rounds: how often each load is set on the way up.
        times: times of the points while the middle load is held [s].
        force_limit: force limit of the bench [N].
        slopes: relative uncertainty of the slope of each film's line; None: by the scatter about that line.
    """
    found = []
    for number, film in enumerate(of.design.films):
        sources = _sources(of, film, rounds, times, force_limit)
        if slopes is not None:
            sources = replace(sources, line=Component("line", slopes[number]))
        parts = components(sources)
        for quantity, each in parts.items():
            u = factor(quantity, 1.0) * math.hypot(*(part.u for part in each))
            unit = RELATIVE if quantity in SCALED else DEFINITIONS[quantity].unit
            found.append(Expected(f"{quantity}, {film.name}", u, unit))
    return [*found, Expected(f"{SPATIAL_RESOLUTION}, sensor", min(of.design.cell) / math.sqrt(12), "m")]


def _sources(of: Conditions, film: Film, rounds: int, times: Sequence[float], force_limit: float) -> Sources:
    # All uncertainties are in newtons of the load: the slope is one.
    loads, noise, each = (np.tile(values, rounds) for values in (of.loads, of.noise(film), of.apart(film)))
    away = loads - loads.mean()
    weight = 1 - 1 / loads.size - away**2 / float(away @ away)  # of each point's error in the line's residuals
    scatter = math.sqrt(float(weight @ each**2) / (loads.size - 2))
    top, span, middle = float(loads.max()), float(np.ptp(loads)), len(of.loads) // 2
    minutes = np.asarray(times) / 60
    square = of.rounding(film) ** 2
    rounded = ROUNDED * square / (square + noise_of(of.design) ** 2 * of.samples / of.dwell / 2)
    random = 1 / math.sqrt(2 * of.samples)
    widest = 2 * max(RANGE_VOLTS) * top / (film.sensitivity * of.force(film, top))
    return Sources(
        line=Component("line", scatter / float(np.linalg.norm(away))),
        cell=cell_component(of.cell),
        noise=noise_component(math.hypot(random, rounded), loads.size, of.samples * loads.size),
        amplitude=Component("amplitude", noise[-1] / top / math.sqrt(rounds)),
        residual=Component("noise", random / math.sqrt(rounds)),
        greatest=Component("greatest of the noise", of_greatest(of.samples) / math.sqrt(rounds)),
        scatter=Component("scatter", scatter),
        typical=math.sqrt(float(np.mean(loads**2))),
        top=top,
        span=span,
        rounds=rounds,
        drift=Component("drift", noise[middle] / of.loads[middle] / float(np.linalg.norm(minutes - minutes.mean()))),
        by_converter=widest < force_limit,
    )


# --- A tolerance of each film's force sensitivity, or a time: how often the loads are set on the way up
#
# The sensitivity is the slope of the line through all load sets. The first sets tell how much they scatter about it,
# and that tells how many rounds of the loads there are in all, as `instrument.allocation.stopping` has it. The error
# of the load cell is common to all of them.

READING = "reading of the loads"
LOAD_CELL = "load cell"
RESERVE = 1.0  # s, for a round that takes longer than usual

Set = tuple[float, float]  # a load [N], and a film's voltage under it [V]


@dataclass(frozen=True)
class SlopeSets(Repeated):
    """The load sets on the way up for the force sensitivity of a film, which has a number; all films have one plan."""

    of: Conditions
    number: int

    def are_enough(self, points: Sequence[FilmsPoint]) -> bool:
        """Whether the valid ones of the points reach the tolerance, or by their scatter no number of them does."""
        sets = self._valid(points)
        if self.tolerance is None or len(sets) < FIRST:
            return False
        try:
            verdict = enough(self.lines, self.costs, self.tolerance, self.plan, 1.0, [self._apart(sets)])
        except RangeError:
            return True
        parts = self._line(sets), cell_component(self.of.cell)
        return bool(verdict.why) and self.reaches(Budget("slope", 1.0, "", parts).expanded())

    def line(self, points: Sequence[FilmsPoint]) -> Component | None:
        """Relative uncertainty of the slope, without that of the load cell; None: too few of the points are valid."""
        sets = self._valid(points)
        return self._line(sets) if sets else None

    def _valid(self, points: Sequence[FilmsPoint]) -> tuple[Set, ...]:
        """The valid load sets on the way up; empty: they are at too few different loads for a slope."""
        up = [p for p in points if p.direction == LOADING and p.valid]
        if len({p.load_N for p in up}) < LEAST_LOADS:
            return ()
        return tuple((p.load_measured_N, p.voltages_V[self.number]) for p in up)

    def _line(self, sets: Sequence[Set]) -> Component:
        parts = [part for part in self.answer(self._apart(sets)).budget.components if part.name != LOAD_CELL]
        least = budget([line for line in self.lines if line.name in (NOISE, READING)], 1, len(sets), self.plan.dwell).u
        u = max(math.hypot(*(part.u for part in parts)), least)  # a display may round a load alike in every round
        return Component("line", u, 1.0, min(part.degrees_of_freedom for part in parts), "A")

    def _apart(self, sets: Sequence[Set]) -> list[float]:
        """How far each set alone would move the slope, as the exponential that the rules of ratios take.

        A residual counts in standard deviations that are expected of it.
        """
        loads, volts = (np.array(values) for values in zip(*sets, strict=True))
        expected = np.interp(loads, self.of.loads, self.of.apart(self.of.design.films[self.number]))
        away = loads - loads.mean()
        square, size = float(away @ away), len(sets)
        slope = float(away @ volts) / square
        residuals = volts - volts.mean() - slope * away
        zeroth, first, second = (float(away**power @ expected**2) for power in range(3))
        of_line = zeroth / size**2 + 2 * away * first / size / square + (away / square) ** 2 * second
        own = (1 - 2 / size - 2 * away**2 / square) * expected**2
        of_set = budget(falling(self.lines), 1, 1, self.of.dwell).u
        moved: list[float] = np.exp(of_set * residuals / slope / np.sqrt(own + of_line)).tolist()
        return moved


def lines_of(of: Conditions, film: Film) -> tuple[BudgetLine, ...]:
    """Lines of a film's sensitivity."""
    loads, cell = np.array(of.loads), cell_component(of.cell)
    away = loads - loads.mean()
    weight = math.sqrt(loads.size) * away / float(away @ away)

    def slope_u(each: np.ndarray | float) -> float:
        """Relative uncertainty of the slope by one load set [1], of errors of the loads [N]."""
        return float(np.linalg.norm(weight * each))

    return (
        BudgetLine(SCATTER, slope_u(film.scatter * loads), RepeatUnit.SET, PRIOR_FREEDOM),
        BudgetLine(NOISE, slope_u(of.noise(film)) * math.sqrt(of.dwell), RepeatUnit.SECOND),
        BudgetLine(READING, slope_u(reading_u(of.cell, 1.0)), RepeatUnit.SET),
        BudgetLine(LOAD_CELL, cell.u, RepeatUnit.NOTHING, cell.degrees_of_freedom),
    )


def _for_time(ways: Sequence[RunOption], loads: int, time: float) -> Allocation:
    costs, dwell = ways[0].costs, ways[0].dwell
    each = loads * (costs.set + dwell)
    least = costs.start + each
    if time < least:
        raise RangeError(
            f"--time {as_typed(time, 's')} is too short: one round of {counted(loads, 'load')} and what follows take "
            f"{least:.0f} s; give more time, a shorter --drift-time, or fewer --loads"
        )
    rounds = max(1, math.floor((time - RESERVE - costs.start) / each))
    if rounds * loads > MOST_SETS:
        raise too_long(time, "on the way up")
    plans = [allocation(way.lines, costs, 1, rounds * loads, dwell) for way in ways]
    return max(plans, key=lambda plan: plan.half)


def _for_tolerance(ways: Sequence[RunOption], loads: int, tolerance: float) -> Allocation:
    better = share(tolerance / math.sqrt(2), 3)
    remedies = [
        f"or        a better calibration of the load cell: palpate calibrate load-cell --tolerance '{better}'",
        "note      signal-to-noise ratios and force ratios do not feel the load cell",
    ]
    each = {number: [way] for number, way in enumerate(ways)}
    found = repeated(each, tolerance, loads, "each force sensitivity", {LOAD_CELL: remedies})
    return max((each.plan for each in found.values()), key=lambda plan: (plan.sets, plan.half))


# --- the procedure -------------------------------------------------------------------------------------

LARGEST_DRIFT_TIME = 86_400.0  # s
DRIFT_POINTS = 10  # of the load that is held, after the first one
END = 7.0  # s, for the load cell's zero after the last point, with the probe moved home [M]
STANDING = 6 * CHARGE_AMPLIFIER  # s, until a film's offset stands still: before, steps round it anew in each record


@dataclass(frozen=True, slots=True)
class CharacteriseStep(Step):
    """One load, peak to peak. `direction` is LOADING, UNLOADING or HOLDING."""

    direction: str
    load_N: float


SlopePlan = Plan[CharacteriseStep, Sequence[SlopeSets] | None]


@dataclass(frozen=True)
class Characterisation(Procedure[CharacteriseStep, FilmsPoint, CharacteriseResult, Sequence[SlopeSets] | None]):
    """Find noise, sensitivity, resolution, linearity, hysteresis, dynamic range and drift of a sensor.

    The loads are set in increasing order, then in decreasing order. Then the middle one is held for `drift_time`. With
    a tolerance or a time, they are set in increasing order several times.
    """

    name = "characterise"
    point = FilmsPoint

    sample: SampleName = "1"
    loads: PeakLoads = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5)
    dwell: DwellTime = 1.0
    frequency: Frequency = 10.0
    drift_time: Annotated[float, Setting("s", "How long the middle load is held to see drift.", default="5 min")] = (
        300.0
    )
    tolerance: Annotated[
        float | None,
        tolerance_setting("of each film's force sensitivity; the loads up are repeated until all have it."),
    ] = None
    time: Annotated[
        float | None, bench_time("Bench time, which is filled with repeated loads up and not exceeded.")
    ] = None

    def check(self, target: Target) -> None:
        get_sample(self.sample)
        check_nodes(target.design, target.nodes, target.channels)
        if len(self.loads) < LEAST_LOADS:
            raise RangeError(
                f"{counted(len(self.loads), 'load')} cannot give a line with its scatter; give {LEAST_LOADS} or more"
            )
        check_force(self.loads, target.force_limit)
        check_increasing("loads", self.loads, "N")
        check_frequency(self.frequency, target)
        check_time(self.dwell, self.frequency)
        least = LEAST_DRIFT_POINTS * self.dwell
        if not least <= self.drift_time <= LARGEST_DRIFT_TIME:
            raise RangeError(
                f"drift time {self.drift_time:g} s is outside {least:g} s, {LEAST_DRIFT_POINTS} dwells, to"
                f" {LARGEST_DRIFT_TIME:g} s; give one inside"
            )
        if self.tolerance is not None:
            check_tolerance(self.tolerance, f"--tolerance {self.tolerance:g}")
        check_bench_time(self.time, "30 min")

    def required_loads(self) -> RequiredLoads:
        return RequiredLoads(self.loads)

    def plan(self, target: Target) -> SlopePlan:
        """All points: every load up, every load down, then the middle one several times.

        With a tolerance or a time, there are the most rounds up that a run can have.
        """
        times = [STANDING + self.interval * number for number in range(DRIFT_POINTS + 1)]
        of = self.conditions(target.design, probable_cell_of(target))
        if self.tolerance is not None or self.time is not None:
            repeats = self._repeats(of, target)
            forecast = self._forecast(repeats, times, target)
            return Plan(self.name, self._steps(target, repeats[0].most // len(self.loads)), forecast, repeats)
        steps = self._steps(target, 1)
        return Plan(self.name, steps, predicted(steps, expected_figures(of, 1, times, target.force_limit)))

    def _steps(self, target: Target, rounds: int) -> list[CharacteriseStep]:
        first, later = self._first(target), self._seconds()
        up = self.loads * rounds
        steps = [self._step(LOADING, load, later if number else first) for number, load in enumerate(up)]
        steps += [self._step(UNLOADING, load, later) for load in self.loads[::-1]]
        return steps + [self._step(HOLDING, self.middle, seconds) for seconds in self._holding()]

    def course(self, plan: SlopePlan, points: Sequence[FilmsPoint], lab: Lab) -> Generator[int, None, str]:
        """The rounds up end once they give the tolerance, or fill the time."""

        def full(step: CharacteriseStep, own: Sequence[FilmsPoint]) -> bool:
            return plan.basis is not None and step.direction == LOADING and self.has_enough(plan.basis, own)

        return until_full(plan.steps, points, lambda step: step.direction, full)

    def has_enough(self, repeats: Sequence[SlopeSets], up: Sequence[FilmsPoint]) -> bool:
        """Whether no further round is needed after the points on the way up."""
        if not up or len(up) % len(self.loads):
            return False
        if all(each.are_enough(up) for each in repeats):
            return True
        following = len(self.loads) * (repeats[0].costs.set + self.dwell) + self.after + RESERVE
        return self.time is not None and math.fsum(point.seconds or 0.0 for point in up) + following > self.time

    @property
    def after(self) -> float:
        """Expected time after the last round [s]."""
        return len(self.loads) * self._seconds() + math.fsum(self._holding()) + END

    def _repeats(self, of: Conditions, target: Target) -> tuple[SlopeSets, ...]:
        """The load sets for each film, with the plan in whole rounds by the film that needs most of them.

        Raises:
            RangeError: no number of rounds reaches the tolerance, or not one fits into the time; the message says what
                would do.
        """
        loads, later, plan = len(self.loads), self._seconds(), None
        costs = Costs(self._first(target) - later + self.after, 0.0, later - self.dwell)
        ways = [RunOption(lines_of(of, film), costs, self.dwell) for film in of.design.films]
        if self.tolerance is not None:
            plan = _for_tolerance(ways, loads, self.tolerance)
        if plan is None or (self.time is not None and plan.seconds > self.time):
            plan = _for_time(ways, loads, self.time or 0.0)
        return tuple(
            SlopeSets(way.lines, costs, plan, self.tolerance, of, number, rounds=loads)
            for number, way in enumerate(ways)
        )

    def _forecast(self, repeats: Sequence[SlopeSets], times: Sequence[float], target: Target) -> Predicted:
        """What the run is predicted to take and to give. Times as for `expected_figures`."""
        plan, loads, of = repeats[0].plan, len(self.loads), repeats[0].of
        rounds = plan.sets // loads
        slopes = [budget(falling(each.lines), 1, plan.sets, plan.dwell).u for each in repeats]
        figures = expected_figures(of, rounds, times, target.force_limit, slopes)

        def most(quantity: str) -> float:
            return max(each.u for each in figures if each.name.startswith(f"{quantity}, "))

        lines = [
            wanted_of("the force sensitivity of each film", self._tolerance_text, self.time),
            f"plan           {counted(rounds, 'round')} of {loads} loads up, of {show(self.dwell, 's')}; then down and "
            "held",
            f"time           {duration(plan.seconds)} ({target.mounts.described(1)})",
            f"expected       {plus_minus(plan.half, 3)} of each sensitivity at most; u of each resolution "
            f"{share(most(RESOLUTION), 3)},",
            f"               of each {SNR} {most(SNR):.2g} dB",
            binding(plan),
        ]
        planned = {"rounds": rounds, "sets": plan.sets, **plan.summary()}
        return foreseen(plan.seconds, plan.u, figures, lines, planned=planned)

    @property
    def _tolerance_text(self) -> str:
        """The tolerance for people; empty: there is none."""
        return "" if self.tolerance is None else plus_minus(self.tolerance, 3)

    def conditions(self, design: Design, cell: LoadCellCalibration) -> Conditions:
        """The conditions that a plan expects."""
        ratio, loads = expected_ratio(design, self.sample), tuple(self.loads)
        return Conditions(design, ratio, loads, self.frequency, self.dwell, cell)

    def _first(self, target: Target) -> float:
        """Expected time of the first load, with the sample's mounting [s]."""
        return point_seconds(self.frequency, self.dwell, first=True, mounts=target.mounts)

    def _seconds(self) -> float:
        """Expected time of a load after the first one [s]."""
        return point_seconds(self.frequency, self.dwell, first=False)

    def _holding(self) -> list[float]:
        """Expected time of each point of the load that is held [s]."""
        still = point_seconds(self.frequency, self.dwell, first=False, steps=0)
        return [self._seconds() + STANDING, *[max(0.0, self.interval - self.dwell) + still] * DRIFT_POINTS]

    @property
    def middle(self) -> float:
        """The load that is held [N]."""
        return self.loads[len(self.loads) // 2]

    def _step(self, direction: str, load: float, seconds: float) -> CharacteriseStep:
        what, group = f"{direction}, {show(load, 'N')}", f"mount sample {self.sample}"
        return CharacteriseStep(self.dwell, seconds, None, direction, load, what=what, group=group)

    @property
    def interval(self) -> float:
        """Time between two points of the load that is held [s]."""
        return self.drift_time / DRIFT_POINTS

    def begin(self, plan: SlopePlan, lab: Lab, record: Recorder) -> Characterising:
        return Characterising(lab, record, self)

    def evaluate(self, points: Sequence[FilmsPoint], plan: SlopePlan, lab: Lab) -> CharacteriseResult:
        widest = max(lab.bench.role(SensorNode).ranges.values())
        limit, repeats = lab.bench.force_limit, plan.basis
        lines = [line for each in repeats or () if (line := each.line(points))]
        found = evaluate(points, lab.design, lab.calibration, self.dwell, limit, widest, lines)
        if repeats is None:
            return found
        missed = [f"{plus_minus(u, 3)} of film {film}" for film, u in found.sensitivities if not repeats[0].reaches(u)]
        where_missed = f": {', '.join(missed)}" if missed else ""
        return replace(found, stopped=ended_by("round of loads", self._tolerance_text, self.time, where_missed))

    def report(self, result: CharacteriseResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.characterise.report import plot_characteristics, show_characteristics

        simulated = lab.bench.simulated
        return Report(partial(show_characteristics, result), partial(plot_characteristics, result, simulated))


class Characterising(DynamicLoadWork):
    """The bench work: loads up, loads down, then one load that is held."""

    def __init__(self, lab: Lab, record: Recorder, asked: Characterisation) -> None:
        self._laps = Laps(lab.bench.clock, asked.time is not None)
        super().__init__(lab, record, asked.loads, asked.frequency, (asked.sample,))
        self._asked = asked
        self._held_ns: int | None = None  # bench time since which the last load is held

    def arrange(self, step: CharacteriseStep) -> None:
        self.press(get_sample(self._asked.sample))

    def take(self, step: CharacteriseStep) -> Measurement[FilmsPoint]:
        clock = self.lab.bench.clock
        if self._held_ns is None:
            self.set(step.load_N, step.what)
        else:
            clock.wait(max(0.0, self._asked.interval - self._asked.dwell))
        if step.direction == HOLDING and self._held_ns is None:
            self._held_ns = clock.now_ns()
            clock.wait(STANDING)
        measured = self.held(step.load_N, step.what, self._asked.dwell, compare=False)
        time = 0.0 if self._held_ns is None else 1e-9 * (clock.now_ns() - self._held_ns)
        point = _point(step, time, self._laps.seconds(), measured)
        return self.measurement(point, measured)


def _point(step: CharacteriseStep, time: float, seconds: float | None, measured: FilmPoint) -> FilmsPoint:
    fit = measured.fit
    return gathered(
        FilmsPoint, step, measured,
        time_s=time,
        voltages_V=tuple(float(v) for v in 2 * fit.amplitude),
        voltages_u=tuple(float(u) for u in 2 * fit.amplitude_u),
        noise_V=tuple(float(v) for v in fit.rapid.rms),
        noise_u=tuple(float(u) for u in fit.rapid.rms_u),
        noise_freedom=float(fit.rapid.degrees_of_freedom),
        noise_peak_V=tuple(float(v) for v in fit.rapid.greatest),
        samples=fit.samples,
        seconds=seconds,
    )  # fmt: skip
