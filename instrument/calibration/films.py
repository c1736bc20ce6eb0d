"""Calibration of films against the load cell: sensitivity to a film's own teeth, and crosstalk from others."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from palpate.instrument.arrays import Floats
from palpate.instrument.calibration.calibration import Calibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.config import Config, Name, NotNegative, Positive, check
from palpate.instrument.errors import ConfigError, EstimateError
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.uncertainty.budget import Between, Budget, Component
from palpate.instrument.uncertainty.interpolation import interpolate

# --- the films -----------------------------------------------------------------------------------------


FEWEST = 3  # least number of points for each film; fewer do not show the scatter
REPEATS, LOAD_CELL = "scatter from one load set to the next", "load cell"


@dataclass(frozen=True, slots=True)
class FilmReading:
    """Voltages of a design's films while one tooth alone was pressed. Loads and voltages are peak to peak.

    Args:
        tooth: number of the tooth, from 0.
        frequency: frequency of the load [Hz].
        set_load: load that was asked for [N].
        load, load_u: load by the load cell, with its standard uncertainty [N].
        voltage: (films,) V, in the design's order.
    """

    tooth: int
    frequency: float
    set_load: float
    load: float
    load_u: float
    voltage: Floats


class CalibratedFilm(Config):
    """Calibration of one film.

    Args:
        sensitivity_mV_per_N, sensitivity_u: mean over all points, with standard uncertainty.
        scatter_u, degrees_of_freedom: part of that uncertainty that comes from the scatter of the points.
        load_cell_u: part of it that comes from the load cell's calibration, the same for all films.
        linearity: greatest deviation from a line through the means at the loads, as a fraction of the span.
        clamping: sensitivity over the design's sensitivity.
    """

    model_config = ConfigDict(strict=True)

    name: Name
    sensitivity_mV_per_N: Positive
    sensitivity_u: Positive
    scatter_u: NotNegative
    degrees_of_freedom: Annotated[int, Field(ge=1)]
    load_cell_u: NotNegative
    linearity: NotNegative
    clamping: Positive


class FilmCalibration(Calibration):
    """Calibration of the films of one sensor on its node. The field names are the keys of the calibration file.

    Args:
        films: calibrations in the design's order.
        covariance: (films, films), covariance of the sensitivities, (mV/N)².
        crosstalk: (rigid films, teeth): voltage of film i while tooth j alone is pressed, over its voltage under the
            same force on its own tooth.
        crosstalk_u: standard uncertainties of the crosstalk.
        frequencies_Hz, gain: sensitivity of each film at a frequency over its mean.
        device: serial number of the sensor node.
        load_cell: calibration of the load cell, with the degrees of freedom of its uncertainty.
    """

    file: ClassVar[str] = "calibration of films"
    kind: ClassVar[str] = "films"
    make: ClassVar[str] = "run palpate calibrate films"

    design: Name
    films: Annotated[tuple[CalibratedFilm, ...], Field(min_length=1)]
    covariance: tuple[tuple[float, ...], ...]
    crosstalk: tuple[tuple[float, ...], ...]
    crosstalk_u: tuple[tuple[float, ...], ...]
    frequencies_Hz: tuple[float, ...]
    gain: tuple[tuple[float, ...], ...]
    least_N: float
    greatest_N: float
    load_cell: Name
    load_cell_degrees_of_freedom: Annotated[int, Field(ge=1)] | None = None

    @property
    def of(self) -> tuple[str, ...]:
        return (self.design,)

    @model_validator(mode="after")
    def _fits(self) -> Self:
        """Check that each table has the size that the films and frequencies need."""
        count = len(self.films)
        shapes = {
            "covariance": (self.covariance, count, count),
            "gain": (self.gain, count, len(self.frequencies_Hz)),
            "crosstalk_u": (self.crosstalk_u, len(self.crosstalk), len(self.crosstalk[0]) if self.crosstalk else 0),
            "crosstalk": (self.crosstalk, len(self.crosstalk), len(self.crosstalk[0]) if self.crosstalk else 0),
        }
        for name, (table, rows, columns) in shapes.items():
            if len(table) != rows or any(len(row) != columns for row in table):
                raise ValueError(f"{name} is not {rows} rows of {columns} numbers, for {count} films")
        return self

    def budgets(self) -> tuple[Budget, ...]:
        """Uncertainty budget of each film's sensitivity."""
        freedom = self.load_cell_degrees_of_freedom or math.inf
        return tuple(
            Budget(
                f"sensitivity of film {film.name}",
                film.sensitivity_mV_per_N,
                "mV/N",
                (
                    Component(REPEATS, film.scatter_u, degrees_of_freedom=film.degrees_of_freedom, kind="A"),
                    Component(LOAD_CELL, film.load_cell_u, degrees_of_freedom=freedom),
                ),
            )
            for film in self.films
        )

    def apply(self, design: Design) -> Design:
        """The design with these sensitivities and their covariance.

        The covariance gets the degrees of freedom of the scatter. The load cell's part, which is mostly known better,
        cancels in a ratio.
        """
        found = np.array([film.sensitivity_mV_per_N for film in self.films])
        relative = np.array(self.covariance) / np.outer(found, found)
        films = (
            replace(film, sensitivity=1e-3 * float(value)) for film, value in zip(design.films, found, strict=True)
        )
        return replace(
            design,
            films=tuple(films),
            film_covariance=tuple(map(tuple, relative.tolist())),
            film_freedom=float(min(film.degrees_of_freedom for film in self.films)),
        )

    def check_films(self, design: Design) -> None:
        """Check that the calibrated films are those of a design. Raises ConfigError."""
        if [film.name for film in self.films] != [film.name for film in design.films]:
            raise ConfigError(f"{self.made}, which had other films than design {design.name} has; {self.make}")


def calibrate_films(
    design: Design, readings: Sequence[FilmReading], load_cell: LoadCellCalibration, origin: Mapping[str, Any]
) -> FilmCalibration:
    """Calibrate films from readings in which the teeth were pressed one after the other.

    A film's gain scatters from one load set to the next by a share of itself, so its sensitivity is the mean of voltage
    over load. An error of the load cell's calibration is common to all films.

    Args:
        readings: readings of every tooth, at several loads and frequencies.
        load_cell: calibration of the load cell.
        origin: the fields of `Calibration`.

    Raises:
        EstimateError: a film has fewer than three readings or loads, a load is not positive, or a film gives no
            voltage.
    """
    own = np.array([[reading.tooth in film.teeth for reading in readings] for film in design.films])
    load = np.array([reading.load for reading in readings])
    if not (load > 0).all():
        raise EstimateError(f"load {load.min():g} N by the load cell is not above 0; check the zero of the load cell")
    if (own.sum(axis=1) < FEWEST).any():
        raise EstimateError(f"{own.sum(axis=1).min()} readings of a film give no scatter; use at least {FEWEST}")
    ratio = np.array([reading.voltage for reading in readings]).T / load
    count = own.sum(axis=1)
    mean = np.where(own, ratio, 0.0).sum(axis=1) / count
    deviation = np.where(own, ratio - mean[:, np.newaxis], 0.0) / np.sqrt(count * (count - 1.0))[:, np.newaxis]
    common = mean * load_cell.mean_curve_u(load)
    covariance = deviation @ deviation.T + np.outer(common, common)
    u = np.sqrt(np.diagonal(covariance))
    for film, value, value_u in zip(design.films, mean, u, strict=True):
        if not value > 3 * value_u:
            raise EstimateError(
                f"film {film.name!r} on channel {film.channel} gives {1e3 * value:.3g} mV/N with standard uncertainty "
                f"{1e3 * value_u:.2g} mV/N; it must be more than three times that: check its connection"
            )
    crosstalk, crosstalk_u = _crosstalk(design, readings, ratio, mean)
    frequencies = tuple(sorted({reading.frequency for reading in readings}))
    at = np.array([reading.frequency for reading in readings])
    fields = {
        "design": design.name,
        "films": [
            {
                "name": film.name,
                "sensitivity_mV_per_N": 1e3 * float(mean[i]),
                "sensitivity_u": 1e3 * float(u[i]),
                "scatter_u": 1e3 * float(np.linalg.norm(deviation[i])),
                "degrees_of_freedom": int(count[i]) - 1,
                "load_cell_u": 1e3 * float(common[i]),
                "linearity": _linearity([r for r, mine in zip(readings, own[i], strict=True) if mine], i),
                "clamping": float(mean[i]) / film.sensitivity,
            }
            for i, film in enumerate(design.films)
        ],
        "covariance": (1e6 * covariance).tolist(),
        "crosstalk": crosstalk.tolist(),
        "crosstalk_u": crosstalk_u.tolist(),
        "frequencies_Hz": frequencies,
        "gain": [[float(ratio[i, own[i] & (at == f)].mean() / mean[i]) for f in frequencies] for i in range(len(mean))],
        "least_N": min(reading.set_load for reading in readings),
        "greatest_N": max(reading.set_load for reading in readings),
        "load_cell": f"{load_cell.source}{load_cell.marks()}",
        "load_cell_degrees_of_freedom": load_cell.degrees_of_freedom,
        **origin,
    }
    return check(fields, FilmCalibration, "film calibration")


def _crosstalk(design: Design, readings: Sequence[FilmReading], ratio: Floats, mean: Floats) -> tuple[Floats, Floats]:
    """Crosstalk (rigid films, teeth) and its standard uncertainties."""
    rigid = [i for i, film in enumerate(design.films) if film.kind == FILM_KINDS[0]]
    pressed = np.array([reading.tooth for reading in readings])
    values, uncertainties = np.zeros((2, len(rigid), len(design.teeth)))
    for row, i in enumerate(rigid):
        for tooth in range(len(design.teeth)):
            parts = ratio[i, pressed == tooth] / mean[i]
            values[row, tooth] = parts.mean()
            uncertainties[row, tooth] = parts.std(ddof=1) / math.sqrt(parts.size)
    return values, uncertainties


def _linearity(readings: Sequence[FilmReading], film: int) -> float:
    """Greatest deviation of one film's mean voltages from a line, as a fraction of the span."""
    sets = sorted({reading.set_load for reading in readings})
    load = np.array([np.mean([r.load for r in readings if r.set_load == s]) for s in sets])
    volts = np.array([np.mean([r.voltage[film] for r in readings if r.set_load == s]) for s in sets])
    line = interpolate(load, volts, 0.0)
    return float(np.abs(volts - line.reading(load)).max() / abs(line.coefficients[1] * np.ptp(load)))


# --- scatter of mountings ------------------------------------------------------------------------------


class MountingScatterCalibration(Calibration):
    """Scatter of the ratio of one sensor from mounting to mounting. The field names are the keys of its file.

    Args:
        means_u: relative standard deviation of the mean ratio of a mounting; what sets scatter within it is in it.
        degrees_of_freedom: degrees of freedom of this estimate: mountings less one.
        sets_u: what sets alone add to it.
        sets_freedom: the degrees of freedom of that.
        design: design of the sensor.
        device: serial number of the sensor node.
    """

    file: ClassVar[str] = "scatter of mountings"
    kind: ClassVar[str] = "mountings"
    make: ClassVar[str] = "run palpate measure modulus with three mountings or more"

    model_config = ConfigDict(strict=True)

    means_u: Positive
    degrees_of_freedom: Annotated[int, Field(ge=1)]
    sets_u: NotNegative
    sets_freedom: Annotated[int, Field(ge=1)]
    design: Name

    @property
    def of(self) -> tuple[str, ...]:
        return (self.design,)

    @property
    def found(self) -> Between:
        """What is known of the scatter beyond that of sets."""
        return Between(self.means_u, self.degrees_of_freedom, self.sets_u, self.sets_freedom)
