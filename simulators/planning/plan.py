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
import numpy.typing as npt

from palpate.instrument.additions import taken
from palpate.instrument.arrays import Complexes, Floats, Times
from palpate.instrument.contracts.own import FULL_SCALE_COUNTS, HEADROOM, RANGE_VOLTS
from palpate.instrument.errors import ConfigError, RangeError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import Sample, check_force, get_sample
from palpate.instrument.signals.dwell import LONGEST
from palpate.simulators.bounds import bound_of
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects import EFFECTS, GROUP, WHAT, effect_class, effect_names, origin
from palpate.simulators.linear.periodic import HERTZ, SECOND, Periodic
from palpate.simulators.physics.chain import Touch
from palpate.simulators.physics.dwells import SimulatedDwell, dwell_of
from palpate.simulators.physics.effect import Bound, Case, Effect, rival
from palpate.simulators.rig import FilmInputs, Rig
from palpate.simulators.scenes.scene import RigParameters, Scene, SceneFile

# -------------------------------------------------------------------------------------------------------
# What the sensor nodes of a scene sample, without a bench, each film in the range that a run would set

FINEST, WIDEST = min(RANGE_VOLTS), max(RANGE_VOLTS)  # V


def sampled(scene: Scene, rig: Rig, time_ns: Times, period_ns: int) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Samples of each film [V], and whether they are saturated.

    A film has the finest range if that holds what load and amplifiers give, with `HEADROOM`. If noise or hum clip it
    there, it is sampled in the widest range, as a run repeats its point.
    """
    volts = rig.film_voltages(time_ns)
    samples, saturated = np.empty(volts.shape), np.empty(volts.shape, bool)
    for number in range(1, scene.nodes + 1):
        inputs = FilmInputs(rig, number, number)
        wired = ((i, inputs.wired(film)) for i, film in enumerate(scene.design.films))
        films = {i: channel - 1 for i, channel in wired if channel is not None}
        ranges = inputs.channels * [WIDEST]
        for i, channel in films.items():
            if HEADROOM * np.abs(volts[i]).max() <= FINEST:
                ranges[channel] = FINEST
        at_inputs = inputs.film_channels @ volts
        counts, bits = inputs.converted(time_ns, at_inputs, period_ns, ranges)
        clipped = [channel for channel in films.values() if (bits >> channel & 1).any()]
        if any(ranges[channel] != WIDEST for channel in clipped):
            for channel in clipped:
                ranges[channel] = WIDEST
            again = FilmInputs(rig, number, number)  # whose random numbers begin anew
            counts, bits = again.converted(time_ns, at_inputs, period_ns, ranges)
        for i, channel in films.items():
            samples[i] = counts[:, channel] * (ranges[channel] / FULL_SCALE_COUNTS)
            saturated[i] = bits >> channel & 1
    return samples, saturated


# -------------------------------------------------------------------------------------------------------
# Settled state of a scene under a sine: phasors of its films and of its force, without following the motion
#
# Linear parts give them at once. A play operator outside any loop, under a sine of its force, gives a known
# fundamental: its describing function times the force. Plays act on the films alone, so they are never in a loop.

POINTS = 4096  # samples in a period of a scene that is followed
SETTLED = 10.0  # s after the drive was set, for such a scene


@dataclass(frozen=True, slots=True)
class FilmState:
    """Fundamental of one film.

    Attributes:
        amplitude: amplitude [V].
        phase: phase against the force on the load cell [rad].
        ratio: force ratio of a film under teeth to the film under their base; None: it is no such film.
    """

    film: str
    amplitude: float
    phase: float
    ratio: float | None


@dataclass(frozen=True, slots=True)
class SteadyState:
    """Fundamentals of a settled scene; `force` on the load cell, peak to peak [N]."""

    force: float
    films: tuple[FilmState, ...]


def describing_function(radius: float, amplitude: float) -> complex:
    """Fundamental of a play operator over the sine that moves it; 0 where the sine is too small to move it.

    Gelb and Vander Velde, Multiple-input describing functions (1968): backlash.
    """
    if amplitude <= radius:
        return 0j
    m = 1 - 2 * radius / amplitude
    root = math.sqrt(max(1 - m * m, 0.0))
    return complex(math.pi / 2 + math.asin(m) + m * root, -root * root) / math.pi


def phasors(rig: Rig) -> Complexes:
    """Phasors (films + 1,) of the films' voltages [V] and the force on the load cell [N], where no limit acts."""
    system, plays = rig.without_limits()
    voltage = rig.coil_voltage()
    rate = 2j * math.pi * voltage.frequency / HERTZ
    volts = voltage.amplitude[0]
    a, push = system.a.astype(complex), (system.b[:, 0] + rate * system.b[:, 2]) * volts
    if plays:
        # So far each play follows its force, as if it had no radius.
        force = np.linalg.solve(rate * np.eye(system.order) - a, push)[plays]
        radii = rig.effects.plays.plays().radii if rig.effects.plays else ()
        factors = np.array([describing_function(r, abs(x)) for r, x in zip(radii, force, strict=True)])
        a[plays] *= factors[:, np.newaxis]
        push[plays] *= factors
    state = np.linalg.solve(rate * np.eye(system.order) - a, push)
    return np.asarray(system.c @ state + (system.d[:, 0] + rate * system.d[:, 2]) * volts)


def followed(rig: Rig) -> Complexes:
    """Phasors (films + 1,) where limits act, by a Fourier sum over a period that is followed by its transitions."""
    voltage = rig.coil_voltage()
    period = SECOND * HERTZ / voltage.frequency
    times = round(SETTLED * SECOND) + np.round(period * np.arange(POINTS) / POINTS).astype(np.int64)
    seen = np.vstack([rig.film_voltages(times), rig.cell_force(times)])
    turns = np.exp(-2j * math.pi * 1e-18 * voltage.phase(times))
    return np.asarray(2 * (seen * turns).mean(axis=1))


def steady_state(rig: Rig, values: Complexes) -> SteadyState:
    """The settled state from phasors of films and force."""
    films, force = rig.scene.design.films, values[-1]
    # If a film lies under several teeth, this is the ratio of one tooth.
    shares = [abs(v) / film.sensitivity / len(film.teeth) for v, film in zip(values[:-1], films, strict=True)]
    tooth, base = FILM_KINDS
    states = []
    for film, value, share in zip(films, values[:-1], shares, strict=True):
        under = (s for s, f in zip(shares, films, strict=True) if f.kind == base and set(film.teeth) <= set(f.teeth))
        below = next(under, 0.0) if film.kind == tooth else 0.0
        ratio = float(share / below) if below else None
        states.append(FilmState(film.name, float(abs(value)), float(np.angle(value / force)), ratio))
    return SteadyState(float(2 * abs(force)), tuple(states))


# --- What will impair a measurement of a scene: films that a converter cuts off, or hardly sees --------

FILMS_SETTLED, FILMS_LOOKED_AT = 2.0, 1.0  # s after the drive was set when films are looked at, and how long
SIGNAL_STEPS, NOISE_STEPS = 20.0, 0.5


def impairments(scene: Scene, rig: Rig, pressed: Sample, load: float, rate: float) -> list[str]:
    """A line for each film that exceeds its converter's widest range, and one for a rigid film of hardly a step.

    Args:
        scene: the scene.
        rig: its rig, driven with the load.
        pressed: the sample.
        load: the load, peak to peak [N].
        rate: samples per second.
    """
    period_ns = round(1e9 / rate)
    time_ns = period_ns * np.arange(round(FILMS_SETTLED * rate), round((FILMS_SETTLED + FILMS_LOOKED_AT) * rate))
    _, saturated = sampled(scene, rig, time_ns, period_ns)
    return [*_clipped(scene.design, saturated), *_in_steps(scene, pressed, load, rate)]


def _clipped(design: Design, saturated: npt.NDArray[np.bool_]) -> list[str]:
    return [
        f"film {film.name!r}: its voltage exceeds the widest range of the converter, {max(RANGE_VOLTS):g} V: points"
        " are clipped and not used; take a smaller load, or weaker effects"
        for film, clipped in zip(design.films, saturated, strict=True)
        if clipped.any()
    ]


def _in_steps(scene: Scene, pressed: Sample, load: float, rate: float) -> list[str]:
    """A rigid film of few of a converter's steps, without noise to dither it, cannot be averaged."""
    rigid = next(film for film in scene.design.films if film.kind == "rigid")
    amplitude = rigid.sensitivity * scene.answer(pressed).force_ratio * load / 2
    fits = HEADROOM * amplitude <= min(RANGE_VOLTS)
    step = 2 * (min if fits else max)(RANGE_VOLTS) / 2**16
    noise = math.hypot(*(effect.dither(rate) for effect in scene.effects.values()))
    if amplitude < SIGNAL_STEPS * step and noise < NOISE_STEPS * step:
        return [
            f"film {rigid.name!r}: amplitude {show(amplitude, 'V', 3)} is {amplitude / step:.2g} steps of the"
            f" converter, below {SIGNAL_STEPS:g}, and noise of {show(noise, 'V', 2)} is below half a step: steps do not"
            " average out; take a larger load, or noise"
        ]
    return []


# --- the plan ------------------------------------------------------------------------------------------

PRELOAD = 0.75  # preload as a fraction of the load: half of the load is its peak, the rest keeps contact
SETTLING = 2.0  # s between a change of the drive and a measurement
LOOKED_AT = 2.0  # s of a scene that are searched for transitions
RATE = 250.0  # samples per second
THESIS_RIG = RigParameters()
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
    """A simulated effect, and why it is."""

    name: str
    kind: str
    cancels_in_ratio: bool
    why: str


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
        warnings: what will impair the measurement.
        steady: the settled state, where it was asked for.
    """

    path: str
    why: str
    transitions: float
    included: tuple[Included, ...]
    omitted: tuple[Omitted, ...]
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
    case = case_of(scene.design, scene.model, scene.effects, question, scene.rig, scene.file.parameters)
    omitted, problems = omissions(scene, case)
    return AnswerPlan(
        path=path,
        why=why,
        transitions=len(found) / LOOKED_AT,
        included=tuple(
            Included(name, effect.kind, effect.cancels_in_ratio, scene.called[name])
            for name, effect in scene.effects.items()
        ),
        omitted=tuple(omitted),
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


def omissions(scene: Scene, case: Case) -> tuple[list[Omitted], list[str]]:
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
