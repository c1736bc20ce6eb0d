"""What a least-squares sine finds in other frequencies than its own, and in what is left of transients.

The worst phase of the drive counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from instrument.errors import EstimateError
from instrument.estimate import fit_sine
from simulators.effects.effect import Case, Floats
from simulators.linear.lti import StateSpace
from simulators.linear.periodic import HERTZ

if TYPE_CHECKING:
    from simulators.rig import Rig

Complexes = npt.NDArray[np.complex128]
# Above this condition number the weights of modes say nothing about their sum.
PARALLEL = 1e8


def fitted(case: Case, frequency: float) -> tuple[float, float]:
    """Least and greatest amplitude that a fit of the case's frequency finds in a unit sine of another [Hz]."""
    angle = 2 * np.pi * frequency * _times(case)
    amplitude, phase = _fit(case, [np.cos(angle), np.sin(angle)])
    if not np.isfinite(amplitude).all():
        return 0.0, math.inf
    most, least = np.linalg.svd(amplitude * np.array([np.cos(phase), np.sin(phase)]), compute_uv=False)
    return float(least), float(most)


def _times(case: Case) -> Floats:
    return np.arange(max(1, round(case.dwell * case.rate))) / case.rate


def left_over(case: Case, rig: Rig) -> Floats:
    """What a fit can find of the transients in each film [V]."""
    system, state, forcing = rig.beginning()
    omega = 2 * np.pi * rig.coil_voltage().frequency / HERTZ
    weights, rates = transient(system, system.b[:, 1], state, forcing, omega)
    return np.asarray(weights[: len(case.design.films)] @ leaks(case, rates))


def transient(
    system: StateSpace, constant: Floats, state: Floats, forcing: Complexes | None = None, omega: float = 0.0
) -> tuple[Floats, Complexes]:
    """Greatest weights (p, s) of the modes in the outputs, for a drive of any phase, and the modes' rates (s,)."""
    rates, shapes = np.linalg.eig(system.a)
    rates = rates.astype(complex)
    if len(rates) and np.linalg.cond(shapes) > PARALLEL:
        return np.full((len(system.c), len(rates)), np.inf), rates
    inverse = np.linalg.inv(shapes)
    moving = rates != 0
    mean = np.where(moving, -(inverse @ constant) / np.where(moving, rates, 1.0), 0.0)
    gap = abs(inverse @ state - mean)
    if forcing is not None:
        gap = gap + abs(inverse @ forcing / (1j * omega - rates))
    return abs(system.c @ shapes) * gap, rates


def leaks(case: Case, rates: Complexes) -> Floats:
    """Greatest amplitude that a fit finds in exp(rate t), of unit size when the drive begins, (s,)."""
    time = _times(case)
    leaks = np.zeros(len(rates))
    for k, rate in enumerate(rates):
        if rate != 0:
            wave = np.exp(rate * time)  # of unit size in the dwell: the fit makes no squares of next to nothing
            leaks[k] = np.linalg.norm(_fit(case, [wave.real, wave.imag])[0]) * np.exp(rate.real * case.settled)
    return leaks


def _fit(case: Case, waves: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Amplitudes and phases; infinite amplitudes where the dwell does not determine a sine."""
    try:
        fit = fit_sine(_times(case), waves, case.frequency)
    except EstimateError:
        return np.full(len(waves), np.inf), np.zeros(len(waves))
    return fit.amplitude, fit.phase
