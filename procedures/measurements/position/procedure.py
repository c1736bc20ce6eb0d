"""Position sweep (thesis 4.3, Table A2.7): a point load along the base of two teeth, found by the films."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from palpate.drivers.bench import Bench
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import film_forces, ratio_scatter
from palpate.instrument.findings.position import Located, locate
from palpate.instrument.models.influence import check_place, tooth_shares
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.thesis import read_table
from palpate.procedures.engine.plan import Plan, Step, point_seconds
from palpate.procedures.engine.progress import Progress
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.begin import Points, begin
from palpate.procedures.steps.checks import check_force, check_frequency, check_time, preload_for
from palpate.procedures.steps.film_point import FilmPoint, measure
from palpate.procedures.steps.films import check_nodes
from palpate.procedures.steps.pause import NOBODY, Pause
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import LoadServo, finish, lower, mount, withdraw

PROCEDURE = "sweep-position"
FEWEST = 2
TABLE = "A2.7"
DOUBT = (
    "Table A2.7 prints neither the object nor the shape of its load, and its force hardly depends on the place of a"
    " load beside a tooth, which an elastic object's does: it is shown beside, not to be met"
)


@dataclass(frozen=True, slots=True)
class PositionSettings:
    """Positions in m along the centre line, a sample, a load in N peak to peak, dwell in s, frequency in Hz."""

    positions: tuple[float, ...]
    sample: str
    load: float
    dwell: float
    frequency: float
    extrapolate: bool = False


@dataclass(frozen=True, slots=True)
class PositionStep(Step):
    position_mm: float


@dataclass(frozen=True, slots=True)
class PositionPoint:
    """A load at a place: forces peak to peak, shares of the whole force, and place and size found by the films alone.

    Attributes:
        model_share_left, model_share_right: by the table of the solid model.
        thesis_share_left, thesis_share_right: of Table A2.7, None where it has no such place.
        found_mm: with `found_u`, and `found_low_mm` to `found_high_mm`, a 95 % interval.
        found_force_N: by the base film.
    """

    position_mm: float
    load_measured_N: float
    load_measured_u: float
    force_left_N: float
    force_right_N: float
    share_left: float
    share_left_u: float
    share_right: float
    share_right_u: float
    model_share_left: float
    model_share_right: float
    thesis_share_left: float | None
    thesis_share_right: float | None
    found_mm: float
    found_u: float
    found_low_mm: float
    found_high_mm: float
    found_force_N: float
    found_force_u: float
    valid: bool
    settling_s: float
    attempts: int
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PositionResult:
    """`rms_mm`: of the found places from the set ones; `inside`: share of them within their interval; None: none."""

    points: list[PositionPoint]
    rms_mm: float | None
    inside: float | None

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        return {"position_rms_mm": self.rms_mm, "inside_interval": self.inside, "thesis_doubt": DOUBT}


def check(settings: PositionSettings, design: Design, force_limit: float, nodes: int) -> None:
    """Refuse what cannot be done, before any device is spoken to.

    Raises:
        RangeError: too few positions or one off the sensor, a sensor or object without a table of point loads, a load
            beyond the force limit in N, a frequency or dwell that gives no estimate, or too few sensor nodes.
        UnknownName: an unknown sample.
    """
    check_nodes(design, nodes)
    sample = get_sample(settings.sample)
    if len(settings.positions) < FEWEST:
        raise RangeError(f"{len(settings.positions)} positions make no sweep; give {FEWEST} or more")
    for position in settings.positions:
        check_place(design, position)
        tooth_shares(design, sample, _at(design, position))
    check_force((settings.load,), force_limit)
    check_frequency(settings.frequency)
    check_time(settings.dwell, settings.frequency)


def plan(settings: PositionSettings, _design: Design) -> Plan[PositionStep]:
    """Every position, from left to right."""
    seconds = point_seconds(settings.frequency, settings.dwell, first=True)
    return Plan(PROCEDURE, [PositionStep(settings.dwell, seconds, None, 1e3 * x) for x in settings.positions])


def run(
    bench: Bench,
    design: Design,
    calibration: LoadCellCalibration,
    settings: PositionSettings,
    record: Recorder,
    progress: Progress,
    pause: Pause = NOBODY,
) -> PositionResult:
    """Press at one place after the other. Each point is durable before `progress` hears of it.

    Raises:
        RangeError, UnknownName: as `check`, or a load outside the calibrated range; the outputs have stayed off.
        UnreachableError, SafetyError, LinkError, DeviceError: the bench could not; points stay on disk.
    """
    check(settings, design, bench.force_limit, len(bench.nodes))
    films = begin(
        bench, design, calibration, (settings.load,), settings.frequency, (settings.sample,), settings.extrapolate
    )
    points = Points[PositionPoint](films, record, progress, len(settings.positions), pause)
    points.tell(f"mount sample {settings.sample}")
    mount(bench, get_sample(settings.sample))
    for position in settings.positions:
        what = show(position, "m")
        points.next(what)
        withdraw(bench)
        bench.operator.place_probe(*_at(design, position))
        preloaded = lower(bench, calibration, preload_for((settings.load,)), f"sample {settings.sample} at {what}")
        servo = LoadServo(bench, calibration, settings.frequency, preloaded)
        carry_out(bench, what, partial(servo.set, settings.load))
        measured = measure(films, servo, settings.load, settings.dwell, record, what)
        points.keep(_point(design, settings, position, measured), measured, what)
    finish(bench, calibration)
    return evaluate(points.taken)


def _at(design: Design, position: float) -> tuple[float, float]:
    return position, design.cell[1] / 2


def _point(design: Design, settings: PositionSettings, position: float, measured: FilmPoint) -> PositionPoint:
    forces, sample = film_forces(design, measured.fit), get_sample(settings.sample)
    left, right = forces.teeth
    base = next(film for film in design.films if film.kind == FILM_KINDS[1])
    scatter = [ratio_scatter(design, film, base) for film in design.films if film is not base]
    shares = (left.force_ratio, right.force_ratio)
    found: Located = locate(design, sample, shares, (left.noise_u, right.noise_u), scatter)
    model = tooth_shares(design, sample, _at(design, position))
    thesis = _thesis().get(round(1e3 * position, 6), (None, None))
    return PositionPoint(
        position_mm=1e3 * position,
        load_measured_N=measured.load_N,
        load_measured_u=measured.load_u,
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
        valid=measured.valid,
        settling_s=measured.settling,
        attempts=measured.attempts,
        flags=measured.flags,
    )


def _thesis() -> dict[float, tuple[float | None, float | None]]:
    """Shares of the left and the right tooth in Table A2.7, by the place in mm."""
    table = read_table(TABLE)
    rows = zip(table.keys(), table.values("force_pvdf3_N"), table.values("force_pvdf1_N"), strict=True)
    return {round(float(x), 6): (float(left), float(right)) for x, left, right in rows}


def evaluate(points: Sequence[PositionPoint]) -> PositionResult:
    """How far the found places are from the set ones, by the valid points."""
    valid = [point for point in points if point.valid]
    if not valid:
        return PositionResult(list(points), None, None)
    squares = math.fsum((p.found_mm - p.position_mm) ** 2 for p in valid)
    inside = sum(p.found_low_mm <= p.position_mm <= p.found_high_mm for p in valid)
    return PositionResult(list(points), math.sqrt(squares / len(valid)), inside / len(valid))
