"""Random sensors: is any error estimate of a finite-element model below the error, and how wide are they?

Each sensor is judged on each of its meshes but the first and the finest, under 61 moduli of the object; what the finest
may be rounded by is no error of these. Crossings of
two meshes, where these agree and are both wrong, are among them. A seventh of the sensors have capped rings. Resumable:
what each sensor gives goes to `estimates-VERSION.jsonl` in `$PALPATE_CAMPAIGN` (`campaigns`), VERSION being that of the
models' numbers, and a command that is given again goes on from there. Curves are kept on disk: in another folder, an
estimate that was changed is judged on the same sensors at once. `$PALPATE_SENSORS` says how many (1,000),
`$PALPATE_FIRST` from which number on (0).
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import CLOSED, RoundParameters
from palpate.instrument.models.stored.version import CODE_VERSION
from tests.benchmarks.lines import read
from tests.benchmarks.row import Row
from tests.settings import round_sensors

Array = NDArray[np.float64]

SENSORS, SEED = 1000, 19_000_000
EVERY_CAPPED = 7
RATIOS = np.logspace(-1, 5, 61)  # moduli of the object over the ring's
HALF_DECADE = 5  # of these
NEGLIGIBLE = 1e-7  # an error that is none: rounding, and what the finest mesh is off by
# What the change to the finest mesh leaves.
LEFT, LEFT_CLOSED = 0.3, 1.5
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


def sensor(number: int) -> RoundParameters:
    """The sensor of that number."""
    drawn = round_sensors(1, SEED + number)[0]
    return replace(drawn, interface="capped") if number % EVERY_CAPPED == 0 and not _closed(drawn) else drawn


def tried(number: int) -> Tried:
    """Judge all meshes of a sensor."""
    drawn = sensor(number)
    try:
        curves = [axisymmetric.curve(drawn, refinement) for refinement in axisymmetric.REFINEMENTS[: _finest(number)]]
    except EstimateError as error:
        return Tried(number, [], str(error))
    return Tried(number, [asdict(claim) for claim in claims(number, drawn, curves)])


def _finest(number: int) -> int:
    """Number of meshes, by the last of which the others are judged: each takes twice as long as the one before."""
    return 5 if number % 5 == 3 else 4


def claims(number: int, drawn: RoundParameters, curves: Sequence[Curve]) -> Iterator[Claim]:
    """What the estimates of each mesh but the first and the finest are worth."""
    moduli = RATIOS * drawn.compliant_modulus
    closed = _closed(drawn)
    last, finest = (curve.force_ratios(moduli)[:, 0] for curve in curves[-2:])
    volts_last, volts = (curve.voltages(moduli)[:, :, 0] for curve in curves[-2:])
    left = LEFT_CLOSED if closed else LEFT
    rounded, rounded_volts = axisymmetric.rounding(curves, drawn, moduli)
    for count in range(2, len(curves)):
        bounds, told = axisymmetric.estimates(curves[:count], drawn, moduli)
        errors = np.abs(curves[count - 1].force_ratios(moduli)[:, 0] - finest) + left * np.abs(finest - last)
        errors = np.maximum(errors - rounded, 0.0)
        off = (np.abs(curves[count - 1].voltages(moduli)[:, :, 0] - volts) + left * np.abs(volts - volts_last)).max(
            axis=1, initial=0.0
        )
        off = np.maximum(off - rounded_volts, 0.0)
        around = np.array([errors[max(0, k - HALF_DECADE) : k + HALF_DECADE + 1].max() for k in range(len(errors))])
        counted = errors > NEGLIGIBLE
        felt = off > NEGLIGIBLE * np.abs(volts).max(axis=1, initial=0.0)
        yield Claim(
            number=number,
            closed=closed,
            refinement=axisymmetric.REFINEMENTS[count - 1],
            points=int(counted.sum()),
            ratio=float((errors / bounds)[counted].max(initial=0.0)),
            voltage=float((off / told)[felt].max(initial=0.0)) if volts.shape[1] else None,
            eager=int((around >= LAZY * bounds)[counted].sum()),
        )


def _closed(drawn: RoundParameters) -> bool:
    return drawn.ring_inner_radius - drawn.tooth_radius < CLOSED * drawn.tooth_radius


def measure() -> Iterator[Row]:
    first, goal = int(os.environ.get("PALPATE_FIRST", 0)), int(os.environ.get("PALPATE_SENSORS", SENSORS))
    file = Path(os.environ.get("PALPATE_CAMPAIGN", "campaigns")) / f"estimates-{CODE_VERSION}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    known = {each.number: each for each in read(file, Tried)}
    try:
        with file.open("a", encoding="utf-8") as out:
            for number in range(first, first + goal):
                if number not in known:
                    known[number] = tried(number)
                    out.write(json.dumps(asdict(known[number])) + "\n")
                    out.flush()
    except KeyboardInterrupt:
        print(f"{len(known)} of {goal} sensors; give the command again to go on", file=sys.stderr)  # noqa: T201
    yield from rows([known[number] for number in sorted(known)], goal)


def rows(results: Sequence[Tried], goal: int) -> Iterator[Row]:
    """The figures of some sensors."""
    refused = sum(1 for result in results if result.refused)
    yield Row("random sensors; refused as too ill-conditioned", f"{len(results)}; {refused}", f"{goal}")
    found = [Claim(**claim) for result in results for claim in result.claims]  # type: ignore[arg-type]
    for closed, gap in ((False, "open gaps"), (True, "closed gaps")):
        some = [claim for claim in found if claim.closed is closed]
        if some:
            yield from _figures(some, gap)


def _figures(found: Sequence[Claim], gap: str) -> Iterator[Row]:
    points = sum(claim.points for claim in found)
    for what in ("ratio", "voltage"):
        values = [(value, claim) for claim in found if (value := getattr(claim, what)) is not None]
        misses = [claim for value, claim in values if value > 1]
        named = ", ".join(f"sensor {claim.number} refinement {claim.refinement}" for claim in misses[:5])
        worst = max((value for value, _ in values), default=0.0)
        yield Row(
            f"  {gap}, {points} points: meshes with an error of the {what} above its estimate",
            f"{len(misses)} {named}".strip() + f", error over estimate {worst:.2f} at worst",
            "0",
            not misses,
        )
    eager = sum(claim.eager for claim in found) / max(points, 1)
    yield Row(
        f"  {gap}: greatest error within half a decade above a tenth of the estimate of the ratio",
        f"{eager:.0%} of points",
        f">= {MOST:.0%}" if gap == "open gaps" else "",
        eager >= MOST if gap == "open gaps" else None,
    )
