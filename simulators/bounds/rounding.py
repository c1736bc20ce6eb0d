"""Errors of fitted amplitudes by the steps of a converter."""

from __future__ import annotations

import functools
import math

import numpy as np

from palpate.instrument.arrays import Complexes, Floats
from palpate.instrument.contracts.sensor_node import RANGE_VOLTS
from palpate.simulators.bounds.fits import SIGMAS, fitted, largest_within, weights
from palpate.simulators.physics.effect import Case
from palpate.simulators.physics.stages import ConverterEffect
from palpate.simulators.randomness import Stream

TRIED = 64  # phases and draws of the noise with which samples are converted
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
    likely = (count for count in range(FLIPS) if expected ** (count + 1) / math.factorial(count + 1) < SELDOM)
    return next(likely, FLIPS)


def _step(converter: ConverterEffect) -> float:
    """Step of the converter [V]."""
    return 2 * max(RANGE_VOLTS) / 2.0**converter.bits


def _few(converter: ConverterEffect, volts: Floats, noise: float) -> bool:
    return bool(np.ptp(volts) < FEW * _step(converter) and noise < _step(converter) / 2)


def _phases(volts: Floats) -> Floats:
    """Phases that are tried, spaced by the golden section, because a cycle may have any whole number of samples."""
    return GOLDEN * np.arange(max(4, min(TRIED, LARGEST // volts.shape[1]))) % 1


def _tried(volts: Floats, noise: float) -> Floats:
    """Samples in the tried phases, from a constant and the part that turns with the phase."""
    known, asked = np.arange(len(volts)) / len(volts), _phases(volts)
    weights = 1 + 2 * np.cos(2 * math.pi * (asked[:, np.newaxis] - known))
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
