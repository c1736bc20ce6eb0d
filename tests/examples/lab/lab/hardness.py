"""Which of two samples is the harder one: a lab's own procedure, from palpate's steps."""

from __future__ import annotations

from palpate.extend import Bench, Films, LoadServo, film_forces, preload_for, press, withdraw
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample

LOAD = 3.0  # N peak to peak
FREQUENCY = 10.0  # Hz
DWELL = 1.0  # s


def force_ratio(bench: Bench, sample: str) -> float:
    """Force ratio of one sample; the probe is home and the outputs are off when it is known."""
    design = get_design(bench.description.design)
    preload = preload_for([LOAD])
    films = Films(bench, design, FREQUENCY, preload + LOAD / 2)
    withdraw(bench)
    servo = LoadServo(bench, THESIS_LOAD_CELL, FREQUENCY, press(bench, THESIS_LOAD_CELL, get_sample(sample), preload))
    servo.set(LOAD)
    ratio = film_forces(design, films.fit(films.acquire(DWELL))).force_ratio
    withdraw(bench)
    return ratio


def harder(bench: Bench, first: str, second: str) -> str:
    """The harder of two samples, which gives the greater force ratio."""
    return max(first, second, key=lambda sample: force_ratio(bench, sample))
