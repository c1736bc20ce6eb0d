"""Random sensors: is any error estimate of the round model below the error, and how wide are they?

Each sensor is judged on each of its meshes but the first and the finest, under 61 moduli of the object; what the finest
may be rounded by is no error of these. Crossings of two meshes, where these agree and are both wrong, are among them. A
seventh of the sensors have capped rings. `claims` tells how such a campaign is gone on with.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import RoundParameters
from tests.benchmarks.claims import RATIOS, Claim, Tried, Truth, campaign, changes, claim, errors, is_closed, left_over
from tests.benchmarks.row import Row
from tests.settings import round_sensors

SENSORS, SEED = 1000, 19_000_000
EVERY_CAPPED = 7
# What the change to the finest mesh leaves.
LEFT, LEFT_CLOSED = 0.3, 1.5


def sensor(number: int) -> RoundParameters:
    """The sensor of that number."""
    drawn = round_sensors(1, SEED + number)[0]
    return replace(drawn, interface="capped") if number % EVERY_CAPPED == 0 and not is_closed(drawn) else drawn


def tried(number: int) -> Tried:
    """Judge all meshes of a sensor."""
    drawn = sensor(number)
    try:
        curves = [axisymmetric.curve(drawn, refinement) for refinement in axisymmetric.REFINEMENTS[: _finest(number)]]
    except EstimateError as error:
        return Tried(number, [], str(error))
    return Tried(number, [asdict(each) for each in claims(number, drawn, curves)])


def _finest(number: int) -> int:
    """Number of meshes, by the last of which the others are judged: each takes twice as long as the one before."""
    return 5 if number % 5 == 3 else 4


def claims(number: int, drawn: RoundParameters, curves: Sequence[Curve]) -> Iterator[Claim]:
    """What the estimates of each mesh but the first and the finest are worth."""
    moduli = RATIOS * drawn.compliant_modulus
    finest = curves[-1]
    ratios, volts = finest.force_ratios(moduli)[:, 0], finest.voltages(moduli)[:, :, 0]
    truth = Truth(ratios, volts, *axisymmetric.rounding(curves, drawn, moduli))
    left = left_over(LEFT_CLOSED if is_closed(drawn) else LEFT, changes(curves[-2], finest, moduli), truth)
    for count in range(2, len(curves)):
        bounds = axisymmetric.estimates(curves[:count], drawn, moduli)
        found = errors(curves[count - 1], finest, moduli, left)
        yield claim(drawn, number, axisymmetric.REFINEMENTS[count - 1], found, bounds, truth)


def measure() -> Iterator[Row]:
    yield from campaign("estimates", SENSORS, tried)
