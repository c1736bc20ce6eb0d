"""Whether devices that know one quantity agree on it, at every point, within what is uncertain in them.

The load cell and the base films know the force; the generator and the nodes' clock know the drive's frequency. A
calibration that is wrong, a film that came off or a generator that drifts shows in no reading of its own.
"""

from __future__ import annotations

import math

import numpy as np

from instrument.contracts import signal_generator
from instrument.errors import EstimateError
from instrument.estimate import SineFit
from instrument.film_forces import FilmForces
from procedures.films import FilmRecord, Films

FORCE, FREQUENCY = "force", "frequency"
APART = 4.0  # standard uncertainties of a difference: 6 points in 1e5 by chance
CHARGE_AMPLIFIER = 1.0  # s, time constant [A]; what it takes at low frequencies is in no film's sensitivity
FREQUENCY_STEP = signal_generator.CONTRACT["frequency"].scale  # Hz
CRYSTALS = 1e-4  # relative, of two clocks [A]


def forces_differ(forces: FilmForces, frequency: float, load: float, load_u: float) -> bool:
    """Whether films and load cell tell of another force [N, peak to peak] at a frequency [Hz]."""
    passed = 1 / math.hypot(1.0, 1 / (2 * math.pi * frequency * CHARGE_AMPLIFIER))
    allowed = APART * math.hypot(forces.force_total_u, load_u) + (1 - passed) * load
    return not abs(forces.force_total_N - load) <= allowed


def frequencies_differ(films: Films, record: FilmRecord) -> bool:
    """Whether the films swing with another frequency than was set: their phase turns from one half to the other.

    A record of less than two cycles is not asked.
    """
    half = record.time.size // 2
    if half / record.rate * films.frequency < 1:
        return False
    try:
        first, second = (films.fit(part(half / record.rate)) for part in (record.first, record.last))
    except EstimateError:
        return False  # too few good samples, of which other flags tell
    loudest = int(np.argmax(first.amplitude))
    turned = math.remainder(float(second.phase[loudest] - first.phase[loudest]), 2 * math.pi)
    between = float(record.time[-half:].mean() - record.time[:half].mean())
    off, off_u = turned / (2 * math.pi * between), _phase_u(first, second, loudest) / (2 * math.pi * between)
    return not abs(off) <= APART * off_u + CRYSTALS * films.frequency + FREQUENCY_STEP / 2


def _phase_u(first: SineFit, second: SineFit, film: int) -> float:
    """Of a change of phase [rad]."""
    relative = [
        float(fit.amplitude_u[film] / fit.amplitude[film]) if fit.amplitude[film] > 0 else math.inf
        for fit in (first, second)
    ]
    return math.hypot(*relative)
