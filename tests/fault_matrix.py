"""Every fault on everything that can have it, in the middle of a procedure: what comes of it.

The outcome is a result that is right within its stated uncertainty, with the incident in the record; or one that is
marked; or a stop with an error that says what failed, and outputs at zero. Anything else is WRONG.
"""

from __future__ import annotations

import functools
import math
import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

from palpate.drivers.bench import Bench
from palpate.drivers.incident import INCIDENT
from palpate.instrument.calibration.load_cell import STANDARD_GRAVITY, THESIS_LOAD_CELL
from palpate.instrument.errors import PalpateError
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
from palpate.procedures.records.run import Run
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.faults import FAULTS, fault_class, inject
from palpate.simulators.faults.can import CanFault, FilmFault
from palpate.simulators.faults.device import IndicatorFault
from palpate.simulators.faults.fault import parse_faults, places, struck
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


# --- the procedures ----------------------------------------------------------------------------------

PROCESSES_A_CORE = 4
HASTY = "0.5 s"  # of the wall: where it is too short for a busy machine, one more thing fails, and the verdict holds
ONCE, STAYS = "once", "stays"
LONG = "100000 s"
A_WHILE = "1 s"  # a single frame is a heartbeat as often as a sample
SETTLED = 2.1  # s, after which a watchdog has dropped what nobody could switch off

# What somebody turns at each device.
PANEL = {
    "signal_generator": (("amplitude", 0.5), ("frequency", 11.0), ("output", 0.0)),
    "shaker_amplifier": (("gain", 3.0), ("enable", 0.0)),
    "strain_indicator": (("gage_factor", 4.0), ("mode", 0.0), ("filter", 5.0)),
    "positioner": (("limit_high", 0.02),),
    "sample_changer": (("speed", 0.001),),
    "sensor_node_1": (("range_1", 0.0), ("sync_period", 0.01)),
    "exciter": (("mode", 1.0),),
    "load_cell": (("filter_level", 5.0),),
    "stage": (("limit_high", -20000.0), ("mode", 3.0)),
    "films": (("sync_period", 0.01), ("heartbeat", 0.0)),
}  # fmt: skip


Scenes = Callable[[str], Scene]


@dataclass(frozen=True, slots=True)
class Cell:
    procedure: str
    kind: str
    on: str
    lasts: str
    more: tuple[tuple[str, Any], ...] = ()

    @property
    def name(self) -> str:
        setting = f" {self.more[0][1]}" if self.more else ""
        return f"{self.kind}{setting}, {self.on}, {self.lasts}, {self.procedure}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """`verdict`: right, marked, stopped or WRONG. `said`: the error, or what is wrong."""

    verdict: str
    incidents: int = 0
    said: str = ""


def cells(procedures: Iterable[str] = tuple(PROCEDURES), of: Scenes = scene) -> Iterator[Cell]:
    """The whole matrix of a bench; `of`: gives the scene of a procedure."""
    for procedure in procedures:
        standing = places(1, of(procedure).devices)
        for kind in FAULTS:
            for on in struck(fault_class(kind).targets, standing):
                mores: list[tuple[tuple[str, Any], ...]] = [()]
                if kind == "front_panel":
                    mores = [(("setting", setting), ("value", value)) for setting, value in PANEL[on]]
                for more in mores:
                    yield from (Cell(procedure, kind, on, lasts, more) for lasts in (ONCE, STAYS))


def incidents_of(run: Run) -> list[str]:
    """What failed in a run. That a reading could be a load in both orders of its words is told, and is no fault."""
    events = [event["message"] for event in run.events() if event["kind"] == INCIDENT]
    return [message for message in events if "with its words in the other order" not in message]


@functools.cache
def undisturbed(procedure: str, changer: bool = False, of: Scenes = scene) -> tuple[Found, float]:
    """The result without faults, and the bench time in the middle of a point in its middle [s]."""
    with tempfile.TemporaryDirectory() as folder:
        result, run, _ = _done(procedure, of(procedure), Path(folder) / "run", changer)
        assert not isinstance(result, PalpateError)
        times = [point["bench_ns"] for point in run.points()]
        before, after = times[len(times) // 2 - 1], times[len(times) // 2]
        assert not incidents_of(run)
        return result, 1e-9 * (before + after) / 2


def play(cell: Cell, of: Scenes = scene) -> Outcome:
    """What comes of one cell; `of`: gives the scene of its procedure."""
    return _play(cell, *undisturbed(cell.procedure, cell.on == "sample_changer", of), of)


def play_all(procedures: Sequence[str] = tuple(PROCEDURES), of: Scenes = scene) -> dict[Cell, Outcome]:
    """What comes of every cell, in as many processes as keep the cores busy: most of a cell is waiting in vain."""
    whole = list(cells(procedures, of))
    spawned = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(PROCESSES_A_CORE * (os.cpu_count() or 1), spawned) as pool:
        kinds = [(procedure, changer) for procedure in procedures for changer in (False, True)]
        right = dict(zip(kinds, pool.map(partial(undisturbed, of=of), *zip(*kinds, strict=True)), strict=True))
        found = (right[cell.procedure, cell.on == "sample_changer"] for cell in whole)
        return dict(zip(whole, pool.map(partial(_play, of=of), whole, *zip(*found, strict=True)), strict=True))


def _play(cell: Cell, right: Found, middle: float, of: Scenes = scene) -> Outcome:
    table = {"kind": cell.kind, "on": cell.on, "at": f"{middle} s", **dict(cell.more)}
    if cell.lasts == STAYS:
        table["lasts"] = LONG
    elif issubclass(fault_class(cell.kind), (CanFault, IndicatorFault, FilmFault)):
        table["lasts"] = A_WHILE
    with tempfile.TemporaryDirectory() as folder:
        base = of(cell.procedure)
        faulty = replace(base, faults=parse_faults([table], places(1, base.devices), "matrix"))
        result, run, live = _done(cell.procedure, faulty, Path(folder) / "run", cell.on == "sample_changer")
        incidents = len(incidents_of(run))
        if live:
            return Outcome("WRONG", incidents, f"outputs are at {live:g} V")
        if isinstance(result, PalpateError):
            clear = run.status == "failed" and len(str(result)) > 20
            return Outcome("stopped" if clear else "WRONG", incidents, f"{type(result).__name__}: {result}")
        if said := wrong(result, right):
            return Outcome("WRONG", incidents, said)
        whole = result.keys() == right.keys() and all(value.valid for value in result.values())
        return Outcome("right" if whole else "marked", incidents)


def _done(procedure: str, of: Scene, folder: Path, changer: bool) -> tuple[Found | PalpateError, Run, float]:
    """The result or the error, the run, and the greatest output voltage that is left in the end [V]."""
    header = {"procedure": procedure, "simulated": True, "started": "2025-03-14T15:09:26Z"}
    result: Found | PalpateError
    samples = [get_sample(SAMPLE)] if changer else []
    with patch.object(inject, "TIMEOUT", HASTY), SimulatedBench(of, samples=samples) as sim:
        try:
            with Recorder.create(folder, header) as record:
                with Bench(sim.description, sim.clock, sim.operator) as bench:
                    bench.attend(record.event)
                    result = PROCEDURES[procedure](bench, record)
                record.finish("complete", {})
        except PalpateError as error:
            result = error
        sim.clock.wait(SETTLED)
        least, greatest = sim.rig.coil_voltage().extremes()
    return result, Run.open(folder), max(math.fabs(least), math.fabs(greatest))
