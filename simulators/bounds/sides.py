"""One side of a comparison: the films of a scene over a dwell, followed by a rig, without random parts."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from palpate.simulators.bounds.creeping import ERROR, crept, held, offsets
from palpate.simulators.bounds.fits import SIGMAS, fitted, weights
from palpate.simulators.linear.lti import Complexes
from palpate.simulators.physics.dwells import SimulatedDwell
from palpate.simulators.physics.effect import Case, Floats, Rates
from palpate.simulators.physics.in_order import Effects


@dataclass(frozen=True, eq=False)
class Side:
    """A scene at the moment of the dwell.

    Attributes:
        linear: whether phases between those that were followed are superpositions.
        volts: (phases, films, n), voltages at unit gains [V].
        all_rates: gives their rates [V/s].
        uncertain: (films,), by which voltages may be wrong through round-off and interpolation [V].
        passed, added: (phases, films), phasors of the part that passes the scattering gains, and of the part behind
            them.
        scatter: (films,), greatest relative change of each film's gain.
    """

    effects: Effects
    dwell: SimulatedDwell
    linear: bool
    volts: Floats
    all_rates: Rates
    uncertain: Floats
    passed: Complexes
    added: Complexes
    scatter: Floats

    @functools.cached_property
    def _rates(self) -> Floats:
        return self.all_rates()

    def rates(self, film: int) -> Rates:
        """Rates (phases, n) [V/s] of a film with its greatest gain."""
        return lambda: np.asarray((1 + self.scatter[film]) * self._rates[:, film])


def sides(case: Case, without: Effects, with_it: Effects) -> tuple[Side, Side]:
    """The scene without and with an effect. Raises EstimateError: the dwell does not determine a sine."""
    weights(case)
    followed = [certain(case, effects) for effects in (without, with_it)]
    linear = all(case.follow(each).linear for each in followed)
    before, after = (_side(case, *each, linear) for each in zip((without, with_it), followed, strict=True))
    return before, after


def _side(case: Case, effects: Effects, followed: Effects, linear: bool) -> Side:
    dwell = case.follow(followed)
    volts, rates, uncertain = _signals(case, effects, dwell, linear)
    volts = volts + offsets(case, effects, dwell)
    passed, scatter = fitted(case, volts), np.zeros(len(case.design.films))
    added = np.zeros_like(passed)
    if effects.scattering is not None:
        seen, scatter = passed, reach(case, effects)
        passed = fitted(case, _signals(case, effects, case.follow(followed.but(*followed.source)), linear)[0])
        added = seen - passed
    return Side(effects, dwell, linear, volts, rates, uncertain, passed, added, scatter)


def _signals(case: Case, effects: Effects, dwell: SimulatedDwell, linear: bool) -> tuple[Floats, Rates, Floats]:
    """Voltages and rates (phases, films, n) behind the amplifiers, and by how much voltages (films,) may be wrong."""
    more = crept(case, effects, dwell, linear)  # first, because a long motion forgets how it began
    if more is None:
        return dwell.volts(linear), lambda: dwell.rates(linear), dwell.rounding()
    volts, rates = more
    uncertain = dwell.rounding() + ERROR * np.abs(volts).max(axis=(0, 2))
    return dwell.volts(linear) + volts, lambda: dwell.rates(linear) + rates, uncertain


def certain(case: Case, effects: Effects) -> Effects:
    """The effects that a rig follows, with a leak that is held."""
    found, leak = deterministic(effects), effects.leak
    return found if leak is None else found.including(held(case, leak))


def reach(case: Case, effects: Effects) -> Floats:
    """Greatest relative change (films,) of each film's gain by scatter."""
    scatter = effects.scattering.scatter if effects.scattering else None
    return np.array([SIGMAS * (scatter or 0.0) * film.scatter for film in case.design.films])


def deterministic(effects: Effects) -> Effects:
    """The effects that a rig follows without drawing random numbers."""
    return effects.but(*effects.input, effects.scattering, effects.converter)
