"""Does `measure modulus` keep what it promises, on benches whose truth is not what the procedure assumes?

A bench is on the wire, or one that draws ratios as the simulated bench does. The second is fast: it draws gains,
mountings and the distance of each object from the curve by the scene's own effects, at clock times of its own. Its
noise is that of a least-squares sine in white noise. Plan, course and answer are the procedure's own.
"""

from __future__ import annotations

import functools
import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from palpate.instrument.allocation.stopping import first_sets
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.calibration.model_calibration import MeasuredReference, ModelCalibration, fit_model
from palpate.instrument.errors import EstimateError, PalpateError
from palpate.instrument.findings import object_modulus
from palpate.instrument.findings.object_modulus import ByReferences
from palpate.instrument.models.curve import RatioCurve
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.validation import Validation, validate
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.lab.lab import Target, with_kinds
from palpate.procedures.measurements.loads import LoadSweep
from palpate.procedures.measurements.object_modulus import planning as lines
from palpate.procedures.measurements.object_modulus import procedure as course
from palpate.procedures.measurements.object_modulus.planning import END, costs_of, expected, most_sets
from palpate.procedures.measurements.object_modulus.procedure import ObjectModulus, mounts_again
from palpate.procedures.measurements.object_modulus.report import ModulusPoint, ObjectModulusAnswer
from palpate.procedures.measurements.softness import unknown_object
from palpate.simulators.effects import effect_class, in_order
from palpate.simulators.effects.curve_error import CurveError
from palpate.simulators.physics.effect import Effect, Effects
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.randomness import Stream
from palpate.simulators.scenes.scene import Scene
from palpate.testing import steps
from tests.benchmarks.common import (
    Campaign,
    Row,
    at_least,
    at_most,
    between,
    measured,
    opened,
    version_of,
)

# --- modulus bench -------------------------------------------------------------------------------------

MODEL = "surface"
SCENE = "poor_seating"  # whose chain and model are taken; effects that draw are those of the truth
DRAWING = ("curve_error", "mounting_scatter", "gain_scatter", "triboelectric")
DENSITY = 2e-6  # V/√Hz, white noise of that scene


@dataclass(frozen=True)
class Truth:
    """A bench with an object of known modulus [Pa] and effects that draw, by name with their parameters.

    `phased`: the pick-up of each film's cable has a phase of its own, which no effect of a scene has.
    """

    modulus: float
    effects: dict[str, dict[str, Any]] = field(default_factory=dict)
    seed: int = 1
    references: ByReferences | None = None
    phased: bool = False

    @cached_property
    def scene(self) -> Scene:
        plain = _plain()
        own: dict[str, Effect] = {name: effect_class(name).model_validate(of) for name, of in self.effects.items()}
        others = {name: effect for name, effect in plain.effects.items() if name not in DRAWING}
        effects = in_order({**others, **own})
        return replace(plain, effects=effects, called=dict.fromkeys(effects, "called for"), seed=self.seed)

    @cached_property
    def object(self) -> Sample:
        return unknown_object(self.scene.design, modulus=self.modulus)

    @property
    def design(self) -> Design:
        """As the bench file states it, with the pick-up of its cables."""
        return self.scene.design.with_pickup(self.scene.pickup)

    @property
    def target(self) -> Target:
        force_limit = BenchDescription.model_fields["force_limit"].default
        calibrated = (THESIS_LOAD_CELL.least_N, THESIS_LOAD_CELL.greatest_N)
        target = Target(self.design, force_limit, self.scene.nodes, calibrated=calibrated, references=self.references)
        return with_kinds(target, self.scene.kind_in)


@functools.cache
def _plain() -> Scene:
    return read_scene(SCENE)


@functools.cache
def _on_the_curve(modulus: float) -> float:
    """Force ratio of an object by the scene's model."""
    return _plain().answer(Truth(modulus).object).force_ratio


class Draws:
    """Force ratios of one truth, as the rig would have them."""

    def __init__(self, truth: Truth) -> None:
        self._truth, self._effects = truth, Effects(truth.scene.effects)
        self._plain = _on_the_curve(truth.modulus)
        drawing = (*self._effects.share, *self._effects.films)
        phases = np.random.default_rng([7, truth.seed]).uniform(0, 2 * math.pi, 2) if truth.phased else np.zeros(2)
        self._pickup = truth.scene.pickup * np.cos(phases)
        self._streams = {effect.name: Stream(truth.seed, effect.name) for effect in drawing}

    def ratio(self, set_at_ns: int, mounted_at_ns: int) -> float:
        """The ratio of a set without noise."""
        design, films = self._truth.scene.design, self._effects.films
        changes = [
            effect.ln_change(self._truth.object, self._streams[effect.name], mounted_at_ns)
            for effect in self._effects.share
        ]
        forces = np.array([self._plain * math.exp(math.fsum(changes)), 1.0])
        for effect in films:
            drawn_at_ns = mounted_at_ns if effect.by_mounting else set_at_ns
            forces = effect.matrix(design, self._streams[effect.name], drawn_at_ns) @ forces
        rigid, total = forces + self._pickup
        return float(rigid / total)

    def noise(self, load: float, dwell: float, ratio: float) -> float:
        """Relative standard deviation of a set's ratio by white noise, under a load [N, peak to peak]."""
        rigid, total = (film.sensitivity * load / 2 for film in self._truth.scene.design.films)
        return DENSITY / math.sqrt(dwell) * math.hypot(1 / (rigid * ratio), 1 / total)


@dataclass(frozen=True, slots=True)
class Done:
    """A run: its points and answer, bench time [s], for each set when it began and when its object was mounted [ns]."""

    points: list[ModulusPoint]
    answer: ObjectModulusAnswer | None
    seconds: float
    began: list[tuple[int, int]]


def fast(asked: ObjectModulus, truth: Truth, steps: int | None = None, *, every: bool = False) -> Done:
    """A run by the procedure's own plan, course and answer, on drawn ratios; at most so many sets.

    The course is asked after every set, as a procedure asks it, only with `every`. Else it is asked again after half of
    the sets that it still wants in a mounting: what it wants moves by less than that. Part of the last of several
    mountings may be enough: there it is asked after every set, too.
    """
    course, draws = asked.course_on(truth.target), Draws(truth)
    load, plan = course.prospect.allocation.load, course.prospect.allocation
    costs = costs_of(load, asked.frequency)
    rng = np.random.default_rng(truth.seed)
    points: list[ModulusPoint] = []
    began: list[tuple[int, int]] = []
    taken, spent, mounting, mounted = costs.start - END, costs.start - END, 0, 0
    following = 1 if every else first_sets(plan)  # before the first sets are complete, a tolerance alone goes on
    for number in range(most_sets(course.prospect, course.wanted) if steps is None else steps):
        verdict = course.verdict(points) if number >= following else None
        if verdict and verdict.why:
            break
        if not points or (verdict and mounts_again(points, verdict)):
            mounting += 1
            mounted = round(1e9 * taken)
            spent += costs.mounting
            taken += costs.mounting
        if verdict:
            more = verdict.sets // verdict.mountings - sum(point.mounting == mounting for point in points)
            left = int((course.prospect.times.longest - taken - END) / (costs.set + plan.dwell))  # until the bound
            following = number + (1 if every or mounting > 1 else max(1, min(more, left) // 2))
        began.append((round(1e9 * taken), mounted))
        ratio = draws.ratio(*began[-1])
        noise = draws.noise(load, plan.dwell, ratio)
        ratio *= 1 + noise * float(rng.standard_normal())
        spent, taken = spent + costs.set + plan.dwell, taken + costs.set + plan.dwell
        points.append(_point(mounting, load, ratio, ratio * noise, plan.dwell, spent))
        spent = 0.0
    return Done(points, course.answer(points), taken + END, began)


def _point(mounting: int, load: float, ratio: float, noise: float, dwell: float, seconds: float) -> ModulusPoint:
    return ModulusPoint(
        mounting=mounting,
        load_N=load,
        load_measured_N=load,
        load_measured_u=0.0,
        force_ratio=ratio,
        force_ratio_u=noise,
        noise_u=noise,
        calibration_u=0.0,
        pickup_u=0.0,
        degrees_of_freedom=math.inf,
        dwell_s=dwell,
        seconds=seconds,
        valid=True,
        flags=(),
        attempts=1,
        incidents=0,
        free_m=0.0,
    )


def on_the_wire(asked: ObjectModulus, truth: Truth) -> Done:
    """The same run on the simulated bench, by its devices and buses."""
    began: list[tuple[int, int]] = []
    with tempfile.TemporaryDirectory() as folder, opened(truth.scene) as (simulated, bench):

        def seen(done: int, _total: int, _what: str) -> None:
            if done > len(began):
                began.append((simulated.rig.set_at_ns, simulated.rig.mounted_at_ns))

        result = measured(asked, bench, truth.design, Path(folder), steps(seen))
        return Done(result.points, result.answer, 1e-9 * simulated.clock.now_ns(), began)


def differences(done: Done, truth: Truth) -> Iterator[float]:
    """Ratios of a run on the wire less those that are drawn for its own times, in standard deviations of noise."""
    draws = Draws(truth)
    for point, times in zip(done.points, done.began, strict=True):
        yield (point.force_ratio - draws.ratio(*times)) / point.noise_u


# --- modulus references --------------------------------------------------------------------------------

REFERENCES = (25e3, 75e3, 200e3)  # Pa; none of them is an object of the campaign
STATED = 0.02  # relative standard uncertainty of their moduli
SETS = 6
ABOUT = {
    "design": "single", "model": MODEL, "parameters": "physical", "thickness_m": 3e-3, "device": "drawn",
    "simulated": True, "source": "drawn", "created": "2000-01-01T00:00:00+00:00", "expires": "2100-01-01",
}  # fmt: skip


@functools.cache
def _by_the_curve(modulus: float) -> tuple[float, float]:
    """Force ratio and sensitivity of an object by the model."""
    found = expected(RatioQuestion("single", MODEL), modulus)
    return found.ratio, found.sensitivity or math.nan


@functools.cache
def _known() -> Validation:
    return validate("single", "physical", MODEL)


def calibrated(truth: Truth) -> ByReferences:
    """The model's calibration on the bench of a truth; each reference is as far off its stated modulus as it may be."""
    chance, measured = np.random.default_rng([3, truth.seed]), []
    for number, modulus in enumerate(REFERENCES):
        real = replace(truth, modulus=modulus)
        draws, scatter = Draws(real), real.scene.design.ratio_scatter
        logs = [math.log(draws.ratio(round(1e9 * (number * 100 + each)), number)) for each in range(SETS)]
        ratio, slope = _by_the_curve(modulus)
        stated = modulus * math.exp(STATED * float(chance.standard_normal()))
        ratio *= (stated / modulus) ** (1 / slope)
        measured.append(
            MeasuredReference(
                f"reference {number}", stated, STATED, "stated", math.exp(math.fsum(logs) / SETS),
                scatter / math.sqrt(SETS), 0.0, 0.0, ratio, slope,
            )
        )  # fmt: skip
    found: ModelCalibration = fit_model(measured, _known(), ABOUT)
    return ByReferences(found)


# --- modulus figures -----------------------------------------------------------------------------------

SPREAD = {"scatter known": (0.9, 1.1), "scatter known, fine": (0.9, 1.1)}
SPREAD |= dict.fromkeys(("scatter learned", "scatter drawn"), (0.9, 1.2))


class Run(NamedTuple):
    """One run: logarithm of answer over truth; relative standard uncertainties that it and its plan state; whether both
    intervals hold the truth; number of sets; bench times of the run, that is predicted, and of its bound [s]."""

    error: float
    stated: float
    planned: float
    scale: float
    absolute: float
    sets: float
    seconds: float
    planned_seconds: float
    bound_seconds: float


@dataclass(frozen=True, slots=True)
class Block:
    """Runs of some seeds in a row; `refused`: why the plan refuses them."""

    kind: str
    tolerance: float
    modulus: float
    first: int
    runs: list[list[float]] = field(default_factory=list)
    refused: str = ""

    @property
    def key(self) -> tuple[str, float, float, int]:
        return self.kind, self.tolerance, self.modulus, self.first


@dataclass(frozen=True, slots=True)
class Cell:
    """All runs of a kind of truth, a tolerance and an object."""

    kind: str
    tolerance: float
    modulus: float
    runs: list[Run]

    def mean(self, name: str) -> float:
        return float(np.mean([getattr(run, name) for run in self.runs]))

    def over_predicted(self) -> float:
        """Mean bench time over the predicted one."""
        return self.mean("seconds") / self.mean("planned_seconds")

    def against_sweeps(self, seconds: float) -> float:
        """Bench time over that of sweeps of six sets which are repeated until they state as little."""
        return self.mean("seconds") / (math.ceil(self.mean("sets") / 6 - 1e-9) * seconds)

    def spread(self) -> float:
        """Standard deviation of the answers over the mean of what they state."""
        told = [run for run in self.runs if math.isfinite(run.error)]  # else only a bound is known
        return float(np.std([run.error for run in told], ddof=1) / np.mean([run.stated for run in told]))

    @property
    def told(self) -> str:
        return f"{self.modulus / 1e3:g} kPa, {self.tolerance:.0%}"


def cells_of(blocks: Sequence[Block]) -> list[Cell]:
    found: dict[tuple[str, float, float], Cell] = {}
    for each in blocks:
        key = each.kind, each.tolerance, each.modulus
        runs = found.setdefault(key, Cell(*key, [])).runs
        runs += [Run(*run) for run in each.runs]
    return [cell for cell in found.values() if cell.runs]


def rows(blocks: Sequence[Block]) -> Iterator[Row]:
    """Of each kind of truth; the least and the greatest are those of its cells."""
    cells = cells_of(blocks)
    for kind in dict.fromkeys(cell.kind for cell in cells):
        own = [cell for cell in cells if cell.kind == kind]
        count = f"{len(own)} of object and tolerance, {min(len(cell.runs) for cell in own)} seeds"
        refused = len({(b.tolerance, b.modulus) for b in blocks if b.kind == kind and b.refused})
        yield Row(kind, count + (f"; {refused} are refused" if refused else ""))
        yield _all_within("standard deviation of answers / mean stated u", SPREAD.get(kind), own, Cell.spread)
        scale = "absolute" if kind.startswith("off") else "scale"
        total = float(np.mean([cell.mean(scale) for cell in own]))
        yield between(
            f"  95 % intervals that hold, {scale}",
            total,
            (0.93, 0.97),
            "{:.0%}",
            f"{total:.1%}; {_ends(own, lambda cell, of=scale: cell.mean(of))}",
        )
        yield _all_within("mean bench time / predicted", (0.9, 1.1), own, Cell.over_predicted)
        below = float(np.mean([run.seconds <= run.bound_seconds for cell in own for run in cell.runs]))
        yield at_least("  runs within the bound of bench time", below, 0.95, "{:.0%}", f"{below:.1%}")
    known = [cell for cell in cells if cell.kind.startswith("scatter known")]
    for tolerance, goal in ((0.02, 0.45), (0.01, 0.20)):
        if some := [cell for cell in known if cell.tolerance == tolerance]:
            whole = sweep_seconds()
            share, told = max((cell.against_sweeps(whole), cell.told) for cell in some)
            yield at_most(
                f"bench time over that of default sweeps of {whole:.1f} s, {tolerance:.0%}",
                share,
                goal,
                "{:.0%}",
                f"{share:.0%} ({told})",
            )


def _ends(cells: Sequence[Cell], of: Callable[[Cell], float]) -> str:
    found = sorted((of(cell), cell.told) for cell in cells)
    return " to ".join(f"{value:.3g} ({told})" for value, told in (found[0], found[-1]))


def _all_within(
    figure: str, ends: tuple[float, float] | None, cells: Sequence[Cell], of: Callable[[Cell], float]
) -> Row:
    """The goal holds for each cell."""
    if ends is None:
        return Row(f"  {figure}", _ends(cells, of))
    met = all(ends[0] <= of(cell) <= ends[1] for cell in cells)
    return Row(f"  {figure}", _ends(cells, of), f"{ends[0]} to {ends[1]}", met)


def sweep_seconds() -> float:
    """Bench time of the default load sweep of one sample [s]."""
    truth = Truth(60e3, {"gain_scatter": {}})
    with tempfile.TemporaryDirectory() as folder, opened(truth.scene) as (simulated, bench):
        measured(LoadSweep(("4",)), bench, truth.design, Path(folder))
        return 1e-9 * simulated.clock.now_ns()


# --- modulus budget ------------------------------------------------------------------------------------

BLOCK = 100
MODULI = (15e3, 30e3, 60e3, 120e3, 250e3, 500e3)
TOLERANCES = (0.4, 0.2, 0.1, 0.04)
FREEDOM = 7.0  # degrees of freedom of the stated scatter
SAMPLES, DISTANCE = 5, 6  # degrees of freedom of the spread of the thesis' samples about a curve, and of their distance
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


def modulus_budget(seeds: int = 1000, workers: int = 1) -> Iterator[Row]:
    """Does `measure modulus` keep what it promises? Answers, intervals and bench times over a thousand seeds of each
    truth.

    The truth is not what the procedure assumes: gains scatter as stated or otherwise, mountings scatter, cables move,
    the sensor lies off its model's curve. Runs draw their ratios as the simulated bench does (`fast`).
    Resumable: blocks of runs go into a campaign.
    """
    code = ("tests/benchmarks/modulus.py", *(f"{folder}/*.py" for folder in SOURCES))
    campaign = Campaign("modulus-budget", version_of(*code))
    cells = [
        (name, tolerance, modulus, first)
        for first in range(0, seeds, BLOCK)
        for name, kind in KINDS.items()
        for tolerance in kind.tolerances
        for modulus in kind.moduli
    ]
    known = {Block(**each).key for each in campaign.found}
    with ProcessPoolExecutor(workers) as pool:
        found = campaign.go_on(map(asdict, pool.map(_block, [cell for cell in cells if cell not in known])))
    yield from rows([block for block in (Block(**each) for each in found) if block.key in cells])


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
    """In the order of `Run`."""
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
    freedom, cached = math.inf if kind.known else FREEDOM, functools.cache(object_modulus.validation_u)
    with (
        mock.patch.object(lines, "PRIOR_FREEDOM", freedom),
        mock.patch.object(course, "PRIOR_FREEDOM", freedom),
        mock.patch.object(object_modulus, "validation_u", cached),
        mock.patch.object(course, "sensitivity_at", _sensitivity),
    ):
        yield


# --- modulus wire --------------------------------------------------------------------------------------

# kind of truth, tolerance, object [Pa], seed
RUNS = (
    ("scatter learned", 0.05, 15e3, 1),
    ("scatter learned", 0.05, 60e3, 2),
    ("scatter learned", 0.05, 500e3, 2),
    ("scatter learned", 0.02, 120e3, 3),
    ("scatter x 1.5", 0.05, 500e3, 4),
    ("mounting scatter 1 %", 0.03, 60e3, 5),
    ("moving cables", 0.1, 30e3, 6),
    ("off the model's curve by a drawn distance", 0.1, 250e3, 7),
)


def compared(kind: str, tolerance: float, modulus: float, seed: int) -> tuple[list[float], float, float]:
    """Ratios on the wire less drawn ones in standard deviations of noise; bench times on the wire and drawn [s]."""
    truth: Truth = KINDS[kind].truth(modulus, seed)
    measuring = asked(KINDS[kind], tolerance, truth)
    done = on_the_wire(measuring, truth)
    steps = len(done.points)
    drawn = fast(measuring, truth, steps)
    return list(differences(done, truth)), done.seconds, drawn.seconds


def modulus_wire() -> Iterator[Row]:
    """The share of `modulus_budget` that runs on the wire: drawn ratios are the bench's, and so is the time."""
    far, ratios, five = [], [], []
    for kind, tolerance, modulus, seed in RUNS:
        deviates, seconds, drawn = compared(kind, tolerance, modulus, seed)
        far += deviates
        ratios.append(seconds / drawn)
        five += [seconds] if (kind, tolerance) == RUNS[0][:2] else []
    rms = math.sqrt(math.fsum(z * z for z in far) / len(far))
    yield between(
        f"ratios of {len(RUNS)} runs on the wire less drawn ones / their noise, rms of {len(far)}",
        rms,
        (0.8, 1.25),
        "{:g}",
        f"{rms:.2f}, {max(map(abs, far)):.1f} at most",
    )
    farthest = max(ratios, key=lambda ratio: abs(ratio - 1))
    yield between("bench time of as many sets on the wire / drawn, farthest", farthest, (0.9, 1.1), "{:.2f}")
    yield at_most(
        "5 % on the scale, 15 to 500 kPa: bench time with the person's 60 s",
        max(five),
        85,
        "{:.1f} s",
        f"{min(five):.1f} to {max(five):.1f} s",
    )
