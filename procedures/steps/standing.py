"""What a change of the surroundings adds to the films' signals at rest, beyond the drift that they had before it.

An amplifier's offset drifts by damp, or by an earlier change, and that is no answer to this change. So the films are
recorded several times before the change and once after it, without a drive. A straight line through the records before
predicts the one after. The line's uncertainty allows for a curve in its place, and for a random walk.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.uncertainty.interpolation import interpolate
from palpate.procedures.steps.films import Films
from palpate.procedures.steps.flags import CLIPPED, FAULT, NOT_FINITE
from palpate.procedures.steps.policy import carry_out

RECORDS = 8  # before the change
APART = 4.0  # s, from one record to the next
LENGTH = 1.0  # s, of each record: whole cycles of the mains
BEFORE = RECORDS * APART  # s, that the records before the change take
RESPONSE = 10.0  # s, after which an amplifier with a time constant of 1 s has answered a change


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """One record at rest.

    Attributes:
        time: time of its middle [s].
        voltage: mean voltages (films,) [V].
        lost: flags, if the record is not to be used.
    """

    time: float
    voltage: Floats
    lost: frozenset[str]


@dataclass(frozen=True, slots=True, eq=False)
class Added:
    """What a change has added to the films' signals.

    Attributes:
        voltage, u: added voltages and their standard uncertainties (films,) [V].
        after: time since the change [s].
        lost: flags, if one of the records is not to be used.
    """

    voltage: Floats
    u: Floats
    after: float
    lost: frozenset[str]


def before_change(films: Films) -> list[Standing]:
    """Record the films as they drift at rest. Call it with the outputs off."""
    found = []
    for _ in range(RECORDS):
        found.append(_standing(films))
        films.bench.clock.wait(APART - LENGTH)
    return found


def after_change(films: Films, before: list[Standing]) -> Added:
    """Find what a change has added. Call it as soon as the change is made, with the records from before it."""
    changed = 1e-9 * films.bench.clock.now_ns()
    films.bench.clock.wait(RESPONSE)
    now = _standing(films)
    since = [each.time - now.time for each in before]
    added, u = np.empty(len(now.voltage)), np.empty(len(now.voltage))
    for film, step in enumerate(films.steps()):
        drift = [float(each.voltage[film]) for each in before]
        if not np.isfinite([*drift, now.voltage[film]]).all():
            added[film] = u[film] = math.nan
            continue
        rounding = step / math.sqrt(12)  # of a signal that stays within one step; noise would average it out
        line, curve = (interpolate(since, drift, rounding, degree) for degree in (1, 2))
        predicted = float(line.coefficients[0])
        added[film] = now.voltage[film] - predicted
        bend = float(curve.coefficients[0]) - predicted
        noise = math.hypot(math.sqrt(line.covariance[0, 0]), max(line.residual_sd, rounding), bend)
        u[film] = max(noise, wandered(drift, -since[-1] / APART))
    return Added(added, u, now.time - changed, frozenset().union(now.lost, *(each.lost for each in before)))


def wandered(drift: list[float], hops: float) -> float:
    """Standard deviation of a random walk with drift, some records after the last one.

    The residuals of a line make too little of 1/f noise. A random walk with the same steps wanders no less than it.
    """
    each = float(np.std(np.diff(drift), ddof=1))
    return each * math.sqrt(hops + hops**2 / (len(drift) - 1))


def _standing(films: Films) -> Standing:
    heard, begun = films.emergencies(), films.bench.clock.now_ns()
    record = carry_out(films.bench, "films at rest", partial(films.acquire, LENGTH))
    ended = films.bench.clock.now_ns()
    flags = {
        CLIPPED: record.clipped.any(),
        NOT_FINITE: not np.isfinite(record.voltage).all(),
        FAULT: films.emergencies() > heard and not record.clipped.any(),
    }
    lost = frozenset(flag for flag, raised in flags.items() if raised)
    return Standing(0.5e-9 * (begun + ended), record.voltage.mean(axis=1), lost)
