"""What a position sweep is expected to give: the uncertainty of each place that the films find.

It is that of `locate` for the shares of the table of point loads. The gains scatter as the design says [M], noise is
that of usual films [A]. Where two places give nearly the same shares, the uncertainty depends on how the gains fall:
so it is the root mean square over shares that are off by both, by Gauss and Hermite's rule of three points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

from palpate.instrument.findings.film_forces import ratio_scatter
from palpate.instrument.findings.position import locate
from palpate.instrument.models.influence import tooth_shares
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.engine.plan import NOISE
from palpate.procedures.engine.promise import Expected

QUADRATURE = ((-math.sqrt(3), 1 / 6), (0.0, 2 / 3), (math.sqrt(3), 1 / 6))  # of a normal distribution


def expected_places(
    design: Design, sample: Sample, places: Sequence[tuple[float, float]], load: float, dwell: float
) -> list[Expected]:
    """Standard uncertainty of each place [mm]; their names are those of the places.

    Args:
        design: design of the sensor.
        sample: the sample.
        places: places (x, y) of the point load [m].
        load: load, peak to peak [N].
        dwell: dwell of each point [s].
    """
    base = next(film for film in design.films if film.kind == FILM_KINDS[1])
    rigid = [film for film in design.films if film is not base]
    scatter = [ratio_scatter(design, film, base) for film in rigid]
    of_one = 2 * NOISE / math.sqrt(dwell) / load  # of a share, in one film, times its sensitivity
    found = []
    for place in places:
        shares = tooth_shares(design, sample, place)
        noise = [
            of_one * math.hypot(1 / film.sensitivity, share / base.sensitivity)
            for film, share in zip(rigid, shares, strict=True)
        ]
        apart = [math.hypot(u, share * own) for u, share, own in zip(noise, shares, scatter, strict=True)]
        square = 0.0
        for (one, own), (other, its) in product(QUADRATURE, repeat=2):
            off = shares[0] + one * apart[0], shares[1] + other * apart[1]
            square += own * its * locate(design, sample, off, noise, scatter).u ** 2
        found.append(Expected(f"position at {1e3 * place[0]:g} mm", 1e3 * math.sqrt(square), "mm"))
    return found
