"""Coverage: how often 95 % intervals hold the scene's truth, over repeats with fresh seeds.

The scene's rig, converter and display stand for the bench; what is made of their readings is what the procedures call:
calibration of load cell and films, sine fit, film forces, moduli. On its buses the bench would take an hour.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.calibration.films import FilmReading, calibrate_films
from palpate.instrument.calibration.load_cell import LoadCellCalibration, WeightRun, calibrate_load_cell, load_budget
from palpate.instrument.findings.compression import DisplaySeries, compress
from palpate.instrument.findings.film_forces import film_forces, mean_ratio
from palpate.instrument.findings.object_modulus import modulus_of_ratio
from palpate.instrument.models.curve import ratio_curve
from palpate.instrument.models.response import response
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Load, get_sample
from palpate.instrument.signals.estimate import SineFit, fit_sine
from palpate.instrument.uncertainty.budget import Propagated, coverage_factor
from palpate.procedures.measurements.load_cell.procedure import LOADS
from palpate.procedures.measurements.load_cell.report import REPEATS
from palpate.procedures.steps.servo import READINGS
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects.load_cell import LoadCell
from palpate.simulators.planning.plan import Question, driven, sampled
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.randomness import Stream
from palpate.simulators.scenes.scene import Scene
from tests.benchmarks.row import Row

SCENE, SAMPLE = "thesis_single", "4"
TEETH_SCENE, TEETH_LOAD = "thesis_different_base", 3.0  # two teeth, each on a base of its own; N, peak to peak
TIMES = 1000  # repeats
SETS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)  # N, peak to peak
PERIOD_NS, SAMPLES, SETTLING = 4_000_000, 250, 5.0  # 1 s of samples; s
ORIGIN = {"device": "1", "simulated": True, "source": "benchmark", "created": "now", "expires": "2099-01-01"}
STEPS, STRAINS, DISPLAYS, AREA_U = 6, (0.3, 0.45), 10, 0.01
BENCH_COMPLIANCE = 1e-4  # m/N
WITHIN = (0.93, 0.97)
SENSITIVITY = "sensitivity of the load cell"  # u is the greatest over slopes that may be: its intervals hold more often

Held = dict[str, list[bool]]


@dataclass(frozen=True, slots=True)
class Repeat:
    """One simulated life of a bench: its display, its films, and the generator of what the scene leaves open."""

    scene: Scene
    number: int
    rng: np.random.Generator

    def display(self, load: float, count: int, update: int) -> Floats:
        """Successive displays [mV] of a load."""
        cell = cast("LoadCell", self.scene.effects["load_cell"])
        ideal, stream = 1e3 * cell.sensitivity * load, Stream(self.scene.seed, "load_cell")
        return np.array([cell.display(ideal, stream, update + i) for i in range(count)])

    def films(self, loads: tuple[float, ...]) -> list[SineFit]:
        """Load sets one after the other: the drive is set anew for each, and the gains scatter anew."""
        clock = VirtualClock()
        rig = driven(self.scene, Question(SAMPLE, max(loads)), clock)
        largest = rig.coil_voltage()
        fits = []
        for load in loads:
            clock.wait(SETTLING)
            rig.set_voltage(replace(largest.restarted(clock.now_ns()), amplitude=largest.amplitude * load / max(loads)))
            clock.wait(SETTLING)
            time_ns = clock.now_ns() + np.arange(SAMPLES) * PERIOD_NS
            fits.append(fit_sine(1e-9 * time_ns, sampled(self.scene, rig, time_ns, PERIOD_NS)[0], 10.0))
        return fits


def measure() -> Iterator[Row]:
    """A row a quantity."""
    scene, two_teeth = read_scene(SCENE), read_scene(TEETH_SCENE)
    held: Held = defaultdict(list)
    means: list[tuple[float, float]] = []
    for number in range(TIMES):
        repeat = Repeat(scene.with_seed(1000 + number), number, np.random.default_rng(number))
        calibration = _load_cell(repeat, held)
        _load(repeat, calibration, held)
        means.append(_films(repeat, calibration, held))
        _teeth(replace(repeat, scene=two_teeth.with_seed(1000 + number)), held)
        _compression(repeat, calibration, held)
    _softness(scene.design, np.array(means), held)
    for name, hits in held.items():
        share, most = sum(hits) / len(hits), 1.0 if name == SENSITIVITY else WITHIN[1]
        yield Row(f"95 % intervals that hold {name}", f"{share:.1%} of {len(hits)}",
                  f"{WITHIN[0]:.0%} to {most:.0%}", WITHIN[0] <= share <= most)  # fmt: skip


def _load_cell(repeat: Repeat, held: Held) -> LoadCellCalibration:
    """Dead weights up and down, as `palpate calibrate load-cell` has them."""
    loads = np.array(LOADS)
    shown = np.array(
        [[repeat.display(load, REPEATS, 1000 * way + 20 * i) for i, load in enumerate(loads)] for way in (1, 2)]
    )
    scatter = float(np.sqrt(shown.var(axis=2, ddof=1).mean()))
    run = WeightRun(0.0, *shown.mean(axis=2), repeats=REPEATS, scatter_mV=scatter)
    found = calibrate_load_cell(loads, [run], 1.0, degree=1, gage_factor=8.98, **ORIGIN)  # type: ignore[arg-type]
    cell = cast("LoadCell", repeat.scene.effects["load_cell"])
    half = coverage_factor(found.degrees_of_freedom or math.inf) * found.sensitivity_u
    held[SENSITIVITY].append(abs(found.sensitivity_mV_per_N - 1e3 * cell.sensitivity) <= half)
    return found


def _load(repeat: Repeat, calibration: LoadCellCalibration, held: Held) -> None:
    true = repeat.rng.uniform(SETS[0], SETS[-1])
    load, _ = calibration.load(float(repeat.display(true, READINGS, 5000).mean()))
    low, high = load_budget(calibration, load, READINGS).interval()
    held["load"].append(low <= true <= high)


def _films(repeat: Repeat, calibration: LoadCellCalibration, held: Held) -> tuple[float, float]:
    """Films calibrated, then the ratio measured; returns the mean ratio and its uncertainty."""
    design = repeat.scene.design
    fits = repeat.films(SETS + SETS)
    readings = []
    for number, (load, fit) in enumerate(zip(SETS, fits, strict=False)):
        shown = float(repeat.display(load, READINGS, 6000 + 20 * number).mean())
        readings.append(FilmReading(0, 10.0, load, *calibration.load(shown, READINGS), 2 * fit.amplitude))
    found = calibrate_films(design, readings, calibration, ORIGIN)
    # What tooth and total film give for the load on the whole sensor: the tooth takes its share of it.
    share = _true_ratio(repeat.scene)
    for film, budget, part in zip(design.films, found.budgets(), (share, 1.0), strict=True):
        low, high = budget.interval()
        held[f"sensitivity of the {film.name} film"].append(low <= 1e3 * film.sensitivity * part <= high)
    points = [film_forces(design, fit) for fit in fits[len(SETS) :]]
    first, true = points[3], SETS[3]
    held["force on the rigid film"].append(_near(first.force_rigid_N, first.force_rigid_u, share * true))
    held["force on the total film"].append(_near(first.force_total_N, first.force_total_u, true))
    held["force ratio, one load set"].append(_near(first.force_ratio, first.force_ratio_u, share))
    mean = mean_ratio("force ratio", points, design.film_freedom)
    low, high = mean.interval()
    held["force ratio, mean of six"].append(low <= share <= high)
    calibrated = found.apply(design)
    shared = mean_ratio("force ratio", [film_forces(calibrated, f) for f in fits[len(SETS) :]], calibrated.film_freedom)
    low, high = shared.interval()
    # Each film was calibrated by the load on the whole sensor, of which both then tell.
    held["force ratio, mean of six by calibrated films"].append(low <= 1 <= high)
    return mean.value, mean.u


def _teeth(repeat: Repeat, held: Held) -> None:
    """Forces of two teeth and their bases, each and together, whose films' gains scatter together."""
    share = _true_ratio(repeat.scene)
    found = film_forces(repeat.scene.design, repeat.films((TEETH_LOAD,))[0])
    held["force on two teeth"].append(_near(found.force_rigid_N, found.force_rigid_u, share * TEETH_LOAD))
    held["force on two bases"].append(_near(found.force_total_N, found.force_total_u, TEETH_LOAD))
    for tooth in found.teeth:
        name, true = f"tooth {tooth.tooth} of two", TEETH_LOAD / len(found.teeth)
        held[f"force on {name}"].append(_near(tooth.force_N, tooth.force_u, share * true))
        held[f"force on the base of {name}"].append(_near(tooth.base_force_N, tooth.base_force_u, true))


def _near(value: float, u: float | None, true: float) -> bool:
    return u is not None and abs(value - true) <= coverage_factor(math.inf) * u


def _true_ratio(scene: Scene) -> float:
    return response(scene.design, Load(1.0, get_sample(SAMPLE)), scene.model).force_ratio


def _softness(design: Design, means: Floats, held: Held) -> None:
    curve = ratio_curve(design, Load(1.0, get_sample(SAMPLE)), "experiment", None)
    found = modulus_of_ratio(curve, means[:, 0], means[:, 1])
    true = get_sample(SAMPLE).modulus
    held["modulus by the force ratio"] = ((found.low <= true) & (true <= found.high)).tolist()


def _compression(repeat: Repeat, calibration: LoadCellCalibration, held: Held) -> None:
    """A pad of linear springs on a bench that yields, its edges measured with their uncertainty.

    How deep it is pressed differs: at the same loads the display's rounding would be off alike in all repeats.
    """
    sample = get_sample(SAMPLE)
    pad = sample.thickness / (sample.modulus * sample.area)
    support = 12e-3 + repeat.rng.uniform(0, 1e-4)

    def series(contact: float, compliance: float, deepest: float, update: int) -> DisplaySeries:
        positions = np.round((contact + deepest * np.arange(1, STEPS + 1) / STEPS) * 1e6) / 1e6
        loads = (positions - contact) / compliance
        shown = [repeat.display(float(load), DISPLAYS, update + 20 * i) for i, load in enumerate(loads)]
        return DisplaySeries(positions, np.array(shown))

    contact, yielding = support - sample.thickness, BENCH_COMPLIANCE + pad
    deepest = repeat.rng.uniform(*STRAINS) * sample.thickness * yielding / pad
    measured = sample.area * (1 + AREA_U * repeat.rng.normal())
    found = compress(
        series(support, BENCH_COMPLIANCE, repeat.rng.uniform(4, 6) * BENCH_COMPLIANCE, 7000),
        series(contact, yielding, deepest, 8000),
        series(contact, yielding, deepest, 9000),
        calibration,
        measured,
        AREA_U * measured,
    )
    _held_by(held, "tangent modulus", found.tangent, sample.modulus)
    _held_by(held, "secant modulus", found.secant, sample.modulus)


def _held_by(held: Held, name: str, found: Propagated, true: float) -> None:
    held[name].append(found.low <= true <= found.high)
