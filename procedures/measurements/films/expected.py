"""What a calibration of the films is expected to give: the uncertainty of each film's sensitivity.

A film's gain scatters from load set to load set as the design says [M], noise is that of usual films [A], and each load
is off by its reading. The error of the load cell's curve is common to all points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.sensor.design import Design
from palpate.procedures.engine.plan import noise_of
from palpate.procedures.engine.promise import Expected
from palpate.procedures.measurements.prospects import film_noise, reading_u


def expected_sensitivities(
    design: Design, loads: Sequence[float], frequencies: int, dwell: float, cell: LoadCellCalibration
) -> list[Expected]:
    """Relative uncertainty of each film's sensitivity.

    Args:
        design: design of the sensor.
        loads: load of each load set on a tooth, peak to peak [N].
        frequencies: how many frequencies they are taken at.
        dwell: dwell of each point [s].
        cell: calibration of the load cell.
    """
    common = cell.mean_curve_u(np.asarray(loads, dtype=np.float64))
    found = []
    for film in design.films:
        noise = [film_noise(film, load, dwell, noise_of(design)) for load in loads]
        points = [
            math.hypot(film.scatter, each, reading_u(cell, load)) for each, load in zip(noise, loads, strict=True)
        ]
        count = len(points) * frequencies * len(film.teeth)
        scatter = math.sqrt(math.fsum(u**2 for u in points) / len(points) / count)
        found.append(Expected(f"sensitivity of film {film.name}", math.hypot(scatter, common)))
    return found
