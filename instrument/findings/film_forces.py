"""Forces and force ratio, with uncertainty, from the fitted sines of films of any design, and their mean over sets."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.signals.estimate import SineFit, quotient_bias
from palpate.instrument.uncertainty.budget import Budget, Component, coverage_factor

# --- forces --------------------------------------------------------------------------------------------


LEAST_SIGNAL = 3.0
"""Least signal of a base film, in standard uncertainties by noise: a smaller one is no denominator."""


@dataclass(frozen=True, slots=True)
class ToothPoint:
    """One tooth under a load. Voltages and forces are peak to peak.

    Attributes:
        tooth: number of the tooth, from 1.
        voltage_V, force_N: voltage of the tooth's own film, and the force on it.
        base_voltage_V, base_force_N: the same of the film under its base, which other teeth may share.
        force_ratio: force on the tooth over force on its base, so that the ratios of one base add up.
        force_ratio_u: standard uncertainty of the ratio, with the scatter of both films' gains, their calibration and
            their cables' pick-up.
        noise_u: part of that uncertainty that comes from noise.
        force_u, base_force_u: standard uncertainties of the forces, with the scatter of the film's gain, its
            calibration and its pick-up; None: the record was written before palpate computed them.
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
        force_ratio: for each base the force on its teeth over the force on the base, and of these the mean over the
            bases, as in Tables 5.7 and A2.9 to A2.20.
        force_ratio_u: standard uncertainty of the ratio, with the scatter of the gains, noise, the films' calibration
            and pick-up.
        noise_u, calibration_u, pickup_u: parts of it that come from noise, the films' calibration and the cables'
            pick-up.
        degrees_of_freedom: degrees of freedom of `noise_u` and `force_total_noise_u`.
        force_rigid_u, force_total_u: standard uncertainties of the sums, with noise, scatter, calibration and pick-up
            and their correlations.
        force_total_noise_u: part of `force_total_u` that comes from noise.
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
    """Forces by the films' sensitivities, and the force ratios of teeth and sensor, with the bias by noise subtracted.

    Args:
        design: the sensor.
        fit: fit of all films, in the design's order.

    Raises:
        EstimateError: a base film's amplitude is below three of its standard uncertainties.
    """
    films = design.films
    for i in _bases(design):
        if not fit.amplitude[i] > LEAST_SIGNAL * fit.amplitude_u[i]:
            raise EstimateError(
                f"film {films[i].name!r} on channel {films[i].channel} gives {show(float(fit.amplitude[i]), 'V')} with "
                f"standard uncertainty {show(float(fit.amplitude_u[i]), 'V')}, too little for a ratio; check its "
                "connection"
            )
    sums, teeth = _forces(design, fit)
    return FilmForces(
        **{name: float(value) for name, value in sums.items()},
        teeth=tuple(
            ToothPoint(tooth=tooth, **{name: float(value) for name, value in of.items()}) for tooth, of in teeth.items()
        ),
    )


def stacked_forces(design: Design, fits: SineFit) -> tuple[dict[str, Floats], npt.NDArray[np.bool_]]:
    """What `film_forces` gives for each record of a stack, to the last bit: its numbers by name, each (records,).

    Teeth are left out. The second array tells for which records there are forces; for the others `film_forces` raises.
    """
    bases = _bases(design)
    sound = np.asarray((fits.amplitude[:, bases] > LEAST_SIGNAL * fits.amplitude_u[:, bases]).all(axis=1))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return _forces(design, fits)[0], sound


def _bases(design: Design) -> list[int]:
    return [i for i, film in enumerate(design.films) if film.kind == FILM_KINDS[1]]


def _forces(design: Design, fit: SineFit) -> tuple[dict[str, Floats], dict[int, dict[str, Floats]]]:
    """The numbers of `FilmForces`, and those of `ToothPoint` by the tooth's number, of a record or of a stack of them.

    A square is written as a product: numpy rounds the power of one number and of an array in different ways.
    """
    films = design.films
    gains = np.array([film.sensitivity for film in films])
    voltage = 2 * fit.unbiased
    force = voltage / gains
    force_u = 2 * fit.amplitude_u / gains
    covariance = fit.amplitude_correlation * _outer(force_u)
    bases = _bases(design)
    calibrated = np.zeros((len(films), len(films))) if design.film_covariance is None else design.film_covariance
    force_covariance = np.asarray(calibrated) * _outer(force)
    on_bases = np.take(force, bases, axis=-1).sum(axis=-1)
    share = pickup_u(design)
    pickup_covariance = (share * share * (on_bases * on_bases))[..., np.newaxis, np.newaxis] * np.eye(len(films))
    scatter_covariance = np.asarray(design.scatter_covariance) * _outer(force)
    parts = (covariance, scatter_covariance, force_covariance, pickup_covariance)
    whole_covariance: Floats = np.sum(parts, axis=0)
    each_u = np.sqrt(np.diagonal(whole_covariance, axis1=-2, axis2=-1))
    slopes = np.zeros_like(force)
    teeth = {}
    for rigid, film in enumerate(films):
        if film.kind != FILM_KINDS[0]:
            continue
        base = next(i for i in bases if film.teeth[0] in films[i].teeth)
        on_tooth, on_base = force[..., rigid], force[..., base]
        slope = np.zeros_like(force)
        slope[..., rigid] = 1 / on_base
        slope[..., base] = -on_tooth / (on_base * on_base)
        slopes += slope / len(bases)
        ratio = on_tooth / on_base
        ratio = ratio - quotient_bias(ratio, on_base, covariance[..., base, base], covariance[..., rigid, base])
        by_part = [_u(slope, part) for part in parts]
        teeth[film.teeth[0] + 1] = {
            "voltage_V": voltage[..., rigid],
            "force_N": on_tooth,
            "base_voltage_V": voltage[..., base],
            "base_force_N": on_base,
            "force_ratio": ratio,
            "force_ratio_u": _each(math.hypot, by_part),
            "noise_u": by_part[0],
            "force_u": each_u[..., rigid],
            "base_force_u": each_u[..., base],
        }
    rigids = [i for i in range(len(films)) if i not in bases]
    of_rigid = np.array([float(i in rigids) for i in range(len(films))])
    by_part = [_u(slopes, part) for part in parts]
    sums = {
        "voltage_rigid_V": np.take(voltage, rigids, axis=-1).sum(axis=-1),
        "voltage_total_V": np.take(voltage, bases, axis=-1).sum(axis=-1),
        "force_rigid_N": np.take(force, rigids, axis=-1).sum(axis=-1),
        "force_total_N": on_bases,
        "force_ratio": _each(_sum, [tooth["force_ratio"] for tooth in teeth.values()]) / len(bases),
        "force_ratio_u": _each(math.hypot, by_part),
        "noise_u": by_part[0],
        "calibration_u": by_part[2],
        "pickup_u": by_part[3],
        "degrees_of_freedom": np.asarray(fit.degrees_of_freedom),
        "force_rigid_u": _u(of_rigid, whole_covariance),
        "force_total_u": _u(1 - of_rigid, whole_covariance),
        "force_total_noise_u": _u(1 - of_rigid, covariance),
    }
    return sums, teeth


def _outer(values: Floats) -> Floats:
    return values[..., :, np.newaxis] * values[..., np.newaxis, :]


def _sum(*values: float) -> float:
    return math.fsum(values)


def _each(combine: Callable[..., float], parts: Sequence[Floats]) -> Floats:
    """A function of Python's floats, of which numpy has none that rounds alike, for each record."""
    together = np.stack(parts, axis=-1)
    rows = together.reshape(-1, len(parts)).tolist()
    return np.array([combine(*row) for row in rows]).reshape(together.shape[:-1])


def calibration_u(design: Design) -> float:
    """Relative standard uncertainty of the ratio by the films' calibration, where all teeth bear alike."""
    if design.film_covariance is None:
        return 0.0
    return float(_u(np.array(design.ratio_slopes), np.asarray(design.film_covariance)))


def pickup_u(design: Design) -> float:
    """Standard uncertainty of each film's force by its cable's pick-up, as a share of the load on the sensor.

    A bound of the pick-up is known, its phase against the load is not. So its component in phase with the load has the
    arc sine distribution (JCGM 101, 6.4.6). Each film has a cable of its own.
    """
    return (design.pickup or 0.0) / math.sqrt(2)


def _u(slope: Floats, covariance: Floats) -> Floats:
    variance = ((slope[..., np.newaxis, :] @ covariance) @ slope[..., :, np.newaxis])[..., 0, 0]
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


# --- mean ratio over load sets -------------------------------------------------------------------------

# The gains scatter anew with each load set, and noise is new in each dwell: both average out. How much the gains
# scatter is the design's statement, which comes from few sets itself. The films' calibration and their cables' pick-up
# are the same in all points and do not average out.


SCATTER, NOISE, CALIBRATION, PICKUP = "gain scatter", "noise", "films' calibration", "pick-up in step with the load"
PRIOR_FREEDOM = 7.0  # degrees of freedom of a design's `ratio_scatter`: the thesis' 30 are worth no more


class RatioPoint(Protocol):
    """One point of a run, as the procedures record it. `degrees_of_freedom` of its noise; None: infinitely many."""

    @property
    def force_ratio(self) -> float: ...
    @property
    def force_ratio_u(self) -> float: ...
    @property
    def noise_u(self) -> float: ...
    @property
    def calibration_u(self) -> float: ...
    @property
    def pickup_u(self) -> float: ...
    @property
    def degrees_of_freedom(self) -> float | None: ...


def mean_ratio(quantity: str, points: Sequence[RatioPoint], film_freedom: float | None) -> Budget:
    """Budget of the mean ratio of one point or more.

    Args:
        quantity: name of the result, for people.
        points: the points.
        film_freedom: degrees of freedom of the films' calibration; None: infinitely many.
    """
    n = len(points)
    shared = [(p.noise_u, p.calibration_u, p.pickup_u) for p in points]
    scatter = math.fsum(
        max(p.force_ratio_u**2 - math.hypot(*parts) ** 2, 0.0) for p, parts in zip(points, shared, strict=True)
    )
    noise = math.fsum(p.noise_u**2 for p in points)
    # Welch and Satterthwaite: each point estimated its noise by itself.
    spent = math.fsum(p.noise_u**4 / (p.degrees_of_freedom or math.inf) for p in points)
    freedom = noise**2 / spent if spent > 0 else math.inf
    components = [
        Component(SCATTER, math.sqrt(scatter) / n, degrees_of_freedom=PRIOR_FREEDOM),
        Component(NOISE, math.sqrt(noise) / n, degrees_of_freedom=freedom, kind="A"),
        Component(
            CALIBRATION,
            math.fsum(p.calibration_u for p in points) / n,
            degrees_of_freedom=film_freedom or math.inf,
        ),
        Component(PICKUP, math.fsum(p.pickup_u for p in points) / n),
    ]
    ratio = math.fsum(p.force_ratio for p in points) / n
    return Budget(quantity, ratio, "", tuple(c for c in components if c.u > 0 or c.name != PICKUP))


def apart(one: Budget, other: Budget) -> bool:
    """Whether two means differ by more than their uncertainties explain, at 95 %.

    Calibration and pick-up are nearly the same in both means. They are counted as if they were independent, which makes
    a difference harder to prove.
    """
    least = min(one.degrees_of_freedom, other.degrees_of_freedom)
    return abs(one.value - other.value) >= coverage_factor(least) * math.hypot(one.u, other.u)
