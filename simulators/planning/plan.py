"""Plan of a scene: what it simulates, how, and what it leaves out.

    plan(read_scene("thesis_single"), Question()).path

Nothing is integrated in steps: between two transitions a scene is linear and known in closed form. Scenes differ in the
number of transitions. There is none where every limit certainly stays inactive; else the scene is followed from one to
the next. Where only play operators move, their describing functions give the settled state without that.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from palpate.instrument.additions import taken
from palpate.instrument.errors import ConfigError, RangeError
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.load import check_force
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.instrument.signals.dwell import LONGEST
from palpate.simulators.bounds.changes import bound_of
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects import EFFECTS, GROUP, WHAT, effect_class, effect_names, origin
from palpate.simulators.linear.periodic import HERTZ, Periodic
from palpate.simulators.physics.dwells import SimulatedDwell, dwell_of
from palpate.simulators.physics.effect import Bound, Case, Effect
from palpate.simulators.physics.in_order import rival
from palpate.simulators.physics.parts import Touch
from palpate.simulators.planning.impairments import impairments
from palpate.simulators.planning.steady import POINTS, SETTLED, SteadyState, followed, phasors, steady_state
from palpate.simulators.rig.rig import Rig
from palpate.simulators.scenes.scene import RigParameters, Scene, SceneFile

PRELOAD = 0.75  # preload as a fraction of the load: half of the load is its peak, the rest keeps contact
SETTLING = 2.0  # s between a change of the drive and a measurement
LOOKED_AT = 2.0  # s of a scene that are searched for transitions
FOLLOWED = 10.0  # periods of the drive after which transitions usually recur [M]
RATE = 250.0  # samples per second
THESIS_RIG = RigParameters()
# CPU time [s, M] of a transition, of a settled state's phasors, and of a sample of a film: by itself, and for each
# state of the chain. Each effect says what it adds.
A_TRANSITION, A_STEADY_STATE, A_SAMPLE, A_STATE = 1e-3, 5e-5, 3e-8, 5e-9
CLOSED_FORM, DESCRIBING_FUNCTION, TRANSITIONS = "closed form", "describing function", "transitions"


UNITS = {"load": "N", "frequency": "Hz", "dwell": "s"}
FREQUENCIES, DWELLS = (1e-6, 1e6), (1e-6, LONGEST)  # limits in Hz and s; beyond them numbers overflow or vanish


@dataclass(frozen=True, slots=True)
class Question:
    """A measurement: one sample under one load.

    Attributes:
        sample: name of the sample, or the object itself if it is none of the samples.
        load: load, peak to peak [N].
        frequency: frequency of the drive [Hz].
        dwell: dwell [s].
        steady: whether the settled fundamentals are asked for; else the waveforms over the dwell.
    """

    sample: str | Sample = "2"
    load: float = 3.0
    frequency: float = 10.0
    dwell: float = 1.0
    steady: bool = False

    def __post_init__(self) -> None:
        _ = self.pressed  # an unknown name is refused here
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, float) and not (0 < value < math.inf):
                unit = UNITS[item.name]
                raise RangeError(f"{item.name} {value:g} {unit} is not above 0 and finite; give a positive one")
        for value, unit, limits in ((self.frequency, "Hz", FREQUENCIES), (self.dwell, "s", DWELLS)):
            if not limits[0] <= value <= limits[1]:
                raise RangeError(f"{value:g} {unit} is outside {limits[0]:g} to {limits[1]:g} {unit}; give one inside")
        check_force(self.load)

    @property
    def pressed(self) -> Sample:
        """The sample. Raises UnknownName: there is none of that name."""
        return get_sample(self.sample) if isinstance(self.sample, str) else self.sample


@dataclass(frozen=True, slots=True)
class Included:
    """A simulated effect, the reason, and its estimated share of the answer's CPU time [s]."""

    name: str
    kind: str
    cancels_in_ratio: bool
    why: str
    seconds: float


@dataclass(frozen=True, slots=True)
class Omitted:
    """An effect that is not simulated, and the greatest relative change that it could have made; None: no bound."""

    name: str
    kind: str
    force: float | None
    ratio: float | None


@dataclass(frozen=True, slots=True)
class AnswerPlan:
    """How a question about a scene is answered.

    Attributes:
        path: "closed form", "describing function" or "transitions".
        why: reason for this path.
        transitions: number of transitions in each second.
        seconds: estimated CPU time for the answer [s].
        warnings: what will impair the measurement.
        steady: the settled state, where it was asked for.
    """

    path: str
    why: str
    transitions: float
    included: tuple[Included, ...]
    omitted: tuple[Omitted, ...]
    seconds: float
    warnings: tuple[str, ...]
    steady: SteadyState | None


def plan(scene: Scene, question: Question) -> AnswerPlan:
    """Plan for a question: how the scene answers it, and how much the effects that it leaves out could have changed.

    Raises:
        RangeError: the scene's model does not answer for the sample.
    """
    rig = driven(scene, question)
    found = moves(rig, round(LOOKED_AT * 1e9))
    path, why = path_of(found, question.steady)
    steady = None
    if question.steady:
        steady = steady_state(rig, followed(rig) if path == TRANSITIONS else phasors(rig))
    costs = _costs(scene, question, path, found)
    case = case_of(scene.design, scene.model, scene.effects, question, scene.rig, scene.file.parameters)
    omitted, problems = _omitted(scene, case)
    return AnswerPlan(
        path=path,
        why=why,
        transitions=len(found) / LOOKED_AT,
        included=tuple(
            Included(name, effect.kind, effect.cancels_in_ratio, scene.called[name], costs[name])
            for name, effect in scene.effects.items()
        ),
        omitted=tuple(omitted),
        seconds=sum(costs.values()),
        warnings=(*impairments(scene, rig, question.pressed, question.load, RATE), *problems),
        steady=steady,
    )


def driven(scene: Scene, question: Question, clock: VirtualClock | None = None) -> Rig:
    """A rig with the sample preloaded and the drive just set for the load, as if nothing limited it."""
    rig = Rig(scene, clock or VirtualClock())
    sample = question.pressed
    rig.mount(sample)
    touching = scene.rig.sensor_position - sample.thickness
    stiffness = scene.answer(sample).stiffness
    rig.set_position(touching + PRELOAD * question.load * (1 / stiffness + 1 / scene.rig.suspension_stiffness))
    volts = question.load / 2 / abs(rig.transfer(question.frequency)[-1])
    frequency = round(question.frequency * HERTZ)
    rig.set_voltage(Periodic(0.0, frequency, 0, 0, np.array([1]), np.array([-1j * volts])))
    return rig


def case_of(
    design: Design,
    model: str,
    effects: Mapping[str, Effect],
    question: Question,
    rig: RigParameters = THESIS_RIG,
    parameters: str | None = None,
) -> Case:
    """The question in the form that the bounds of effects need; `design` includes the parameter set's numbers."""
    file = SceneFile(name="case", purpose="bounds", design=design.name, model=model, parameters=parameters, rig=rig)
    bare = Scene("case", "bounds", design, model, None, "", 1, 1, rig, {}, {}, file)

    def with_these(chosen: Mapping[str, Effect]) -> Rig:
        return driven(replace(bare, effects=chosen), question)

    @functools.cache  # the bounds of many effects examine the same scene without them
    def followed(chosen: frozenset[tuple[str, Effect]]) -> SimulatedDwell:
        return dwell_of(with_these(dict(chosen)), len(design.films), SETTLING, question.dwell, RATE)

    return Case(
        design=design,
        frequency=question.frequency,
        dwell=question.dwell,
        rate=RATE,
        settled=SETTLING,
        effects=effects,
        driven=with_these,
        follow=lambda chosen: followed(frozenset(chosen.items())),
    )


def _costs(scene: Scene, question: Question, path: str, found: list[set[str]]) -> dict[str, float]:
    """CPU time of each effect [s], and under "" that of the sensor by itself."""
    costs = dict.fromkeys(("", *scene.effects), 0.0)
    if question.steady and path != TRANSITIONS:
        return {**costs, "": A_STEADY_STATE}
    over = SETTLED + 1 / question.frequency if question.steady else question.dwell
    over = min(over, FOLLOWED / question.frequency)
    samples = (POINTS if question.steady else question.dwell * RATE) * len(scene.design.films)

    def states(effects: Mapping[str, Effect]) -> int:
        return Rig(replace(scene, effects=effects), VirtualClock()).without_limits()[0].order

    of_all = states(scene.effects)
    for name, effect in scene.effects.items():
        own = of_all - states({k: v for k, v in scene.effects.items() if k != name})
        added = 0.0 if question.steady else effect.seconds_a_sample
        met = sum(effect.moves in moved for moved in found) / LOOKED_AT
        costs[name] = samples * (own * A_STATE + added) + met * over * A_TRANSITION
    costs[""] = samples * (A_SAMPLE + states({}) * A_STATE) + A_TRANSITION
    costs[""] += sum("contact" in moved for moved in found) / LOOKED_AT * over * A_TRANSITION
    return costs


def moves(rig: Rig, until_ns: int) -> list[set[str]]:
    """The changes at each transition, from the present settings up to a time."""
    return [
        {item.name for item in fields(Touch) if getattr(before, item.name) != getattr(after, item.name)}
        for before, after in rig.transitions(until_ns)
    ]


def path_of(found: list[set[str]], steady: bool) -> tuple[str, str]:
    """Path of a scene with these transitions, and the reason."""
    if not found:
        return CLOSED_FORM, "it is proven for each limit of the bench that the drive does not reach it"
    moved = set[str]().union(*found)
    if steady and moved == {"drag"}:
        return DESCRIBING_FUNCTION, "play operators move on a sine, outside any loop; no limit acts"
    return TRANSITIONS, ", ".join(sorted(_NAMES[name] for name in moved))


_NAMES = {
    "contact": "the probe loses contact",
    "rail": "the amplifier clips",
    "current": "the current limit acts",
    "stop": "the armature meets a stop",
    "drag": "play operators move",
}


def _omitted(scene: Scene, case: Case) -> tuple[list[Omitted], list[str]]:
    """The effects that the scene leaves out, and what is wrong with those of other packages that cannot be weighed."""
    left = [_weighed(name, scene, case) for name in EFFECTS if name not in scene.effects]
    problems = taken(GROUP, WHAT, EFFECTS)
    for name in effect_names()[len(EFFECTS) :]:
        if name not in scene.effects:
            try:
                left.append(_weighed(name, scene, case))
            except ConfigError as error:
                problems.append(f"left out and not weighed: {error}")
            except Exception as error:  # code of another package can raise anything
                problems.append(
                    f"left out and not weighed: effect {name!r}{origin(name)}, fails: {error!r}; mend its package"
                )
    return left, problems


def _weighed(name: str, scene: Scene, case: Case) -> Omitted:
    effect = effect_class(name)()
    bound = Bound(0.0, 0.0) if rival(effect, scene.effects) else bound_of(case, effect)
    return Omitted(name, effect.kind, _finite(bound.force), _finite(bound.ratio))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
