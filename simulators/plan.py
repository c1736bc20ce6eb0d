"""What a scene will simulate, how, and what it leaves out.

    plan(read_scene("thesis_single"), Question()).path

Nothing is ever stepped: between two transitions a scene is linear and known in closed form. What differs is how many
transitions there are: none where every limit certainly stays inactive, else the scene goes from one to the next.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from instrument.contracts.sensor_node import RANGE_VOLTS
from instrument.design import Design
from instrument.errors import RangeError
from instrument.load import Load
from instrument.models.response import response
from instrument.sample import SAMPLES, get_sample
from simulators.chain import Touch
from simulators.clock import VirtualClock
from simulators.effects import EFFECTS, effect_class
from simulators.effects.effect import Bound, Case, Effect
from simulators.lti import HERTZ, Periodic
from simulators.rig import Rig
from simulators.scene import RigParameters, Scene, SceneFile

PRELOAD = 0.75  # of the load: half of it is its peak, the rest keeps contact
SETTLING = 2.0  # s between a change of the drive and a measurement
LOOKED_AT = 2.0  # s of a scene that are searched for transitions
RATE = 250.0  # samples a second
THESIS_RIG = RigParameters()
THESIS_LOADS = (1.5, 4.0)  # N, the least and the greatest of A2.9 to A2.14
SIGNAL_STEPS, NOISE_STEPS = 20.0, 0.5
# CPU time [M]: of a change or a transition, and of a sample of a film.
SECONDS_A_TRANSITION, SECONDS_A_SAMPLE = 1e-3, 4e-7


@dataclass(frozen=True, slots=True)
class Question:
    """A measurement: one sample under one load.

    Attributes:
        sample: name.
        load: peak to peak [N].
        frequency: of the drive [Hz].
        dwell: how long is measured [s].
    """

    sample: str = "2"
    load: float = 3.0
    frequency: float = 10.0
    dwell: float = 1.0

    def __post_init__(self) -> None:
        get_sample(self.sample)
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, float) and not (0 < value < math.inf):
                raise RangeError(f"{item.name} {value:g} of a question is not above 0 and finite; give a positive one")


@dataclass(frozen=True, slots=True)
class Included:
    """An effect that is simulated, and why."""

    name: str
    kind: str
    cancels_in_ratio: bool
    why: str


@dataclass(frozen=True, slots=True)
class Omitted:
    """An effect that is not simulated, and the most that it could have changed, relative; None: without limit."""

    name: str
    kind: str
    force: float | None
    ratio: float | None


@dataclass(frozen=True, slots=True)
class Plan:
    """How a question about a scene is answered.

    Attributes:
        path: "closed form" or "transitions".
        why: what forces it.
        transitions: found in each second.
        seconds: estimated CPU time for the dwell.
        warnings: what the measurement will suffer from.
    """

    path: str
    why: str
    transitions: float
    included: tuple[Included, ...]
    omitted: tuple[Omitted, ...]
    seconds: float
    warnings: tuple[str, ...]


def plan(scene: Scene, question: Question) -> Plan:
    """How the scene answers the question, and what what it leaves out could have changed.

    Raises:
        RangeError: the scene's model does not answer for the sample.
    """
    found = driven(scene, question).transitions(round(LOOKED_AT * 1e9))
    path, why = _path(found)
    case = case_of(scene.design, scene.model, scene.effects, question, scene.rig)
    count = len(found) / LOOKED_AT
    samples = question.dwell * RATE * len(scene.design.films)
    return Plan(
        path=path,
        why=why,
        transitions=count,
        included=tuple(
            Included(name, effect.kind, effect.cancels_in_ratio, scene.called[name])
            for name, effect in scene.effects.items()
        ),
        omitted=tuple(_omitted(scene, case)),
        seconds=SECONDS_A_TRANSITION * (1 + count * question.dwell) + SECONDS_A_SAMPLE * samples,
        warnings=tuple(_warnings(scene, case)),
    )


def driven(scene: Scene, question: Question) -> Rig:
    """A rig with the sample preloaded and the drive just set for the load, as if nothing limited it."""
    rig = Rig(scene, VirtualClock())
    sample = get_sample(question.sample)
    rig.mount(sample)
    touching = scene.rig.sensor_position - sample.thickness
    stiffness = response(scene.design, Load(1.0, sample), scene.model).stiffness
    rig.set_position(touching + PRELOAD * question.load * (1 / stiffness + 1 / scene.rig.suspension_stiffness))
    volts = question.load / 2 / abs(rig.transfer(question.frequency)[-1])
    frequency = round(question.frequency * HERTZ)
    rig.set_voltage(Periodic(0.0, frequency, 0, 0, np.array([1]), np.array([-1j * volts])))
    return rig


def case_of(
    design: Design, model: str, effects: Mapping[str, Effect], question: Question, rig: RigParameters = THESIS_RIG
) -> Case:
    """The question as the bounds of the effects want it."""
    file = SceneFile(name="case", purpose="bounds", design=design.name, model=model, rig=rig)
    bare = Scene("case", "bounds", design, model, None, "", 1, 1, rig, {}, {}, file)
    load = Load(question.load, get_sample(question.sample))
    return Case(
        design=design,
        frequency=question.frequency,
        amplitude=question.load / 2,
        preload=PRELOAD * question.load,
        ratio=response(design, load, model).force_ratio,
        dwell=question.dwell,
        rate=RATE,
        settled=SETTLING,
        effects=effects,
        driven=lambda chosen: driven(replace(bare, effects=chosen), question),
    )


def needed(
    effect: Effect, design: Design, model: str, effects: Mapping[str, Effect], tolerance: float, rig: RigParameters
) -> Bound | None:
    """The largest bound of an effect for the thesis' samples and loads if it exceeds the tolerance, else None."""
    bounds = [
        effect.bound(case_of(design, model, effects, Question(sample, load), rig))
        for sample in SAMPLES
        for load in THESIS_LOADS
    ]
    largest = Bound(max(bound.force for bound in bounds), max(bound.ratio for bound in bounds))
    return largest if max(largest.force, largest.ratio) > tolerance else None


def _path(found: list[tuple[Touch, Touch]]) -> tuple[str, str]:
    if not found:
        return "closed form", "every limit carries a certificate that it stays inactive"
    moved = {
        item.name
        for before, after in found
        for item in fields(Touch)
        if getattr(before, item.name) != getattr(after, item.name)
    }
    return "transitions", ", ".join(sorted(_NAMES[name] for name in moved))


_NAMES = {
    "contact": "the probe loses contact",
    "rail": "the amplifier clips",
    "current": "the current limit acts",
    "stop": "the armature meets a stop",
    "drag": "play operators move",
}


def _omitted(scene: Scene, case: Case) -> list[Omitted]:
    left = []
    for name in EFFECTS:
        if name in scene.effects:
            continue
        effect = effect_class(name)()
        bound = Bound(0.0, 0.0) if set(effect.excludes) & set(scene.effects) else effect.bound(case)
        left.append(Omitted(name, effect.kind, _finite(bound.force), _finite(bound.ratio)))
    return left


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _warnings(scene: Scene, case: Case) -> list[str]:
    """A rigid film that gives hardly a step of its converter, without noise to dither it, cannot be averaged."""
    rigid = next(film for film in scene.design.films if film.kind == "rigid")
    amplitude = rigid.sensitivity * case.ratio * case.amplitude
    step = 2 * max(RANGE_VOLTS) / 2**16
    density = getattr(scene.effects.get("white_noise"), "density", 0.0)
    noise = density * math.sqrt(case.rate / 2)
    if amplitude < SIGNAL_STEPS * step and noise < NOISE_STEPS * step:
        return [
            f"film {rigid.name!r}: amplitude {amplitude:.3g} V is {amplitude / step:.2g} steps of the converter, below"
            f" {SIGNAL_STEPS:g}, and noise of {noise:.2g} V is below half a step: steps do not average out; take a"
            " smaller range, a larger load, or noise"
        ]
    return []
