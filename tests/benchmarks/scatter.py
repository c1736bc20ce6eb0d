"""The films' scatter: what is drawn beside what a design states, and whether points are as uncertain as they say."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import palpate
from palpate.instrument.models.response import response
from palpate.instrument.sensor.designs import DESIGNS
from palpate.instrument.sensor.sample import Load, get_sample
from palpate.instrument.uncertainty.budget import coverage_factor
from palpate.simulators.effects.gain_scatter import GainScatter
from palpate.simulators.randomness import Stream
from tests.benchmarks.row import Row

DRAWS = 20_000
SEEDS = int(os.environ.get("PALPATE_SEEDS", "200"))  # of a sweep of 36 points
SMALL = 0.1  # strength at which a quotient of gains is linear, as what a design states is
APART, WITHIN = 0.02, (0.93, 0.97)
SCENES = ("thesis_different_base", "thesis_single", "thesis_common_base", "array_16")


def measure() -> Iterator[Row]:
    for name in DESIGNS:
        yield _drawn(name)
    for scene in SCENES:
        yield _held(scene)


def _drawn(name: str) -> Row:
    """The figure that lies furthest from what is stated, of all films, teeth and the sensor."""
    design, stream, effect = DESIGNS[name], Stream(1, "scatter"), GainScatter(strength=SMALL)
    gains = np.array([effect.matrix(design, stream, 1000 * number).diagonal() for number in range(DRAWS)]).T
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
    apart = np.array(found) / SMALL / [*films, *of_teeth, design.ratio_scatter] - 1
    worst = float(apart[np.abs(apart).argmax()])
    return Row(
        f"{name}: {len(apart)} films, teeth and sensor over {DRAWS:,} draws, drawn over stated scatter",
        f"{worst:+.1%} at worst; the ratio scatters by {found[-1] / SMALL:.2%}",
        f"within {APART:.0%}",
        abs(worst) <= APART,
    )


def _held(scene: str) -> Row:
    """Points whose 95 % interval holds the scene's ratio, over sweeps with fresh seeds."""
    held = []
    for seed in range(1, SEEDS + 1):
        with tempfile.TemporaryDirectory() as folder:
            os.environ["PALPATE_STORE"] = folder
            with palpate.open_bench(scene=scene, seed=seed) as bench:
                palpate.run(palpate.LoadSweep(dwell=0.5), bench, out=Path(folder) / "run")
                design, model = bench.target.design, bench.target.model
            for point in palpate.read(Path(folder) / "run").points():
                true = response(design, Load(1.0, get_sample(point["sample"])), model).force_ratio
                held.append(abs(point["force_ratio"] - true) <= coverage_factor(math.inf) * point["force_ratio_u"])
    share = sum(held) / len(held)
    return Row(
        f"{scene}: 95 % intervals of points that hold the ratio, {SEEDS} seeds",
        f"{share:.1%} of {len(held)}",
        f"{WITHIN[0]:.0%} to {WITHIN[1]:.0%}",
        WITHIN[0] <= share <= WITHIN[1],
    )
