"""The points and the result of a frequency sweep: gains and phases of films, their amplifiers' corners, a resonance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.frequency_response import Corner, Resonance, fit_corner, fit_resonance
from palpate.instrument.uncertainty.budget import Budget

FEWEST = 3  # least number of points for a corner


@dataclass(frozen=True, slots=True)
class FilmResponse:
    """Response of one film. Names with `_u` are standard uncertainties.

    The generator and the nodes have no common clock, so the phase relative to the drive is unknown.

    Attributes:
        film: name of the film.
        gain_V_per_N, gain_u: voltage over load.
        phase_deg, phase_u: phase lead over the first base film.
    """

    film: str
    gain_V_per_N: float
    gain_u: float
    phase_deg: float
    phase_u: float


@dataclass(frozen=True, slots=True)
class FrequencyPoint:
    """One frequency. Loads are peak to peak; names with `_u` are standard uncertainties.

    Attributes:
        frequency_Hz: the frequency.
        tactile: whether it lies within the band of touch.
        load_measured_N, load_measured_u: the measured load.
        response_N_per_V: the measured load over the generator's voltage, both peak to peak.
        films: the response of each film.
        valid: whether the point is used.
        dwell_s: the dwell.
        settling_s: how long the films took to settle.
        attempts: number of attempts.
        flags: why the point is not used, or what to know about it.
    """

    frequency_Hz: float
    tactile: bool
    load_measured_N: float
    load_measured_u: float
    response_N_per_V: float
    films: tuple[FilmResponse, ...]
    valid: bool
    dwell_s: float
    settling_s: float
    attempts: int
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FrequencyResult:
    """The result of a frequency sweep.

    Attributes:
        points: the points.
        corners: corner of each film's charge amplifier, by film; None: the sweep shows none.
        resonance: resonance of shaker, object and sensor; None: the sweep shows none.
        budgets: none.
    """

    points: list[FrequencyPoint]
    corners: dict[str, Corner | None]
    resonance: Resonance | None
    budgets: tuple[Budget, ...] = ()

    def summary(self) -> dict[str, Any]:
        """The result for JSON, without its points."""
        return {
            "corners": [{"film": film, **_known(corner)} for film, corner in self.corners.items()],
            "resonance": None if self.resonance is None else asdict(self.resonance),
        }


def _known(corner: Corner | None) -> dict[str, float | None]:
    if corner is None:
        return dict.fromkeys(("gain", "gain_u", "corner_Hz", "corner_u", "time_constant_s"))
    return {**asdict(corner), "time_constant_s": corner.time_constant}


def evaluate(points: Sequence[FrequencyPoint], design: Design) -> FrequencyResult:
    """Find corners and resonance from the valid points; they are None if there are too few points."""
    valid = [point for point in points if point.valid]
    frequency = [point.frequency_Hz for point in valid]
    corners: dict[str, Corner | None] = dict.fromkeys(film.name for film in design.films)
    if len(valid) >= FEWEST:
        for i, film in enumerate(design.films):
            gains = [point.films[i] for point in valid]
            corners[film.name] = fit_corner(frequency, [g.gain_V_per_N for g in gains], [g.gain_u for g in gains])
    resonance = None
    if len(valid) > FEWEST:
        response = np.array([point.response_N_per_V for point in valid])
        relative = np.array([point.load_measured_u / point.load_measured_N for point in valid])
        resonance = fit_resonance(frequency, response, response * relative)
    return FrequencyResult(list(points), corners, resonance)
