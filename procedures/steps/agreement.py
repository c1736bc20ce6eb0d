"""Whether devices that know one quantity agree on it, at every point, within what is uncertain in them.

The load cell and the base films know the force; the generator and the nodes' clock know the drive's frequency. A
calibration that is wrong, a film that came off or a generator that drifts shows in no reading of its own.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.instrument.contracts import signal_generator
from palpate.instrument.errors import EstimateError
from palpate.instrument.findings.film_forces import FilmForces
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.steps.films import CHARGE_AMPLIFIER, FilmRecord, Films

FALSE_ALARMS = 6.3e-5  # of points that agree: 4 standard uncertainties, where they are well known
FREQUENCY_STEP = signal_generator.CONTRACT["frequency"].scale  # Hz
CRYSTALS = 1e-4  # relative, of two clocks [A]


def forces_differ(forces: FilmForces, frequency: float, load: float, load_u: float, known: float = math.inf) -> bool:
    """Whether films and load cell tell of another force [N, peak to peak] at a frequency [Hz].

    Args:
        known: degrees of freedom of `load_u`.
    """
    # What the charge amplifier takes at low frequencies is in no film's sensitivity.
    passed = 1 / math.hypot(1.0, 1 / (2 * math.pi * frequency * CHARGE_AMPLIFIER))
    noise_u = forces.force_total_noise_u
    difference = Budget(
        "films less load cell",
        forces.force_total_N - load,
        "N",
        (
            Component("films' noise", noise_u, degrees_of_freedom=forces.degrees_of_freedom),
            Component("films' gains", math.sqrt(max(forces.force_total_u**2 - noise_u**2, 0.0))),
            Component("load cell", load_u, degrees_of_freedom=known),
        ),
    )
    return _differ(difference, (1 - passed) * load)


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
    if not min(first.amplitude[loudest], second.amplitude[loudest]) > 0:
        return False
    turned = math.remainder(float(second.phase[loudest] - first.phase[loudest]), 2 * math.pi)
    between = 2 * math.pi * float(record.time[-half:].mean() - record.time[:half].mean())
    halves = tuple(
        Component(name, float(fit.phase_u[loudest]) / between, degrees_of_freedom=fit.degrees_of_freedom)
        for name, fit in (("first half", first), ("second half", second))
    )
    off = Budget("frequency less what was set", turned / between, "Hz", halves)
    return _differ(off, CRYSTALS * films.frequency + FREQUENCY_STEP / 2)


def _differ(difference: Budget, allowed: float) -> bool:
    """Whether a difference is more than what is allowed and what its uncertainty makes of it by chance."""
    return not abs(difference.value) <= difference.expanded(1 - FALSE_ALARMS) + allowed
