"""Estimates of the solid model, as `estimates` has those of the round one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.finite_elements.ladder import differences
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.solid.ladders import OF_FEW_TEETH, Resolution, has_many_teeth, refinements
from palpate.instrument.sensor.material import PVDF
from tests.benchmarks.common import Row
from tests.benchmarks.estimates import (
    RATIOS,
    Array,
    Claim,
    Tried,
    Truth,
    campaign,
    changes,
    claim,
    errors,
    is_closed,
    left_over,
)
from tests.settings import disc, solid_sensors

SEED = 91_000_000
EVERY_CAPPED = 7
ROUND_REFINEMENTS = axisymmetric.REFINEMENTS[:4]
FINER = Resolution(layers=5, ratio=0.15, sectors=1, degree=5, stiff=4)
# What the last change to the judge leaves: to the finest mesh, to a finer one, and for many teeth from the first mesh
# of few teeth to the second.
LEFT, LEFT_CLOSED, LEFT_OF_FINER, LEFT_OF_MANY = 0.6, 1.5, 0.3, 0.1
MANY_REFINEMENTS = (0, 1)


def sensor(number: int) -> SolidParameters:
    """The sensor of that number: of ten five are discs, two squares, one a point load, a pair and an array."""
    seed, kind = SEED + number, number % 10
    if kind < 5:
        drawn = replace(solid_sensors(1, 0, 0, seed)[0], film=PVDF.round())
    elif kind < 8:
        drawn = next(found for found in _squares(seed) if (found.load_at is None) == (kind < 7))
    else:
        drawn = solid_sensors(0, 0, 2, seed)[number // 20 % 2]
        if number % 10 == 9:
            drawn = replace(drawn, rows=2, columns=2 if number % 20 == 9 else 4)
    return replace(drawn, interface="capped") if number % EVERY_CAPPED == 0 and not is_closed(drawn) else drawn


def _squares(seed: int) -> Iterator[SolidParameters]:
    while True:
        yield solid_sensors(0, 1, 0, seed)[0]
        seed += 1_000_000


def tried(number: int) -> Tried:
    """Judge all meshes of a sensor but the first, and but the finest where that judges."""
    drawn = sensor(number)
    try:
        several = MANY_REFINEMENTS if has_many_teeth(drawn) else refinements(drawn)
        curves = [solid.curve(drawn, refinement).poles for refinement in several]
        found = claims(number, drawn, curves)
        return Tried(number, [asdict(each) for each in found])
    except EstimateError as error:
        return Tried(number, [], str(error))


def claims(number: int, drawn: SolidParameters, curves: Sequence[Curve]) -> Iterator[Claim]:
    """What the estimates of each mesh that can be judged are worth."""
    moduli = RATIOS * drawn.compliant_modulus
    if drawn.outline == "round":
        around = disc(drawn)
        known = [axisymmetric.curve(around, refinement) for refinement in ROUND_REFINEMENTS]
        doubts, left, last = axisymmetric.estimates(known, around, moduli), 0.0, len(curves)
    elif has_many_teeth(drawn):
        known = [solid.curve_on(drawn, finer).poles for finer in OF_FEW_TEETH.resolutions[:2]]
        doubts, left, last = (0.0 * moduli, 0.0 * moduli), LEFT_OF_MANY, len(curves)
    elif drawn.columns * drawn.rows == 1 and drawn.load_at is None:
        known = [*curves, solid.curve_on(drawn, FINER).poles]
        doubts = _rounded(drawn, known[-1], moduli)
        left, last = LEFT_CLOSED if is_closed(drawn) else LEFT_OF_FINER, len(curves)
    else:
        known, doubts = list(curves), (0.0 * moduli, 0.0 * moduli)
        left, last = LEFT_CLOSED if is_closed(drawn) else LEFT, len(curves) - 1
    best = known[-1]
    truth = Truth(best.force_ratios(moduli)[:, 0], best.voltages(moduli)[:, :, 0], *doubts)
    still = left_over(left, changes(known[-2], best, moduli), truth)
    for count in range(2, last + 1):
        bounds = solid.estimates(curves[:count], drawn, moduli)
        found = errors(curves[count - 1], best, moduli, still)
        yield claim(drawn, number, count - 1, found, bounds, truth)


def _rounded(drawn: SolidParameters, judge: Curve, moduli: Array) -> tuple[Array, Array]:
    """What the judge of a square is off by through rounding, as the model tells it of its own meshes."""
    if drawn.sensed_thickness > solid.SHEET * drawn.cell_length:
        return 0.0 * moduli, 0.0 * moduli
    twin = solid.curve_on(solid.in_other_units(drawn), FINER).poles
    ratio, voltage = differences(judge, twin, moduli, solid.UNIT)
    return solid.ROUNDING * ratio, solid.ROUNDING * voltage


def estimates_solid(first: int = 0, sensors: int = 1000) -> Iterator[Row]:
    """Random sensors: is any error estimate of the solid model below the error, and how wide are they?

    Half of the sensors are discs, which the round model knows better; what that may be off by is no error of theirs.
    Others are square cells, some under a load in one point, pairs on one base or two, and arrays of four. A square
    cell under an even load is judged by a mesh that is finer than all of its own, others by the finest of theirs,
    arrays of eight by the second mesh of few teeth. A seventh of all have capped rings.
    """
    yield from campaign("estimates-solid", tried, first, sensors)
