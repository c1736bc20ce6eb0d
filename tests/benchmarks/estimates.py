"""Random sensors: is any error estimate of a finite-element model below the error, and how wide are they?

A quarter of the sensors have an object under which the ratios of the two coarsest meshes cross, where two meshes agree
and are both wrong. Of sensors after the first thousand a third are the solid model's, on one mesh more, and a seventh
have capped rings. Estimates were chosen by some of these, too; the rest only tell whether they hold. Resumable: what
each mesh gives goes to `estimates-VERSION.jsonl` in `$PALPATE_CAMPAIGN` (`campaigns`), VERSION being that of the
models' numbers, and a command that is given again goes on from there: an estimate that was changed is judged on the
same sensors. `$PALPATE_SENSORS` says how many (1,000).
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.axisymmetric.mesh import CLOSED
from palpate.instrument.models.finite_elements.error_estimate import Bounds, Energies, Judged
from palpate.instrument.models.parameters import RoundParameters, SolidParameters
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.stored.surface import CODE_VERSION
from palpate.instrument.sensor.film_material import PVDF
from tests.benchmarks.lines import read
from tests.benchmarks.row import Row
from tests.settings import disc, round_sensors, solid_sensors

SENSORS, SEED = 1000, 15_000_000
CHOSEN_BY = {*range(1140), 1911}  # sensors that estimates were chosen by
SOLID_MESHES, LATER_SOLID_MESHES = (0, 1), (0, 1, 2)
KNOWN = 3  # refinement of the round model that knows a disc of the solid model
EVERY_SOLID, EVERY_LATER_SOLID, EVERY_LATER_CAPPED, EVERY_CROSSING = 10, 3, 7, 4
NEAR = (0.3, 30.0)  # moduli of the object over the ring's between which ratios may cross
HALVINGS = 5
NEGLIGIBLE = 1e-9  # rounding
# What a mesh's change leaves. In a closed gap the error falls by 0.57 from mesh to mesh at the slowest that was seen.
LEFT, LEFT_CLOSED = 0.3, 1.5


@dataclass(frozen=True)
class Tried:
    """One sensor: what each mesh gives, and what the round model knows of a disc; refused: why it was not solved."""

    number: int
    kind: str
    meshes: list[dict[str, Any]]
    known: dict[str, Any] | None
    refused: str = ""


def sensor(number: int) -> tuple[str, RoundParameters | SolidParameters]:
    """The sensor of that number, and what it is for."""
    drawn = _drawn(number)
    what = ", capped" if drawn.interface == "capped" else ""
    if isinstance(drawn, SolidParameters):
        return f"solid{what}", drawn
    crossing = _crossing(drawn) if number % EVERY_CROSSING == 1 else None
    return (f"crossing{what}", crossing) if crossing else (f"random{what}", drawn)


def _drawn(number: int) -> RoundParameters | SolidParameters:
    """The sensor of that number under any object."""
    later = number >= SENSORS
    solid_one = number % (EVERY_LATER_SOLID if later else EVERY_SOLID) == 0
    drawn = _disc(number) if solid_one else round_sensors(1, SEED + number)[0]
    capped = later and number % EVERY_LATER_CAPPED == 0 and not _closed(drawn)
    return replace(drawn, interface="capped") if capped else drawn


def tried(number: int) -> Tried:
    """Solve on all meshes."""
    kind = "random"
    try:
        kind, drawn = sensor(number)
        known = None
        if isinstance(drawn, SolidParameters):
            refinements = LATER_SOLID_MESHES if number >= SENSORS else SOLID_MESHES
            meshes = [solid.solve(drawn, refinement).judged for refinement in refinements]
            known = asdict(axisymmetric.solve(disc(drawn), KNOWN).judged)
        else:
            meshes = [axisymmetric.solve(drawn, refinement).judged for refinement in range(1, _finest(number) + 1)]
    except EstimateError as error:
        return Tried(number, kind, [], None, str(error))
    return Tried(number, kind, [asdict(mesh) for mesh in meshes], known)


def _disc(number: int) -> SolidParameters:
    """A random sensor whose films are the same in every direction, as in the round model."""
    return replace(solid_sensors(1, 0, 0, SEED + number)[0], film=PVDF.round())


def _finest(number: int) -> int:
    """Refinement that the coarser ones are judged by: each takes three times as long as the one before."""
    return 5 if number % 50 == 3 else 4 if number % 5 == 2 or number >= SENSORS else 3


def _crossing(drawn: RoundParameters) -> RoundParameters | None:
    """The sensor under the object where the two coarsest meshes give one ratio; None: there is none."""

    def at(place: float) -> RoundParameters:
        return replace(drawn, sensed_modulus=drawn.compliant_modulus * 10**place)

    def change(place: float) -> float:
        return axisymmetric.solve(at(place), 2).force_ratio - axisymmetric.solve(at(place), 1).force_ratio

    low, high = np.log10(NEAR).tolist()
    below, above = change(low), change(high)
    if below * above >= 0:
        return None
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        here = change(middle)
        low, high, below = (middle, high, here) if here * below > 0 else (low, middle, below)
    return at((low + high) / 2)


@dataclass(frozen=True)
class Claim:
    """Error over estimate of one answer, of the force ratio and of the worst voltage; NaN where there is no film."""

    number: int
    kind: str
    closed: bool
    refinement: int
    ratio: float
    voltage: float


def claims(result: Tried) -> list[Claim]:
    """What the estimates of a sensor's answers are worth."""
    if result.refused:
        return []
    drawn, meshes = _drawn(result.number), [_judged(mesh) for mesh in result.meshes]
    if isinstance(drawn, SolidParameters):
        assert result.known is not None
        bounds = [solid.error_estimate(meshes[:count], drawn) for count in range(2, len(meshes) + 1)]
        answers, references, first = meshes[1:], [_judged(result.known)], 1
    else:
        bounds = [axisymmetric.error_estimate(meshes[:count], drawn) for count in range(2, len(meshes))]
        answers, references, first = meshes[1:-1], meshes[-2:], 2
    return [
        _claim(result, _closed(drawn), first + k, bound, answer, references)
        for k, (bound, answer) in enumerate(zip(bounds, answers, strict=True))
    ]


def _claim(
    result: Tried, closed: bool, refinement: int, bound: Bounds, answer: Judged, references: Sequence[Judged]
) -> Claim:
    """What the bounds of an answer are worth, by the last of the references.

    Args:
        references: the last is the finest; what it changed tells what is left.
    """
    before, reference = references[0], references[-1]
    left = LEFT_CLOSED if closed else LEFT
    error = abs(answer.force_ratio - reference.force_ratio) + left * abs(reference.force_ratio - before.force_ratio)
    volts = [
        abs(own - true) + left * abs(true - last)
        for own, true, last in zip(answer.voltages, reference.voltages, before.voltages, strict=True)
    ]
    voltage = _over(max(volts), bound.voltage) if volts else float("nan")
    return Claim(result.number, result.kind, closed, refinement, _over(error, bound.force_ratio), voltage)


def _over(error: float, bound: float) -> float:
    return 0.0 if error < NEGLIGIBLE else error / bound


def _closed(drawn: RoundParameters | SolidParameters) -> bool:
    return drawn.ring_inner_radius - drawn.tooth_radius < CLOSED * drawn.tooth_radius


def _judged(stored: dict[str, Any]) -> Judged:
    energies = Energies(**stored["energies"])
    return Judged(stored["force_ratio"], tuple(stored["voltages"]), energies, stored["imbalance"])


# --- the state on disk ---------------------------------------------------------------------------------


def measure() -> Iterator[Row]:
    goal = int(os.environ.get("PALPATE_SENSORS", SENSORS))
    file = Path(os.environ.get("PALPATE_CAMPAIGN", "campaigns")) / f"estimates-{CODE_VERSION}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    known = {each.number: each for each in read(file, Tried)}
    try:
        with file.open("a", encoding="utf-8") as out:
            for number in range(goal):
                if number not in known:
                    known[number] = tried(number)
                    out.write(json.dumps(asdict(known[number])) + "\n")
                    out.flush()
    except KeyboardInterrupt:
        print(f"{len(known)} of {goal} sensors; give the command again to go on", file=sys.stderr)  # noqa: T201
    yield from rows([known[number] for number in sorted(known)], goal)


# --- figures -------------------------------------------------------------------------------------------


def rows(results: Sequence[Tried], goal: int) -> Iterator[Row]:
    """The figures of some sensors."""
    refused = sum(1 for result in results if result.refused)
    yield Row("random sensors; refused as too ill-conditioned", f"{len(results)}; {refused}", f"{goal}")
    found = [claim for result in results for claim in claims(result)]
    for whose, some in (
        ("", [claim for claim in found if claim.number in CHOSEN_BY]),
        ("not chosen by: ", [claim for claim in found if claim.number not in CHOSEN_BY]),
    ):
        if some or not whose:
            yield from _figures(some, whose)


def _figures(found: Sequence[Claim], whose: str) -> Iterator[Row]:
    for what in ("ratio", "voltage"):
        values = [(getattr(claim, what), claim) for claim in found if not np.isnan(getattr(claim, what))]
        misses = [claim for value, claim in values if value > 1]
        named = ", ".join(f"sensor {claim.number} refinement {claim.refinement}" for claim in misses[:5])
        yield Row(f"  {whose}estimates of the {what}", f"{len(values)}")
        yield Row(f"    {whose}optimistic estimates of the {what}", f"{len(misses)} {named}".strip(), "0", not misses)
        for closed, gap in ((False, "open gaps"), (True, "closed gaps")):
            for kind in sorted({claim.kind for _, claim in values}):
                shares = np.array([value for value, claim in values if (claim.closed, claim.kind) == (closed, kind)])
                if len(shares):
                    yield Row(
                        f"    {whose}error over estimate, {kind}, {gap}",
                        f"{np.median(shares):.3f} in the middle, {shares.max():.2f} at worst",
                    )
