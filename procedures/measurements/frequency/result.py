"""The points and the result of a frequency sweep: gains and phases of films, their amplifiers' corners, a resonance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

import numpy as np

from palpate.instrument.calibration.films import LOAD_CELL
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.frequency_response import Corner, Resonance, fit_corner, fit_resonance
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import Column

FEWEST = 3  # least number of points for a corner


def in_touch(point: FrequencyPoint) -> str:
    """Whether a point lies within the band of touch, for its row in a table."""
    return "yes" if point.tactile else ""


@dataclass(frozen=True, slots=True)
class FilmFrequencyResponse:
    """Response of one film.

    The exciter and the nodes have no common clock, so the phase relative to the drive is unknown.
    """

    film: Annotated[str, Column("name of the film")]
    gain_V_per_N: Annotated[float, Column("voltage over load", "V/N", "mV/N", ".3g", 1e3, u="gain_u")]
    gain_u: float
    phase_deg: Annotated[
        float, Column("phase lead over the first base film; `phase_u` by noise and hum", "°", "°", "+z.2f", u="phase_u")
    ]
    phase_u: float


@dataclass(frozen=True, slots=True)
class FrequencyPoint:
    """One frequency. Loads are peak to peak."""

    frequency_Hz: Annotated[float, Column("the frequency", "Hz", "Hz", "g")]
    tactile: Annotated[bool, Column("whether it lies within the band of touch", head="touch", cell=in_touch)]
    load_measured_N: columns.PrintedLoad
    load_measured_u: float
    response_N_per_V: Annotated[
        float, Column("the measured load over the exciter's voltage", "N/V", "load/drive\nN/V", "z.3f")
    ]
    films: Annotated[tuple[FilmFrequencyResponse, ...], Column("the response of each film", each="film")]
    valid: columns.Valid
    dwell_s: columns.Dwell
    settling_s: columns.Settling
    attempts: columns.Attempts
    flags: columns.Flags


@dataclass(frozen=True, slots=True)
class FrequencyResult:
    """The result of a frequency sweep.

    Attributes:
        points: the points.
        corners: corner of each film's charge amplifier, by film; None: the sweep shows none.
        resonance: resonance of shaker, object and sensor; None: the sweep shows none.
        budgets: uncertainty budget of each corner and gain above it, and of the resonance and its damping.
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


def evaluate(points: Sequence[FrequencyPoint], design: Design, calibration: LoadCellCalibration) -> FrequencyResult:
    """Find corners and resonance from the valid points; they are None if there are too few points.

    The load cell's curve shifts the load, and with it the gain, alike at all points. So it adds to the gain above a
    corner, and not to what the fits find from the differences between the points.
    """
    valid = [point for point in points if point.valid]
    frequency = [point.frequency_Hz for point in valid]
    load = np.array([point.load_measured_N for point in valid])
    curve_u = [calibration.curve_u(each) / each for each in load.tolist()]
    corners: dict[str, Corner | None] = dict.fromkeys(film.name for film in design.films)
    budgets: list[Budget] = []
    if len(valid) >= FEWEST:
        freedom = float(calibration.degrees_of_freedom or math.inf)
        for i, film in enumerate(design.films):
            gain = np.array([point.films[i].gain_V_per_N for point in valid])
            gain_u = np.array([point.films[i].gain_u for point in valid])
            corner = fit_corner(frequency, gain, np.sqrt(gain_u**2 - (gain * curve_u) ** 2))
            if corner is None:
                continue
            load_cell = Component(LOAD_CELL, calibration.mean_curve_u(load), corner.gain, freedom)
            above = Budget(f"gain of film {film.name}", corner.gain, "V/N", (_of_points(corner.gain_u), load_cell))
            corners[film.name] = replace(corner, gain_u=above.u)
            budgets += [_fitted(f"corner of film {film.name}", corner.corner_Hz, corner.corner_u, "Hz"), above]
    resonance = None
    if len(valid) > FEWEST:
        response = np.array([point.response_N_per_V for point in valid])
        load_u = np.array([point.load_measured_u for point in valid])
        resonance = fit_resonance(frequency, response, response * np.sqrt((load_u / load) ** 2 - np.square(curve_u)))
    if resonance is not None:
        budgets.append(_fitted("resonance", resonance.frequency_Hz, resonance.frequency_u, "Hz"))
        budgets.append(_fitted("damping ratio", resonance.damping, resonance.damping_u, ""))
    return FrequencyResult(list(points), corners, resonance, tuple(budgets))


def _fitted(quantity: str, value: float, u: float, unit: str) -> Budget:
    """The budget of a quantity that the differences between the points alone make uncertain."""
    return Budget(quantity, value, unit, (_of_points(u),))


def _of_points(u: float) -> Component:
    return Component("points of the sweep", u)
