"""What a characterisation is expected to give: the uncertainty of each figure of merit, by its budget's components.

A film's gain scatters from load to load as the design says [M], noise is that of the bench file, or of usual films [A],
and of the converter's steps, and each load is off by its reading. Linearity, hysteresis and drift are expected to be
what scatter and noise make of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.contracts.sensor_node import FULL_SCALE_COUNTS, HEADROOM, RANGE_VOLTS
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.signals.rapid_noise import of_greatest
from palpate.instrument.uncertainty.budget import Component
from palpate.procedures.engine.plan import noise_of
from palpate.procedures.engine.promise import RELATIVE, Expected
from palpate.procedures.measurements.characterise import definitions as named
from palpate.procedures.measurements.characterise.uncertainty import (
    Sources,
    cell_component,
    components,
    factor,
    noise_component,
)
from palpate.procedures.measurements.prospects import film_noise, load_on, reading_u
from palpate.procedures.steps.checks import preload_for
from palpate.procedures.steps.films import SAMPLES_PER_CYCLE

ROUNDED = 0.12  # relative scatter of a record's noise that is all rounding: an offset passes steps, or stands still [M]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Conditions:
    """Under which conditions a sensor is characterised.

    Attributes:
        design: the sensor.
        ratio: expected force ratio of the sample.
        loads: increasing loads, peak to peak [N].
        frequency: frequency of the load [Hz].
        dwell: dwell of each point [s].
        cell: calibration of the load cell.
    """

    design: Design
    ratio: float
    loads: tuple[float, ...]
    frequency: float
    dwell: float
    cell: LoadCellCalibration

    @property
    def samples(self) -> int:
        """Number of samples in each record."""
        return round(SAMPLES_PER_CYCLE * self.frequency * self.dwell)

    def force(self, film: Film, load: float) -> float:
        """Force on a film under a load [N, peak to peak]."""
        return load_on(self.design, film, self.ratio, load)

    def noise(self, film: Film) -> Floats:
        """Expected error of each load [N] by the film's noise and the converter's steps."""
        steps = math.sqrt(2 / self.samples) * self.rounding(film)
        forces = [self.force(film, load) for load in self.loads]
        relative = [
            math.hypot(
                film_noise(film, force, self.dwell, noise_of(self.design)), steps / (film.sensitivity * force / 2)
            )
            for force in forces
        ]
        return np.array(self.loads) * relative

    def rounding(self, film: Film) -> float:
        """Standard uncertainty of a sample by rounding to the converter's steps [V].

        They are those of the range that the films are set to for these loads, as `Films` chooses it.
        """
        largest = preload_for(self.loads) + max(self.loads) / 2
        finest, widest = min(RANGE_VOLTS), max(RANGE_VOLTS)
        range_ = finest if HEADROOM * film.sensitivity * largest <= finest else widest
        return range_ / FULL_SCALE_COUNTS / math.sqrt(12)

    def apart(self, film: Film) -> Floats:
        """Expected standard deviation of a load set about the line, as an error of each load [N]."""
        loads = np.array(self.loads)
        found: Floats = np.sqrt((film.scatter * loads) ** 2 + self.noise(film) ** 2 + reading_u(self.cell, 1.0) ** 2)
        return found


def expected_figures(
    of: Conditions,
    rounds: int,
    times: Sequence[float],
    force_limit: float,
    slope_u: Callable[[Film], float] | None = None,
) -> list[Expected]:
    """The uncertainty of each figure of merit.

    Args:
        of: the conditions.
        rounds: how often each load is set on the way up.
        times: times of the points while the middle load is held [s].
        force_limit: force limit of the bench [N].
        slope_u: relative uncertainty of the slope of a film's line; None: by the scatter about that line.
    """
    found = []
    for film in of.design.films:
        sources = _sources(of, film, rounds, times, force_limit)
        if slope_u is not None:
            sources = replace(sources, line=Component("line", slope_u(film)))
        parts = components(sources)
        for quantity, each in parts.items():
            u = factor(quantity, 1.0) * math.hypot(*(part.u for part in each))
            unit = RELATIVE if quantity in named.SCALED else named.DEFINITIONS[quantity].unit
            found.append(Expected(f"{quantity}, {film.name}", u, unit))
    return [*found, Expected(f"{named.SPATIAL_RESOLUTION}, sensor", min(of.design.cell) / math.sqrt(12), "m")]


def _sources(of: Conditions, film: Film, rounds: int, times: Sequence[float], force_limit: float) -> Sources:
    # All uncertainties are in newtons of the load: the slope is one.
    loads, noise, each = (np.tile(values, rounds) for values in (of.loads, of.noise(film), of.apart(film)))
    away = loads - loads.mean()
    weight = 1 - 1 / loads.size - away**2 / float(away @ away)  # of each point's error in the line's residuals
    scatter = math.sqrt(float(weight @ each**2) / (loads.size - 2))
    top, span, middle = float(loads.max()), float(np.ptp(loads)), len(of.loads) // 2
    minutes = np.asarray(times) / 60
    square = of.rounding(film) ** 2
    rounded = ROUNDED * square / (square + noise_of(of.design) ** 2 * of.samples / of.dwell / 2)
    random = 1 / math.sqrt(2 * of.samples)
    widest = 2 * max(RANGE_VOLTS) * top / (film.sensitivity * of.force(film, top))
    return Sources(
        line=Component("line", scatter / float(np.linalg.norm(away))),
        cell=cell_component(of.cell),
        noise=noise_component(math.hypot(random, rounded), loads.size, of.samples * loads.size),
        amplitude=Component("amplitude", noise[-1] / top / math.sqrt(rounds)),
        residual=Component("noise", random / math.sqrt(rounds)),
        greatest=Component("greatest of the noise", of_greatest(of.samples) / math.sqrt(rounds)),
        scatter=Component("scatter", scatter),
        typical=math.sqrt(float(np.mean(loads**2))),
        top=top,
        span=span,
        rounds=rounds,
        drift=Component("drift", noise[middle] / of.loads[middle] / float(np.linalg.norm(minutes - minutes.mean()))),
        by_converter=widest < force_limit,
    )
