"""Does `measure modulus` keep what it promises? Answers, intervals and bench times over a thousand seeds of each truth.

The truth is not what the procedure assumes: gains scatter as stated or otherwise, mountings scatter, cables move, the
sensor lies off its model's curve. Runs draw their ratios as the simulated bench does (`modulus_bench.py`); a share runs
on the wire. Resumable: blocks of runs go to `modulus-budget-VERSION.jsonl` in `$PALPATE_CAMPAIGN` (`campaigns`).
`$PALPATE_SEEDS` says how many seeds, `$PALPATE_WORKERS` how many processes.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.instrument.errors import EstimateError, PalpateError
from palpate.instrument.findings import object_modulus
from palpate.instrument.models.curve import RatioCurve
from palpate.procedures.measurements.object_modulus import planning as lines
from palpate.procedures.measurements.object_modulus import procedure as course
from palpate.procedures.measurements.object_modulus.procedure import ObjectModulus
from palpate.simulators.effects.curve_error import CurveError
from tests.benchmarks.lines import read
from tests.benchmarks.modulus_bench import MODEL, Truth, fast
from tests.benchmarks.modulus_figures import Block, rows
from tests.benchmarks.modulus_references import calibrated
from tests.benchmarks.row import Row

SEEDS, BLOCK = 1000, 100
MODULI = (15e3, 30e3, 60e3, 120e3, 250e3, 500e3)
TOLERANCES = (0.4, 0.2, 0.1, 0.04)
FREEDOM = 7.0  # degrees of freedom of the stated scatter
SAMPLES, DISTANCE = 5, 6  # degrees of freedom of the spread of the thesis' samples about a curve, and of their distance
ROOT = Path(__file__).parents[2]
SOURCES = ("instrument/allocation", "procedures/measurements/object_modulus", "simulators/effects")
CABLES = {"charge": "0.1 pC"}


@dataclass(frozen=True)
class Kind:
    """A truth, and what the procedure is told of it.

    Attributes:
        effects: those that draw, with their parameters.
        known: whether the scatter of gains is certain for the procedure; else the design's counts as an estimate.
        drawn: whether the true scatter, or distance from the curve, is drawn by what its degrees of freedom leave open.
        mounted: scatter of mountings that the procedure is told.
        phased: whether the pick-up of each film's cable has a phase of its own, drawn anew; else all are in step.
        references: whether three references calibrate the model, for each seed anew.
        tolerances, moduli: those that are tried [1, Pa].
    """

    effects: dict[str, dict[str, Any]]
    known: bool = False
    drawn: bool = False
    mounted: float = 0.0
    phased: bool = False
    references: bool = False
    tolerances: tuple[float, ...] = (0.2, 0.04)
    moduli: tuple[float, ...] = MODULI

    def truth(self, modulus: float, seed: int) -> Truth:
        effects = dict(self.effects)
        chance = np.random.default_rng([20, seed])
        if self.drawn and "curve_error" in effects:
            spread = CurveError().spread * math.sqrt(SAMPLES / float(chance.chisquare(SAMPLES)))
            constant = CurveError().constant
            if not self.references:  # nothing tells the constant
                constant *= float(chance.normal()) * math.sqrt(DISTANCE / float(chance.chisquare(DISTANCE)))
            effects["curve_error"] = {"constant": min(3.0, max(-3.0, constant)), "spread": min(0.5, spread)}
        elif self.drawn:
            strength = min(10.0, math.sqrt(FREEDOM / float(chance.chisquare(FREEDOM))))
            effects["gain_scatter"] = {**effects["gain_scatter"], "strength": strength}
        truth = Truth(modulus, effects, seed, phased=self.phased)
        return replace(truth, references=calibrated(truth)) if self.references else truth


SCATTER: dict[str, dict[str, Any]] = {"gain_scatter": {}}
KINDS = {
    "scatter known": Kind(SCATTER, known=True, tolerances=TOLERANCES),
    "scatter known, fine": Kind(SCATTER, known=True, tolerances=(0.02,), moduli=(15e3, 60e3)),
    "scatter learned": Kind(SCATTER, tolerances=TOLERANCES),
    "scatter drawn": Kind(SCATTER, drawn=True),
    "scatter x 1.5": Kind({"gain_scatter": {"strength": 1.5}}),
    "mounting scatter 1 %": Kind({**SCATTER, "mounting_scatter": {"scatter": 0.01}}, mounted=0.01),
    "moving cables": Kind({**SCATTER, "triboelectric": CABLES}),
    "moving cables, any phase, scatter drawn": Kind({**SCATTER, "triboelectric": CABLES}, drawn=True, phased=True),
    "off the model's curve by a drawn distance": Kind(
        {**SCATTER, "curve_error": {}}, drawn=True, tolerances=(0.2,), moduli=MODULI[:3]
    ),
    "off the curve, references": Kind({**SCATTER, "curve_error": {}}, references=True, tolerances=(0.2,)),
    "off the curve by a drawn spread, references": Kind(
        {**SCATTER, "curve_error": {}}, drawn=True, references=True, tolerances=(0.2,)
    ),
}


def measure() -> Iterator[Row]:
    seeds = int(os.environ.get("PALPATE_SEEDS", SEEDS))
    file = Path(os.environ.get("PALPATE_CAMPAIGN", "campaigns")) / f"modulus-budget-{_version()}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    known = {each.key: each for each in read(file, Block)}
    cells = [
        (name, tolerance, modulus, first)
        for first in range(0, seeds, BLOCK)
        for name, kind in KINDS.items()
        for tolerance in kind.tolerances
        for modulus in kind.moduli
    ]
    try:
        with file.open("a", encoding="utf-8") as out:
            for each in _blocks([cell for cell in cells if cell not in known]):
                known[each.key] = each
                out.write(json.dumps(asdict(each)) + "\n")
                out.flush()
    except KeyboardInterrupt:
        print(f"{len(known)} of {len(cells)} blocks; give the command again to go on", file=sys.stderr)  # noqa: T201
    yield from rows([known[cell] for cell in cells if cell in known])


def _blocks(cells: Sequence[tuple[str, float, float, int]]) -> Iterator[Block]:
    workers = int(os.environ.get("PALPATE_WORKERS", "1"))
    if workers == 1:
        yield from map(_block, cells)
    else:
        with ProcessPoolExecutor(workers) as pool:
            yield from pool.map(_block, cells)


def _block(cell: tuple[str, float, float, int]) -> Block:
    name, tolerance, modulus, first = cell
    return block(name, tolerance, modulus, range(first, first + BLOCK))


def block(name: str, tolerance: float, modulus: float, seeds: Sequence[int]) -> Block:
    """Runs of a kind of truth, with an object [Pa], by a tolerance on the model's scale."""
    kind = KINDS[name]
    with _told(kind):
        try:
            runs = [_run(kind, tolerance, truth) for truth in _truths(kind, modulus, seeds)]
        except PalpateError as error:  # of the plan, before anything is drawn
            return Block(name, tolerance, modulus, seeds[0], [], str(error).split("\n")[0])
    return Block(name, tolerance, modulus, seeds[0], runs)


def _truths(kind: Kind, modulus: float, seeds: Sequence[int]) -> Iterator[Truth]:
    """The truths of some seeds. References that contradict each other are refused: there is no run."""
    for seed in seeds:
        try:
            yield kind.truth(modulus, seed)
        except EstimateError:
            continue


def asked(kind: Kind, tolerance: float, truth: Truth) -> ObjectModulus:
    """The procedure that measures an object to a tolerance on the model's scale."""
    return ObjectModulus(
        truth.object, tolerance=tolerance, relative_to_model=True, model=MODEL, mounting_scatter=kind.mounted
    )


def _run(kind: Kind, tolerance: float, truth: Truth) -> list[float]:
    """In the order of `modulus_figures.Run`."""
    measuring = asked(kind, tolerance, truth)
    done, plan = fast(measuring, truth), measuring.course_on(truth.target).prospect
    assert done.answer is not None
    row = done.answer.row
    stated = "absolute_u" if "curve_error" in kind.effects else "scale_u"
    told = {name: math.nan if row[name] is None else row[name] for name in ("modulus_Pa", stated)}
    ends = [row[f"{of}_{end}_Pa"] for of in ("scale", "absolute") for end in ("low", "high")]
    scale, absolute = ((low or 0.0) <= truth.modulus <= (high or math.inf) for low, high in (ends[:2], ends[2:]))
    return [
        math.log(told["modulus_Pa"] / truth.modulus),
        told[stated],
        plan.scale_u or math.nan,
        float(scale),
        float(absolute),
        len(done.points),
        done.seconds,
        plan.times.mean,
        plan.times.longest,
    ]


_KNOWN: dict[tuple[int, float], tuple[RatioCurve, float | None]] = {}  # holds the curve, so that its id stays its own


def _sensitivity(curve: RatioCurve, ratio: float) -> float | None:
    """Of a ratio to three digits: the sensitivity is found by search, and changes by less than 1 % between them."""
    rounded = float(f"{ratio:.3g}")
    if (id(curve), rounded) not in _KNOWN:
        _KNOWN[id(curve), rounded] = curve, lines.sensitivity_at(curve, rounded)
    return _KNOWN[id(curve), rounded][1]


@contextmanager
def _told(kind: Kind) -> Iterator[None]:
    """The procedure takes the stated scatter as certain, or as an estimate; plans and validation are kept."""
    places, freedom = (lines, course), math.inf if kind.known else FREEDOM
    was, validation = lines.PRIOR_FREEDOM, object_modulus.validation_u
    try:
        for place in places:
            place.PRIOR_FREEDOM = freedom  # type: ignore[attr-defined]
        object_modulus.validation_u = functools.cache(validation)  # type: ignore[assignment]
        course.sensitivity_at = _sensitivity  # type: ignore[attr-defined]
        yield
    finally:
        for place in places:
            place.PRIOR_FREEDOM = was  # type: ignore[attr-defined]
        object_modulus.validation_u = validation
        course.sensitivity_at = lines.sensitivity_at  # type: ignore[attr-defined]


def _version() -> str:
    """Of plans, courses and answers, of what draws, and of this campaign."""
    digest = hashlib.sha256()
    own = [Path(__file__), Path(__file__).with_name("modulus_bench.py")]
    for path in sorted([*own, *(each for folder in SOURCES for each in (ROOT / folder).glob("*.py"))]):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]
