"""Phase of one film over another, and fits to gains over frequency: a charge amplifier's corner, and a resonance."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError
from palpate.instrument.signals.estimate import SineFit

TACTILE = 20.0
"""Frequency [Hz] below which touch takes place (thesis 5.1)."""
DETERMINED = 3.0
"""A fitted frequency that is fewer of its standard uncertainties above zero is not determined."""


@dataclass(frozen=True, slots=True)
class Corner:
    """A first-order high-pass, gain·f/√(f² + corner²): its gain far above the corner, and its corner in Hz."""

    gain: float
    gain_u: float
    corner_Hz: float
    corner_u: float

    @property
    def time_constant(self) -> float:
        """Time constant of the high-pass [s]."""
        return 1 / (2 * math.pi * self.corner_Hz)


@dataclass(frozen=True, slots=True)
class Resonance:
    """A mass on a spring: its undamped frequency in Hz, and its damping ratio."""

    frequency_Hz: float
    frequency_u: float
    damping: float
    damping_u: float


def phase_lead(fit: SineFit, film: int, reference: int) -> tuple[float, float]:
    """Phase lead of a film over another one, −π to π, and its standard uncertainty by noise and hum [rad].

    u² = u₁² + u₂² − 2 r u₁u₂, where u is noise across the drive over its amplitude, and r is the correlation of the two
    phases: noise that both films share turns both by the same angle where their amplitudes are the same.

    Args:
        fit: fit of both films together.
        film, reference: numbers of the two.

    Returns: the lead, and its uncertainty, which is infinite where an amplitude is zero.
    """
    lead = math.remainder(float(fit.phase[film] - fit.phase[reference]), 2 * math.pi)
    one, other = float(fit.phase_u[film]), float(fit.phase_u[reference])
    if math.isinf(one) or math.isinf(other):
        return lead, math.inf
    common = float(fit.phase_correlation[film, reference]) * one * other
    return lead, math.sqrt(max(one**2 + other**2 - 2 * common, 0.0))


def fit_corner(frequency: npt.ArrayLike, gain: npt.ArrayLike, gain_u: npt.ArrayLike) -> Corner | None:
    """Fit a high-pass to gains with their standard uncertainties. None: they show no corner.

    Args:
        frequency: (n,) Hz, three or more.
        gain, gain_u: (n,), gains and their standard uncertainties, in any unit.

    Raises:
        EstimateError: fewer than three frequencies.
    """
    f, y, u = _checked(frequency, gain, gain_u)
    found = _fit(high_pass, f, y, u, (math.log(float(y.max())), 0.5 * float(f.min())))
    if found is None:
        return None
    (level, corner), (level_u, corner_u) = found
    corner = abs(corner)
    if not corner > DETERMINED * corner_u:
        return None
    return Corner(math.exp(level), math.exp(level) * level_u, corner, corner_u)


def fit_resonance(frequency: npt.ArrayLike, response: npt.ArrayLike, response_u: npt.ArrayLike) -> Resonance | None:
    """Fit the resonance of a response to a force. None: no resonance lies within the sweep.

    Args:
        frequency: (n,) Hz, four or more.
        response, response_u: (n,), responses and their standard uncertainties, in any unit.

    Raises:
        EstimateError: fewer than four frequencies.
    """
    f, y, u = _checked(frequency, response, response_u, least=4)
    start = (math.log(float(y[0])), float(f[int(y.argmax())]), 0.3)
    found = _fit(mass_on_spring, f, y, u, start)
    if found is None:
        return None
    (_, natural, damping), (_, natural_u, damping_u) = found
    natural, damping = abs(natural), abs(damping)
    if not (f.min() < natural < f.max() and natural > DETERMINED * natural_u):
        return None
    return Resonance(natural, natural_u, damping, damping_u)


def high_pass(frequency: Floats, level: float, corner: float) -> Floats:
    """Logarithm of the gain of a high-pass with a corner [Hz]; `level` is its value far above the corner."""
    value: Floats = level - 0.5 * np.log1p((corner / frequency) ** 2)
    return value


def mass_on_spring(frequency: Floats, level: float, natural: float, damping: float) -> Floats:
    """Logarithm of the response of a mass on a spring to a force; `level` is its value far below resonance."""
    r = frequency / natural
    value: Floats = level - 0.5 * np.log((1 - r**2) ** 2 + (2 * damping * r) ** 2)
    return value


def _checked(
    frequency: npt.ArrayLike, value: npt.ArrayLike, value_u: npt.ArrayLike, least: int = 3
) -> tuple[Floats, Floats, Floats]:
    f, y, u = (np.asarray(each, dtype=np.float64) for each in (frequency, value, value_u))
    if np.unique(f).size < least:
        raise EstimateError(f"{np.unique(f).size} frequencies do not determine it; sweep {least} or more")
    return f, y, u


def _fit(
    model: Callable[..., Floats], f: Floats, y: Floats, u: Floats, start: tuple[float, ...]
) -> tuple[Floats, Floats] | None:
    """Parameters and their standard uncertainties by least squares in the logarithm, which weights relative errors."""
    from scipy.optimize import least_squares

    def residual(parameters: Floats) -> Floats:
        off: Floats = (model(f, *parameters) - np.log(y)) * y / u
        return off

    solution = least_squares(residual, start, method="lm", x_scale="jac")
    if not (solution.success and np.isfinite(solution.x).all()):
        return None
    try:
        upper = np.linalg.qr(np.asarray(solution.jac), mode="r")
        spread = np.linalg.norm(np.linalg.inv(upper), axis=1)
    except np.linalg.LinAlgError:
        return None
    return solution.x, spread
