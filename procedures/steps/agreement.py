"""Whether two devices that measure the same quantity agree within their uncertainties. This is checked at each point.

The load cell and the base films measure the force. The exciter and the nodes' clock have the drive's frequency. A
wrong calibration, a film that came off, or an exciter that drifts does not show in the readings of one device alone.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.instrument.errors import EstimateError
from palpate.instrument.findings.film_forces import FilmForces
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.steps.films import CHARGE_AMPLIFIER, FilmRecord, Films, LongFilmRecord

FALSE_ALARMS = 6.3e-5  # of points that agree: 4 standard uncertainties of a normal distribution
CRYSTALS = 1e-4  # relative difference of two clocks [A]
HARMONICS = 0.01  # of a load, peak to peak [A]


def forces_differ(forces: FilmForces, frequency: float, load: float, load_u: float, known: float = math.inf) -> bool:
    """Whether films and load cell measure different forces.

    Args:
        forces: forces by the films.
        frequency: frequency of the drive [Hz].
        load: load by the load cell, peak to peak [N].
        load_u: standard uncertainty of the load [N].
        known: degrees of freedom of `load_u`.
    """
    # The films' sensitivities do not contain what the charge amplifier takes away at low frequencies.
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


def loads_differ(waveform: float, waveform_u: float, load: float, load_u: float) -> bool:
    """Whether the waveform of the load indicator's output and its display tell different loads, peak to peak [N].

    Args:
        waveform, waveform_u: load by the sine of the waveform, and its standard uncertainty.
        load, load_u: load by the display, in which harmonics count.
    """
    parts = (Component("waveform", waveform_u), Component("display", load_u))
    return _differ(Budget("waveform less display", waveform - load, "N", parts), HARMONICS * load)


def frequencies_differ(films: Films, record: FilmRecord | LongFilmRecord) -> bool:
    """Whether the films swing with another frequency than was set: then their phase turns between the record's halves.

    A record of less than two cycles cannot tell.
    """
    half = record.samples // 2
    if half / record.rate * films.frequency < 1:
        return False
    try:
        first, second = (films.fit(part(half / record.rate)) for part in (record.first, record.last))
    except EstimateError:
        return False  # there are too few good samples, and other flags say so
    loudest = int(np.argmax(first.amplitude))
    if not min(first.amplitude[loudest], second.amplitude[loudest]) > 0:
        return False
    turned = math.remainder(float(second.phase[loudest] - first.phase[loudest]), 2 * math.pi)
    between = 2 * math.pi * record.between(half)
    halves = tuple(
        Component(name, float(fit.phase_u[loudest]) / between, degrees_of_freedom=fit.degrees_of_freedom)
        for name, fit in (("first half", first), ("second half", second))
    )
    off = Budget("frequency less what was set", turned / between, "Hz", halves)
    return _differ(off, CRYSTALS * films.frequency + films.frequency_step / 2)


def _differ(difference: Budget, allowed: float) -> bool:
    """Whether a difference exceeds what is allowed plus what its uncertainty explains."""
    return not abs(difference.value) <= difference.expanded(1 - FALSE_ALARMS) + allowed
