"""Every procedure as small as it can be, and what it finds: what the matrix of faults plays."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from palpate.drivers.bench import Bench
from palpate.instrument.calibration.load_cell import STANDARD_GRAVITY, THESIS_LOAD_CELL
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.lab import Lab
from palpate.procedures.measurements.characterise.procedure import Characterisation
from palpate.procedures.measurements.films import FilmSeries
from palpate.procedures.measurements.frequency import FrequencySweep
from palpate.procedures.measurements.load_cell.procedure import LoadCellSeries
from palpate.procedures.measurements.loads import LoadPoint, LoadSweep
from palpate.procedures.measurements.modulus import NAMES, ModulusTest
from palpate.procedures.measurements.object_modulus.procedure import ObjectModulus
from palpate.procedures.measurements.object_modulus.report import ModulusPoint
from palpate.procedures.measurements.position import PositionSweep
from palpate.procedures.measurements.softness import SoftnessPoint, SoftnessTest
from palpate.procedures.measurements.temperature import TemperaturePoint, TemperatureSweep
from palpate.procedures.records.record import Recorder
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene

CREATED = datetime(2025, 3, 14, tzinfo=UTC)
SAMPLE, LOADS, DWELL, FREQUENCY = "2", (2.0, 2.5, 3.0), 0.2, 10.0
SINGLE = get_design("single")
APART = 3 * 2**0.5  # standard uncertainties that two results may differ by which share nothing


@dataclass(frozen=True, slots=True)
class Value:
    """A result, by how much two right ones may differ, and whether it stands without a mark."""

    value: float
    allowed: float
    valid: bool = True


Found = dict[str, Value]


def _ratios(
    points: Sequence[LoadPoint | SoftnessPoint | ModulusPoint | TemperaturePoint],
) -> Found:
    return {f"ratio {i}": Value(p.force_ratio, p.force_ratio_u, p.valid) for i, p in enumerate(points)}


def _gain(gain: float, load: float, load_u: float, valid: bool, noise_u: float = 0.0) -> Value:
    """The gain of a film; `noise_u`: relative uncertainty of its voltage.

    Its uncertainty leaves out the scatter of gains, which the scene does not have.
    """
    return Value(gain, APART * gain * math.hypot(load_u / load, noise_u), valid)


def _lab(bench: Bench) -> Lab:
    return Lab(bench, SINGLE, THESIS_LOAD_CELL, run="run", started=CREATED)


def _sweep_loads(bench: Bench, record: Recorder) -> Found:
    sweep = LoadSweep((SAMPLE,), LOADS[::2], DWELL, FREQUENCY)
    return _ratios(conduct(sweep, _lab(bench), record).points)


def _sweep_position(bench: Bench, record: Recorder) -> Found:
    sweep = PositionSweep((12e-3, 14e-3), SAMPLE, 2.0, DWELL, FREQUENCY)
    result = conduct(sweep, Lab(bench, get_design("common_base"), THESIS_LOAD_CELL), record)
    found = {f"place {i}": Value(p.found_mm, p.found_u, p.valid) for i, p in enumerate(result.points)}
    for i, p in enumerate(result.points):
        share, u = max((p.share_left, p.share_left_u), (p.share_right, p.share_right_u))  # the other is hardly one
        found[f"share {i}"] = Value(share, u, p.valid)
    return found


def _sweep_frequency(bench: Bench, record: Recorder) -> Found:
    sweep = FrequencySweep((5.0, 10.0, 20.0), SAMPLE, 2.0, DWELL)
    result = conduct(sweep, Lab(bench, SINGLE, THESIS_LOAD_CELL), record)
    return {
        f"{film.film} {i}": _gain(film.gain_V_per_N, p.load_measured_N, p.load_measured_u, p.valid)
        for i, p in enumerate(result.points)
        for film in p.films
    }


def _sweep_temperature(bench: Bench, record: Recorder) -> Found:
    sweep = TemperatureSweep((0.0, 5.0, 15.0), SAMPLE, 2.0, DWELL, FREQUENCY, 0.0)
    return _ratios(conduct(sweep, Lab(bench, SINGLE, THESIS_LOAD_CELL), record).points)


def _calibrate_load_cell(bench: Bench, record: Recorder) -> Found:
    loads = tuple(1e-3 * gram * STANDARD_GRAVITY for gram in (140, 340, 540, 740))
    found = conduct(LoadCellSeries(loads), _lab(bench), record).calibration
    return {
        "sensitivity": Value(found.sensitivity_mV_per_N, found.sensitivity_u),
        "zero": Value(found.zero_mV, found.zero_u),
    }


def _calibrate_films(bench: Bench, record: Recorder) -> Found:
    found = conduct(FilmSeries(LOADS, (FREQUENCY,), DWELL), _lab(bench), record).calibration
    return {f.name: Value(f.sensitivity_mV_per_N, APART * f.sensitivity_u) for f in found.films}


def _test_modulus(bench: Bench, record: Recorder) -> Found:
    result = conduct(ModulusTest("1", 0.3, 4), _lab(bench), record)
    return {name: Value(found.value, APART * found.u) for (name, _), found in zip(NAMES, result.results(), strict=True)}


def _softness(bench: Bench, record: Recorder) -> Found:
    result = conduct(SoftnessTest((get_sample(SAMPLE),), LOADS[::2], DWELL, FREQUENCY), _lab(bench), record)
    found = _ratios(result.points)
    for each in result.objects:
        if each.modulus_Pa is not None and each.scale_low_Pa is not None and each.scale_high_Pa is not None:
            found["modulus"] = Value(each.modulus_Pa, (each.scale_high_Pa - each.scale_low_Pa) / 4)
    return found


def _measure_modulus(bench: Bench, record: Recorder) -> Found:
    wanted = ObjectModulus(get_sample(SAMPLE), tolerance=0.2, relative_to_model=True, frequency=FREQUENCY)
    result = conduct(wanted, _lab(bench), record)
    found = _ratios(result.points)
    if result.answer is not None:
        found["ratio"] = Value(result.answer.ratio.value, APART * result.answer.ratio.u)
    return found


def _characterise(bench: Bench, record: Recorder) -> Found:
    result = conduct(Characterisation(SAMPLE, LOADS, DWELL, FREQUENCY, 2.0), _lab(bench), record)
    found = {f"{row.film} {row.quantity}": Value(row.value, APART * row.u) for row in result.rows}
    for i, p in enumerate(result.points):
        for film, volts, volts_u in zip(result.films, p.voltages_V, p.voltages_u, strict=True):
            gain, noise_u = volts / p.load_measured_N, volts_u / volts
            found[f"{film} {i}"] = _gain(gain, p.load_measured_N, p.load_measured_u, p.valid, noise_u)
    return found


PROCEDURES: dict[str, Callable[[Bench, Recorder], Found]] = {
    "sweep loads": _sweep_loads,
    "sweep position": _sweep_position,
    "sweep frequency": _sweep_frequency,
    "sweep temperature": _sweep_temperature,
    "calibrate load-cell": _calibrate_load_cell,
    "calibrate films": _calibrate_films,
    "test modulus": _test_modulus,
    "softness": _softness,
    "measure modulus": _measure_modulus,
    "characterise": _characterise,
}


@functools.cache
def scene(procedure: str = "") -> Scene:
    """The thesis' bench without the scatter of the films' gains, behind which a wrong number could hide."""
    whole = read_scene("thesis_common_base" if procedure == "sweep position" else "thesis_single")
    return replace(whole, effects={name: e for name, e in whole.effects.items() if name != "gain_scatter"})


@functools.cache
def real_bench(procedure: str = "") -> Scene:
    """The same bench of twins of devices that can be bought."""
    return replace(scene(procedure), devices=read_scene("real_bench").devices)


def wrong(found: Found, right: Found) -> str:
    """The first value that is wrong without a mark; empty: none is."""
    for name, each in found.items():
        if each.valid and not abs(each.value - right[name].value) <= each.allowed:
            return f"{name}: {each.value:.5g} ± {each.allowed:.2g}, should be {right[name].value:.5g}, without a mark"
    return ""
