"""What a change adds to the films' standing signals: against the drift that they had before it, without a drive.

An amplifier's offset and its drift, by damp or by what was changed before, are no answer to this change. So the films
are recorded several times before it and once after, and the drift is drawn on as a straight line; by as much as a bent
one would lead elsewhere, or as a walk by chance might have gone, the line is uncertain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from palpate.instrument.uncertainty.interpolation import interpolate
from palpate.procedures.steps.films import Films
from palpate.procedures.steps.flags import CLIPPED, FAULT, NOT_FINITE
from palpate.procedures.steps.policy import carry_out

Floats = npt.NDArray[np.float64]

RECORDS, APART, LENGTH = (
    8,
    4.0,
    1.0,
)  # before the change; s from one to the next, and of each: whole cycles of the mains
BEFORE = RECORDS * APART  # s, that they take
RESPONSE = 10.0  # s, after which an amplifier of 1 s has answered a change


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """One record. time: of its middle [s]. voltage: means (films,) V. lost: why one is not to be used."""

    time: float
    voltage: Floats
    lost: frozenset[str]


@dataclass(frozen=True, slots=True, eq=False)
class Added:
    """What a change has added, (films,) V, with its standard uncertainty, so many seconds after it."""

    voltage: Floats
    u: Floats
    after: float
    lost: frozenset[str]


def before_change(films: Films) -> list[Standing]:
    """The films drifting, without a drive."""
    found = []
    for _ in range(RECORDS):
        found.append(_standing(films))
        films.bench.clock.wait(APART - LENGTH)
    return found


def after_change(films: Films, before: list[Standing]) -> Added:
    """Against the drift before; call it as soon as the change is made."""
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
        rounding = step / math.sqrt(12)  # of signals that stand within a step; noise would even it out
        line, curve = (interpolate(since, drift, rounding, degree) for degree in (1, 2))
        predicted = float(line.coefficients[0])
        added[film] = now.voltage[film] - predicted
        bend = float(curve.coefficients[0]) - predicted
        noise = math.hypot(math.sqrt(line.covariance[0, 0]), max(line.residual_sd, rounding), bend)
        u[film] = max(noise, _wandered(drift, -since[-1] / APART))
    return Added(added, u, now.time - changed, frozenset().union(now.lost, *(each.lost for each in before)))


def _wandered(drift: list[float], hops: float) -> float:
    """Standard deviation, so many records after the last, of a signal that goes on as by chance it went before.

    That of a random walk with drift: 1/f noise, which a line through it makes too little of, does no worse.
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
