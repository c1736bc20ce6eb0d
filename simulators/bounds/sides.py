"""One side of a comparison: the films of a scene over a dwell, followed by a rig, without random parts."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.instrument.sensor.design import Film
from palpate.simulators.bounds.fits import SIGMAS, fitted
from palpate.simulators.linear.lti import Complexes
from palpate.simulators.physics.dwells import Dwell
from palpate.simulators.physics.effect import Case, Floats, Rates
from palpate.simulators.physics.in_order import Effects
from palpate.simulators.physics.stages import LeakEffect


@dataclass(frozen=True, eq=False)
class Side:
    """A scene at the moment of the dwell.

    Attributes:
        linear: whether phases between those that were followed are superpositions.
        volts: (phases, films, n), voltages at unit gains [V].
        passed, added: (phases, films), phasors of the part that passes the scattering gains, and of the part behind
            them.
        scatter: (films,), greatest relative change of each film's gain.
    """

    effects: Effects
    dwell: Dwell
    linear: bool
    volts: Floats
    passed: Complexes
    added: Complexes
    scatter: Floats

    @functools.cached_property
    def _rates(self) -> Floats:
        return self.dwell.rates(self.linear)

    def rates(self, film: int) -> Rates:
        """Rates (phases, n) [V/s] of a film with its greatest gain."""
        return lambda: np.asarray((1 + self.scatter[film]) * self._rates[:, film])


def sides(case: Case, without: Effects, with_it: Effects, moment: float) -> tuple[Side, Side]:
    """The scene without and with an effect. A leak is held at its value at a moment [s]."""
    followed = [certain(effects, moment) for effects in (without, with_it)]
    linear = all(case.follow(each).linear for each in followed)
    before, after = (_side(case, *each, moment, linear) for each in zip((without, with_it), followed, strict=True))
    return before, after


def _side(case: Case, effects: Effects, followed: Effects, moment: float, linear: bool) -> Side:
    dwell, leak = case.follow(followed), effects.leak
    volts = dwell.volts(linear)
    if leak is not None:
        volts = volts + _creeping(case, effects, leak, moment, volts)
    seen = fitted(case, volts)
    if effects.scattering is None:
        return Side(effects, dwell, linear, volts, seen, np.zeros_like(seen), np.zeros(len(case.design.films)))
    passed = fitted(case, case.follow(followed.but(*followed.source)).volts(linear))
    return Side(effects, dwell, linear, volts, passed, seen - passed, reach(case, effects))


def certain(effects: Effects, moment: float) -> Effects:
    """The effects that a rig follows at a moment [s]."""
    found, leak = deterministic(effects), effects.leak
    return found if leak is None else found.including(leak.held(leak.conductance(leak.middle(moment))))


def reach(case: Case, effects: Effects) -> Floats:
    """Greatest relative change (films,) of each film's gain by scatter."""
    scatter = effects.scattering.scatter if effects.scattering else None
    return np.array([SIGMAS * (scatter or 0.0) * film.scatter for film in case.design.films])


def moments(case: Case, effects: Effects) -> Iterator[float]:
    """Moments at which a scene is examined [s]; a leak may change time constants before the dwell."""
    last = case.settled + case.dwell
    yield last
    leak, amplifier = effects.leak, effects.amplifier
    if leak is not None and amplifier is not None:
        conductances = [leak.conductance(leak.middle(time)) for time in (0.0, last)]
        film = case.design.films[0]
        then, now = (amplifier.system(film, case.design, conductance).a for conductance in conductances)
        if not np.array_equal(then, now):
            yield 0.0


def _creeping(case: Case, effects: Effects, leak: LeakEffect, moment: float, volts: Floats) -> Floats:
    """Voltages (phases, films, n) that a leak which changes within the dwell adds to those with a held leak [V]."""
    amplifier = effects.amplifier
    if amplifier is None:
        return np.zeros_like(volts)
    times = case.settled + np.arange(volts.shape[-1]) / case.rate
    epochs, which = np.unique([leak.middle(time) for time in [moment, *times]], return_inverse=True)
    conductances = [leak.conductance(epoch) for epoch in epochs]

    def offset(film: Film, conductance: float) -> float:
        return amplifier.offset(film, case.design, conductance)

    def decay(film: Film, conductance: float) -> float:
        return -float(amplifier.system(film, case.design, conductance).a[0, 0])

    offsets, decays = (
        np.array([[of(film, conductance) for conductance in conductances] for film in case.design.films])[:, which]
        for of in (offset, decay)
    )
    slower = _between(volts, decays[:, 1:], decays[:, :1], 1 / case.rate)
    return np.asarray(slower + offsets[:, 1:] - offsets[:, :1])


def _between(volts: Floats, decays: Floats, held: Floats, step: float) -> Floats:
    """Difference d of the solution of y' = u' - decays y from `volts`, which solve y' = u' - held y.

    It solves d' = -decays d - (decays - held) y.
    """
    found = np.zeros_like(volts)
    if np.array_equal(decays, np.broadcast_to(held, decays.shape)):
        return found
    middle = (decays[:, 1:] + decays[:, :-1]) / 2
    left = np.exp(-middle * step)
    push = (held - middle) * -np.expm1(-middle * step) / middle * (volts[..., 1:] + volts[..., :-1]) / 2
    for k in range(volts.shape[-1] - 1):
        found[..., k + 1] = left[:, k] * found[..., k] + push[..., k]
    return found


def deterministic(effects: Effects) -> Effects:
    """The effects that a rig follows without drawing random numbers."""
    return effects.but(*effects.input, effects.scattering, effects.converter)
