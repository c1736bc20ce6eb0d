"""What a frequency sweep measures and finds: gains and phases of films, their amplifiers' corners, a resonance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.frequency_response import Corner, Resonance, fit_corner, fit_resonance
from palpate.instrument.uncertainty.budget import Budget

FEWEST = 3  # points that show a corner


@dataclass(frozen=True, slots=True)
class FilmResponse:
    """One film: voltage per newton of load, and its phase before that of the first base film.

    The generator and the nodes share no clock, so no phase against the drive is known.
    """

    film: str
    gain_V_per_N: float
    gain_u: float
    phase_deg: float
    phase_u: float


@dataclass(frozen=True, slots=True)
class FrequencyPoint:
    """One frequency. `response_N_per_V`: load for the generator's amplitude, both peak to peak."""

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
    """`corners`: of each film; None where the sweep shows none. `resonance`: of shaker, object and sensor."""

    points: list[FrequencyPoint]
    corners: dict[str, Corner | None]
    resonance: Resonance | None
    budgets: tuple[Budget, ...] = ()

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        return {
            "corners": [{"film": film, **_known(corner)} for film, corner in self.corners.items()],
            "resonance": None if self.resonance is None else asdict(self.resonance),
        }


def _known(corner: Corner | None) -> dict[str, float | None]:
    if corner is None:
        return dict.fromkeys(("gain", "gain_u", "corner_Hz", "corner_u", "time_constant_s"))
    return {**asdict(corner), "time_constant_s": corner.time_constant}


def evaluate(points: Sequence[FrequencyPoint], design: Design) -> FrequencyResult:
    """Corners and resonance by the valid points; None where there are too few."""
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
