"""Devices that know one quantity: what agrees is not flagged, in any draw of scatter and noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.instrument.sensor.designs import get_design
from palpate.instrument.signals.estimate import FEW_DEGREES
from palpate.procedures.steps.film_point import CRYSTALS, frequencies_differ
from palpate.procedures.steps.films import FilmRecord
from tests.benchmarks.coverage import DWELLS, FREQUENCY, LOADS, LOUD, RATE, OnPaper, false_alarms

SEEDS = 20
FILMS = OnPaper(get_design("single"))
ALLOWED = CRYSTALS * FREQUENCY + FILMS.frequency_step / 2  # Hz, beside what is uncertain


def record(dwell: float, turned: float, noise: float) -> FilmRecord:
    """A record of films whose phase turns by an angle [rad] from the first half to the second."""
    time = np.arange(round(dwell * RATE)) / RATE
    angle = 2 * np.pi * FREQUENCY * time + turned * (time >= dwell / 2)
    volts = np.array([[0.012], [0.10]]) * np.cos(angle)
    volts += noise * np.random.default_rng(3).standard_normal(volts.shape)
    return FilmRecord(RATE, time, volts, np.zeros(volts.shape, bool))


def test_four_standard_uncertainties_between_short_halves_are_chance_and_twenty_times_as_many_are_not() -> None:
    """25 samples tell the noise so badly that the same level of false alarms takes more standard uncertainties."""
    dwell, noise = 0.2, 2e-3
    halves = [FILMS.fit(part(dwell / 2)) for whole in [record(dwell, 0.0, noise)] for part in (whole.first, whole.last)]
    assert max(fit.degrees_of_freedom for fit in halves) < FEW_DEGREES
    turned_u = math.hypot(*(float(fit.phase_u[1]) for fit in halves))
    drawn = float(halves[1].phase[1] - halves[0].phase[1])
    allowed = ALLOWED * math.pi * dwell  # rad between the halves' middles
    flagged = [
        frequencies_differ(FILMS, record(dwell, allowed + times * turned_u - drawn, noise)) for times in (4.5, 20)
    ]
    assert flagged == [False, True]


@pytest.mark.parametrize(("step", "differ"), [(0.5, False), (1e-3, True), (0.0, True)])
def test_a_drive_may_be_half_a_step_of_the_bench_s_own_exciter_beside_what_was_set(step: float, differ: bool) -> None:
    films = OnPaper(FILMS.design, step)
    turned = 2 * math.pi * 0.2 * 0.5  # rad between the halves' middles, of a drive that is 0.2 Hz too fast
    assert frequencies_differ(films, record(1.0, turned, 1e-5)) == differ


@pytest.mark.slow
def test_films_that_agree_with_load_cell_and_generator_are_not_flagged() -> None:
    assert false_alarms(LOUD, LOUD, range(SEEDS)) == (0, 0, SEEDS * len(LOADS) * len(DWELLS))
