"""Settled state of a scene under a sine: phasors of its films and of its force, without following the motion.

Linear parts give them at once. A play operator outside any loop, under a sine of its force, gives a known fundamental:
its describing function times the force. Plays act on the films alone, so they are never in a loop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.instrument.sensor.design import FILM_KINDS
from palpate.simulators.linear.lti import Complexes
from palpate.simulators.linear.periodic import HERTZ, SECOND
from palpate.simulators.rig.rig import Rig

POINTS = 4096  # samples in a period of a scene that is followed
SETTLED = 10.0  # s after the drive was set, for such a scene


@dataclass(frozen=True, slots=True)
class FilmState:
    """Fundamental of one film.

    Attributes:
        amplitude: amplitude [V].
        phase: phase against the force on the load cell [rad].
        ratio: force ratio of a film under teeth to the film under their base; None: it is no such film.
    """

    film: str
    amplitude: float
    phase: float
    ratio: float | None


@dataclass(frozen=True, slots=True)
class SteadyState:
    """Fundamentals of a settled scene; `force` on the load cell, peak to peak [N]."""

    force: float
    films: tuple[FilmState, ...]


def describing_function(radius: float, amplitude: float) -> complex:
    """Fundamental of a play operator over the sine that moves it; 0 where the sine is too small to move it.

    Gelb and Vander Velde, Multiple-input describing functions (1968): backlash.
    """
    if amplitude <= radius:
        return 0j
    m = 1 - 2 * radius / amplitude
    root = math.sqrt(max(1 - m * m, 0.0))
    return complex(math.pi / 2 + math.asin(m) + m * root, -root * root) / math.pi


def phasors(rig: Rig) -> Complexes:
    """Phasors (films + 1,) of the films' voltages [V] and the force on the load cell [N], where no limit acts."""
    system, plays = rig.without_limits()
    voltage = rig.coil_voltage()
    rate = 2j * math.pi * voltage.frequency / HERTZ
    volts = voltage.amplitude[0]
    a, push = system.a.astype(complex), (system.b[:, 0] + rate * system.b[:, 2]) * volts
    if plays:
        # So far each play follows its force, as if it had no radius.
        force = np.linalg.solve(rate * np.eye(system.order) - a, push)[plays]
        radii = rig.effects.plays.plays().radii if rig.effects.plays else ()
        factors = np.array([describing_function(r, abs(x)) for r, x in zip(radii, force, strict=True)])
        a[plays] *= factors[:, np.newaxis]
        push[plays] *= factors
    state = np.linalg.solve(rate * np.eye(system.order) - a, push)
    return np.asarray(system.c @ state + (system.d[:, 0] + rate * system.d[:, 2]) * volts)


def followed(rig: Rig) -> Complexes:
    """Phasors (films + 1,) where limits act, by a Fourier sum over a period that is followed by its transitions."""
    voltage = rig.coil_voltage()
    period = SECOND * HERTZ / voltage.frequency
    times = round(SETTLED * SECOND) + np.round(period * np.arange(POINTS) / POINTS).astype(np.int64)
    seen = np.vstack([rig.film_voltages(times), rig.cell_force(times)])
    turns = np.exp(-2j * math.pi * 1e-18 * voltage.phase(times))
    return np.asarray(2 * (seen * turns).mean(axis=1))


def steady_state(rig: Rig, values: Complexes) -> SteadyState:
    """The settled state from phasors of films and force."""
    films, force = rig.scene.design.films, values[-1]
    # If a film lies under several teeth, this is the ratio of one tooth.
    shares = [abs(v) / film.sensitivity / len(film.teeth) for v, film in zip(values[:-1], films, strict=True)]
    tooth, base = FILM_KINDS
    states = []
    for film, value, share in zip(films, values[:-1], shares, strict=True):
        under = (s for s, f in zip(shares, films, strict=True) if f.kind == base and set(film.teeth) <= set(f.teeth))
        below = next(under, 0.0) if film.kind == tooth else 0.0
        ratio = float(share / below) if below else None
        states.append(FilmState(film.name, float(abs(value)), float(np.angle(value / force)), ratio))
    return SteadyState(float(2 * abs(force)), tuple(states))
