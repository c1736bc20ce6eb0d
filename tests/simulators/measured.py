"""What a scene's films measure, without devices: the samples of a dwell, and forces and ratios from them."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.contracts.own import RANGE_VOLTS
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.signals.estimate import amplitudes
from palpate.simulators.bounds import bound_of
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.effects import EFFECTS
from palpate.simulators.effects.adc import Adc
from palpate.simulators.linear.periodic import CYCLE, HERTZ, Periodic
from palpate.simulators.physics.effect import Bound, Effect, InputEffect
from palpate.simulators.planning.plan import RATE, SETTLING, Question, case_of, driven
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.randomness import Stream
from palpate.simulators.rig import Rig
from palpate.simulators.scenes.scene import Scene

PERIOD_NS = round(1e9 / RATE)
GOLDEN = (math.sqrt(5) - 1) / 2
Key = frozenset[tuple[str, Effect]]
Signals = tuple[Floats, Floats]  # voltages and rates (films, n) [V, V/s]


def sample_times(question: Question) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Of the dwell [ns]."""
    return np.asarray((round(SETTLING * RATE) + np.arange(round(question.dwell * RATE))) * PERIOD_NS, np.int64)


def volts(scene: Scene, question: Question) -> Floats:
    """Voltages that a node of unlimited resolution would sample, or its converter gives, (films, n)."""
    return _sampled(scene, question, *followed(scene, question, 0.0))


@functools.lru_cache(maxsize=32)
def _stream(seed: int, name: str, number: int) -> Stream:
    """Of an effect on a film; kept, since a scene with an effect and without it draws the same numbers."""
    return Stream(seed, name, 1, number, PERIOD_NS)


def _sampled(scene: Scene, question: Question, signals: Floats, rates: Floats) -> Floats:
    times = sample_times(question)
    added = np.zeros_like(signals)
    for name, effect in scene.effects.items():
        if isinstance(effect, InputEffect):
            for number in range(len(signals)):
                stream = _stream(scene.seed, name, 0 if effect.common else number)
                added[number] += effect.volts(stream, times, PERIOD_NS, lambda n=number: rates[n])
    converter = scene.effects.get("adc")
    if isinstance(converter, Adc):
        return converter.convert((signals + added) / max(RANGE_VOLTS))[0] * max(RANGE_VOLTS)
    return signals + added


def followed(scene: Scene, question: Question, phase: float) -> Signals:
    """Voltages and rates at the amplifiers' outputs, on a clock that goes on where a leak grows.

    phase: of the drive as it begins, in cycles.
    """
    clock = VirtualClock()
    rig = driven(scene, question, clock)
    if rig.next_event_ns() == NEVER:
        return _followed(rig, question, phase)
    _begin(rig, question, phase)
    clock.add(rig)
    times, parts = sample_times(question), []
    while len(times):
        clock.wait(1e-9 * (int(times[0]) - clock.now_ns()))
        count = max(1, int(np.searchsorted(times, rig.next_event_ns())))
        parts.append((rig.film_voltages(times[:count]), rig.film_rates(times[:count])))
        times = times[count:]
    voltages, rates = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
    return voltages, rates


def _followed(rig: Rig, question: Question, phase: float) -> Signals:
    _begin(rig, question, phase)
    times = sample_times(question)
    return rig.film_voltages(times), rig.film_rates(times)


def _begin(rig: Rig, question: Question, phase: float) -> None:
    """The drive that has just been set, in another phase."""
    size, start = abs(rig.coil_voltage().amplitude[0]), round(phase * CYCLE) % CYCLE
    rig.set_voltage(Periodic(0.0, round(question.frequency * HERTZ), 0, start, np.array([1]), np.array([-1j * size])))


def forces_and_ratios(scene: Scene, question: Question, samples: Floats) -> tuple[Floats, Floats]:
    """Forces of the films under a base [N], and the force ratios of each tooth's film to that under its base."""
    found = amplitudes(np.arange(samples.shape[1]) / RATE, samples, question.frequency)
    forces = found / [film.sensitivity for film in scene.design.films]
    teeth, bases = np.array(pairs(scene.design)).T
    with np.errstate(divide="ignore", invalid="ignore"):  # a coarse converter may see nothing at all
        return forces[np.unique(bases)], forces[teeth] / forces[bases]


def pairs(design: Design) -> list[tuple[int, int]]:
    """Numbers of the films under teeth, each with that of the film under its base."""
    tooth, base = ([i for i, film in enumerate(design.films) if film.kind == kind] for kind in FILM_KINDS)
    films = design.films
    return [(i, j) for i in tooth for j in base if set(films[i].teeth) <= set(films[j].teeth)]


def force_and_ratio(scene: Scene, question: Question) -> tuple[float, float]:
    """Amplitude of the first base's force [N], and the first force ratio, by least squares."""
    forces, ratios = forces_and_ratios(scene, question, volts(scene, question))
    return float(forces[0]), float(ratios[0])


def changes(
    without: Scene, with_it: Scene, question: Question, phases: int = 1, seeds: int = 1
) -> list[tuple[float, float]]:
    """What an effect really changes in force and ratio, relatively and at most of all films, in each draw.

    Draws differ in the drive's phase, with it the films' scatter, and in the seed of noise; the first is the scene as
    it is asked for.
    """
    found: list[tuple[float, float]] = []
    rigs: dict[Key, Rig] = {}
    for draw in range(phases * seeds):
        if draw % seeds == 0:
            known: dict[Key, Signals] = {}  # of scenes that differ in noise and steps alone
        phase = draw // seeds * GOLDEN % 1
        results = []
        for scene in (replace(each, seed=(each.seed + draw) % 2**31) for each in (without, with_it)):
            kept = {name: e for name, e in scene.effects.items() if not isinstance(e, InputEffect | Adc)}
            key = frozenset(kept.items())
            if key not in known:
                known[key] = _again(replace(scene, effects=kept), question, phase, rigs)
            results.append(forces_and_ratios(scene, question, _sampled(scene, question, *known[key])))
        (force, ratio), (other_force, other_ratio) = results
        if force.all() and ratio.all() and np.isfinite([*ratio, *other_ratio]).all():
            found.append((float(abs(other_force / force - 1).max()), float(abs(other_ratio / ratio - 1).max())))
    return found


def _again(scene: Scene, question: Question, phase: float, rigs: dict[Key, Rig]) -> Signals:
    """In another phase, by the same rig where neither a leak nor a play has moved on, and where no seed matters."""
    if {"humidity_leak", "gain_scatter", "hysteresis", "curve_error", "mounting_scatter"} & set(scene.effects):
        return followed(scene, question, phase)
    key = frozenset(scene.effects.items())
    if key not in rigs:
        rigs[key] = driven(scene, question)
    return _followed(rigs[key], question, phase)


THESIS = read_scene("thesis_single")


def beside(others: dict[str, Effect], name: str, effect: Effect, seed: int = 1) -> tuple[Scene, Scene]:
    without = replace(THESIS, effects={each: others[each] for each in EFFECTS if each in others}, seed=seed)
    both = {**without.effects, name: effect}
    return without, replace(without, effects={each: both[each] for each in EFFECTS if each in both})


def bounded(name: str, without: Scene, with_it: Scene, question: Question) -> Bound:
    return bound_of(case_of(without.design, without.model, without.effects, question), with_it.effects[name])
