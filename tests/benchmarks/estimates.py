"""Random sensors: is any error estimate of a finite-element model below the error, and how wide are they?

A quarter of the sensors have an object under which the ratios of the two coarsest meshes cross, where two meshes agree
and are both wrong. Resumable: what each mesh gives goes to `estimates-VERSION.jsonl` in `$PALPATE_CAMPAIGN`
(`campaigns`), VERSION being that of the models' numbers, and a command that is given again goes on from there: an
estimate that was changed is judged on the same sensors. `$PALPATE_SENSORS` says how many.
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
SOLID_MESHES = (0, 1)
KNOWN = 3  # refinement of the round model that knows a disc of the solid model
EVERY_SOLID, EVERY_CROSSING = 10, 4
NEAR = (0.3, 30.0)  # moduli of the object over the ring's between which ratios may cross
HALVINGS = 5
NEGLIGIBLE = 1e-9  # rounding
# In a closed gap the error falls by 0.57 from mesh to mesh at the slowest that was seen: what the last change leaves.
LEFT = 1.5


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
    if number % EVERY_SOLID == 0:
        return "solid", _disc(number)
    (drawn,) = round_sensors(1, SEED + number)
    if number % EVERY_CROSSING == 1:
        crossing = _crossing(drawn)
        return ("crossing", crossing) if crossing else ("random", drawn)
    return "random", drawn


def tried(number: int) -> Tried:
    """Solve on all meshes."""
    kind = "random"
    try:
        kind, drawn = sensor(number)
        known = None
        if isinstance(drawn, SolidParameters):
            meshes = [solid.solve(drawn, refinement).judged for refinement in SOLID_MESHES]
            known = asdict(axisymmetric.solve(disc(drawn), KNOWN).judged)
        else:
            meshes = [axisymmetric.solve(drawn, refinement).judged for refinement in range(1, _finest(number) + 1)]
    except EstimateError as error:
        return Tried(number, kind, [], None, str(error))
    return Tried(number, kind, [asdict(mesh) for mesh in meshes], known)


def _disc(number: int) -> SolidParameters:
    """Of films that are the same in every direction, as the round model has them."""
    return replace(solid_sensors(1, 0, 0, SEED + number)[0], film=PVDF.round())


def _finest(number: int) -> int:
    """Refinement that the coarser ones are judged by: each takes three times as long as the one before."""
    return 5 if number % 50 == 3 else 4 if number % 5 == 2 else 3


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
    meshes = [_judged(mesh) for mesh in result.meshes]
    if result.known is not None:
        drawn = _disc(result.number)
        bound = solid.error_estimate(meshes, drawn)
        return [_claim(result, _closed(drawn), SOLID_MESHES[-1], bound, meshes[-1], [_judged(result.known)])]
    (drawn_round,) = round_sensors(1, SEED + result.number)
    *answers, reference = meshes
    return [
        _claim(
            result,
            _closed(drawn_round),
            k + 1,
            axisymmetric.error_estimate(answers[: k + 1], drawn_round),
            answers[k],
            [answers[-1], reference],
        )
        for k in range(1, len(answers))
    ]


def _claim(
    result: Tried, closed: bool, refinement: int, bound: Bounds, answer: Judged, references: Sequence[Judged]
) -> Claim:
    """What the bounds of an answer are worth, by the last of the references.

    Args:
        references: the last is the finest; in a closed gap what it changed tells what is left.
    """
    before, reference = references[0], references[-1]
    left = LEFT if closed else 0.0
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
    found = [claim for result in results for claim in claims(result)]
    refused = sum(1 for result in results if result.refused)
    yield Row("random sensors; refused as too ill-conditioned", f"{len(results)}; {refused}", f"{goal}")
    for what in ("ratio", "voltage"):
        values = [(getattr(claim, what), claim) for claim in found if not np.isnan(getattr(claim, what))]
        misses = [claim for value, claim in values if value > 1]
        named = ", ".join(f"sensor {claim.number} refinement {claim.refinement}" for claim in misses[:5])
        yield Row(f"  estimates of the {what}", f"{len(values)}")
        yield Row(f"    optimistic estimates of the {what}", f"{len(misses)} {named}".strip(), "0", not misses)
        for group, members in _groups(values):
            shares = np.array([value for value, _ in members])
            if len(shares):
                yield Row(
                    f"    error over estimate, {group}",
                    f"{np.median(shares):.3f} in the middle, {shares.max():.2f} at worst",
                )


def _groups(values: Sequence[tuple[float, Claim]]) -> Iterator[tuple[str, list[tuple[float, Claim]]]]:
    for closed in (False, True):
        gap = "closed gaps" if closed else "open gaps"
        for kind in ("random", "crossing", "solid"):
            yield f"{kind}, {gap}", [(v, c) for v, c in values if c.closed == closed and c.kind == kind]
