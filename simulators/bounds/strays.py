"""The difference between a fit that searches for the mains' true frequency, and one at their rated frequency.

Bounds are of a linear fit. But the fit of a record takes for hum what it finds near the mains, such as a drive there
that is not of the frequency that was asked for, or a multiple of a drive whose force plays have bent.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.contracts.sensor_node import RANGE_VOLTS
from palpate.instrument.signals.hum import tuned
from palpate.instrument.signals.sine_columns import SineColumns
from palpate.simulators.bounds.fits import columns
from palpate.simulators.bounds.sides import Side
from palpate.simulators.physics.effect import Bound, Case, Effect
from palpate.simulators.physics.stages import InputEffect
from palpate.simulators.randomness import Stream

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
