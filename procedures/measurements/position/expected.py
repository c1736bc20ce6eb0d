"""What a position sweep is expected to give: the uncertainty of each place that the films find.

It is that of `locate` for the shares of the table of point loads. The gains scatter as the design says [M], noise is
that of usual films [A]. Where two places give nearly the same shares, the uncertainty depends on how the gains fall:
so it is the root mean square over shares that are off by gains, noise and the table's own error, by Gauss and Hermite's
rule of three points.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from palpate.instrument.allocation.lines import BudgetLine, RepeatUnit
from palpate.instrument.allocation.table import FIRST
from palpate.instrument.arrays import Floats
from palpate.instrument.findings.film_forces import NOISE as BY_NOISE
from palpate.instrument.findings.film_forces import PRIOR_FREEDOM, SCATTER
from palpate.instrument.findings.position import locate
from palpate.instrument.models.influence import ERROR, tooth_shares
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.engine.plan import APPROACH, noise_of, point_seconds
from palpate.procedures.engine.promise import Expected

QUADRATURE = ((-math.sqrt(3), 1 / 6), (0.0, 2 / 3), (math.sqrt(3), 1 / 6))  # of a normal distribution
TABLE = "table of point loads"
ONCE, END = 64.0, 6.7  # s, for the sample's mounting and the load cell's zero before and after, of which the end [M]
TOUCH, PER_NEWTON = 15.7, 2.9  # s, and s/N of the load: from home until the preload is reached at a place [M]

Place = tuple[float, float]


def expected_places(
    design: Design, sample: Sample, places: Sequence[Place], load: float, dwell: float
) -> list[Expected]:
    """Standard uncertainty of each place by one load set [mm]; their names are those of the places.

    Args:
        design: design of the sensor.
        sample: the sample.
        places: places (x, y) of the point load [m].
        load: load, peak to peak [N].
        dwell: dwell of each point [s].
    """
    scatter = np.array(design.tooth_covariance)
    found = []
    for place in places:
        noise = [u / math.sqrt(dwell) for u in share_noise(design, tooth_shares(design, sample, place), load)]
        found.append(Expected(name_of(place[0]), 1e3 * _place_u(design, sample, place, noise, scatter), "mm"))
    return found


def place_seconds(frequency: float, dwell: float, load: float) -> float:
    """Expected time of the first load set at a place, with the probe set there by a person [s].

    Args:
        frequency: frequency of the load [Hz].
        dwell: dwell [s].
        load: load, peak to peak [N].
    """
    return point_seconds(frequency, dwell, first=True) - APPROACH + TOUCH + PER_NEWTON * load


def name_of(x: float) -> str:
    """Name of the result for a place at x [m]."""
    return f"position at {1e3 * x:g} mm"


def share_noise(design: Design, shares: Sequence[float], load: float) -> list[float]:
    """Standard uncertainty of each tooth's share by the noise of its films, after one second [√s].

    Args:
        design: design of the sensor.
        shares: share of each tooth.
        load: load, peak to peak [N].
    """
    base = next(film for film in design.films if film.kind == FILM_KINDS[1])
    rigid = [film for film in design.films if film is not base]
    return [
        2 * noise_of(design) / load * math.hypot(1 / film.sensitivity, share / base.sensitivity)
        for film, share in zip(rigid, shares, strict=True)
    ]


@functools.lru_cache(maxsize=1024)
def lines_at(design: Design, sample: Sample, place: Place, load: float) -> tuple[BudgetLine, ...]:
    """Lines of the uncertainty [m] of a place that load sets find. Arguments as for `expected_places`.

    `locate` is no linear function of the shares. So a line is what it adds to ten load sets, the fewest that a
    tolerance has, beside the error of the table.
    """
    scatter, still, quiet = np.array(design.tooth_covariance), np.zeros((2, 2)), (0.0, 0.0)
    noise = share_noise(design, tooth_shares(design, sample, place), load)
    table = _place_u(design, sample, place, quiet, still)

    def added(noise: Sequence[float], scatter: Floats) -> float:
        u = _place_u(design, sample, place, [each / math.sqrt(FIRST) for each in noise], scatter / FIRST)
        return math.sqrt(FIRST * max(u**2 - table**2, 0.0))

    return (
        BudgetLine(SCATTER, added(quiet, scatter), RepeatUnit.SET, PRIOR_FREEDOM),
        BudgetLine(BY_NOISE, added(noise, still), RepeatUnit.SECOND),
        BudgetLine(TABLE, table, RepeatUnit.NOTHING),
    )


def _place_u(design: Design, sample: Sample, place: Place, noise: Sequence[float], scatter: Floats) -> float:
    """Standard uncertainty of a place [m] by shares of some noise and of some relative covariance."""
    shares = tooth_shares(design, sample, place)
    apart = scatter * np.outer(shares, shares) + np.diag(np.square(noise) + ERROR**2 / 3)
    together = np.linalg.cholesky(apart)
    square = 0.0
    for (one, own), (other, its) in product(QUADRATURE, repeat=2):
        off = (shares + together @ (one, other)).tolist()
        square += own * its * locate(design, sample, off, noise, scatter).u ** 2
    return math.sqrt(square)
