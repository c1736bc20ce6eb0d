"""The chain of a scene, put together of what its effects make of the bench as it stands."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from palpate.simulators.effects.effect import (
    AmplifierEffect,
    FilmsEffect,
    HysteresisEffect,
    ShakerEffect,
    SourceEffect,
    StackEffect,
)
from palpate.simulators.linear.lti import StateSpace, gain
from palpate.simulators.physics.chain import Chain
from palpate.simulators.physics.parts import Armature, Limits, Plays
from palpate.simulators.randomness import Stream
from palpate.simulators.rig.mounted import Mounted
from palpate.simulators.scenes.scene import Scene


def chain_of(
    scene: Scene,
    mounted: Mounted,
    signals: StateSpace,
    leakage: float,
    position: float,
    bridge_tau: float,
    weight: float,
) -> Chain:
    """The chain, from the films' `signals` before their amplifiers.

    leakage: conductance across a film [S]. position: of the positioner [m]. bridge_tau: time constant of the
    indicator's filter [s]. weight: dead weight on the load cell [N].
    """
    rig, effects = scene.rig, scene.effects.values()
    armature, limits = Armature(rig.force_constant, rig.coil_resistance, rig.suspension_stiffness), Limits()
    stack = mounted.springs()
    yielding = stack.elastic()
    plays = Plays(ring=False, radii=(), weights=())
    for effect in effects:
        if isinstance(effect, ShakerEffect):
            armature, limits = effect.shaker(armature, limits)
        if isinstance(effect, StackEffect):
            yielding = effect.stack(stack)
        if isinstance(effect, HysteresisEffect):
            plays = effect.plays()
    films, amplifier = scene.design.films, next((e for e in effects if isinstance(e, AmplifierEffect)), None)
    amplifiers, offsets = [gain(np.eye(1)) for _ in films], np.zeros(len(films))
    if amplifier is not None:
        amplifiers = [amplifier.system(film, scene.design, leakage) for film in films]
        offsets = np.array([amplifier.offset(film, scene.design, leakage) for film in films])
    return Chain(
        armature,
        limits,
        yielding,
        advance=position - (rig.sensor_position - mounted.thickness),
        plays=plays,
        before=signals,
        amplifiers=amplifiers,
        offsets=offsets,
        bridge_tau=bridge_tau,
        weight=weight,
    )


def film_signals(
    scene: Scene, mounted: Mounted, streams: Mapping[str, Stream], set_at_ns: int, ambient: float
) -> StateSpace:
    """From tooth force, ring force, the plays' force and 1 to the films' voltages before their amplifiers."""
    hysteresis = next((e for e in scene.effects.values() if isinstance(e, HysteresisEffect)), None)
    shares = np.zeros((len(scene.design.films), 4))
    for number, film in enumerate(scene.design.films):
        part = mounted.part(film)
        played = part if hysteresis is not None and film.kind == hysteresis.path else 0.0
        both = film.kind == "total" or mounted.probe_at is not None
        shares[number] = (part, part if both else 0.0, played, 0.0)
    matrix = np.diag([film.sensitivity for film in scene.design.films])
    for name, effect in scene.effects.items():
        if isinstance(effect, FilmsEffect):
            matrix = effect.matrix(scene.design, streams[name], set_at_ns) @ matrix
    signals = gain(matrix @ shares)
    for effect in scene.effects.values():
        if isinstance(effect, SourceEffect):
            signals = signals.plus(effect.source(scene.design, ambient))
    return signals
