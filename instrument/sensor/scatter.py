"""Scatter of films' gains as a whole: its covariance, and the triangle by which it is drawn.

Both are computed in plain Python: a triangle by a BLAS would give a simulated bench other bytes on another processor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from palpate.instrument.errors import RangeError

Matrix = tuple[tuple[float, ...], ...]
Correlations = Mapping[tuple[str, str], float]

NOTHING = 1e-9  # of a film's variance: what is left of it below that is rounding of the stated correlations


def covariance_of(scatter: Mapping[str, float], correlation: Correlations) -> Matrix:
    """Relative covariance (films, films) of gains.

    Args:
        scatter: film's name -> relative standard deviation of its gain.
        correlation: names of two films -> correlation of their gains; films of no such pair are independent.

    Raises:
        RangeError: a scatter is not 0 to 1, a pair names no two films or comes twice, a correlation is outside -1 to 1.
    """
    for name, deviation in scatter.items():
        if not 0 <= deviation < 1:
            raise RangeError(f"film {name!r}: its scatter {deviation:g} is not from 0 to below 1; correct it")
    coefficients = {(name, name): 1.0 for name in scatter}
    for pair, coefficient in correlation.items():
        if len({*pair} & {*scatter}) != 2 or len(pair) != 2:
            raise RangeError(
                f"scatter_correlation of {pair!r}: give the names of two of its films: {', '.join(scatter)}"
            )
        if pair in coefficients:
            raise RangeError(f"scatter_correlation of {pair!r}: the pair is given twice; leave one out")
        if not -1 <= coefficient <= 1:
            raise RangeError(f"scatter_correlation of {pair!r}: {coefficient:g} is not from -1 to 1; correct it")
        one, other = pair
        coefficients[one, other] = coefficients[other, one] = coefficient
    return tuple(
        tuple(coefficients.get((one, other), 0.0) * scatter[one] * scatter[other] for other in scatter)
        for one in scatter
    )


def triangle(covariance: Matrix, names: tuple[str, ...]) -> Matrix:
    """Lower triangle L with L Lᵀ = covariance: L z has that covariance where z are independent standard normals.

    Raises:
        RangeError: there is none, as the correlations cannot all be true together.
    """
    rows: list[list[float]] = []
    for i, wanted in enumerate(covariance):
        row: list[float] = []
        for j, other in enumerate([*rows, row]):
            left = wanted[j] - math.fsum(a * b for a, b in zip(row, other, strict=False))
            limit = NOTHING * math.sqrt(wanted[i] * covariance[j][j])
            if j == i and left >= -limit:
                row.append(math.sqrt(left) if left > limit else 0.0)
            elif j < i and other[j]:
                row.append(left / other[j])
            elif j < i and abs(left) <= math.sqrt(NOTHING) * math.sqrt(wanted[i] * covariance[j][j]):
                row.append(0.0)  # film j scatters just as those before it say
            else:
                raise RangeError(
                    f"scatter_correlation: film {names[i]!r} cannot correlate so with"
                    f" {', '.join(map(repr, names[:i]))}:"
                    " the matrix of all correlations is not positive semidefinite; bring those of this film nearer to 0"
                )
        rows.append(row)
    return tuple((*row, *[0.0] * (len(rows) - len(row))) for row in rows)
