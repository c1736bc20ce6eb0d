"""Time and accuracy of the sensor models: stored curves, curves found anew, work and precision, tables of the thesis.

Work is spread over two processes where it is not timed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from tempfile import TemporaryDirectory
from unittest import mock

import numpy as np

from palpate.instrument.errors import RangeError
from palpate.instrument.models import surface
from palpate.instrument.models.axisymmetric import curves
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.finite_elements.work import VARIABLE
from palpate.instrument.models.parameters import (
    IDENTIFIED_ROUND,
    IDENTIFIED_SOLID,
    PHYSICAL,
    Parameters,
    RoundParameters,
    SolidParameters,
    round_parameters,
    solid_parameters,
)
from palpate.instrument.models.response import responses
from palpate.instrument.models.solid import model as solid
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.thesis import read_table
from tests.benchmarks.row import Row

CORES = 2
DESIGNS = ("single_round", "single", "common_base", "different_base", "array")
MANY, REPEATS = 1000, 3
MODULI = np.geomspace(24.0, 24e10, 81)
CASE_A = RoundParameters()
# Degree 9 with 8 layers: 0.4245273654; degree 8 with 7 layers: 0.4245273658.
CASE_A_RATIO = 0.424527365
# Every third of 48 rows.
STRIDE = 3


TOLERANCES = (0.5, 0.2, 0.1, 0.05, 0.01, 1e-3)


def measure() -> Iterator[Row]:
    yield from _automatic()
    yield from _stored()
    yield from _cold()
    yield from _work_precision()
    with ProcessPoolExecutor(CORES) as pool:
        yield from _tables(pool)


def _automatic() -> Iterator[Row]:
    """Model "auto" against the finest mesh: one finer than any that it answers with, or the finest there is."""
    for design in ("single_round", "single", "common_base"):
        sensor = get_design(design)
        moduli = np.geomspace(1.49e4, 140e9, 500)
        loads = [PHYSICAL.load(float(modulus)) for modulus in moduli]
        if design == "single_round":
            finer = curves.found_on(round_parameters(sensor, loads[0]), 8, 7, mixed=True)  # refinement 6
            finest = finer.force_ratios(moduli)[:, 0]
        else:
            finest = surface.find(sensor, loads[0]).force_ratios(moduli)
        worst = 0.0
        for tolerance in TOLERANCES:
            found = np.array([each.force_ratio for each in responses(sensor, loads, "auto", tolerance)])
            worst = max(worst, float(np.abs(found / finest - 1).max()) / tolerance)
        yield Row(
            f"{design}, 500 moduli x {len(TOLERANCES)} tolerances: greatest error of auto over its tolerance",
            f"{worst:.2f}",
            "<= 1",
            worst <= 1,
        )


def _tables(pool: Executor) -> Iterator[Row]:
    for number, design, column, limit in (
        ("A2.1", "single", "force_rigid_N", 0.012),
        ("A2.3", "common_base", "force_ratio", 0.015),
    ):
        table = read_table(number)
        moduli, printed = table.keys()[::STRIDE], np.abs(table.values(column))[::STRIDE]
        sensor = solid_parameters(IDENTIFIED_SOLID.design(get_design(design)), IDENTIFIED_SOLID.load(1e5))
        ratios = list(pool.map(_solid_ratio, [replace(sensor, sensed_modulus=float(modulus)) for modulus in moduli]))
        yield _worst(f"Table {number}, {len(moduli)} rows, solid, one set for both", ratios, printed, limit)
    table = read_table("A2.1")
    disc = round_parameters(IDENTIFIED_ROUND.design(get_design("single")), IDENTIFIED_ROUND.load(1e5))
    moduli = table.keys()
    ratios = [axisymmetric.solve(replace(disc, sensed_modulus=float(modulus)), 1).force_ratio for modulus in moduli]
    printed = np.abs(table.values("force_rigid_N"))
    yield _worst(f"Table A2.1, {len(ratios)} rows, axisymmetric, a set of its own", ratios, printed, 0.008)


def _solid_ratio(parameters: SolidParameters) -> float:
    return solid.solve(parameters, 1).force_ratio


def _worst(figure: str, ratios: Sequence[float], printed: Sequence[float] | np.ndarray, limit: float) -> Row:
    worst = float(np.abs(np.array(ratios) - printed).max())
    return Row(f"{figure}: force ratio off by at most", f"{worst:.4f}", f"<= {limit}", worst <= limit)


def _work_precision() -> Iterator[Row]:
    axisymmetric.solve(CASE_A, 1)  # imports
    for refinement, error_goal, seconds_goal in ((2, 1e-4, 0.5), (3, 5e-6, 2.0)):
        start = time.perf_counter()
        ratio = axisymmetric.solve(CASE_A, refinement).force_ratio
        seconds = time.perf_counter() - start
        error = abs(ratio - CASE_A_RATIO)
        yield Row(
            f"axisymmetric, case A, refinement {refinement}: error and time",
            f"{error:.1e} in {seconds:.2f} s",
            f"<= {error_goal:g} in < {seconds_goal} s",
            error <= error_goal and seconds < seconds_goal,
        )
    for tolerance in (1e-4, 5e-6):
        start = time.perf_counter()
        solution, estimate = axisymmetric.solve_to(CASE_A, tolerance)
        seconds = time.perf_counter() - start
        yield Row(
            f"the same to a tolerance of {tolerance:g}, its estimate included",
            f"{abs(solution.force_ratio - CASE_A_RATIO):.1e}, estimate {estimate:.1e}, in {seconds:.2f} s",
        )


def _cold() -> Iterator[Row]:
    """Whole curves, found anew, each with the error estimate of its finest mesh."""
    for design, tolerance, goal in (("single_round", 1e-5, 0.7), ("single", 1e-3, 3.0), ("common_base", 3e-3, 15.0)):
        sensor = _sensor(design)
        model = axisymmetric if isinstance(sensor, RoundParameters) else solid
        figure = f"{design}: whole curve to {tolerance:g}, cold"
        with _cold_store():
            start = time.process_time()
            try:
                poles, error = model.ladder(sensor).poles_to(MODULI, tolerance)  # type: ignore[arg-type]
            except RangeError as refused:
                yield Row(figure, str(refused), f"<= {goal} s", False)
                continue
            seconds = time.process_time() - start
        yield Row(
            figure, f"{seconds:.2f} s, estimate {error:.1e}, {len(poles.rates)} poles", f"<= {goal} s", seconds <= goal
        )


@contextmanager
def _cold_store() -> Iterator[None]:
    """A context without any curve that is known."""
    for known in (curves.kept_curve, solid.curve_of_one):
        known.cache_clear()
    with TemporaryDirectory() as folder, mock.patch.dict(os.environ, {VARIABLE: folder}):
        yield


def _stored() -> Iterator[Row]:
    """What is asked of stored curves: by a function, and by commands in processes of their own."""
    moduli = np.geomspace(1e4, 1e8, MANY)
    for design in DESIGNS:
        shipped = surface.find(get_design(design), PHYSICAL.load(1e5))
        for figure, ask in (("ratio", shipped.force_ratios), ("ratio, signals and estimate", shipped.solve_at)):
            ask(moduli)
            start = time.process_time()
            for _ in range(REPEATS):
                ask(moduli)
            each = (time.process_time() - start) / (REPEATS * MANY)
            yield Row(f"{design}: {figure} of {MANY} moduli, each", f"{1e6 * each:.1f} us", "<= 30 us", each <= 30e-6)
        many = ("ratio", "--sensed-modulus", ", ".join(f"{modulus:.6g} Pa" for modulus in moduli))
        back = ("modulus", "--force-ratio", "0.3")
        for command in (many, back):
            figure = f"{design}: palpate model {command[0]}, {MANY if command is many else 1} of them"
            seconds = min(_process("model", *command, "--design", design, "--model", "surface") for _ in range(REPEATS))
            yield Row(f"{figure}, curve stored", f"{seconds:.2f} s", "<= 0.5 s", seconds <= 0.5)


def _process(*arguments: str) -> float:
    """Processor time of a command in a process of its own [s]."""
    before = os.times()
    subprocess.run(
        [sys.executable, "-c", "from palpate.procedures.commands import main; main()", *arguments, "--json"],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def _sensor(design: str) -> Parameters:
    return surface.surface_parameters(get_design(design), PHYSICAL.load(1e5))
