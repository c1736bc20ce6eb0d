"""The load sweep (thesis 5.4.1): the force ratio of each sample under each load."""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit
from palpate.instrument.allocation.repeated import Repeated
from palpate.instrument.allocation.stopping import RunRatio
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import RangeError, quoted
from palpate.instrument.findings.film_forces import (
    CALIBRATION,
    NOISE,
    PICKUP,
    PRIOR_FREEDOM,
    SCATTER,
    ToothPoint,
    calibration_u,
    film_forces,
    mean_ratio,
    pickup_u,
)
from palpate.instrument.models.evidence import Evidence
from palpate.instrument.quantity import check_tolerance, plus_minus, show
from palpate.instrument.sensor.design import THESIS_LOADS, Design
from palpate.instrument.sensor.sample import get_sample, parse_samples
from palpate.instrument.signals.dwell import STEP, Floor, RequiredDwell, dwell_of, floor_u, half_width
from palpate.instrument.signals.estimate import SineFit
from palpate.instrument.uncertainty.budget import Budget
from palpate.procedures.engine.plan import Plan, Step, expected_noise, point_seconds
from palpate.procedures.engine.procedure import (
    Expected,
    Measurement,
    Report,
    RequiredLoads,
    foreseen,
    predicted,
    until_full,
)
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.lab import Dwells, Lab, Target
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.measurements.prospects import (
    binding,
    expected_mean,
    expected_ratio,
    options,
    repeated,
    share,
    wanted_of,
)
from palpate.procedures.measurements.settings import DwellTime, Frequency, tolerance_setting
from palpate.procedures.measurements.work import Sweep, SweepWork
from palpate.procedures.records.columns import LAST, Column, columns_of, gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.showing.figure import name_all, new_figure, plot_over_loads, save, with_u
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.tables import NOTHING, table_of
from palpate.procedures.showing.text import OUTSIDE, legend, new_table, percent, stamped
from palpate.procedures.steps.checks import check_force, check_frequency, check_increasing, check_time, set_names
from palpate.procedures.steps.film_point import DwellChoice, FilmPoint, recording_seconds
from palpate.procedures.steps.films import check_nodes

if TYPE_CHECKING:
    from rich.table import Table

# --- the points and the result of a load sweep ---------------------------------------------------------


def marked_load(point: LoadPoint) -> str:
    """The load that was asked for, with a mark where it lies outside the calibrated range."""
    return f"{point.load_N:g}{OUTSIDE * point.extrapolated}"


@dataclass(frozen=True, slots=True)
class LoadPoint:
    """One load on one sample. Forces and voltages are peak to peak."""

    sample: columns.SampleOf
    load_N: Annotated[float, replace(columns.ASKED, cell=marked_load)]
    indicator_mV: columns.Indicator
    load_measured_N: columns.MeasuredLoad
    load_measured_u: float
    voltage_rigid_V: Annotated[float, Column("sum of the rigid films' voltages", "V", "rigid\nmV", "z.3f", 1e3)]
    voltage_total_V: Annotated[float, Column("sum of the base films' voltages", "V", "total\nmV", "z.2f", 1e3)]
    force_rigid_N: Annotated[float, Column("sum of forces on the teeth", "N", "rigid\nN", "z.3f", u="force_rigid_u")]
    force_total_N: Annotated[float, Column("sum of forces on the bases", "N", "total\nN", "z.3f", u="force_total_u")]
    force_ratio: columns.ForceRatio
    force_ratio_u: columns.ForceRatioU
    noise_u: columns.NoiseU
    condition: Annotated[float, Column("condition number of the fit")]
    valid: columns.Valid
    dwell_s: Annotated[float | None, Column("the dwell", "s", "dwell\ns", "z.4g")] = None
    relative_u: Annotated[
        float | None,
        Column("`force_ratio_u` over `force_ratio`", "", "u\n%", "z.2f", 100, after="relative_u_predicted"),
    ] = None
    relative_u_predicted: Annotated[
        float | None,
        Column(
            "the `relative_u` for which the dwell was chosen; null: the dwell was given", "", "u to be\n%", "z.2f", 100
        ),
    ] = None
    settling_s: Annotated[float | None, columns.SETTLING] = None
    attempts: columns.Attempts = 1
    flags: columns.Flags = ()
    incidents: columns.Incidents = 0
    teeth: Annotated[tuple[ToothPoint, ...], Column("forces and ratio of each tooth, if there are several")] = ()
    extrapolated: columns.Extrapolated = False
    calibration_u: columns.CalibrationU = 0.0
    force_rigid_u: float | None = None
    force_total_u: float | None = None
    pickup_u: columns.PickupU = 0.0
    degrees_of_freedom: Annotated[float | None, columns.FREEDOM] = None


@dataclass(frozen=True, slots=True)
class SampleMean:
    """The mean force ratio of one sample over its valid points."""

    sample: columns.SampleOf
    force_ratio: Annotated[
        float | None, Column("the mean; null: no point is valid", head="ours", cell="z.4f", u="force_ratio_u")
    ]
    force_ratio_u: Annotated[float | None, Column(head="u", cell="z.4f")]
    valid_points: Annotated[int, Column("number of valid points", head="valid points", after=LAST)]
    thesis_force_ratio: Annotated[
        float | None, Column("the thesis' mean; null: it has none", head="thesis", cell="z.4g")
    ]
    teeth: Annotated[tuple[float, ...], Column("mean ratio of each tooth to its base, if there are several")] = ()

    @property
    def relative_u(self) -> float | None:
        """`force_ratio_u` over `force_ratio`; None: there is no mean."""
        return self.force_ratio_u / self.force_ratio if self.force_ratio and self.force_ratio_u is not None else None


@dataclass(frozen=True, slots=True)
class SweepResult:
    """The result of a load sweep.

    Attributes:
        points: the points.
        samples: mean force ratio of each sample.
        softness_order: names of the samples with a valid point, from hard to soft.
        budgets: uncertainty budget of each mean.
        halves: half-width of the 95 % interval of each valid point, relative.
        tolerance: half-width that was asked for; None: none was.
        tolerance_for: "point", or "mean" of each sample; None: there is no tolerance.
    """

    points: list[LoadPoint]
    samples: list[SampleMean]
    softness_order: list[str]
    budgets: tuple[Budget, ...]
    halves: tuple[float, ...] = ()
    tolerance: float | None = None
    tolerance_for: str | None = None

    @property
    def achieved_u(self) -> float | None:
        """Greatest relative standard uncertainty of what the tolerance is of, else of the means; None: one lacks."""
        of = {"point": [p.relative_u for p in self.points], "mean": [s.relative_u for s in self.samples]}
        found = of[self.tolerance_for or "mean"]
        us = [u for u in found if u is not None]
        return max(us) if us and len(us) == len(found) else None

    @property
    def reached(self) -> float | None:
        """Greatest half-width of a 95 % interval, relative, of what the tolerance is of; None: one is not known."""
        means = [budget.expanded() / budget.value for budget in self.budgets]
        found, of = (self.halves, self.points) if self.tolerance_for == "point" else (means, self.samples)
        return max(found) if found and len(found) == len(of) else None

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        return {
            "samples": [asdict(s) for s in self.samples],
            "softness_order": self.softness_order,
            **({} if self.tolerance is None else {"tolerance_for": self.tolerance_for}),
        }


def ratio_of(sample: str) -> str:
    """Name of the result for the mean force ratio of a sample."""
    return f"force ratio of sample {sample}"


def valid_ratios(points: Sequence[LoadPoint]) -> list[float]:
    """Ratios of the valid points."""
    return [point.force_ratio for point in points if point.valid and point.force_ratio > 0]


def evaluate(
    points: Sequence[LoadPoint], design: Design, repeats: Repeats | None = None, tolerance: float | None = None
) -> SweepResult:
    """The mean force ratio of each sample over its valid points, and the samples from hard to soft.

    Args:
        points: the points.
        design: the sensor.
        repeats: the load sets that were repeated, whose own scatter then tells the uncertainty of the mean; None: the
            scatter of the design tells it.
        tolerance: the tolerance that was asked for, of a point, or of the mean where sets were repeated.
    """
    means, budgets = [], []
    for name in dict.fromkeys(point.sample for point in points):
        valid = [point for point in points if point.sample == name and point.valid]
        n = len(valid)
        what = ratio_of(name)
        budget = mean_ratio(what, valid, design.film_freedom) if valid else None
        if repeats is not None and (ratios := valid_ratios(valid)):
            budget = _by_scatter(what, repeats[name].answer(ratios))
        budgets += [budget] if budget else []
        means.append(
            SampleMean(
                sample=name,
                force_ratio=budget.value if budget else None,
                force_ratio_u=budget.u if budget else None,
                valid_points=n,
                thesis_force_ratio=design.thesis_force_ratio.get(name),
                teeth=tuple(
                    math.fsum(t.force_ratio for t in same) / n for same in zip(*(p.teeth for p in valid), strict=True)
                ),
            )
        )
    measured = [(mean.force_ratio, mean.sample) for mean in means if mean.force_ratio is not None]
    order = [sample for _, sample in sorted(measured, reverse=True)]
    halves = tuple(_half(point, design) for point in points if point.valid and point.force_ratio > 0)
    wanted = None if tolerance is None else "point" if repeats is None else "mean"
    return SweepResult(list(points), means, order, tuple(budgets), halves, tolerance, wanted)


def _half(point: LoadPoint, design: Design) -> float:
    """Half-width of the 95 % interval of a point's ratio, relative."""
    return mean_ratio("", [point], design.film_freedom).expanded() / point.force_ratio


def _by_scatter(quantity: str, found: RunRatio) -> Budget:
    """The budget of a mean ratio by what its sets scatter."""
    parts = tuple(replace(part, sensitivity=found.ratio) for part in found.budget.components)
    return Budget(quantity, found.ratio, "", parts, found.budget.correlations)


# -------------------------------------------------------------------------------------------------------
# A tolerance of the mean ratio of each sample, below what one load set can have: how often the loads are
# repeated
#
# The sets of a sample take the loads in turn, in whole rounds. Its first sets tell how much sets scatter, and that
# tells how many there are in all, as `instrument.allocation.stopping` has it.

REMEDIES = {
    CALIBRATION: ["or        calibrate the films with more load sets: palpate calibrate films"],
    PICKUP: ["or        tie the films' cables down, and give the smaller pick-up in the bench file"],
}


def lines_of(design: Design, sample: str, loads: Sequence[float]) -> list[BudgetLine]:
    """Lines of the mean ratio of a sample by sets that take the loads in turn [N]."""
    ratio = expected_ratio(design, sample)
    noise = math.sqrt(math.fsum(expected_noise(design, load, ratio) ** 2 for load in loads) / len(loads))
    scatter, *fixed = floor_of(design, ratio)
    return [
        BudgetLine(scatter.name, scatter.u, RepeatUnit.SET, scatter.degrees_of_freedom),
        BudgetLine(NOISE, noise, RepeatUnit.SECOND),
        *(BudgetLine(part.name, part.u, RepeatUnit.NOTHING, part.degrees_of_freedom) for part in fixed),
    ]


def floor_of(design: Design, ratio: float) -> tuple[Floor, ...]:
    """Relative uncertainties of a force ratio that no dwell lowers, for one tooth and its base; the scatter first."""
    scatter = Floor(SCATTER, design.ratio_scatter, PRIOR_FREEDOM)
    films = Floor(CALIBRATION, calibration_u(design), design.film_freedom or math.inf)
    pickup = Floor(PICKUP, pickup_u(design) * math.hypot(1.0, 1 / ratio))
    return (scatter, *(part for part in (films, pickup) if part.u))


def one_set_suffices(design: Design, samples: Sequence[str], tolerance: float) -> bool:
    """Whether one load set of each sample can have a tolerance; if not, it is one of the mean."""
    return all(tolerance > half_width(floor_of(design, expected_ratio(design, sample))) for sample in samples)


# --- the procedure -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LoadStep(Step):
    """One load on one sample, peak to peak."""

    sample: str
    load_N: float


Repeats = Mapping[str, Repeated]  # the load sets of each sample, where these are repeated
LoadPlan = Plan[LoadStep, Repeats | None]


@dataclass(frozen=True)
class LoadSweep(Sweep[LoadStep, LoadPoint, SweepResult, Repeats | None]):
    """Load each sample with each load and measure the force ratio."""

    name = "sweep-loads"
    point = LoadPoint
    resumable_on_real_bench = True

    samples: Annotated[
        tuple[str, ...], Setting(help="Rubber samples, in order.", read=parse_samples, default="1-6")
    ] = ("1", "2", "3", "4", "5", "6")
    loads: Annotated[
        tuple[float, ...] | None,
        Setting(
            "N",
            "Loads, peak to peak: first:last:step or a list. A load may be repeated. Default: those of the thesis'"
            " tables of this sensor.",
        ),
    ] = None
    dwell: DwellTime = 1.0
    frequency: Frequency = 10.0
    tolerance: Annotated[
        float | None,
        tolerance_setting(
            "of each point, in place of --dwell; where no load set can have it, of the mean of each sample, whose loads"
            " are then repeated.",
            determines="dwell",
        ),
    ] = None

    @property
    def sets(self) -> tuple[float, ...]:
        """The loads [N]; those of the single sensor's tables until `on` has told which sensor it is."""
        return THESIS_LOADS if self.loads is None else self.loads

    def on(self, target: Target) -> LoadSweep:
        return replace(self, loads=target.design.thesis_loads) if self.loads is None else self

    def check(self, target: Target) -> None:
        check_nodes(target.design, target.nodes, target.channels)
        for sample in self.samples:
            get_sample(sample)
        if len(set(self.samples)) < len(self.samples):
            raise RangeError(f"samples {quoted(list(self.samples))}: one is named twice; name each sample once")
        check_force(self.sets, target.force_limit)
        check_increasing("loads", self.sets, "N", repeated=True)
        check_frequency(self.frequency, target)
        if self.tolerance is None:
            check_time(self.dwell, self.frequency)
            return
        check_tolerance(self.tolerance, f"tolerance {self.tolerance:g}")

    def required_loads(self) -> RequiredLoads:
        return RequiredLoads(self.sets, self.extrapolate)

    def dwells(self) -> Dwells:
        dwell = self.dwell if self.tolerance is None else max(STEP, 1 / self.frequency)
        objects = [get_sample(name) for name in self.samples]
        return Dwells(objects, (min(self.sets), max(self.sets)), self.frequency, dwell)

    def plan(self, target: Target) -> LoadPlan:
        """All points: every load on every sample.

        Where one load set of a sample cannot have the tolerance, it is one of the mean: then the basis are the repeated
        load sets, and the steps are the most of each sample.
        """
        if self.tolerance is not None and not one_set_suffices(target.design, self.samples, self.tolerance):
            return self._repeated(target, self.tolerance)
        sets = list(zip(self.sets, set_names(self.sets), strict=True))
        steps = [
            self._step(target, name, load, load_text, first=not number)
            for name in self.samples
            for number, (load, load_text) in enumerate(sets)
        ]
        forecast = predicted(steps, [self._expected(target.design, name) for name in self.samples])
        if self.tolerance is not None:
            worst = max(step.ratio_u_expected or 0.0 for step in steps)
            forecast = replace(forecast, u=worst, details={**forecast.details, "tolerance_for": "point"})
        return Plan(self.name, steps, forecast)

    def _repeated(self, target: Target, tolerance: float) -> LoadPlan:
        """The most load sets of each sample for a tolerance of its mean."""
        design, mounts, steps = target.design, target.mounts, []
        first, later = (point_seconds(self.frequency, STEP, first=first, mounts=mounts) for first in (True, False))
        costs = Costs(first - later, 0.0, later - STEP)
        ways = {each: options(lines_of(design, each, self.sets), costs, self.frequency) for each in self.samples}
        repeats = repeated(ways, tolerance, len(self.sets), "the mean ratio of sample {}", REMEDIES)
        for sample, each in repeats.items():
            for number in range(each.most):
                load, dwell = self.sets[number % len(self.sets)], each.plan.dwell
                seconds = point_seconds(self.frequency, dwell, first=not number, mounts=mounts)
                what, group = f"sample {sample}, {load:g} N, set {number + 1}", f"mount sample {sample}"
                steps.append(LoadStep(dwell, seconds, design.ratio_scatter, sample, load, what=what, group=group))
        plans = {sample: each.plan for sample, each in repeats.items()}
        seconds, worst = math.fsum(plan.seconds for plan in plans.values()), max(plans.values(), key=lambda p: p.half)
        sets = ", ".join(f"{sample}: {plan.sets}" for sample, plan in plans.items())
        longest = show(max(plan.dwell for plan in plans.values()), "s")
        wanted = wanted_of("the mean ratio of each sample", plus_minus(tolerance, 3))
        lines = [
            f"{wanted}; one load set scatters by u = {share(design.ratio_scatter, 3)}",
            f"plan           load sets of each sample: {sets}, of {longest} at most: {duration(seconds)} "
            f"({mounts.described(len(plans))})",
            f"expected       {plus_minus(worst.half, 3)} at most",
            binding(worst),
        ]
        results = [Expected(ratio_of(sample), plan.u) for sample, plan in plans.items()]
        planned = {s: {"sets": plan.sets, "dwell_s": plan.dwell, **plan.summary()} for s, plan in plans.items()}
        u = max(plan.u for plan in plans.values())
        forecast = foreseen(seconds, u, results, lines, tolerance_for="mean", planned=planned)
        return Plan(self.name, steps, forecast, repeats)

    def course(self, plan: LoadPlan, points: Sequence[LoadPoint], lab: Lab) -> Generator[int, None, str]:
        """Each sample ends once it has the load sets that the tolerance of its mean needs."""

        repeats = plan.basis

        def full(step: LoadStep, own: Sequence[LoadPoint]) -> bool:
            return repeats is not None and repeats[step.sample].is_enough(len(own), valid_ratios(own))

        return until_full(plan.steps, points, lambda step: step.sample, full)

    def _expected(self, design: Design, sample: str) -> Expected:
        """The mean ratio that is expected of a sample, by the lines of `mean_ratio`."""
        ratio = expected_ratio(design, sample)
        dwells = [
            self.dwell if self.tolerance is None else self._chosen(design, load, ratio).dwell for load in self.sets
        ]
        return Expected.of(expected_mean(ratio_of(sample), design, ratio, self.sets, dwells))

    def _step(self, target: Target, sample: str, load: float, load_text: str, first: bool) -> LoadStep:
        design = target.design
        ratio = expected_ratio(design, sample)
        floor, noise = floor_of(design, ratio), expected_noise(design, load, ratio)
        recording, u = self.dwell, math.hypot(floor_u(floor), noise / math.sqrt(self.dwell))
        if self.tolerance is not None:
            chosen = self._chosen(design, load, ratio)
            recording, u = recording_seconds(chosen.dwell, self.frequency), chosen.u
        seconds = point_seconds(self.frequency, recording, first=first, mounts=target.mounts)
        what, group = f"sample {sample}, {load_text}", f"mount sample {sample}"
        dwell = None if self.tolerance else self.dwell
        return LoadStep(dwell, seconds, u, sample, load, what=what, group=group)

    def _chosen(self, design: Design, load: float, ratio: float) -> RequiredDwell:
        """The dwell that is expected to be chosen for the tolerance."""
        assert self.tolerance is not None
        return dwell_of(self.tolerance, expected_noise(design, load, ratio), self.frequency, floor_of(design, ratio))

    def begin(self, plan: LoadPlan, lab: Lab, record: Recorder) -> LoadSweepWork:
        return LoadSweepWork(lab, record, self, by_point=self.tolerance is not None and plan.basis is None)

    def evaluate(self, points: Sequence[LoadPoint], plan: LoadPlan, lab: Lab) -> SweepResult:
        return evaluate(points, lab.design, plan.basis, self.tolerance)

    def report(self, result: SweepResult, lab: Lab) -> Report:
        simulated = lab.bench.simulated
        return Report(partial(show_sweep, result, lab.design), partial(plot_sweep, result, lab.design, simulated))


class LoadSweepWork(SweepWork):
    """The bench work: one load after the other on each sample."""

    def __init__(self, lab: Lab, record: Recorder, sweep: LoadSweep, by_point: bool) -> None:
        """`by_point`: whether the tolerance is that of each point, whose dwell is chosen by its noise."""
        super().__init__(lab, record, sweep, sweep.sets, sweep.frequency, sweep.samples)
        self._chosen: DwellChoice | None = None
        if by_point and sweep.tolerance is not None:
            self._chosen = _chosen(lab.design, sweep.tolerance)

    def arrange(self, step: LoadStep) -> None:
        self.press(get_sample(step.sample))

    def take(self, step: LoadStep) -> Measurement[LoadPoint]:
        measured = self.load_set(step.load_N, step.what, self._chosen or float(step.dwell_s or 0.0))
        point = _point(self.lab.design, self.lab.calibration, step, measured)
        return self.measurement(point, measured)


def _chosen(design: Design, target: float) -> DwellChoice:
    """How a dwell is chosen from the noise of a short record, for a tolerance of the ratio."""

    def choose(short: SineFit) -> RequiredDwell:
        forces = film_forces(design, short)
        noise = forces.noise_u / forces.force_ratio * math.sqrt(short.samples / short.rate)
        return dwell_of(target, noise, short.frequency, floor_of(design, forces.force_ratio))

    return choose


def _point(design: Design, calibration: LoadCellCalibration, step: LoadStep, measured: FilmPoint) -> LoadPoint:
    forces = measured.forces(design)
    return gathered(
        LoadPoint, step, measured, forces,
        condition=measured.fit.condition,
        dwell_s=measured.dwell_s,
        relative_u=forces.force_ratio_u / forces.force_ratio if forces.force_ratio else None,
        teeth=forces.teeth if len(forces.teeth) > 1 else (),
        extrapolated=not calibration.covers(step.load_N),
    )  # fmt: skip


# --- what it shows -------------------------------------------------------------------------------------

ROUNDING = 1e-6  # of a tolerance
OF_CHOSEN = ("dwell_s", "relative_u_predicted", "relative_u")  # columns of points whose dwell was chosen


def show_sweep(result: SweepResult, design: Design, outcome: Outcome) -> list[object]:
    """The points, the means beside the thesis' means, and the softness order."""
    columns = columns_of(LoadPoint)
    if all(p.relative_u_predicted is None for p in result.points):
        columns = {name: column for name, column in columns.items() if name not in OF_CHOSEN}
    title = "Load sets (forces and voltages peak to peak)"
    points = table_of(stamped(outcome["simulated"], title), result.points, columns)
    evidence = outcome["evidence"] if design.thesis_force_ratio else None
    columns = columns_of(SampleMean) | {"difference": Column(head="difference", cell=_difference)}
    if evidence:
        columns["evidence"] = Column(head="evidence", cell=partial(_evidence, evidence))
    means = table_of(stamped(outcome["simulated"], "Mean force ratio"), result.samples, columns)
    compared = (
        f"   (thesis: {thesis_order})" if (thesis_order := _thesis_order(design, set(result.softness_order))) else ""
    )
    repeated = sum(p.attempts - 1 for p in result.points)
    return [
        points,
        *([_teeth(result, outcome["simulated"])] if any(s.teeth for s in result.samples) else []),
        means,
        *([_evidence_line(evidence, outcome["model"])] if evidence else []),
        f"softness order, hard to soft: {' > '.join(result.softness_order) or 'none, no point is valid'}{compared}",
        *legend(points, means),
        *([] if result.tolerance is None else [_tolerance(result.tolerance, result)]),
        _forces(result.points),
        *([f"repeated       {repeated} attempts were rejected; events of the run say why"] if repeated else []),
    ]


def _difference(mean: SampleMean) -> str:
    """The mean over the thesis' mean, less one."""
    if mean.force_ratio is None or mean.thesis_force_ratio is None:
        return NOTHING
    return f"{100 * (mean.force_ratio / mean.thesis_force_ratio - 1):+z.1f} %"


def _evidence(evidence: str, mean: SampleMean) -> str:
    """Which evidence the agreement of a mean with the thesis is."""
    return NOTHING if mean.force_ratio is None else evidence


def _tolerance(tolerance: float, result: SweepResult) -> str:
    """A line that says of what the tolerance is, and what was reached."""
    of = "the mean of each sample" if result.tolerance_for == "mean" else "each point"
    half = result.reached
    reached = f"{plus_minus(half, 3)} reached at most" if half is not None else "not known what was reached"
    missed = ", NOT REACHED" if half is not None and half > tolerance * (1 + ROUNDING) else ""
    return f"tolerance      {plus_minus(tolerance, 3)} of {of}: {reached}{missed}"


def _evidence_line(evidence: str, model: str | None) -> str:
    """A line that says what agreement with the thesis' means is worth. The scene's model may contain those means."""
    if evidence == Evidence.INPUT.value:
        return f"{evidence}: model {model} is the thesis' own means; agreement shows that the bench measures right"
    return f"{evidence}: model {model} knows nothing of the thesis' means"


def _forces(points: Sequence[LoadPoint]) -> str:
    """A line with the largest relative uncertainties of the forces. They hardly differ."""
    rigid, total = (
        max((u / abs(force) for force, u in pairs if u is not None and force), default=None)
        for pairs in (
            [(p.force_rigid_N, p.force_rigid_u) for p in points if p.valid],
            [(p.force_total_N, p.force_total_u) for p in points if p.valid],
        )
    )
    return f"forces         standard uncertainty, % at most: rigid {percent(rigid)}, total {percent(total)}"


def _thesis_order(design: Design, swept: set[str]) -> str:
    """The softness order of the thesis by its means, and that of its figure at 3 N if it differs."""
    means = sorted(design.thesis_force_ratio, key=lambda name: design.thesis_force_ratio[name], reverse=True)
    by_mean, figure = (
        " > ".join(name for name in order if name in swept) for order in (means, design.thesis_softness_order)
    )
    return by_mean if by_mean == figure else f"{by_mean}; its figure at 3 N: {figure}"


def _teeth(result: SweepResult, simulated: bool) -> Table:
    """A table of the mean ratio of each tooth, with a row for each sample."""
    count = max(len(s.teeth) for s in result.samples)
    teeth = new_table(
        stamped(simulated, "Mean force ratio of each tooth to its base"), "sample", *(str(i + 1) for i in range(count))
    )
    for s in result.samples:
        teeth.add_row(s.sample, *(f"{tooth:z.4f}" for tooth in s.teeth))
    return teeth


def plot_sweep(result: SweepResult, design: Design, simulated: bool, folder: Path) -> Path:
    """Plot force ratios over loads, and the means beside the thesis' means. Returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"force ratio, design {design.name}")
    for which, mean in enumerate(result.samples):
        points = [p for p in result.points if p.sample == mean.sample]
        plot_over_loads(left, which, f"sample {mean.sample}", points)
    if invalid := [p for p in result.points if not p.valid]:
        left.plot([p.load_N for p in invalid], [p.force_ratio for p in invalid], "rx", ms=10, label="not valid")
    left.set(xlabel="load, peak to peak (N)", ylabel="force ratio (bars: standard uncertainty)", ylim=(0, None))
    name_all(left, 4)
    shown = [s for s in result.samples if s.valid_points]
    place = range(len(shown))
    right.errorbar(place, *with_u(shown, "force_ratio"), fmt="o", capsize=3, label="this run")
    if design.thesis_force_ratio:
        right.plot(place, with_u(shown, "thesis_force_ratio")[0], "k_", ms=16, label="thesis, mean of its tables")
    right.set(xlabel="sample", ylabel="mean force ratio (bars: u)", ylim=(0, None))
    right.set_xticks(list(place), [s.sample for s in shown])
    name_all(right)
    return save(figure, folder)
