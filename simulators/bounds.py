"""Bounds on the change of the results when an effect is left out of a scene."""

from __future__ import annotations

import functools
import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from palpate.instrument.arrays import Complexes, Floats, Times
from palpate.instrument.contracts.own import RANGE_VOLTS
from palpate.instrument.errors import EstimateError, RangeError
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import Sample
from palpate.instrument.signals.estimate import SineColumns, amplitudes, sine_columns, tuned
from palpate.simulators.physics.dwells import GONE, ROUNDING, SimulatedDwell, begun, met, superposed, touched
from palpate.simulators.physics.effect import (
    Bound,
    Case,
    ConverterEffect,
    Effect,
    Effects,
    InputEffect,
    Kind,
    LeakEffect,
    Rates,
    ShareEffect,
)
from palpate.simulators.randomness import Stream

# --- fits ----------------------------------------------------------------------------------------------


DIRECTIONS = 64  # number of directions in half a circle
SIGMAS = 6.0  # standard deviations of noise in a bound: two quadratures exceed them once in 6e7 fits


def fitted(case: Case, samples: Floats) -> Complexes:
    """Fitted phasors (...) of samples (..., n). Raises EstimateError: the dwell does not determine a sine."""
    cosine, sine = weights(case)
    centred = samples - samples.mean(axis=-1, keepdims=True)
    return np.asarray(centred @ cosine - 1j * (centred @ sine))


def largest(case: Case, variance: Floats) -> float:
    """Six standard deviations of an amplitude by independent noise of a variance (phases, n) or (n,) in each sample."""
    covariance = np.einsum("in,...n,jn->...ij", weights(case), variance, weights(case))
    return SIGMAS * math.sqrt(float(np.linalg.norm(covariance, 2, axis=(-2, -1)).max()))


def spread(case: Case) -> float:
    """Standard deviation of an amplitude over that of independent noise in each sample."""
    return float(np.linalg.norm(weights(case), 2))


def correlated_spread(case: Case, correlation: Callable[[Floats], Floats]) -> float:
    """Standard deviation of an amplitude over that of noise with a correlation, which is a function of the lag [s]."""
    count = weights(case).shape[1]
    column = correlation(np.arange(count) / case.rate)
    # The matrix of the correlations is part of a circulant one, by which a Fourier transform multiplies.
    circulant = np.concatenate((column, column[:0:-1]))
    filtered = np.fft.rfft(circulant) * np.fft.rfft(weights(case), len(circulant))
    covariance = weights(case) @ np.fft.irfft(filtered, len(circulant))[:, :count].T
    return math.sqrt(np.linalg.norm(covariance, 2))


def largest_within(case: Case) -> float:
    """Greatest error of an amplitude over the greatest error of a sample."""
    return _largest(case.frequency, case.dwell, case.rate)


@functools.lru_cache(maxsize=8)
def _largest(frequency: float, dwell: float, rate: float) -> float:
    # The sum of |weights| along a direction is convex, so around the circle it is below that at a polygon's corners.
    angles = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    seen = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ _fit_weights(frequency, dwell, rate)
    return float(np.abs(seen).sum(axis=1).max()) / math.cos(np.pi / 2 / DIRECTIONS)


def largest_tone(case: Case, frequency: float) -> float:
    """Greatest error of an amplitude over the amplitude of a sine of another frequency [Hz]."""
    turns = np.exp(2j * np.pi * frequency * np.arange(weights(case).shape[1]) / case.rate)
    phasors = weights(case) @ turns
    return float(np.linalg.norm(np.stack([phasors.real, phasors.imag]), 2))  # at its worst phase


def weights(case: Case) -> Floats:
    """Weights (2, n) of the samples of a dwell in the fitted cosine and sine. Raises EstimateError."""
    return _fit_weights(case.frequency, case.dwell, case.rate)


def columns(case: Case) -> SineColumns:
    """Columns of the fit of a dwell. Raises EstimateError."""
    return _columns(case.frequency, case.dwell, case.rate)


@functools.lru_cache(maxsize=8)
def _fit_weights(frequency: float, dwell: float, rate: float) -> Floats:
    return _columns(frequency, dwell, rate).weights()


@functools.lru_cache(maxsize=8)
def _columns(frequency: float, dwell: float, rate: float) -> SineColumns:
    times = np.arange(max(1, round(dwell * rate))) / rate
    amplitudes(times, np.zeros((1, len(times))), frequency)  # raises where a fit raises
    return sine_columns(times, frequency)


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
    levels = [held(case, leak).conductance(0.0), *conductances]
    found = np.array([[amplifier.offset(film, case.design, each) for each in levels] for film in case.design.films])
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


# --- rounding ------------------------------------------------------------------------------------------


CONVERTED = 64  # phases and draws of the noise with which samples are converted
FEW = 8.0  # steps; a film that spans no more is rounded alike in every cycle
FLIPS = 3  # greatest number of samples that a small change rounds to another step
SELDOM = 1e-9  # probability below which an event is taken not to happen
LARGEST = 1 << 21  # greatest number of values in memory at once
MARGIN = 0.99
GOLDEN = (math.sqrt(5) - 1) / 2


def reaches_rail(volts: float) -> bool:
    """Whether a voltage is beyond the converter's range, or may be rounded to its end."""
    return not volts < MARGIN * max(RANGE_VOLTS)


def steps(case: Case, converter: ConverterEffect, volts: Floats, noise: float) -> float:
    """Greatest change of an amplitude [V] by rounding samples (phases, n) with `noise` [V] in each sample.

    Half a step in every sample is the worst case. Tried for some phases, the errors scatter, and six standard
    deviations of them are less. A film that spans few steps and has no noise is rounded alike in every cycle, so for it
    the worst case counts.
    """
    worst = 0.5 * _step(converter) * largest_within(case)
    if _few(converter, volts, noise):
        return worst
    return min(worst, _six(_errors(case, converter, _tried(volts, noise))))


def step_changes(
    case: Case, converter: ConverterEffect, before: Floats, after: Floats, factor: Complexes, noise: float, more: float
) -> float:
    """Greatest change by rounding [V] of the difference of samples (phases, n) before and after.

    Args:
        case: the measurement.
        converter: the converter.
        before, after: (phases, n), samples [V].
        factor: (phases,), phasors after over phasors before.
        noise: noise of each sample of both [V].
        more: noise of the samples after alone [V].
    """
    times = float(np.abs(factor).max())
    worst = 0.5 * (1 + times) * _step(converter) * largest_within(case)
    if _few(converter, before, noise) or _few(converter, after, noise):
        return worst
    others = _tried(after, noise)
    if more:
        others = others + more * _normal("more", others.size).reshape(others.shape)
    found = _errors(case, converter, others)
    found -= factor[np.round(_phases(before) * len(factor)).astype(int) % len(factor)] * _errors(
        case, converter, _tried(before, noise)
    )
    moved = (np.abs(after - before).mean() + more) / _step(converter) * before.shape[1]
    few = _flips(float(moved)) * max(1.0, times) * _step(converter) * _heaviest(case, noise > _step(converter) / 4)
    return min(worst, _six(found) + few)


def _flips(expected: float) -> int:
    """Greatest number of samples that are rounded to another step, if the mean number is `expected`."""
    counts = (count for count in range(FLIPS) if expected ** (count + 1) / math.factorial(count + 1) < SELDOM)
    return next(counts, FLIPS)


def _step(converter: ConverterEffect) -> float:
    """Step of the converter [V]."""
    return 2 * max(RANGE_VOLTS) / 2.0**converter.bits


def _few(converter: ConverterEffect, volts: Floats, noise: float) -> bool:
    return bool(np.ptp(volts) < FEW * _step(converter) and noise < _step(converter) / 2)


def _phases(volts: Floats) -> Floats:
    """Phases that are tried, spaced by the golden section, because a cycle may have any whole number of samples."""
    return GOLDEN * np.arange(max(4, min(CONVERTED, LARGEST // volts.shape[1]))) % 1


def _tried(volts: Floats, noise: float) -> Floats:
    """Samples in the tried phases, from a constant and the part that turns with the phase."""
    sampled, asked = np.arange(len(volts)) / len(volts), _phases(volts)
    weights = 1 + 2 * np.cos(2 * math.pi * (asked[:, np.newaxis] - sampled))
    chosen = weights / len(volts) @ volts
    return np.asarray(chosen + noise * _normal("steps", chosen.size).reshape(chosen.shape)) if noise else chosen


@functools.lru_cache(maxsize=2)
def _normal(name: str, count: int) -> Floats:
    """Standard normal numbers, always the same."""
    return Stream(0, name).normal(0, count)


def _errors(case: Case, converter: ConverterEffect, volts: Floats) -> Complexes:
    """Errors of the phasors by rounding."""
    full = max(RANGE_VOLTS)
    return fitted(case, converter.convert(volts / full)[0] * full - volts)


def _six(errors: Complexes) -> float:
    """Six standard deviations of errors along the worst direction."""
    parts = np.stack([errors.real, errors.imag], axis=-1)
    return SIGMAS * float(np.linalg.norm(parts, 2)) / math.sqrt(len(parts))


def _heaviest(case: Case, alone: bool) -> float:
    """Weight in an amplitude of one sample, or of all samples at the same phase of the drive."""
    each = np.hypot(*weights(case))
    if alone:
        return float(each.max())
    turns = np.arange(len(each)) * case.frequency / case.rate
    same = np.unique(np.round((turns % 1) * 1e6).astype(np.int64) % 1_000_000, return_inverse=True)[1]
    return float(np.bincount(same, each).max())


# --- strays --------------------------------------------------------------------------------------------

# Bounds are of a linear fit. But the fit of a record takes for hum what it finds near the mains, such as a drive there
# that is not of the frequency that was asked for, or a multiple of a drive whose force plays have bent.


TRIED, FEWER = 12, 3  # phases of the drive that are tried; fewer for a long record, in which a phase matters less
LONG = 5000  # samples of a long record
MORE = 2.0  # factor that allows for phases in between, and for other noise
# Greatest difference that trying phases can show. Above it a film's signal nearly vanishes in some phases, and may be
# smaller still in phases that were not tried.
TOLD = 1.0


def strays(case: Case, before: Side, after: Side, totals: Sequence[int], pairs: Sequence[tuple[int, int]]) -> Bound:
    """Greatest difference between the changes by both fits, over some phases, with the same noise before and after.

    Infinite above `TOLD`.

    Args:
        case: the measurement.
        before, after: its two sides.
        totals: films whose force counts.
        pairs: films whose ratio counts.
    """
    basis = columns(case)
    alike = np.array_equal(before.volts, after.volts) and _behind(before) == _behind(after)
    if alike or not (basis.mains and basis.slopes):
        return Bound(0.0, 0.0)
    both = [_fits(case, basis, side) for side in (before, after)]
    if all(linear is own for linear, own in both):
        return Bound(0.0, 0.0)
    top, tooth, base = list(totals), *(list(each) for each in zip(*pairs, strict=True))
    with np.errstate(all="ignore"):
        linear, own = (became / was for was, became in zip(*both, strict=True))
        found = (
            np.abs(own[:, top] - linear[:, top]).max(),
            np.abs(own[:, tooth] / own[:, base] - linear[:, tooth] / linear[:, base]).max(),
        )
    force, ratio = (MORE * float(each) if each <= TOLD else np.inf for each in found)
    return Bound(force, ratio)


def _behind(side: Side) -> tuple[Effect | None, ...]:
    """The effects that change the samples of its voltages."""
    return (*side.effects.input, side.effects.converter)


def _fits(case: Case, basis: SineColumns, side: Side) -> tuple[Floats, Floats]:
    """Amplitudes with the mains at their rated and at their true frequency, shapes (phases, films) [V].

    Both are the same object if the frequencies are the same.
    """
    samples = _sampled(case, side)
    samples = samples - samples.mean(axis=2, keepdims=True)
    phases, films, n = samples.shape
    rated = basis.solve(samples.reshape(-1, n)).reshape(-1, phases, films)
    fits = [tuned(basis, each, rated[:, number]) for number, each in enumerate(samples)]
    linear = np.hypot(*(rated[:2] * basis.scale[:2, np.newaxis, np.newaxis]))
    if all(own is basis for own, _ in fits):
        return linear, linear
    return linear, np.stack([np.hypot(*(scaled[:2] * basis.scale[:2, np.newaxis])) for _, scaled in fits])


def _sampled(case: Case, side: Side) -> Floats:
    """Samples with one draw of the noise, shape (phases, films, n) [V]."""
    tried = TRIED if side.volts.shape[2] < LONG else FEWER
    every, period_ns = len(side.volts) // tried, round(1e9 / case.rate)
    volts = side.volts[::every]
    films, times = range(volts.shape[1]), side.dwell.times
    for each in side.effects.input:
        streams = [Stream(0, each.name, 0 if each.common else film) for film in films]
        if each.follows:
            seen = [side.rates(film)()[::every] for film in films]
            noise = [[_volts(each, streams[i], times, period_ns, seen[i][k]) for i in films] for k in range(len(volts))]
            volts = volts + np.array(noise)
        else:
            volts = volts + np.array([_volts(each, stream, times, period_ns, volts[0, 0]) for stream in streams])
    if side.effects.converter is not None:
        volts = side.effects.converter.convert(volts / max(RANGE_VOLTS))[0] * max(RANGE_VOLTS)
    return volts


def _volts(effect: InputEffect, stream: Stream, times: Times, period_ns: int, rates: Floats) -> Floats:
    return effect.volts(stream, times, period_ns, lambda: rates)


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
#
# The rig follows the scene with the effect and without it, for a drive that begins in any phase. Everything that is
# certain changes by just that difference. Random parts, of both sides or of one, are added with six standard
# deviations. Rounding by a converter is tried out. Where contact is lost, a limit acts or the converter's rail is
# reached, there is no bound.

BEYOND = Bound(math.inf, math.inf)
BETWEEN = {True: 0.01, False: 0.5}  # share of the results' span over phases that is added for phases between
LOOKED_AT = 8  # phases of the drive in which a limit is looked for
NEARER = math.cos(math.pi / LOOKED_AT)  # share of the limit that is looked for, because of phases between


def bound_of(case: Case, effect: Effect) -> Bound:
    """Greatest change of the results when the effect is left out, for any share of the force that teeth may take."""
    own, nearer = effect.known_bound(case), effect.nearer(NEARER)
    if own is not None:
        return own
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
