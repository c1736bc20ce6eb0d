"""Young modulus of a sample: the micro-positioner compresses it on a rigid support (thesis 5.3, Tables 5.2, 5.3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from palpate.drivers.roles import LoadIndicator, Positioner
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import DeviceError, RangeError, SafetyError, UnreachableError
from palpate.instrument.findings.compression import (
    LEAST_POINTS,
    LOADING,
    POSITION_STEP,
    SURE,
    UNLOADING,
    Compression,
    CompressionPoint,
    DisplaySeries,
    compress,
)
from palpate.instrument.quantity import show, show_with_u
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.instrument.thesis import COMPRESSION_TABLES, ThesisTable, read_table
from palpate.instrument.uncertainty.budget import Propagated
from palpate.procedures.engine.plan import Plan, Step
from palpate.procedures.engine.procedure import Expected, Measurement, Procedure, Report, predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.lab import MOUNTING, Lab, Target
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.measurements.prospects import display_u, load_cell_of
from palpate.procedures.measurements.settings import Extrapolate, SampleName
from palpate.procedures.records.columns import Column
from palpate.procedures.records.record import Recorder
from palpate.procedures.showing.figure import name_all, new_figure, save
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import MARKS, OUTSIDE, legend, new_table, stamped
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.probe import check_zero, finish, preload, withdraw
from palpate.procedures.steps.servo import READING_INTERVAL, TRACK_SETTLING, steady

if TYPE_CHECKING:
    from rich.table import Table as RichTable

# --- the points and the result of a compression test ---------------------------------------------------

NAMES = (
    ("tangent_modulus", "Pa"), ("secant_modulus", "Pa"), ("unloading_modulus", "Pa"), ("thickness", "m"),
    ("bench_compliance", "m_per_N"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class DisplaysPoint:
    """Readings of the indicator at one position."""

    series: Annotated[str, Column('"bare", "loading" or "unloading"')]
    position_m: Annotated[float, Column("position of the positioner", "m")]
    reading_mV: Annotated[float, columns.READING]
    readings_mV: columns.Readings
    incidents: columns.Incidents


@dataclass(frozen=True, slots=True)
class ModulusResult:
    """The tested sample and the evaluation of its compression."""

    sample: Sample
    compression: Compression

    @property
    def points(self) -> Sequence[CompressionPoint]:
        """Stress and strain of the sample, with the bench's compliance taken off."""
        return self.compression.points

    @property
    def budgets(self) -> Sequence[Propagated]:
        """The results with their budgets, in the order of NAMES."""
        return self.results()

    def results(self) -> tuple[Propagated, ...]:
        """The results, in the order of NAMES."""
        c = self.compression
        return c.tangent, c.secant, c.unloading, c.thickness, c.compliance

    def summary(self) -> dict[str, Any]:
        """The results for JSON; linearity and energy_loss are fractions."""
        public: dict[str, Any] = {"sample": self.sample.name}
        for (name, unit), found in zip(NAMES, self.results(), strict=True):
            public |= {f"{name}_{unit}": found.value, f"{name}_u": found.u}
        return {
            **public,
            "linearity": self.compression.linearity,
            "energy_loss": self.compression.energy_loss.value,
            "energy_loss_u": self.compression.energy_loss.u,
            "thesis_modulus_Pa": self.sample.modulus,
        }


# --- What a compression test is expected to give: Young moduli, thickness, and compliance of the bench -
#
# Each line of load over position has loads that are off by the display's steps and noise (`display_u`); the load
# cell's curve, the area [A] and the positions' steps add theirs. The sample has its known modulus and thickness. The
# pad's lines are straight [A], and the bare support yields by COMPLIANCE [M].

COMPLIANCE = 1e-3  # m/N, of the bench, which yields with the sample [M]


@dataclass(frozen=True, slots=True)
class _EvenLoads:
    """Loads that grow evenly from `first` to `last` [N] over positions, each off by `u` [N].

    Those of `least` [N] or less do not count, because they may be no contact.
    """

    first: float
    last: float
    steps: int
    u: float
    least: float

    @property
    def loads(self) -> np.ndarray:
        loads = np.linspace(self.first, self.last, self.steps)
        return loads[loads > self.least]

    @property
    def slope_u(self) -> float:
        """Relative standard uncertainty of the slope."""
        return self.u / float(np.linalg.norm(self.loads - self.loads.mean()))

    @property
    def mean_u(self) -> float:
        """Standard uncertainty of the mean load [N]."""
        return self.u / math.sqrt(len(self.loads))


# --- the procedure -------------------------------------------------------------------------------------

LARGEST_STRAIN = 0.6
LARGEST_STEPS = 100
LEAST_LOAD = 4.0  # least load at the largest strain, in steps of the indicator
DISPLAYS = 10  # readings at each position
BARE = (0.05, 0.6)  # least and greatest force on the bare support, as fractions of the force limit
AREA_U = 0.01  # relative standard uncertainty of the area: 0.05 mm on each edge of 10 mm [A]
BARE_SUPPORT = "bare"
SPEED = 1e-3  # m/s, of the positioner, unless it is told another
STARTING = 0.13  # s, that a move takes beyond its way [M]
TO_SUPPORT, TO_SAMPLE = 74.0, 12.5  # s, from home to the bare support, lightly and hard; and to the sample [M]


@dataclass(frozen=True, slots=True)
class CompressionStep(Step):
    """A position in a series.

    Attributes:
        series: "bare", "loading" or "unloading".
        number: number of the equal steps of compression, from 1; it counts down in unloading.
    """

    series: str
    number: int


@dataclass(frozen=True)
class ModulusTest(Procedure[CompressionStep, DisplaysPoint, ModulusResult]):
    """Compress a sample with the micro-positioner and find its Young modulus."""

    name = "test-modulus"
    point = DisplaysPoint
    manual_work = "lays the sample on the support"

    sample: SampleName
    strain: Annotated[float, Setting(help="Largest strain.", metavar="SHARE", default="30 %")] = 0.3
    steps: Annotated[int, Setting(help="Number of equal steps up to it, and back.")] = 10
    extrapolate: Extrapolate = False

    def check(self, target: Target) -> None:
        sample = get_sample(self.sample)
        if not 0 < self.strain <= LARGEST_STRAIN:
            raise RangeError(
                f"strain {self.strain:g} is outside 0 to {LARGEST_STRAIN:g}; give one inside, such as 30 %"
            )
        if not LEAST_POINTS <= self.steps <= LARGEST_STEPS:
            raise RangeError(
                f"steps {self.steps} is outside {LEAST_POINTS} to {LARGEST_STEPS}, which give a line with its "
                "uncertainty; give a number inside"
            )
        if target.travel is not None and not sample.thickness <= target.travel:
            raise RangeError(
                f"sample {sample.name!r} is {show(sample.thickness, 'm')} thick, beyond the positioner's travel of"
                f" {show(target.travel, 'm')}; test a thinner sample"
            )
        force = _force(sample, self.strain)
        if force > target.force_limit:
            raise RangeError(
                f"strain {self.strain:g} of sample {sample.name!r} takes about {force:.3g} N, above the bench's force"
                f" limit of {target.force_limit:g} N; strains up to {self.strain * target.force_limit / force:.2g} are"
                " possible"
            )

    def plan(self, target: Target) -> Plan[CompressionStep]:
        """All positions: down on the bare support, then down and up on the sample."""
        down = range(1, self.steps + 1)
        places = [(BARE_SUPPORT, n) for n in down] + [(LOADING, n) for n in down] + [(UNLOADING, n) for n in down[::-1]]
        steps = [self._step(series, number, target.force_limit) for series, number in places]
        return Plan(self.name, steps, predicted(steps, self._expected(load_cell_of(target), target.force_limit)))

    def _expected(self, cell: LoadCellCalibration, force_limit: float) -> list[Expected]:
        """Relative uncertainties of the tangent and the unloading modulus, of the thickness, and of the compliance.

        Empty where too few loads are surely contact, so that the run gives no result.
        """
        sample = get_sample(self.sample)
        load_u = display_u(cell, DISPLAYS) / cell.sensitivity_mV_per_N
        force = _force(sample, self.strain)
        sure = SURE * cell.resolution()
        support, pad = (
            _EvenLoads(first, last, self.steps, load_u, sure)
            for first, last in ((BARE[0] * force_limit, BARE[1] * force_limit), (force / self.steps, force))
        )
        if min(len(support.loads), len(pad.loads)) < LEAST_POINTS:
            return []
        yields = sample.thickness / (sample.modulus * sample.area)  # m/N, of the sample alone
        whole, thick = yields + COMPLIANCE, sample.thickness
        # Each error's relative effect on the thickness, which is the distance of two contacts, and on the tangent
        # modulus, which is thickness over yield and area. An error of a slope moves both, against each other.
        of_means = math.hypot(whole * pad.mean_u, COMPLIANCE * support.mean_u) / thick
        of_steps = POSITION_STEP / math.sqrt(6) / thick
        of_pad = whole * float(pad.loads.mean()) / thick, whole / yields
        of_support = COMPLIANCE * float(support.loads.mean()) / thick, COMPLIANCE / yields
        zero = cell.zero_u / cell.sensitivity_mV_per_N * yields / thick
        sensitivity = cell.sensitivity_u / cell.sensitivity_mV_per_N
        related = cell.covariance / cell.sensitivity_mV_per_N**2 * yields / thick
        curve = math.sqrt(max(zero**2 + sensitivity**2 + 2 * related, 0.0))

        def with_slopes(pad_slope: float, support_slope: float, *rest: float) -> float:
            return math.hypot(of_means, of_steps, pad_slope * pad.slope_u, support_slope * support.slope_u, *rest)

        thickness = with_slopes(of_pad[0], of_support[0], zero)
        both = of_support[1] - of_support[0]
        tangent = with_slopes(of_pad[1] - of_pad[0], both, curve, AREA_U)
        unloading = with_slopes(math.hypot(*of_pad), both, curve, AREA_U)
        return [
            Expected("tangent modulus", tangent),
            Expected("unloading modulus", unloading),
            Expected("thickness", thickness),
            Expected("compliance of the bench", math.hypot(support.slope_u, sensitivity)),
        ]

    def _step(self, series: str, number: int, force_limit: float) -> CompressionStep:
        seconds = self._moving(series, force_limit) + TRACK_SETTLING + (DISPLAYS - 1) * READING_INTERVAL
        if number == 1 and series != UNLOADING:
            seconds += MOUNTING + (TO_SUPPORT if series == BARE_SUPPORT else TO_SAMPLE)
        group = "lay the support bare" if series == BARE_SUPPORT else f"lay sample {self.sample} on the support"
        what = f"{series}, step {number} of {self.steps}"
        return CompressionStep(None, seconds, None, series, number, what=what, group=group)

    def _moving(self, series: str, force_limit: float) -> float:
        """Time to move from one position of a series to the next [s]."""
        sample = get_sample(self.sample)
        forces, yields = (BARE[1] - BARE[0]) * force_limit, COMPLIANCE
        if series != BARE_SUPPORT:
            forces, yields = _force(sample, self.strain), yields + sample.thickness / (sample.modulus * sample.area)
        return STARTING + forces * yields / self.steps / SPEED

    def begin(self, plan: Plan[CompressionStep], lab: Lab, record: Recorder) -> Compressing:
        return Compressing(lab, self)

    def evaluate(self, points: Sequence[DisplaysPoint], plan: Plan[CompressionStep], lab: Lab) -> ModulusResult:
        return self.result_of(points, lab.calibration)

    def result_of(self, points: Sequence[DisplaysPoint], calibration: LoadCellCalibration) -> ModulusResult:
        """The result, by a calibration of the load cell. Raises EstimateError: the points give none."""
        sample = get_sample(self.sample)
        bare, loading, unloading = (_series(points, name) for name in (BARE_SUPPORT, LOADING, UNLOADING))
        area_u = AREA_U * sample.area
        return ModulusResult(sample, compress(bare, loading, unloading, calibration, sample.area, area_u))

    def report(self, result: ModulusResult, lab: Lab) -> Report:
        return Report(partial(show_modulus, result), partial(plot_modulus, result, lab.bench.simulated))


def _series(points: Sequence[DisplaysPoint], name: str) -> DisplaySeries:
    own = [point for point in points if point.series == name]
    return DisplaySeries(np.array([point.position_m for point in own]), np.array([point.readings_mV for point in own]))


class Compressing:
    """The bench work: compresses the bare support, then the sample."""

    def __init__(self, lab: Lab, test: ModulusTest) -> None:
        """Raises UnreachableError, RangeError: the load cell cannot measure the loads; nothing has moved yet."""
        self._bench, self._calibration, self._test = lab.bench, lab.calibration, test
        self._sample = sample = get_sample(test.sample)
        self._pressed_bare: Sequence[tuple[float, float]] = ()  # position [m] and load [N], pressed lightly and hard
        self._positions = np.empty(0)
        resolution, force = self._calibration.resolution(), _force(sample, test.strain)
        if force < LEAST_LOAD * resolution:
            least = test.strain * LEAST_LOAD * resolution / force
            raise UnreachableError(
                f"strain {test.strain:g} of sample {sample.name!r} gives about {show(force, 'N', 3)}, below"
                f" {LEAST_LOAD:g} steps of the load indicator; ask for {least:.2g} or more"
            )
        count = sum(force * number / test.steps > SURE * resolution for number in range(1, test.steps + 1))
        if count < LEAST_POINTS:
            raise UnreachableError(
                f"of the loads up to about {show(force, 'N', 3)}, in {test.steps} steps, {count} would be above"
                f" {show(SURE * resolution, 'N', 3)}, which surely is contact, and {LEAST_POINTS} are needed; ask for a"
                " larger strain or more steps"
            )
        if force > self._calibration.greatest_N and not test.extrapolate:
            self._calibration.check_range(force)
        withdraw(self._bench)
        check_zero(self._bench, self._calibration)

    def arrange(self, step: CompressionStep) -> None:
        positions = self._on_support() if step.series == BARE_SUPPORT else self._on_sample()
        self._positions = np.round(positions / POSITION_STEP) * POSITION_STEP

    def take(self, step: CompressionStep) -> Measurement[DisplaysPoint]:
        position = float(self._positions[step.number - 1])
        what = f"{step.series}, {1e3 * position:.3f} mm"
        shown = carry_out(self._bench, what, partial(self._pressed, position))
        mean = math.fsum(shown) / len(shown)
        return Measurement(DisplaysPoint(step.series, position, mean, tuple(shown), self._bench.incidents.new()))

    def end(self) -> None:
        finish(self._bench, self._calibration)

    def _on_support(self) -> np.ndarray:
        """Positions on the bare support [m]; the forces at both ends give its place and the bench's compliance."""
        self._bench.operator.lay_on_support(None)
        self._pressed_bare = (first, _), (last, _) = [self._press(share * self._bench.force_limit) for share in BARE]
        return np.linspace(first, last, self._test.steps)

    def _on_sample(self) -> np.ndarray:
        """Positions on the sample, in equal steps of strain [m]. Raises UnreachableError: they exceed the travel."""
        bench, sample, strain, steps = self._bench, self._sample, self._test.strain, self._test.steps
        (first, light), (last, heavy) = self._pressed_bare
        compliance = (last - first) / (heavy - light)
        support = first - light * compliance
        withdraw(bench)
        bench.operator.lay_on_support(sample)
        yielding = 1 + compliance * sample.modulus * sample.area / sample.thickness
        deflections = sample.thickness * strain * np.arange(1, steps + 1) / steps
        positions = support - sample.thickness + deflections * yielding
        travel = bench.role(Positioner).travel()
        if positions[-1] > travel:
            raise UnreachableError(
                f"strain {strain:g} of sample {sample.name!r} needs the positioner at {show(positions[-1], 'm')},"
                f" which ends at {show(travel, 'm')}; ask for a smaller strain or raise the support"
            )
        return positions

    def _press(self, force: float) -> tuple[float, float]:
        """Press with about this force [N]; returns position [m] and load [N]."""
        what = f"preload of {show(force, 'N')} on the bare support"
        load = carry_out(self._bench, what, lambda: preload(self._bench, self._calibration, force))
        return self._bench.role(Positioner).position(), load

    def _pressed(self, position: float) -> list[float]:
        """Readings of the indicator at a position [m]; a list of DISPLAYS values [mV]."""
        self._bench.role(Positioner).move(position)
        self._bench.clock.wait(TRACK_SETTLING)
        shown = []
        for number in range(DISPLAYS):
            if number:
                self._bench.clock.wait(READING_INTERVAL)
            reading = steady(self._bench, self._within_limit)
            if not reading.valid:
                name = self._bench.role(LoadIndicator).name
                self._bench.role(Positioner).home()
                raise DeviceError(f"{name}: no valid reading; check the bridge and the support", device=name)
            self._within_limit(reading.reading_mV)
            shown.append(reading.reading_mV)
        return shown

    def _within_limit(self, reading_mV: float) -> None:
        """Move the probe home and raise SafetyError if a reading exceeds the bench's force limit."""
        if not self._calibration.load(reading_mV)[0] <= self._bench.force_limit:
            self._bench.role(Positioner).home()
            raise SafetyError(
                f"the load cell reads {reading_mV:g} mV, more than the bench's force limit of"
                f" {self._bench.force_limit:g} N; the probe has moved home. Ask for a smaller strain"
            )


def _force(sample: Sample, strain: float) -> float:
    """Expected force for a strain, by the sample's known modulus [N]."""
    return sample.modulus * sample.area * strain


# --- what it shows -------------------------------------------------------------------------------------


def _calibrated(point: CompressionPoint) -> str:
    return "no" if point.extrapolated else "yes"


COMPRESSED = {  # what is printed of a `CompressionPoint`
    "direction": Column(head="direction"),
    "position_m": Column(head="position\nmm", cell="z.3f", scale=1e3),
    "reading_mV": Column(head="meter\nmV", cell="z.1f"),
    "load_N": Column(head="load\nN", cell="z.3f"),
    "extrapolated": Column(head="calibrated", cell=_calibrated),
    "strain": Column(head="strain", cell="z.4f"),
    "strain_u": Column(head="u", cell="z.4f"),
    "stress_Pa": Column(head="stress\nkPa", cell="z.2f", scale=1e-3),
    "stress_u": Column(head="u", cell="z.2f", scale=1e-3),
    "secant_modulus_Pa": Column(head="secant modulus\nkPa", cell="z.1f", scale=1e-3),
    "secant_modulus_u": Column(head="u", cell="z.1f", scale=1e-3),
}


def show_modulus(result: ModulusResult, outcome: Outcome) -> list[object]:
    """The steps, the moduli with the thesis' values, and the bench's compliance."""
    sample, c = result.sample, result.compression
    title = f"Compression of sample {sample.name} ({sample.material})"
    steps = table_of(stamped(outcome["simulated"], title), c.points, COMPRESSED)
    thesis, loss = _thesis(sample.name), c.energy_loss
    return [
        steps,
        *legend(steps, marks={"no": MARKS[OUTSIDE]}),
        *(() if thesis is None else (_printed(thesis),)),
        f"tangent modulus    {_value(c.tangent)}   (thesis: {show(sample.modulus, 'Pa')}, {sample.source})",
        f"secant modulus     {_value(c.secant)}, at the largest strain",
        f"unloading modulus  {_value(c.unloading)}",
        f"thickness          {_value(c.thickness)}, by the contacts on pad and bare support",
        f"bench              yields {1e3 * c.compliance.value:z.4f} mm/N, u = {1e3 * c.compliance.u:z.4f}, corrected",
        f"linearity          {100 * c.linearity:z.2f} % of the span",
        f"energy loss        {100 * loss.value:z.1f} % of the work of loading, u = {100 * loss.u:.2g} %",
        *(() if thesis is None else (f"Table {thesis.number}: {thesis.doubt}",)),
    ]


def plot_modulus(result: ModulusResult, simulated: bool, folder: Path) -> Path:
    """Plot stress and secant modulus against strain, with the thesis' values; returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"compression of sample {result.sample.name}")
    for direction, marker in (("loading", "^"), ("unloading", "v")):
        points = [p for p in result.compression.points if p.direction == direction]
        strain, strain_u = [p.strain for p in points], [p.strain_u for p in points]
        for axes, values, u in (
            (left, [p.stress_Pa for p in points], [p.stress_u for p in points]),
            (right, [p.secant_modulus_Pa for p in points], [p.secant_modulus_u for p in points]),
        ):
            axes.errorbar(
                strain, [1e-3 * v for v in values], [1e-3 * v for v in u], strain_u, fmt=marker, capsize=2,
                label=direction,
            )  # fmt: skip
    thesis = _thesis(result.sample.name)
    if thesis is not None:
        strain = list(thesis.values("strain"))
        label = f"thesis Table {thesis.number}"
        left.plot(strain, 1e-3 * thesis.values("stress_Pa"), "k_", ms=10, label=label)
        right.plot(strain, 1e-3 * thesis.values("modulus_Pa"), "k_", ms=10, label=label)
    tangent = result.compression.tangent
    right.axhline(1e-3 * tangent.value, color="k", lw=1, label="tangent modulus")
    left.set(xlabel="strain", ylabel="stress (kPa; bars: u)")
    right.set(xlabel="strain", ylabel="secant modulus (kPa; bars: u)", ylim=(0, None))
    name_all(left)
    name_all(right, 2)
    return save(figure, folder)


def _thesis(sample: str) -> ThesisTable | None:
    """The thesis' compression test of a sample; None: it has none (it tests two samples)."""
    return read_table(COMPRESSION_TABLES[sample]) if sample in COMPRESSION_TABLES else None


def _printed(table: ThesisTable) -> RichTable:
    rows = new_table(
        stamped(False, f"Thesis, Table {table.number}"), "position\nmm", "strain", "stress\nkPa", "modulus\nkPa"
    )
    cells = (table.values(name) for name in ("strain", "stress_Pa", "modulus_Pa"))
    for position, strain, stress, modulus in zip(table.rows, *cells, strict=True):
        rows.add_row(position, f"{strain:z.4f}", f"{1e-3 * stress:z.2f}", f"{1e-3 * modulus:z.1f}")
    return rows


def _value(found: Propagated) -> str:
    value, u = show_with_u(found.value, found.u, found.budget.unit)
    return f"{value}, u = {u}"
