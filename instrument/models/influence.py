"""Shares of a point load that the teeth of the common base take, from a table of the solid model.

    tooth_shares(get_design("common_base"), get_sample("1"), (6e-3, 6e-3))      # (0.77, 0.0)

`influence.csv` holds the force on the left tooth for 1 N on the centre line, over each of the six samples. It was
computed by `point_loads` on the coarsest mesh, at positions 0.5 mm apart, because one load takes seconds. The object of
that model sticks to the sensor and would pull at a tooth far away, which a touching object cannot do: such shares count
as 0.
"""

from __future__ import annotations

import csv
import functools
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES, Sample

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

DESIGN = "common_base"
STORED = Path(__file__).with_suffix(".csv")
ERROR = 1.3e-2
"""Bound on the error of a share: four times the next mesh's change (3.1e-3, sample 1), and 1e-4 of the spline.

It counts the discretisation alone. An object that slides, or a load of some width, changes the shares by more.
"""


def tooth_shares(design: Design, sample: Sample, at: tuple[float, float]) -> tuple[float, ...]:
    """Force on each tooth over the whole force, under a load in one point, (x, y) from the sensor's corner [m].

    Raises:
        RangeError: the table does not hold this design or object, or the point is off the sensor or its centre line.
    """
    _check(design, sample)
    check_place(design, at[0])
    if abs(at[1] - design.cell[1] / 2) > 1e-9:
        raise RangeError(
            f"place y = {show(at[1], 'm')} is off the centre line; the table of point loads has "
            f"y = {show(design.cell[1] / 2, 'm')} only"
        )
    return tuple(float(share) for share in shares_along(design, sample, np.array([at[0]]))[:, 0])


def shares_along(design: Design, sample: Sample, x: Floats) -> Floats:
    """Shares (2, n) of the teeth under loads on the centre line at x (n,) [m]. Raises RangeError."""
    _check(design, sample)
    left = _spline(sample.name)
    found: Floats = np.maximum(np.stack([left(x), left(design.plate.length - x)]), 0.0)
    return found


def check_place(design: Design, x: float) -> None:
    """Refuse a place off the sensor. Raises RangeError."""
    if not 0 <= x <= design.plate.length:
        raise RangeError(
            f"position {show(x, 'm')} is off the sensor, which reaches from 0 to {show(design.plate.length, 'm')}"
        )


def _check(design: Design, sample: Sample) -> None:
    if not (_is_known(design) and SAMPLES.get(sample.name) == sample):
        raise RangeError(
            f"design {design.name!r} with object {sample.name!r}: point loads are known for design {DESIGN!r} with "
            f"samples {', '.join(SAMPLES)}; take those, or `palpate model` with the model 'solid'"
        )


def _is_known(design: Design) -> bool:
    """Whether the table holds this design; what a bench tells of its films and cables moves no load."""
    shipped = get_design(DESIGN)
    if design.name != shipped.name:
        return False
    alike = replace(
        design,
        films=shipped.films,
        scatter_correlation=shipped.scatter_correlation,
        film_covariance=None,
        film_freedom=None,
        pickup=None,
        noise=None,
    )
    return alike == shipped


@functools.cache
def _spline(sample: str) -> CubicSpline:
    from scipy.interpolate import CubicSpline

    with STORED.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return CubicSpline(
        [1e-3 * float(row["x_mm"]) for row in rows], [float(row[f"sample_{sample}"]) for row in rows], extrapolate=False
    )
