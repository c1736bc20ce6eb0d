"""Load-set sweep (thesis 5.4.1): each sample under each load, film voltages to forces to force ratio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import groupby
from typing import Any

from palpate.drivers.bench import Bench
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.findings.film_forces import ToothPoint, film_forces
from palpate.instrument.findings.mean_ratio import mean_ratio
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.dwell import Dwell, dwell_of
from palpate.instrument.signals.estimate import SineFit
from palpate.instrument.uncertainty.budget import Budget
from palpate.procedures.measurements.loads.plan import LoadStep, SweepSettings, check, floor_of, plan, preload_for
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.begin import Points, Progress, begin
from palpate.procedures.steps.film_point import DwellChoice, FilmPoint, measure
from palpate.procedures.steps.pause import NOBODY, Pause
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import LoadServo, finish, press


@dataclass(frozen=True, slots=True)
class LoadPoint:
    """One load set. Forces and voltages are peak to peak; `_u` are standard uncertainties.

    Of a sensor of several teeth voltages and forces are sums, the ratio is the sensor's (`film_forces`), and `teeth`
    has each tooth's own. `noise_u`, `calibration_u` and `pickup_u` are what noise, the films' calibration and their
    cables have in `force_ratio_u`; `degrees_of_freedom` are those of `noise_u`. `relative_u` is that to `force_ratio`,
    beside what was predicted of it where the dwell was chosen at the point. `extrapolated`: the load lies outside the
    calibrated range. Not `valid`: after the last of its `attempts` it is flagged still; `flags` say why. `incidents`
    counts what went wrong since the point before and was made good; the events say what. The forces' own
    uncertainties are None in records of before they were known.
    """

    sample: str
    load_N: float
    indicator_mV: float
    load_measured_N: float
    load_measured_u: float
    voltage_rigid_V: float
    voltage_total_V: float
    force_rigid_N: float
    force_total_N: float
    force_ratio: float
    force_ratio_u: float
    noise_u: float
    condition: float
    valid: bool
    dwell_s: float | None = None
    relative_u: float | None = None
    relative_u_predicted: float | None = None
    settling_s: float | None = None
    attempts: int = 1
    flags: tuple[str, ...] = ()
    incidents: int = 0
    teeth: tuple[ToothPoint, ...] = ()
    extrapolated: bool = False
    calibration_u: float = 0.0
    force_rigid_u: float | None = None
    force_total_u: float | None = None
    pickup_u: float = 0.0
    degrees_of_freedom: float | None = None


@dataclass(frozen=True, slots=True)
class SampleMean:
    """Mean over the valid load sets of a sample, beside the thesis' own mean (None where it has none).

    `teeth`: of each tooth to its base, where there are several.
    """

    sample: str
    force_ratio: float | None
    force_ratio_u: float | None
    valid_points: int
    thesis_force_ratio: float | None
    teeth: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class SweepResult:
    points: list[LoadPoint]
    samples: list[SampleMean]
    softness_order: list[str]
    budgets: tuple[Budget, ...]

    def summary(self) -> dict[str, Any]:
        """The result without its points, for the record."""
        return {
            "samples": [asdict(s) for s in self.samples],
            "softness_order": self.softness_order,
            "budgets": [budget.summary() for budget in self.budgets],
        }


def run(
    bench: Bench,
    design: Design,
    calibration: LoadCellCalibration,
    settings: SweepSettings,
    record: Recorder,
    progress: Progress,
    pause: Pause = NOBODY,
) -> SweepResult:
    """Sweep all loads over all samples. Each point is durable before `progress` hears of it.

    Raises:
        RangeError, UnknownName: as `check`, or a load beyond the calibration; the outputs have stayed off.
        UnreachableError: a load too small for the indicator; the outputs have stayed off.
        UnreachableError, SafetyError, LinkError, DeviceError: the bench could not; points stay on disk.
        RangeError: the noise of a point asks for too long a dwell; points stay on disk.
    """
    check(settings, design, bench.force_limit, len(bench.nodes))
    steps = plan(settings, design).steps
    films = begin(
        bench, design, calibration, settings.loads, settings.frequency, settings.samples, settings.extrapolate
    )
    points = Points(films, record, progress, len(steps), pause, record.finished(LoadPoint))
    for name, of_sample in groupby(steps[len(points.taken) :], lambda step: step.sample):
        points.tell(f"mount sample {name}")
        preloaded = press(bench, calibration, get_sample(name), preload_for(settings.loads))
        servo = LoadServo(bench, calibration, settings.frequency, preloaded)
        for step in of_sample:
            what = f"sample {name}, {show(step.load_N, 'N')}"
            points.next(what)
            carry_out(bench, what, partial(servo.set, step.load_N))
            measured = measure(films, servo, step.load_N, _dwell(settings, design), record, what)
            points.keep(_point(design, calibration, step, measured), measured, what)
    finish(bench, calibration)
    return evaluate(points.taken, design)


def _dwell(settings: SweepSettings, design: Design) -> float | DwellChoice:
    """As it was asked for, or chosen by the noise of a short record."""
    if settings.tolerance is None:
        return settings.dwell
    target = settings.tolerance

    def choose(short: SineFit) -> Dwell:
        forces = film_forces(design, short)
        noise = forces.noise_u / forces.force_ratio * math.sqrt(short.samples / short.rate)
        return dwell_of(target, noise, short.frequency, floor_of(design, forces.force_ratio))

    return choose


def _point(design: Design, calibration: LoadCellCalibration, step: LoadStep, measured: FilmPoint) -> LoadPoint:
    forces = film_forces(design, measured.fit)
    return LoadPoint(
        sample=step.sample,
        load_N=step.load_N,
        indicator_mV=measured.indicator_mV,
        load_measured_N=measured.load_N,
        load_measured_u=measured.load_u,
        voltage_rigid_V=forces.voltage_rigid_V,
        voltage_total_V=forces.voltage_total_V,
        force_rigid_N=forces.force_rigid_N,
        force_total_N=forces.force_total_N,
        force_ratio=forces.force_ratio,
        force_ratio_u=forces.force_ratio_u,
        noise_u=forces.noise_u,
        condition=measured.fit.condition,
        valid=measured.valid,
        dwell_s=measured.dwell,
        relative_u=forces.force_ratio_u / forces.force_ratio if forces.force_ratio else None,
        relative_u_predicted=measured.predicted_u,
        settling_s=measured.settling,
        attempts=measured.attempts,
        flags=measured.flags,
        incidents=measured.incidents,
        teeth=forces.teeth if len(forces.teeth) > 1 else (),
        extrapolated=not calibration.covers(step.load_N),
        calibration_u=forces.calibration_u,
        force_rigid_u=forces.force_rigid_u,
        force_total_u=forces.force_total_u,
        pickup_u=forces.pickup_u,
        degrees_of_freedom=forces.degrees_of_freedom,
    )


def evaluate(points: Sequence[LoadPoint], design: Design) -> SweepResult:
    """Mean ratio of each sample over its valid load sets, and the samples from hard to soft."""
    means, budgets = [], []
    for name in dict.fromkeys(point.sample for point in points):
        valid = [point for point in points if point.sample == name and point.valid]
        n = len(valid)
        budget = mean_ratio(f"force ratio of sample {name}", valid, design.film_freedom) if valid else None
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
    known = [(mean.force_ratio, mean.sample) for mean in means if mean.force_ratio is not None]
    return SweepResult(list(points), means, [sample for _, sample in sorted(known, reverse=True)], tuple(budgets))
