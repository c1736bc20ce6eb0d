"""Bounds on the change of force and force ratio, of a least-squares sine at the set load, when an effect is left out.

The rig follows the scene with the effect and without it, for a drive that begins in any phase. Everything that is
certain changes by just that difference. Random parts, of both sides or of one, are added with six standard deviations.
Rounding by a converter is tried out. Where contact is lost, a limit acts or the converter's rail is reached, there is
no bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from palpate.instrument.arrays import Complexes, Floats
from palpate.instrument.errors import EstimateError, RangeError
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.bounds.fits import SIGMAS
from palpate.simulators.bounds.rounding import reaches_rail, step_changes, steps
from palpate.simulators.bounds.sides import Side, certain, deterministic, reach, sides
from palpate.simulators.bounds.strays import strays
from palpate.simulators.physics.dwells import ROUNDING, begun, met, touched
from palpate.simulators.physics.effect import Bound, Case, Effect, Kind, Rates
from palpate.simulators.physics.in_order import Effects
from palpate.simulators.physics.stages import ShareEffect
from palpate.simulators.randomness import Stream

# --- Effects on the share of the force that teeth take, held at the ends of what they may draw ---------
#
# What another effect changes grows or falls with that share, and so does what such an effect changes itself: both are
# greatest at an end, or where nothing is drawn.


class HeldShare(ShareEffect):
    """A change of the force ratio's natural logarithm by a constant."""

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False

    ln: float

    @property
    def reach(self) -> tuple[float, float]:
        return self.ln, self.ln

    def ln_change(self, sample: Sample, stream: Stream, mounted_at_ns: int) -> float:
        return self.ln


def shares(without: Effects, effect: Effect) -> Iterator[tuple[Effects, Effect]]:
    """Effects without one and that one itself, for each end of the share of the force that they may draw."""
    own = Effects({effect.name: effect}).share
    for ln in _ends(without):
        before = without.but(*without.share)
        if without.share:
            before = before.including(HeldShare(ln=ln))
        if not own:
            yield before, effect
        for change in own[0].reach if own else ():
            yield before, HeldShare(ln=ln + change)


def _ends(effects: Effects) -> tuple[float, ...]:
    """Changes of the ratio's natural logarithm: none, least and greatest."""
    if not effects.share:
        return (0.0,)
    low, high = (math.fsum(each.reach[end] for each in effects.share) for end in (0, 1))
    return tuple(sorted({low, 0.0, high}))


# --- the bounds ----------------------------------------------------------------------------------------

BEYOND = Bound(math.inf, math.inf)
BETWEEN = {True: 0.01, False: 0.5}  # share of the results' span over phases that is added for phases between
LOOKED_AT = 8  # phases of the drive in which a limit is looked for
NEARER = math.cos(math.pi / LOOKED_AT)  # share of the limit that is looked for, because of phases between


def bound_of(case: Case, effect: Effect) -> Bound:
    """Greatest change of the results when the effect is left out, for any share of the force that teeth may take."""
    known, nearer = effect.known_bound(case), effect.nearer(NEARER)
    if known is not None:
        return known
    found = []
    for before, after in shares(Effects(case.effects), effect):
        beside = replace(case, effects=before)
        try:
            found.append(_bound_of_change(beside, after) if nearer is None else _bound_of_limit(beside, nearer))
        except RangeError:
            if after is effect and not before.share:
                raise
            return BEYOND  # the teeth would take more than the whole force
    return Bound(max(each.force for each in found), max(each.ratio for each in found))


def _bound_of_change(case: Case, effect: Effect) -> Bound:
    """Bound by comparing the scene with the effect and the scene without it."""
    without = Effects(case.effects)
    with_it = without.including(effect)
    try:
        if any(case.follow(certain(case, each)).limited for each in (without, with_it)):
            return BEYOND
        before, after = sides(case, without, with_it)
    except EstimateError:  # the dwell does not determine a sine
        return BEYOND
    if any(_saturated(case, each) for each in (before, after)):
        return BEYOND
    return _results(case, effect, before, after)


def _bound_of_limit(case: Case, nearer: Effect) -> Bound:
    """Bound of a limit: zero where a limit nearer by `NEARER` is never met, from the beginning of the drive on."""
    rig = case.driven(deterministic(Effects(case.effects).including(nearer)))
    end_ns = round(1e9 * (case.settled + case.dwell))
    acts = any(met(touch, (nearer.moves,)) for path in begun(rig, LOOKED_AT) for touch in touched(path, end_ns))
    return BEYOND if acts else Bound(0.0, 0.0)


def _saturated(case: Case, each: Side) -> bool:
    """Whether a film may reach the rail of the scene's converter."""
    if each.effects.converter is None:
        return False
    volts = np.abs(each.volts).max(axis=(0, 2)) * (1 + each.scatter)
    noise = [sum(effect.largest(case, each.rates(film)) for effect in each.effects.input) for film in range(len(volts))]
    return reaches_rail(float((volts + np.array(noise)).max()))


# --- from films to results -----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Beside:
    """Uncertain parts of a film's phasor, (films,) or (phases, films) [V].

    Attributes:
        common: part that both sides share, beside the signal.
        apart: part that only one side has.
        least: part of the first side's signal that may be missing.
    """

    common: Floats
    apart: Floats
    least: Floats


def _results(case: Case, effect: Effect, before: Side, after: Side) -> Bound:
    """Bound from both sides, compared at the same phase and the same gains."""
    if not before.dwell.period:  # below the generator's step nothing moves, and a fit finds rounding and noise only
        return BEYOND
    beyond = BETWEEN[before.linear]
    scatters = bool(before.scatter.any())
    gains = _gains(before, after) if scatters else np.ones((1, 1, 1))
    was = gains * before.passed + before.added  # (gains, phases, films)
    became = gains * after.passed + after.added
    if effect is after.effects.scattering:  # both sides differ in their gains alone
        became = was
    with np.errstate(all="ignore"):
        factor = np.where(became == was, 1.0, became / was)
        beside = _beside(case, effect, before, after, factor[0])
        # (s f + n) / (s + n) = f' with f' - f = (1 - f) n / (s + n): a part that both sides share dilutes the change.
        missed = np.where(factor == 1.0, 0.0, np.abs(1 - factor)).max(axis=0) * beside.common + beside.apart
        lost = [_lost(case, each) for each in (before, after)]
        least = np.where(missed > sum(lost), _least(before) - lost[0] if scatters else np.abs(was[0]), np.abs(was[0]))
        slack = np.where(missed == 0, 0.0, missed / np.maximum(least - beside.least, 0.0))
        slack = slack + _rounded_off(before, after, lost, was[0], factor[0])
        low, high = np.maximum(np.abs(factor) - slack, 0.0), np.abs(factor) + slack
        pairs = pairs_of(case.design)
        total = [i for i, film in enumerate(case.design.films) if film.kind == FILM_KINDS[1]]
        force = max(_most(low[..., j], high[..., j], beyond) for j in total)
        # The gain of each film scatters by itself.
        others = (np.newaxis, slice(None)) if before.scatter.any() else (slice(None), np.newaxis)
        ratio = max(
            _most(
                low[:, np.newaxis, :, i] / high[others][..., j], high[:, np.newaxis, :, i] / low[others][..., j], beyond
            )
            for i, j in pairs
        )
    more = strays(case, before, after, total, pairs)
    return Bound(force + more.force, ratio + more.ratio)


def _gains(before: Side, after: Side) -> Floats:
    """Gains (7, phases, films) within reach: 1, the ends, and those at which a film changes most or least.

    A film that is g P + A becomes g Q + B. The squares of both and of their difference are polynomials of g. A quotient
    of two of them is greatest or least at an end or where its derivative, a polynomial of second degree, is zero.
    """
    size, other, difference = (
        (np.square(abs(passed)), 2 * (passed * added.conj()).real, np.square(abs(added)))
        for passed, added in (
            (before.passed, before.added),
            (after.passed, after.added),
            (after.passed - before.passed, after.added - before.added),
        )
    )
    extreme = [*_extreme(other, size), *_extreme(difference, size)]
    low, high = (np.broadcast_to(1 + sign * before.scatter, before.passed.shape) for sign in (-1, 1))
    return np.stack([np.ones_like(low), low, high, *(np.clip(each, low, high) for each in extreme)])


def _extreme(above: Sequence[Floats], below: Sequence[Floats]) -> list[Floats]:
    """Where a quotient of polynomials of second degree, greatest power first, is greatest or least; 1: nowhere."""
    (q2, q1, q0), (p2, p1, p0) = above, below
    c2, c1, c0 = q2 * p1 - q1 * p2, 2 * (q2 * p0 - q0 * p2), q1 * p0 - q0 * p1
    with np.errstate(all="ignore"):
        middle = -(c1 + np.copysign(np.sqrt(np.maximum(c1**2 - 4 * c2 * c0, 0.0)), c1)) / 2
        return [np.where(np.isfinite(each), each, 1.0) for each in (middle / c2, c0 / middle)]


def _least(side: Side) -> Floats:
    """Least amplitudes (phases, films) with any gains within reach: |g P + A| where g P is nearest to -A."""
    with np.errstate(all="ignore"):
        nearest = -(side.passed.conj() * side.added).real / np.abs(side.passed) ** 2
    gains = np.clip(np.where(np.isfinite(nearest), nearest, 1.0), 1 - side.scatter, 1 + side.scatter)
    return np.asarray(np.abs(gains * side.passed + side.added), dtype=np.float64)


def _lost(case: Case, side: Side) -> Floats:
    """What round-off may change in amplitudes (films,) [V] beside the round-off of films."""
    added = [sum(each.largest(case, side.rates(i)) for each in side.effects.input) for i in range(len(side.scatter))]
    return np.asarray(ROUNDING * (np.abs(side.volts).max(axis=(0, 2)) + np.array(added)), dtype=np.float64)


def _rounded_off(before: Side, after: Side, lost: Sequence[Floats], was: Complexes, factor: Complexes) -> Floats:
    """Change (phases, films) of factors by round-off of both sides, and where films differ by what is wrong in them."""
    changed = (before.volts != after.volts).any(axis=(0, 2))
    wrong = [rounded + changed * side.uncertain for rounded, side in zip(lost, (before, after), strict=True)]
    more = (np.abs(factor) * wrong[0] + wrong[1]) / np.abs(was)
    return np.where(changed | (before.effects.input != after.effects.input), more, 0.0)


def pairs_of(design: Design) -> list[tuple[int, int]]:
    """Pairs of films: the number of each film under a tooth with that of the film under its base."""
    tooth, base = ([i for i, film in enumerate(design.films) if film.kind == kind] for kind in FILM_KINDS)
    films = design.films
    return [(i, j) for i in tooth for j in base if set(films[i].teeth) <= set(films[j].teeth)]


def _most(low: Floats, high: Floats, beyond: float) -> float:
    """Greatest distance from 1 of factors (..., phases), including those between the phases."""
    if not np.isfinite(high).all():
        return math.inf
    ends = [each.max(axis=-1) + beyond * np.ptp(each, axis=-1) for each in (high - 1, 1 - low)]
    return float(max(0.0, *(end.max() for end in ends)))


def _beside(case: Case, effect: Effect, before: Side, after: Side, factor: Complexes) -> _Beside:
    count = len(case.design.films)
    common, apart, least = np.zeros(count), np.zeros(factor.shape), np.zeros(count)
    if effect is after.effects.scattering:
        apart = reach(case, after.effects) * np.abs(after.passed)
    changed = (before.volts != after.volts).any(axis=(0, 2))
    for i in range(count):
        rates = before.rates(i)
        for each in before.effects.input:
            error = each.error(case, rates)
            least[i] += error
            if not each.follows:
                common[i] += error
            elif changed[i]:  # the same random numbers are multiplied by other rates
                apart[:, i] += each.error(case, _otherwise(rates, factor[:, [i]], after.rates(i)))
        apart[:, i] += sum(each.error(case, rates) for each in after.effects.input if each is effect)
        rounds = changed[i] or apart[:, i].any() or effect is after.effects.converter
        if after.effects.converter is not None and rounds:
            rounded, missing = _rounded(case, effect, before, after, i, factor[:, i])
            apart[:, i] += rounded
            least[i] += missing
    return _Beside(common, apart, least)


def _otherwise(rates: Rates, factor: Complexes, others: Rates) -> Rates:
    """Difference of the second rates from the first ones times the change of the film's phasor."""
    return lambda: np.asarray(np.abs(others() - factor * rates()))


def _rounded(
    case: Case, effect: Effect, before: Side, after: Side, film: int, factor: Complexes
) -> tuple[float, float]:
    """Change by the converter's steps of a film's change, and of its amplitude before [V]."""
    converter = after.effects.converter
    assert converter is not None
    was, became = before.volts[:, film], after.volts[:, film]
    noise = math.hypot(*(each.dither(case.rate) for each in before.effects.input))
    if effect is converter:
        return steps(case, converter, was, noise), 0.0
    if effect is after.effects.scattering:
        became = was * (1 + reach(case, after.effects)[film])
    more = sum(each.largest(case, before.rates(film)) for each in after.effects.input if each is effect) / SIGMAS
    return step_changes(case, converter, was, became, factor, noise, more), steps(case, converter, was, noise)
