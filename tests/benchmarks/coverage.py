"""How often 95 % intervals hold, every parameter drawn from its stated distribution, and what scatter is drawn."""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast
from unittest import mock

import numpy as np

import palpate
from palpate.instrument.arrays import Floats
from palpate.instrument.calibration.films import FilmReading, calibrate_films
from palpate.instrument.calibration.load_cell import (
    THESIS_LOAD_CELL,
    LoadCellCalibration,
    WeightRun,
    calibrate_load_cell,
    load_budget,
)
from palpate.instrument.calibration.model_calibration import MeasuredReference, fit_model
from palpate.instrument.errors import EstimateError
from palpate.instrument.findings.compression import DisplaySeries, compress
from palpate.instrument.findings.film_forces import film_forces, mean_ratio
from palpate.instrument.findings.object_modulus import modulus_of_ratio
from palpate.instrument.models.curve import ratio_curve
from palpate.instrument.models.response import response
from palpate.instrument.models.validation import Validation
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import DESIGNS, get_design
from palpate.instrument.sensor.sample import Load, get_sample
from palpate.instrument.signals.estimate import FEW_DEGREES, SineFit, fit_sine
from palpate.instrument.uncertainty.budget import Propagated, coverage_factor
from palpate.procedures.measurements.load_cell.procedure import LOADS as WEIGHTS
from palpate.procedures.measurements.load_cell.report import REPEATS
from palpate.procedures.steps.film_point import forces_differ, frequencies_differ, may_be_hum
from palpate.procedures.steps.films import FilmRecord, Films
from palpate.procedures.steps.servo import READINGS
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects.gain_scatter import GainScatter
from palpate.simulators.effects.load_cell import LoadCell
from palpate.simulators.effects.pink_noise import PinkNoise
from palpate.simulators.planning.plan import Question, driven, sampled
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.randomness import Stream
from palpate.simulators.scenes.scene import Scene
from tests.benchmarks.common import Row, at_most, between

# --- coverage ------------------------------------------------------------------------------------------

RATE, FREQUENCY, PERIOD_NS = 250.0, 10.0, 4_000_000
AMPLITUDE = np.array([0.012, 0.10])  # V, of the films under 3 N
WANDER, SHORTEST, LONGEST = 0.2, 0.2, 4.0  # Hz, s
QUIET, LOUD = 2e-6, 20e-6  # V/√Hz, of thesis_single and of noisy_lab
HUM = (1e-4, 1e-2)  # V
CORNER = (1.0, 30.0)  # Hz, below which 1/f noise is more than white
WITHIN = (0.93, 0.97)
LOADS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)  # N, peak to peak


@dataclass(frozen=True, slots=True)
class Draw:
    """One record: its length [s], densities of white and 1/f noise [V/√Hz], corner [Hz], hum [V] and its frequency."""

    dwell: float
    white: float
    pink: float = 0.0
    corner: float = FREQUENCY
    hum: float = 0.0
    mains: float = 50.0

    def signals(self, rng: np.random.Generator, stream: Stream) -> tuple[Floats, Floats]:
        """Times (n,) and films (2, n) of it, at any phase."""
        numbers = np.arange(round(self.dwell * RATE)) + 5000
        time = numbers / RATE
        turned, turned_hum = rng.uniform(0, 2 * np.pi, 2)
        films = AMPLITUDE[:, np.newaxis] * np.cos(2 * np.pi * FREQUENCY * time + turned)
        films += self.white * math.sqrt(RATE / 2) * rng.standard_normal(films.shape)
        films += self.hum * np.cos(2 * np.pi * self.mains * time + turned_hum)
        if self.pink:
            noise = PinkNoise(density=f"{self.pink!r} V/√Hz", corner=f"{self.corner!r} Hz")
            films += [
                noise.volts(stream.child(film), numbers * PERIOD_NS, PERIOD_NS, lambda: np.zeros(0)) for film in (0, 1)
            ]
        return time - time[0], films


def coverage(times: int = 1000) -> Iterator[Row]:
    """Coverage of amplitudes and ratios: how often 95 % intervals hold, every parameter drawn from its stated
    distribution.

    Records are made as the nodes' inputs have them (white and 1/f noise, hum) and fitted as the procedures fit them.
    Points that a procedure marks as too short to tell (`flags.USED`) may hold more often: their share is said.
    """
    yield from amplitudes(times)
    yield from ratios(times)


def _mains(rated: float) -> Callable[[np.random.Generator], Draw]:
    return lambda rng: Draw(
        _log(rng, SHORTEST, LONGEST), _log(rng, QUIET, LOUD), 0.0, FREQUENCY, _log(rng, *HUM),
        rng.uniform(rated - WANDER, rated + WANDER),
    )  # fmt: skip


def _everything(rng: np.random.Generator) -> Draw:
    white, rated = _log(rng, QUIET, LOUD), rng.choice((50.0, 60.0))
    return Draw(
        _log(rng, SHORTEST, LONGEST), white, white, _log(rng, *CORNER), _log(rng, *HUM),
        rng.uniform(rated - WANDER, rated + WANDER),
    )  # fmt: skip


def _pink(dwell: float) -> Callable[[np.random.Generator], Draw]:
    return lambda rng: Draw(dwell, white := _log(rng, QUIET, LOUD), white, _log(rng, *CORNER))


KINDS: dict[str, Callable[[np.random.Generator], Draw]] = {
    "mains at 49.95 Hz, 10 mV, over 0.952 s": lambda _: Draw(0.952, LOUD, hum=1e-2, mains=49.95),
    "mains from 49.8 to 50.2 Hz": _mains(50.0),
    "mains from 59.8 to 60.2 Hz": _mains(60.0),
    "1/f and white noise over 0.4 s": _pink(0.4),
    "1/f noise alone over 0.4 s": lambda _: Draw(0.4, 1e-3 * QUIET, LOUD),
    "1/f and white noise over 1 s": _pink(1.0),
    "white noise over 0.1 s": lambda rng: Draw(0.1, _log(rng, QUIET, LOUD)),
    "white noise over 1 s": lambda rng: Draw(1.0, _log(rng, QUIET, LOUD)),
    "1/f, white noise and mains over 0.2 to 4 s": _everything,
    "1/f noise alone over 0.06 to 0.25 s": lambda rng: Draw(_log(rng, 0.06, 0.25), 1e-3 * QUIET, LOUD),
}


def amplitudes(times: int) -> Iterator[Row]:
    for number, name in enumerate(KINDS):
        yield _row(name, *held_amplitudes(number, name, times))


def held_amplitudes(number: int, name: str, times: int) -> tuple[list[bool], list[bool]]:
    """For each film of each record of a kind: whether its interval holds the amplitude, and whether it is marked."""
    rng = np.random.default_rng(number)
    held: list[bool] = []
    marked: list[bool] = []
    for repeat in range(times):
        time, films = KINDS[name](rng).signals(rng, Stream(number, "coverage", repeat))
        fit = fit_sine(time, films, FREQUENCY)
        half = coverage_factor(fit.degrees_of_freedom) * fit.amplitude_u
        held += (np.abs(fit.amplitude - AMPLITUDE) <= half).tolist()
        marked += [fit.degrees_of_freedom < FEW_DEGREES or may_be_hum(fit)] * len(films)
    return held, marked


def ratios(times: int) -> Iterator[Row]:
    """Coverage of ratios over load sets; cables add what the bench states, in any phase, or in step as in `noisy_lab`.

    It does not average out: over many sets it is most of what is uncertain.
    """
    bound, share = 0.1e-12 / 20e-12 / 1.5, 0.142
    design = get_design("single").with_pickup(bound)
    rng = np.random.default_rng(77)
    gains = np.array([film.sensitivity for film in design.films])
    triangle = np.array(design.scatter_triangle)
    in_step = np.zeros(2)
    for name, phases, loads in (
        ("in any phase", None, LOADS),
        ("in phase, as in noisy_lab", in_step, LOADS),
        ("in phase, 17 sets of 4 N", in_step, (4.0,) * 17),
    ):
        single, mean = [], []
        for _ in range(times):
            turned = rng.uniform(0, 2 * np.pi, 2) if phases is None else phases
            pickup = bound * np.exp(1j * turned)
            points = []
            for load in loads:
                scatter = 1 + triangle @ rng.standard_normal(2)
                phasors = gains * load / 2 * (scatter * (share, 1.0) + pickup)
                time = np.arange(250) / RATE
                films = (phasors[:, np.newaxis] * np.exp(2j * np.pi * FREQUENCY * time)).real
                films += LOUD * math.sqrt(RATE / 2) * rng.standard_normal(films.shape)
                points.append(film_forces(design, fit_sine(time, films, FREQUENCY)))
            one, all_ = points[0], mean_ratio("ratio", points, None)
            single.append(abs(one.force_ratio - share) <= 1.96 * one.force_ratio_u)
            mean.append(abs(all_.value - share) <= all_.expanded())
        yield _row(f"a ratio of 0.142, pick-up {name}", single)
        yield _row(f"a mean of {len(loads)}, pick-up {name}", mean)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.uniform())


def _row(name: str, held: list[bool], marked: list[bool] | None = None) -> Row:
    """Those that are marked may hold more often than 97 %; those that are not are judged apart from them."""
    plain = [one for one, mark in zip(held, marked, strict=True) if not mark] if marked else held
    parts = [("", held)]
    if len(plain) < len(held):
        rest = [one for one, mark in zip(held, marked or [], strict=True) if mark]
        parts = [(" all", held), (" marked", rest), *([(" unmarked", plain)] if plain else [])]
    said = ", ".join(f"{sum(part) / len(part):.1%} of {len(part)}{which}" for which, part in parts)
    met = sum(held) >= WITHIN[0] * len(held) and (not plain or WITHIN[0] <= sum(plain) / len(plain) <= WITHIN[1])
    return Row(f"95 % intervals that hold: {name}", said, f"{WITHIN[0]:.0%} to {WITHIN[1]:.0%}", met)


# --- uncertainty ---------------------------------------------------------------------------------------

SCENE, SAMPLE = "thesis_single", "4"
TEETH_SCENE, TEETH_LOAD = "thesis_different_base", 3.0  # two teeth, each on a base of its own; N, peak to peak
SAMPLES_A_FIT, SETTLING = 250, 5.0  # 1 s of samples; s
CELL_ORIGIN = {"device": "1", "simulated": True, "source": "benchmark", "created": "now", "expires": "2099-01-01"}
STEPS, STRAINS, DISPLAYS, AREA_U = 6, (0.3, 0.45), 10, 0.01
BENCH_COMPLIANCE = 1e-4  # m/N
OF_THE_LOAD_CELL = (
    "sensitivity of the load cell"
    """Its u is the greatest over slopes that may be: its intervals hold more often."""
)

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
            time_ns = clock.now_ns() + np.arange(SAMPLES_A_FIT) * PERIOD_NS
            fits.append(fit_sine(1e-9 * time_ns, sampled(self.scene, rig, time_ns, PERIOD_NS)[0], 10.0))
        return fits


def uncertainty(times: int = 1000) -> Iterator[Row]:
    """Coverage: how often 95 % intervals hold the scene's truth, over repeats with fresh seeds.

    The scene's rig, converter and display stand for the bench; what is made of their readings is what the procedures
    call: calibration of load cell and films, sine fit, film forces, moduli. On its buses the bench would take an hour.
    """
    scene, two_teeth = read_scene(SCENE), read_scene(TEETH_SCENE)
    held: Held = defaultdict(list)
    means: list[tuple[float, float]] = []
    for number in range(times):
        repeat = Repeat(scene.with_seed(1000 + number), number, np.random.default_rng(number))
        calibration = _load_cell(repeat, held)
        _load(repeat, calibration, held)
        means.append(_films(repeat, calibration, held))
        _teeth(replace(repeat, scene=two_teeth.with_seed(1000 + number)), held)
        _compression(repeat, calibration, held)
    _softness(scene.design, np.array(means), held)
    for name, hits in held.items():
        share, most = sum(hits) / len(hits), 1.0 if name == OF_THE_LOAD_CELL else WITHIN[1]
        yield between(
            f"95 % intervals that hold {name}", share, (WITHIN[0], most), "{:.0%}", f"{share:.1%} of {len(hits)}"
        )


def _load_cell(repeat: Repeat, held: Held) -> LoadCellCalibration:
    """Dead weights up and down, as `palpate calibrate load-cell` has them."""
    loads = np.array(WEIGHTS)
    shown = np.array(
        [[repeat.display(load, REPEATS, 1000 * way + 20 * i) for i, load in enumerate(loads)] for way in (1, 2)]
    )
    scatter = float(np.sqrt(shown.var(axis=2, ddof=1).mean()))
    run = WeightRun(0.0, *shown.mean(axis=2), repeats=REPEATS, scatter_mV=scatter)
    found = calibrate_load_cell(loads, [run], 1.0, degree=1, gage_factor=8.98, **CELL_ORIGIN)  # type: ignore[arg-type]
    cell = cast("LoadCell", repeat.scene.effects["load_cell"])
    half = coverage_factor(found.degrees_of_freedom or math.inf) * found.sensitivity_u
    held[OF_THE_LOAD_CELL].append(abs(found.sensitivity_mV_per_N - 1e3 * cell.sensitivity) <= half)
    return found


def _load(repeat: Repeat, calibration: LoadCellCalibration, held: Held) -> None:
    true = repeat.rng.uniform(LOADS[0], LOADS[-1])
    load, _ = calibration.load(float(repeat.display(true, READINGS, 5000).mean()))
    low, high = load_budget(calibration, load, READINGS).interval()
    held["load"].append(low <= true <= high)


def _films(repeat: Repeat, calibration: LoadCellCalibration, held: Held) -> tuple[float, float]:
    """Films calibrated, then the ratio measured; returns the mean ratio and its uncertainty."""
    design = repeat.scene.design
    fits = repeat.films(LOADS + LOADS)
    readings = []
    for number, (load, fit) in enumerate(zip(LOADS, fits, strict=False)):
        shown = float(repeat.display(load, READINGS, 6000 + 20 * number).mean())
        readings.append(FilmReading(0, 10.0, load, *calibration.load(shown, READINGS), 2 * fit.amplitude))
    found = calibrate_films(design, readings, calibration, CELL_ORIGIN)
    # What tooth and total film give for the load on the whole sensor: the tooth takes its share of it.
    share = _true_ratio(repeat.scene)
    for film, budget, part in zip(design.films, found.budgets(), (share, 1.0), strict=True):
        low, high = budget.interval()
        held[f"sensitivity of the {film.name} film"].append(low <= 1e3 * film.sensitivity * part <= high)
    points = [film_forces(design, fit) for fit in fits[len(LOADS) :]]
    first, true = points[3], LOADS[3]
    held["force on the rigid film"].append(_near(first.force_rigid_N, first.force_rigid_u, share * true))
    held["force on the total film"].append(_near(first.force_total_N, first.force_total_u, true))
    held["force ratio, one load set"].append(_near(first.force_ratio, first.force_ratio_u, share))
    mean = mean_ratio("force ratio", points, design.film_freedom)
    low, high = mean.interval()
    held["force ratio, mean of six"].append(low <= share <= high)
    calibrated = found.apply(design)
    shared = mean_ratio(
        "force ratio", [film_forces(calibrated, f) for f in fits[len(LOADS) :]], calibrated.film_freedom
    )
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


# --- false alarms --------------------------------------------------------------------------------------

DWELLS = (0.2, 1.0)  # s
SHARE = 0.142  # force ratio
PASSED = 1 / math.hypot(1.0, 1 / (2 * math.pi * FREQUENCY))  # of the charge amplifier, 1 s
DISPLAY_NOISE = 0.3  # mV, before it is shown in whole ones


class OnPaper(Films):
    """Films that fit a record and have no bench."""

    frequency_step = 0.0

    def __init__(self, design: Design, frequency_step: float = 1e-3) -> None:
        self.design, self.frequency, self.frequency_step = design, FREQUENCY, frequency_step


def false_alarms(white: float, pink: float, seeds: range) -> tuple[int, int, int]:
    """Points flagged `force` and `frequency`, and how many there were, under noise of these densities [V/√Hz].

    Each seed draws the films' scatter and noise, and what the display shows of the load; no rig and no wire.
    """
    raised = [each for seed in seeds for each in _points(white, pink, seed)]
    return sum(force for force, _ in raised), sum(frequency for _, frequency in raised), len(raised)


def _points(white: float, pink: float, seed: int) -> Iterator[tuple[bool, bool]]:
    films, rng, numbers = OnPaper(get_design("single")), np.random.default_rng(seed), np.arange(5000, 5250)
    design = films.design
    gains, triangle = np.array([film.sensitivity for film in design.films]), np.array(design.scatter_triangle)
    noise = PinkNoise(density=f"{pink!r} V/√Hz")
    for point, (load, dwell) in enumerate((load, dwell) for load in LOADS for dwell in DWELLS):
        at = numbers[: round(dwell * RATE)] + 2000 * point
        scatter = 1 + triangle @ rng.standard_normal(2)
        amplitude = PASSED * gains * load / 2 * scatter * (SHARE, 1.0)
        volts = amplitude[:, np.newaxis] * np.cos(2 * np.pi * FREQUENCY * at / RATE + rng.uniform(0, 2 * np.pi))
        volts += white * math.sqrt(RATE / 2) * rng.standard_normal(volts.shape)
        if pink:
            own = Stream(seed, "agreement", point)
            volts += [noise.volts(own.child(film), at * PERIOD_NS, PERIOD_NS, lambda: np.zeros(0)) for film in (0, 1)]
        record = FilmRecord(RATE, (at - at[0]) / RATE, volts, np.zeros(volts.shape, bool))
        cell = THESIS_LOAD_CELL
        shown = np.round(cell.reading(load) + DISPLAY_NOISE * rng.standard_normal(READINGS)).mean()
        forces = film_forces(design, films.fit(record))
        yield forces_differ(forces, FREQUENCY, *cell.load(float(shown), READINGS)), frequencies_differ(films, record)


# --- references ----------------------------------------------------------------------------------------

SENSITIVITY, MODULUS_U, SCATTER = 2.0, 0.02, 0.041 / math.sqrt(6)
THESIS_SAMPLES, MEAN = "123456", 0.24  # of the thesis, and the mean of ln of the model's ratio over the measured one
MODEL_ORIGIN = {
    "design": "single", "model": "surface", "parameters": "physical", "thickness_m": 3e-3, "device": "drawn",
    "simulated": True, "source": "drawn", "created": "2026-11-23", "expires": "2027-11-23",
}  # fmt: skip


def references(times: int = 4000) -> Iterator[Row]:
    """How often the 95 % interval by references holds an object, with its spread known from the thesis' samples or not.

    Samples of the thesis, references and the object are drawn about one constant with one spread; references have an
    uncertainty of their modulus and load sets of their own. The object's own load sets are left out: they are known.
    """
    for told in (True, False):
        for count in (1, 2, 3, 6) if told else (2, 3, 6):
            for spread in (0.02, 0.053):
                share, over = covered(times, count, spread, told=told)
                figure = f"{count} references, spread {100 * spread:g} %, {'with' if told else 'without'} the thesis"
                held, ends = f"{100 * share:.1f} % held", WITHIN if told else (WITHIN[0], 1.0)
                yield between(figure, share, ends, "{:.0%}", held)
                if told:
                    yield between("  errors over u", over, (0.9, 1.1), "{:g}", f"{over:.2f}")


def covered(times: int, count: int, spread: float, *, told: bool) -> tuple[float, float]:
    """Share of objects that the interval holds, and the standard deviation of errors over the mean uncertainty.

    Args:
        times: number of draws; those whose references are refused do not count.
        count: number of references.
        spread: standard deviation of ln of the ratio about the constant.
        told: whether the thesis tells a spread.
    """
    rng = np.random.default_rng(20)
    held, errors, uncertainties = 0, [], []
    for _ in range(times):
        known = Validation("single", "physical", "surface", "input")
        if told:
            drawn = 100 * np.expm1(MEAN + spread * rng.standard_normal(len(THESIS_SAMPLES)))
            known = Validation(
                "single", "physical", "surface", "compared", "", dict(zip(THESIS_SAMPLES, drawn, strict=True))
            )
        *truth, sought = MEAN + spread * rng.standard_normal(count + 1)
        measured = truth + math.hypot(MODULUS_U / SENSITIVITY, SCATTER) * rng.standard_normal(count)
        try:
            line = fit_model([_reference(n, error) for n, error in enumerate(measured)], known, MODEL_ORIGIN).line(True)
        except EstimateError:
            continue
        assert line.u is not None
        held += abs(sought - line.constant) <= coverage_factor(line.degrees_of_freedom) * line.u
        errors.append(sought - line.constant)
        uncertainties.append(line.u)
    return held / len(errors), float(np.std(errors) / np.mean(uncertainties))


def _reference(number: int, error: float) -> MeasuredReference:
    name, ratio = f"R{number}", 0.25
    own = ratio * math.exp(-error)
    return MeasuredReference(name, 48e3, MODULUS_U, "drawn", own, SCATTER, 0.0, 0.0, ratio, SENSITIVITY)


# --- scatter -------------------------------------------------------------------------------------------

SMALL = 0.1  # strength at which a quotient of gains is linear, as what a design states is


def scatter(draws: int = 20_000, seeds: int = 200) -> Iterator[Row]:
    """The films' scatter: what is drawn beside what a design states; whether points are as uncertain as they say."""
    for name in DESIGNS:
        yield _drawn(name, draws)
    for scene in ("thesis_different_base", "thesis_single", "thesis_common_base", "array_16"):
        held = [each for seed in range(seeds) for each in _held(scene, seed + 1)]
        share = sum(held) / len(held)
        yield between(
            f"{scene}: 95 % intervals of points that hold the ratio",
            share,
            WITHIN,
            "{:.0%}",
            f"{share:.1%} of {len(held)}",
        )


def _drawn(name: str, draws: int) -> Row:
    """The figure that lies furthest from what is stated, of all films, teeth and the sensor."""
    design, stream, effect = DESIGNS[name], Stream(1, "scatter"), GainScatter(strength=SMALL)
    gains = np.array([effect.matrix(design, stream, 1000 * number).diagonal() for number in range(draws)]).T
    by_film = dict(zip(design.films, gains, strict=True))
    bases = [film for film in design.films if film.kind == "total"]
    teeth = np.array([
        by_film[film] / by_film[next(base for base in bases if film.teeth[0] in base.teeth)]
        for film in design.films
        if film.kind == "rigid"
    ])  # fmt: skip
    found = [*gains.std(axis=1), *teeth.std(axis=1), teeth.mean(axis=0).std()]
    films = [film.scatter for film in design.films]
    of_teeth = [math.sqrt(row[k]) for k, row in enumerate(design.tooth_covariance)]
    apart = np.abs(np.array(found) / SMALL / [*films, *of_teeth, design.ratio_scatter] - 1).max()
    return at_most(
        f"{name}: {len(found)} films, teeth and sensor over {draws:,} draws, drawn and stated scatter apart",
        apart,
        0.02,
        "{:.0%}",
        f"{apart:.1%} at worst; the ratio scatters by {found[-1] / SMALL:.2%}",
    )


def _held(scene: str, seed: int) -> Iterator[bool]:
    """Whether the 95 % interval of each point of a sweep holds the scene's ratio."""
    with TemporaryDirectory() as folder, mock.patch.dict(os.environ, {"PALPATE_STORE": folder}):
        with palpate.open_bench(scene=scene, seed=seed) as bench:
            palpate.run(palpate.LoadSweep(dwell=0.5), bench, out=Path(folder) / "run")
            design, model = bench.target.design, bench.target.model
        for point in palpate.read(Path(folder) / "run").points():
            true = response(design, Load(1.0, get_sample(point["sample"])), model).force_ratio
            yield abs(point["force_ratio"] - true) <= coverage_factor(math.inf) * point["force_ratio_u"]
