"""Position sweep (thesis 4.3, Table A2.7): a point load along the base of two teeth, found by the films."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

from palpate.instrument.errors import RangeError
from palpate.instrument.findings.position import locate
from palpate.instrument.models.influence import check_place, tooth_shares
from palpate.instrument.quantity import counted, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.instrument.thesis import read_table
from palpate.procedures.engine.plan import Plan, Step, point_seconds
from palpate.procedures.engine.procedure import Measurement, Report, RequiredLoads, until_full
from palpate.procedures.engine.promise import predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.measurements.position.expected import ONCE, expected_places, place_seconds
from palpate.procedures.measurements.position.repeats import FEWEST, LARGEST, PlaceRepeats, mm
from palpate.procedures.measurements.position.result import PositionPoint, PositionResult, evaluate
from palpate.procedures.measurements.settings import DwellTime, Frequency, PeakLoad, SampleName, bench_time
from palpate.procedures.measurements.sweep import Sweep, SweepWork
from palpate.procedures.records.columns import gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import check_bench_time, check_force, check_frequency, check_increasing, check_time
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.laps import Laps
from palpate.procedures.steps.probe import lower, mount, withdraw

SMALLEST = 1e-5  # m, of a tolerance
TABLE = "A2.7"


@dataclass(frozen=True, slots=True)
class PositionStep(Step):
    """One position of the point load, along the base."""

    position_mm: float


@dataclass(frozen=True)
class PositionSweep(Sweep[PositionStep, PositionPoint, PositionResult, PlaceRepeats | None]):
    """Move a point load along the base of two teeth; find its place and size by the films."""

    name = "sweep-position"
    point = PositionPoint
    manual_work = "sets the point probe"
    automated_by = "probe_stage"

    positions: Annotated[
        tuple[float, ...],
        Setting("m", "Positions along x: first:last:step or a list, increasing.", default="0 mm:24 mm:2 mm"),
    ] = tuple(round(2e-3 * number, 12) for number in range(13))
    sample: SampleName = "1"
    load: PeakLoad = 2.0
    dwell: DwellTime = 1.0
    frequency: Frequency = 10.0
    tolerance: Annotated[
        float | None,
        Setting(
            "m",
            "Half-width of the 95 % interval of each found place, in place of --dwell; load sets are repeated until it"
            " is reached.",
            example="0.2 mm",
            determines="dwell",
        ),
    ] = None
    time: Annotated[
        float | None,
        bench_time(
            "Instead of --dwell: bench time of the sweep, which is filled with load sets and not exceeded.",
            determines="dwell",
        ),
    ] = None

    def check(self, target: Target) -> None:
        """Refuse what cannot be done, before any device is spoken to.

        Raises:
            RangeError: too few positions, one off the sensor, a design without a table of point loads, a load beyond
                the force limit in N, a frequency or dwell that gives no estimate, or too few sensor nodes; a tolerance
                that no load sets reach, or a time that holds too few.
            UnknownName: an unknown sample.
        """
        check_nodes(target.design, target.nodes, target.channels)
        sample = get_sample(self.sample)
        if len(self.positions) < FEWEST:
            raise RangeError(f"{counted(len(self.positions), 'position')} cannot make a sweep; give {FEWEST} or more")
        check_increasing("positions", self.positions, "m")
        for position in self.positions:
            check_place(target.design, position)
            tooth_shares(target.design, sample, _at(target.design, position))
        check_force((self.load,), target.force_limit)
        check_frequency(self.frequency, target)
        if not self._repeated:
            check_time(self.dwell, self.frequency)
        if self.tolerance is not None:
            _check_tolerance(self.tolerance)
        check_bench_time(self.time, "30 min")

    def required_loads(self) -> RequiredLoads:
        return RequiredLoads((self.load,), self.extrapolate)

    @property
    def _repeated(self) -> bool:
        """Whether load sets are repeated, for a tolerance or to fill a time."""
        return self.tolerance is not None or self.time is not None

    def plan(self, target: Target) -> Plan[PositionStep, PlaceRepeats | None]:
        """Every position, from left to right; with a tolerance or a time, the most load sets at each."""
        if self._repeated:
            asked = get_sample(self.sample), tuple(self.positions), self.load, self.frequency
            return self._of_repeats(PlaceRepeats(target.design, *asked, self.tolerance, self.time))
        steps = [self._step(position, self.dwell, 1) for position in self.positions]
        places = [_at(target.design, position) for position in self.positions]
        found = expected_places(target.design, get_sample(self.sample), places, self.load, self.dwell)
        return Plan(self.name, steps, predicted(steps, found))

    def _of_repeats(self, repeats: PlaceRepeats) -> Plan[PositionStep, PlaceRepeats | None]:
        plans = repeats.allocations
        steps = [
            self._step(position, plans[position].dwell, number)
            for position in self.positions
            for number in range(1, repeats.most(position) + 1)
        ]
        return Plan(self.name, steps, repeats.predicted(), repeats)

    def _step(self, position: float, dwell: float, number: int) -> PositionStep:
        seconds = point_seconds(self.frequency, dwell, first=False)
        if number == 1:
            seconds = place_seconds(self.frequency, dwell, self.load)
            seconds += ONCE if position == self.positions[0] else 0.0
        what = show(position, "m") + (f", set {number}" if number > 1 else "")
        group = f"mount sample {self.sample}"
        return PositionStep(dwell, seconds, None, 1e3 * position, what=what, group=group)

    def course(
        self, plan: Plan[PositionStep, PlaceRepeats | None], points: Sequence[PositionPoint], lab: Lab
    ) -> Generator[int, None, str]:
        """Each position ends once it has the load sets that the tolerance needs, or that the time allows."""
        repeats = plan.basis

        def full(step: PositionStep, own: Sequence[PositionPoint]) -> bool:
            return repeats is not None and repeats.has_enough(self.place(step), own, points)

        return until_full(plan.steps, points, lambda step: step.position_mm, full)

    def place(self, step: PositionStep) -> float:
        """Position of a step [m], to the last digit."""
        return next(place for place in self.positions if 1e3 * place == step.position_mm)

    def begin(self, plan: Plan[PositionStep, PlaceRepeats | None], lab: Lab, record: Recorder) -> PositionSweepWork:
        return PositionSweepWork(lab, record, self)

    def evaluate(
        self, points: Sequence[PositionPoint], plan: Plan[PositionStep, PlaceRepeats | None], lab: Lab
    ) -> PositionResult:
        repeats = plan.basis
        if repeats is None:
            return evaluate(points)
        found = [repeats.place(position, points) for position in self.positions]
        places = [place for place in found if place is not None]
        return evaluate(points, places, repeats.stopped(places))

    def report(self, result: PositionResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.position.report import plot_sweep, show_sweep

        plot = partial(plot_sweep, result, lab.design, get_sample(self.sample), lab.bench.simulated)
        return Report(partial(show_sweep, result, lab.design), plot)


class PositionSweepWork(SweepWork):
    """A position sweep on the bench: the point probe presses at one place after the other."""

    def __init__(self, lab: Lab, record: Recorder, sweep: PositionSweep) -> None:
        self._laps = Laps(lab.bench.clock, sweep.time is not None)
        super().__init__(lab, record, sweep, (sweep.load,), sweep.frequency, (sweep.sample,))
        self._sweep, self._sample = sweep, get_sample(sweep.sample)
        self._pressed: float | None = None  # position on which the probe presses [mm]

    def arrange(self, step: PositionStep) -> None:
        mount(self.lab.bench, self._sample)

    def take(self, step: PositionStep) -> Measurement[PositionPoint]:
        design, position = self.lab.design, self._sweep.place(step)
        if self._pressed != step.position_mm:
            self._press(position, step.position_mm)
        measured = self.load_set(self._sweep.load, step.what, float(step.dwell_s or 0.0))
        point = replace(_point(design, self._sample, position, measured), seconds=self._laps.seconds())
        return Measurement(point, measured.waveforms(design))

    def _press(self, position: float, position_mm: float) -> None:
        bench = self.lab.bench
        withdraw(bench)
        bench.operator.place_probe(*_at(self.lab.design, position))
        onto = f"sample {self._sweep.sample} at {show(position, 'm')}"
        self.hold(lower(bench, self.lab.calibration, self.preload, onto))
        self._pressed = position_mm


def _check_tolerance(tolerance: float) -> None:
    """Check the half-width of a place's interval [m] that is asked for. Raises RangeError."""
    limits = f"is outside {mm(SMALLEST)} to {mm(LARGEST)}"
    if not tolerance >= SMALLEST:
        raise RangeError(f"--tolerance {mm(tolerance)} {limits}; give one inside, such as '0.2 mm'")
    if not tolerance <= LARGEST:
        raise RangeError(
            f"--tolerance {mm(tolerance)} {limits}; leave it out: more than one load set at a position would not help"
        )


def _at(design: Design, position: float) -> tuple[float, float]:
    return position, design.cell[1] / 2


def _point(design: Design, sample: Sample, position: float, measured: FilmPoint) -> PositionPoint:
    forces = measured.forces(design)
    left, right = forces.teeth
    shares = (left.force_ratio, right.force_ratio)
    found = locate(design, sample, shares, (left.noise_u, right.noise_u), design.tooth_covariance)
    model = tooth_shares(design, sample, _at(design, position))
    thesis = _thesis().get(round(1e3 * position, 6), (None, None))
    return gathered(
        PositionPoint, measured,
        position_mm=1e3 * position,
        force_left_N=left.force_N,
        force_right_N=right.force_N,
        share_left=left.force_ratio,
        share_left_u=left.force_ratio_u,
        share_right=right.force_ratio,
        share_right_u=right.force_ratio_u,
        model_share_left=model[0],
        model_share_right=model[1],
        thesis_share_left=thesis[0],
        thesis_share_right=thesis[1],
        found_mm=1e3 * found.position,
        found_u=1e3 * found.u,
        found_low_mm=1e3 * found.low,
        found_high_mm=1e3 * found.high,
        found_force_N=forces.force_total_N,
        found_force_u=forces.force_total_u,
    )  # fmt: skip


def _thesis() -> dict[float, tuple[float | None, float | None]]:
    """Shares of the left and the right tooth in Table A2.7, by the place in mm."""
    table = read_table(TABLE)
    rows = zip(table.keys(), table.values("force_pvdf3_N"), table.values("force_pvdf1_N"), strict=True)
    return {round(float(x), 6): (float(left), float(right)) for x, left, right in rows}
