"""What a frequency sweep is expected to give: the corner of each film and its gain above it.

Both come from the fit of the sweep itself, for gains without an error of their own. A film's gain scatters as the
design says [M], noise is that of usual films [A], and the corner is that of usual charge amplifiers [A]. No resonance
is expected: whether the sweep shows one is for the run to tell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.frequency_response import fit_corner, high_pass
from palpate.procedures.engine.plan import noise_of
from palpate.procedures.engine.promise import Expected
from palpate.procedures.measurements.prospects import film_noise, load_on, reading_u
from palpate.procedures.steps.films import CHARGE_AMPLIFIER


def expected_corners(
    design: Design,
    ratio: float,
    frequencies: Sequence[float],
    dwells: Sequence[float],
    load: float,
    cell: LoadCellCalibration,
) -> list[Expected]:
    """Relative uncertainties of each film's corner and gain; none for a film whose corner the sweep would not show.

    Args:
        design: design of the sensor.
        ratio: expected force ratio of the sample.
        frequencies: frequencies of the points [Hz].
        dwells: dwell of each [s].
        load: load, peak to peak [N].
        cell: calibration of the load cell.
    """
    curve_u = cell.mean_curve_u(np.array([load]))
    corner = 1 / (2 * math.pi * CHARGE_AMPLIFIER)
    passed = np.exp(high_pass(np.asarray(frequencies, dtype=np.float64), 0.0, corner))
    found = []
    for film in design.films:
        noise = film_noise(film, load_on(design, film, ratio, load), 1.0, noise_of(design)) / np.sqrt(dwells) / passed
        u = np.sqrt(film.scatter**2 + noise**2 + reading_u(cell, load) ** 2)
        fitted = fit_corner(frequencies, passed, passed * u)
        if fitted is not None:
            found.append(Expected(f"corner of film {film.name}", fitted.corner_u / fitted.corner_Hz))
            found.append(Expected(f"gain of film {film.name}", math.hypot(fitted.gain_u / fitted.gain, curve_u)))
    return found
