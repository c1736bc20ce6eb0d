"""From the films' sines to forces and force ratio, with uncertainty, for any design."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.instrument.errors import EstimateError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import FILM_KINDS, Design, Film
from palpate.instrument.signals.estimate import SineFit, quotient_bias

Floats = npt.NDArray[np.float64]
LEAST_SIGNAL = 3.0
"""Standard uncertainties of noise that a base film's signal needs to be a denominator."""


@dataclass(frozen=True, slots=True)
class ToothPoint:
    """One tooth under a load. Voltages and forces are peak to peak.

    Attributes:
        tooth: number, from 1.
        voltage_V, force_N: of its own film.
        base_voltage_V, base_force_N: of the film under its base, which other teeth may share.
        force_ratio: of its force to the base's, so that those of one base add up; `force_ratio_u` with the scatter
            of both films' gains, their calibration and their cables' pick-up.
        noise_u: what noise has in it.
        force_u, base_force_u: of the forces, with the scatter of the film's gain, its calibration and its pick-up;
            None: a record of before they were known.
    """

    tooth: int
    voltage_V: float
    force_N: float
    base_voltage_V: float
    base_force_N: float
    force_ratio: float
    force_ratio_u: float
    noise_u: float
    force_u: float | None = None
    base_force_u: float | None = None


@dataclass(frozen=True, slots=True)
class FilmForces:
    """A whole sensor under a load: sums over teeth and bases, peak to peak.

    Attributes:
        force_ratio: mean over the bases of the force on a base's teeth to the force on the base, as in Tables 5.7 and
            A2.9 to A2.20; `force_ratio_u` with the scatter of the gains and the films' calibration.
        noise_u, calibration_u, pickup_u: what noise, the films' calibration and the cables' pick-up have in it.
        degrees_of_freedom: of `noise_u`, and of `force_total_noise_u`.
        force_rigid_u, force_total_u: of the sums, with noise, scatter, calibration and pick-up, all as they hang
            together; `force_total_noise_u` is what noise has in it.
    """

    voltage_rigid_V: float
    voltage_total_V: float
    force_rigid_N: float
    force_total_N: float
    force_ratio: float
    force_ratio_u: float
    noise_u: float
    calibration_u: float
    pickup_u: float
    degrees_of_freedom: float
    force_rigid_u: float
    force_total_u: float
    force_total_noise_u: float
    teeth: tuple[ToothPoint, ...]


def film_forces(design: Design, fit: SineFit) -> FilmForces:
    """Forces by the films' sensitivities, and the ratios of teeth and sensor, free of the bias that noise gives them.

    Args:
        fit: of all films, in the design's order.

    Raises:
        EstimateError: a base film's amplitude is below three of its standard uncertainties.
    """
    films = design.films
    gains = np.array([film.sensitivity for film in films])
    voltage = 2 * fit.unbiased
    force = voltage / gains
    force_u = 2 * fit.amplitude_u / gains
    covariance = fit.amplitude_correlation * np.outer(force_u, force_u)
    bases = [i for i, film in enumerate(films) if film.kind == FILM_KINDS[1]]
    for i in bases:
        if not fit.amplitude[i] > LEAST_SIGNAL * fit.amplitude_u[i]:
            raise EstimateError(
                f"film {films[i].name!r} on channel {films[i].channel} gives {show(float(fit.amplitude[i]), 'V')} with "
                f"standard uncertainty {show(float(fit.amplitude_u[i]), 'V')}, too little for a ratio; check its "
                "connection"
            )
    calibrated = np.zeros((len(films), len(films))) if design.film_covariance is None else design.film_covariance
    force_covariance = np.asarray(calibrated) * np.outer(force, force)
    pickup_covariance = pickup_u(design) ** 2 * float(force[bases].sum()) ** 2 * np.eye(len(films))
    whole_covariance = covariance + force_covariance + pickup_covariance
    whole_covariance += scatter_covariance(design) * np.outer(force, force)
    each_u = np.sqrt(np.diag(whole_covariance))
    slopes = np.zeros(len(films))
    teeth = []
    for rigid, film in enumerate(films):
        if film.kind != FILM_KINDS[0]:
            continue
        base = next(i for i in bases if film.teeth[0] in films[i].teeth)
        slope = np.zeros(len(films))
        slope[rigid] = 1 / force[base]
        slope[base] = -force[rigid] / force[base] ** 2
        slopes += slope / len(bases)
        ratio, noise_u = float(force[rigid] / force[base]), _u(slope, covariance)
        ratio -= quotient_bias(ratio, float(force[base]), float(covariance[base, base]), float(covariance[rigid, base]))
        teeth.append(
            ToothPoint(
                tooth=film.teeth[0] + 1,
                voltage_V=float(voltage[rigid]),
                force_N=float(force[rigid]),
                base_voltage_V=float(voltage[base]),
                base_force_N=float(force[base]),
                force_ratio=ratio,
                force_ratio_u=math.hypot(
                    noise_u,
                    ratio * ratio_scatter(design, film, films[base]),
                    _u(slope, force_covariance),
                    _u(slope, pickup_covariance),
                ),
                noise_u=noise_u,
                force_u=float(each_u[rigid]),
                base_force_u=float(each_u[base]),
            )
        )
    rigids = [i for i in range(len(films)) if i not in bases]
    of_rigid = np.array([float(i in rigids) for i in range(len(films))])
    ratio = math.fsum(tooth.force_ratio for tooth in teeth) / len(bases)
    noise_u, calibration_u, by_pickup = (_u(slopes, each) for each in (covariance, force_covariance, pickup_covariance))
    return FilmForces(
        voltage_rigid_V=float(voltage[rigids].sum()),
        voltage_total_V=float(voltage[bases].sum()),
        force_rigid_N=float(force[rigids].sum()),
        force_total_N=float(force[bases].sum()),
        force_ratio=ratio,
        force_ratio_u=math.hypot(noise_u, design.ratio_scatter * ratio, calibration_u, by_pickup),
        noise_u=noise_u,
        calibration_u=calibration_u,
        pickup_u=by_pickup,
        degrees_of_freedom=fit.degrees_of_freedom,
        force_rigid_u=_u(of_rigid, whole_covariance),
        force_total_u=_u(1 - of_rigid, whole_covariance),
        force_total_noise_u=_u(1 - of_rigid, covariance),
        teeth=tuple(teeth),
    )


def pickup_u(design: Design) -> float:
    """Standard uncertainty of each film's force by its cable's pick-up, as a share of the load on the sensor.

    It is known not to exceed a bound, and its phase against the load is not known: what of it lies along the load has
    the arc sine distribution (JCGM 101, 6.4.6). Each film has a cable of its own.
    """
    return (design.pickup or 0.0) / math.sqrt(2)


def ratio_scatter(design: Design, film: Film, base: Film) -> float:
    """Relative standard deviation from one load set to the next of the ratio of two films' forces, to first order."""
    common = 2 * design.film_correlation * film.scatter * base.scatter
    return math.sqrt(max(film.scatter**2 + base.scatter**2 - common, 0.0))


def scatter_covariance(design: Design) -> Floats:
    """Relative, (films, films), of the scatter from one load set to the next: the correlation of a tooth's film and its
    base's is taken for that of any two."""
    scatter = np.array([film.scatter for film in design.films])
    correlation = np.full((scatter.size, scatter.size), design.film_correlation)
    np.fill_diagonal(correlation, 1.0)
    covariance: Floats = correlation * np.outer(scatter, scatter)
    return covariance


def _u(slope: Floats, covariance: Floats) -> float:
    return math.sqrt(max(float(slope @ covariance @ slope), 0.0))
