"""What error estimates of random sensors claim, held against the errors; campaigns that can be ended and gone on with.

What each sensor gives goes to `NAME-VERSION.jsonl` in `$PALPATE_CAMPAIGN` (`campaigns`), VERSION being that of the
models' numbers. A command that is given again goes on from there, so that an estimate that was changed needs another
folder. `$PALPATE_SENSORS` says how many, `$PALPATE_FIRST` from which number on (0).
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import CLOSED, CODE_VERSION, RoundParameters, SolidParameters
from tests.benchmarks.lines import read
from tests.benchmarks.row import Row

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


def campaign(name: str, sensors: int, tried: Callable[[int], Tried]) -> Iterator[Row]:
    """Try sensors one after the other, as far as they were not tried before."""
    first, goal = int(os.environ.get("PALPATE_FIRST", 0)), int(os.environ.get("PALPATE_SENSORS", sensors))
    file = Path(os.environ.get("PALPATE_CAMPAIGN", "campaigns")) / f"{name}-{CODE_VERSION}.jsonl"
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
    found = [Claim(**each) for result in results for each in result.claims]  # type: ignore[arg-type]
    for closed, gap in ((False, "open gaps"), (True, "closed gaps")):
        some = [each for each in found if each.closed is closed]
        if some:
            yield from _figures(some, gap)


def _figures(found: Sequence[Claim], gap: str) -> Iterator[Row]:
    points = sum(each.points for each in found)
    for what in ("ratio", "voltage"):
        values = [(value, each) for each in found if (value := getattr(each, what)) is not None]
        misses = [each for value, each in values if value > 1]
        named = ", ".join(f"sensor {each.number} refinement {each.refinement}" for each in misses[:5])
        worst = max((value for value, _ in values), default=0.0)
        yield Row(
            f"  {gap}, {points} points: meshes with an error of the {what} above its estimate",
            f"{len(misses)} {named}".strip() + f", error over estimate {worst:.2f} at worst",
            "0",
            not misses,
        )
    yield _eagerness(found, f"{gap}: greatest error within half a decade above a tenth of the estimate", gap)
    for refinement in sorted({each.refinement for each in found}):
        some = [each for each in found if each.refinement == refinement]
        yield _eagerness(some, f"  the same on refinement {refinement}", "")


def _eagerness(found: Sequence[Claim], figure: str, gap: str) -> Row:
    eager = sum(each.eager for each in found) / max(sum(each.points for each in found), 1)
    return Row(
        f"  {figure}",
        f"{eager:.0%} of points",
        f">= {MOST:.0%}" if gap == "open gaps" else "",
        eager >= MOST if gap == "open gaps" else None,
    )
