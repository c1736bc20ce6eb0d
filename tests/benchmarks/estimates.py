"""What error estimates of random sensors claim, held against the errors.

An estimate that was changed needs another campaign.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import CLOSED, CODE_VERSION, RoundParameters, SolidParameters
from tests.benchmarks.common import Campaign, Row, at_least, none
from tests.settings import round_sensors

# --- claims --------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

RATIOS = np.logspace(-1, 5, 61)  # moduli of the object over the ring's
HALF_DECADE = 5  # of these
NEGLIGIBLE = 1e-7  # an error that is none: rounding, and what the truth is off by
LAZY, MOST = 0.1, 0.9  # the greatest error around over the estimate is above this in so many


@dataclass(frozen=True)
class Claim:
    """What the estimates of one mesh of a sensor are worth.

    Attributes:
        number: number of the sensor.
        closed: whether its gap is closed.
        refinement: refinement of the mesh.
        points: number of moduli with an error that is not negligible.
        ratio: greatest error of the force ratio over its estimate, at any of these.
        voltage: the same of the worst voltage; None: there is no film.
        eager: number of these moduli at which the greatest error within half a decade is a tenth of the estimate.
    """

    number: int
    closed: bool
    refinement: int
    points: int
    ratio: float
    voltage: float | None
    eager: int


@dataclass(frozen=True)
class Tried:
    """One sensor; refused: why it was not solved."""

    number: int
    claims: list[dict[str, float]]
    refused: str = ""


@dataclass(frozen=True)
class Truth:
    """What is known better than by a mesh that is judged.

    Attributes:
        ratios: force ratios by the moduli.
        voltages: (moduli, films), voltages under 1 N [V].
        ratio_doubts: what the ratios may be off by; so much of an error does not count.
        voltage_doubts: what any voltage may be off by [V].
    """

    ratios: Array
    voltages: Array
    ratio_doubts: Array
    voltage_doubts: Array


def changes(coarse: Curve, fine: Curve, moduli: Array) -> tuple[Array, Array]:
    """Changes from one mesh to the next: of force ratios (moduli,), and of voltages (moduli, films) [V]."""
    ratio = np.abs(fine.force_ratios(moduli) - coarse.force_ratios(moduli))[:, 0]
    return ratio, np.abs(fine.voltages(moduli) - coarse.voltages(moduli))[:, :, 0]


def errors(judged: Curve, best: Curve, moduli: Array, left: tuple[Array, Array]) -> tuple[Array, Array]:
    """Errors of one mesh, as `changes`: its changes to the best mesh, and what these leave (`left_over`)."""
    ratio, voltage = changes(judged, best, moduli)
    return ratio + left[0], voltage + left[1]


def left_over(share: float, last: tuple[Array, Array], truth: Truth) -> tuple[Array, Array]:
    """What the best mesh is still off by: a share of the last changes that led to it, where these are beyond doubt."""
    ratio, voltage = last
    found = np.maximum(ratio - truth.ratio_doubts, 0.0), np.maximum(voltage - truth.voltage_doubts[:, None], 0.0)
    return share * found[0], share * found[1]


def claim(
    sensor: RoundParameters | SolidParameters,
    number: int,
    refinement: int,
    errors: tuple[Array, Array],
    bounds: tuple[Array, Array],
    truth: Truth,
) -> Claim:
    """What the bounds of one mesh are worth.

    Args:
        sensor: the sensor.
        number: its number.
        refinement: refinement of the mesh.
        errors: its errors of force ratios (moduli,) and voltages (moduli, films) [V].
        bounds: bounds on both, by the moduli.
        truth: what they are errors against.
    """
    wrong = np.maximum(errors[0] - truth.ratio_doubts, 0.0)
    off = np.maximum(errors[1].max(axis=1, initial=0.0) - truth.voltage_doubts, 0.0)
    around = np.array([wrong[max(0, k - HALF_DECADE) : k + HALF_DECADE + 1].max() for k in range(len(wrong))])
    counted = wrong > NEGLIGIBLE
    felt = off > NEGLIGIBLE * np.abs(truth.voltages).max(axis=1, initial=0.0)
    return Claim(
        number=number,
        closed=is_closed(sensor),
        refinement=refinement,
        points=int(counted.sum()),
        ratio=float((wrong / bounds[0])[counted].max(initial=0.0)),
        voltage=float((off / bounds[1])[felt].max(initial=0.0)) if truth.voltages.shape[1] else None,
        eager=int((around >= LAZY * bounds[0])[counted].sum()),
    )


def is_closed(sensor: RoundParameters | SolidParameters) -> bool:
    return sensor.ring_inner_radius - sensor.tooth_radius < CLOSED * sensor.tooth_radius


def campaign(name: str, tried: Callable[[int], Tried], first: int, sensors: int) -> Iterator[Row]:
    """Try sensors one after the other, as far as they were not tried before."""
    kept = Campaign(name, str(CODE_VERSION))
    known = {each["number"] for each in kept.found}
    found = kept.go_on(asdict(tried(number)) for number in range(first, first + sensors) if number not in known)
    yield from rows([Tried(**each) for each in found], sensors)


def rows(results: Sequence[Tried], goal: int) -> Iterator[Row]:
    """The figures of some sensors."""
    refused = sum(1 for result in results if result.refused)
    yield Row("random sensors; refused as too ill-conditioned", f"{len(results)}; {refused}", f"{goal}")
    claimed = [Claim(**each) for result in results for each in result.claims]
    for gap, found in (("open", [c for c in claimed if not c.closed]), ("closed", [c for c in claimed if c.closed])):
        if not found:
            continue
        points = sum(each.points for each in found)
        for what in ("ratio", "voltage"):
            values = [(value, each) for each in found if (value := getattr(each, what)) is not None]
            misses = [f"sensor {each.number} refinement {each.refinement}" for value, each in values if value > 1]
            worst = max((each[0] for each in values), default=0.0)
            yield none(
                f"  {gap} gaps, {points} points: meshes with an error of the {what} above its estimate",
                len(misses),
                f"{', '.join([str(len(misses)), *misses[:5]])}; {worst:.2f} at worst",
            )
        # the greatest error within half a decade is above a tenth of the estimate
        eager = sum(each.eager for each in found) / max(points, 1)
        figure = f"  {gap} gaps: points at which the estimate is sharp"
        yield at_least(figure, eager, MOST, "{:.0%}") if gap == "open" else Row(figure, f"{eager:.0%}")


# --- estimates -----------------------------------------------------------------------------------------

SEED = 19_000_000
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


def estimates(first: int = 0, sensors: int = 1000) -> Iterator[Row]:
    """Random sensors: is any error estimate of the round model below the error, and how wide are they?

    Each sensor is judged on each of its meshes but the first and the finest, under 61 moduli of the object; what the
    finest may be rounded by is no error of these. Crossings of two meshes, where these agree and are both wrong, are
    among them. A seventh of the sensors have capped rings.
    """
    yield from campaign("estimates", tried, first, sensors)
