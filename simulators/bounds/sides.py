"""One side of a comparison: the films of a scene over a dwell, followed by a rig, without random parts."""

from __future__ import annotations

import functools
import math
from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from palpate.instrument.arrays import Complexes, Floats, Times
from palpate.simulators.bounds.fits import SIGMAS, fitted, weights
from palpate.simulators.physics.dwells import GONE, SimulatedDwell, superposed
from palpate.simulators.physics.effect import Case, Rates
from palpate.simulators.physics.in_order import Effects
from palpate.simulators.physics.stages import LeakEffect

# -------------------------------------------------------------------------------------------------------
# The voltages that a changing leak adds to the films' amplified voltages, compared with a constant leak
#
# An amplifier that decays by a(t) solves y' = u' - a y, and with a held decay h it solves v' = u' - h v. Their
# difference d = y - v solves d' = -a d - (a - h) v from the beginning of the drive. From one point in time to the
# next, a is constant and v is taken as the cubic with its values and rates at both points, so that d is known in
# closed form however fast the amplifier is.

ERROR = 1e-6  # tolerance, as a fraction of the greatest added voltage
POINTS = 24.0  # least number of points in a period of the drive; cubics then follow a sine to 1e-5
TERMS = 18  # number of terms of the series for steps in which little decays


def held(case: Case, leak: LeakEffect) -> LeakEffect:
    """A constant leak with the least conductance up to the dwell's end, whose transients are never too fast."""
    return leak.held(min(leak.conductance(leak.middle(time)) for time in (0.0, case.settled + case.dwell)))


def crept(case: Case, effects: Effects, dwell: SimulatedDwell, linear: bool) -> tuple[Floats, Floats] | None:
    """Voltages and rates that the change of a leak adds, shapes (phases, films, n) [V, V/s]; None: nothing changes."""
    leak, amplifier = effects.leak, effects.amplifier
    if leak is None or amplifier is None:
        return None
    edges, conductances = _epochs(leak, int(dwell.times[-1]))
    systems = [
        [
            amplifier.system(film, case.design, each).a[0, 0]
            for each in (held(case, leak).conductance(0.0), *conductances)
        ]
        for film in case.design.films
    ]
    constant, decays = -np.array(systems)[:, :1], -np.array(systems)[:, 1:]
    if (decays == constant).all():
        return None
    times = _points(case, dwell, edges, float(decays.min()))
    steps, decay = 1e-9 * np.diff(times), decays[:, np.searchsorted(edges, times, "right")]
    volts, rates = dwell.at(times, linear)
    push = (constant - decay[:, :-1]) * _integrals(decay[:, :-1] * steps, steps, volts, rates)
    added = _summed(np.broadcast_to(np.exp(-decay[:, :-1] * steps), push.shape), push)
    seen = np.searchsorted(times, dwell.times)
    found, decay = added[..., seen], decay[:, seen]
    both = found, (constant - decay) * volts[..., seen] - decay * found
    return (superposed(both[0]), superposed(both[1])) if linear else both


def offsets(case: Case, effects: Effects, dwell: SimulatedDwell) -> Floats:
    """Voltages (films, n) [V] by which offsets of amplifiers differ from those with the held leak."""
    leak, amplifier = effects.leak, effects.amplifier
    if leak is None or amplifier is None:
        return np.zeros((len(case.design.films), 1))
    edges, conductances = _epochs(leak, int(dwell.times[-1]))
    known = [held(case, leak).conductance(0.0), *conductances]
    found = np.array([[amplifier.offset(film, case.design, each) for each in known] for film in case.design.films])
    return np.asarray(found[:, 1:][:, np.searchsorted(edges, dwell.times, "right")] - found[:, :1])


def _epochs(leak: LeakEffect, end_ns: int) -> tuple[Times, list[float]]:
    """Times [ns] at which the conductance changes up to an end, and the conductances before, between and after them."""
    last = end_ns // leak.epoch_ns

    def conductance(number: int) -> float:
        return leak.conductance((number + 0.5) * leak.epoch_ns * 1e-9)

    # It changes in every epoch or in none that follows.
    count = bisect_left(range(last), x=True, key=lambda number: conductance(number) == conductance(last))
    return np.arange(1, count + 1, dtype=np.int64) * leak.epoch_ns, [conductance(number) for number in range(count + 1)]


def _points(case: Case, dwell: SimulatedDwell, edges: Times, slowest: float) -> Times:
    """Ascending times [ns] up to the dwell's end: its samples, the leak's changes, and some in each period.

    They begin with the drive, or when all that came before has been forgotten.
    """
    start, end = int(dwell.times[0]), int(dwell.times[-1])
    step = 1e9 / max(case.rate, POINTS * case.frequency)
    before = min(start, 1e9 * GONE / slowest) if slowest > 0 else start
    even = start + np.round(step * np.arange(-math.ceil(before / step), math.ceil((end - start) / step)))
    first = max(0, int(even[0]))
    points = np.concatenate([[first], even, dwell.times, edges]).astype(np.int64)
    return np.asarray(np.unique(points[(points >= first) & (points <= end)]))


def _integrals(decayed: Floats, steps: Floats, volts: Floats, rates: Floats) -> Floats:
    """Integrals over steps of voltages, each weighted by what is left of it at the step's end.

    Args:
        decayed: (films, steps), exponents of the decay in a step.
        steps: (steps,) [s].
        volts, rates: (phases, films, steps + 1).
    """
    start, end, rise, slope = volts[..., :-1], volts[..., 1:], steps * rates[..., :-1], steps * rates[..., 1:]
    cubic = start, rise, 6 * (end - start) - 4 * rise - 2 * slope, 12 * (start - end) + 6 * (rise + slope)
    return np.asarray(steps * sum(part * weight for part, weight in zip(cubic, _weights(decayed), strict=True)))


def _weights(decayed: Floats) -> list[Floats]:
    """Integrals of exp(-z (1 - t)) t^k / k! from 0 to 1, for k from 0 to 3; Hochbruck and Ostermann call them phi."""
    small, series = np.minimum(decayed, 1.0), [np.zeros_like(decayed)]
    for k in range(TERMS, 0, -1):
        series.append(1 / math.factorial(k) - small * series[-1])
    large = np.maximum(decayed, 1.0)
    closed = [-np.expm1(-large) / large]
    for k in (1, 2, 3):
        closed.append((1 / math.factorial(k) - closed[-1]) / large)
    return [np.where(decayed < 1, each, other) for each, other in zip(series[:-5:-1], closed, strict=True)]


def _summed(left: Floats, push: Floats) -> Floats:
    """d (..., n + 1) with d[0] = 0 and d[k + 1] = left[k] d[k] + push[k], by doubling the number of steps."""
    left, push, reach = left.copy(), push.copy(), 1
    while reach < push.shape[-1]:
        push[..., reach:] += left[..., reach:] * push[..., :-reach].copy()
        left[..., reach:] *= left[..., :-reach].copy()
        reach *= 2
    return np.concatenate([np.zeros((*push.shape[:-1], 1)), push], axis=-1)


# --- sides of a comparison -----------------------------------------------------------------------------


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
