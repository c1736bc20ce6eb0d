"""False alarms: how often films and load cell, or films and generator, are said to differ where they do not.

Each seed draws the films' scatter and noise, and what the display shows of the load, as `thesis_single` and
`noisy_lab` state them, or under noise that prevails; no rig and no wire.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.findings.film_forces import film_forces
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.steps.film_point import forces_differ, frequencies_differ
from palpate.procedures.steps.films import FilmRecord, Films
from palpate.procedures.steps.servo import READINGS
from palpate.simulators.effects.pink_noise import PinkNoise
from palpate.simulators.randomness import Stream
from tests.benchmarks.coverage import FREQUENCY, LOADS, LOUD, PERIOD_NS, QUIET, RATE
from tests.benchmarks.row import Row

SEEDS = 300
DWELLS = (0.2, 1.0)  # s
SHARE = 0.142  # force ratio
PASSED = 1 / math.hypot(1.0, 1 / (2 * math.pi * FREQUENCY))  # of the charge amplifier, 1 s
DEAFENING = 1e-3  # V/√Hz, at the drive: a phase is uncertain by more than generator and clock are allowed
DISPLAY_NOISE = 0.3  # mV, before it is shown in whole ones
MOST = 3  # of 3600 points: 0.2 are stated, and chance gives more than 3 once in ten thousand tries


class OnPaper(Films):
    """Films that fit a record and have no bench."""

    frequency_step = 0.0

    def __init__(self, design: Design, frequency_step: float = 1e-3) -> None:
        self.design, self.frequency, self.frequency_step = design, FREQUENCY, frequency_step


def measure() -> Iterator[Row]:
    """A row a scene."""
    scenes = (("thesis_single", QUIET, 0.0), ("noisy_lab", LOUD, LOUD), ("loud 1/f noise alone", QUIET, DEAFENING))
    for name, white, pink in scenes:
        force, frequency, points = false_alarms(white, pink, range(SEEDS))
        said = f"force {force}, frequency {frequency} of {points}"
        yield Row(
            f"false alarms of the agreement flags: {name}", said, f"<= {MOST} each", max(force, frequency) <= MOST
        )


def false_alarms(white: float, pink: float, seeds: range) -> tuple[int, int, int]:
    """Points flagged `force` and `frequency`, and how many there were, under noise of these densities [V/√Hz]."""
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
