"""Builds the physical chain (coil, shaker, sample, sensor, load cell) of a scene: the bench, changed by each effect."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from palpate.instrument.errors import RangeError
from palpate.instrument.models.influence import tooth_shares
from palpate.instrument.models.table import Response
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.linear.lti import StateSpace, gain
from palpate.simulators.physics.chain import MeasuringChain
from palpate.simulators.physics.in_order import Effects
from palpate.simulators.physics.parts import Armature, Limits, Plays, SpringStack
from palpate.simulators.randomness import Stream
from palpate.simulators.scenes.scene import Scene

# -------------------------------------------------------------------------------------------------------
# What lies between the probe and the load cell: its stiffness, and the part of the force that each film takes

SUPPORT_STIFFNESS = 1e6  # N/m, rigid support with the load cell below it [A]
PIN_STIFFNESS = 1e3  # N/m, rubber tip of the pin that presses one tooth [A]


@dataclass(frozen=True)
class Mounted:
    """What lies under the probe: a sample on the sensor or on a rigid support, a pin on one tooth, or nothing.

    Attributes:
        design: the sensor design.
        sample: the sample; None: there is none.
        response: force ratio and stiffness of the sensor under the sample; None without a sample on the sensor.
        on_support: True: a rigid support takes the sensor's place.
        tooth: index of the tooth on which the pin stands; None: no pin.
        probe_at: x and y of a point probe from the sensor's corner [m]; None: the probe covers the whole sample.
    """

    design: Design
    sample: Sample | None = None
    response: Response | None = None
    on_support: bool = False
    tooth: int | None = None
    probe_at: tuple[float, float] | None = None

    @property
    def thickness(self) -> float:
        """Thickness of the sample; 0 without one [m]."""
        return self.sample.thickness if self.sample else 0.0

    def probed(self, x: float, y: float) -> Mounted:
        """The same sample with a point probe above (x, y) [m].

        Raises RangeError: no sample lies on the sensor, or no model gives the teeth's shares of the force there.
        """
        if self.sample is None or self.on_support:
            raise RangeError("no sample lies on the sensor: mount one before the point probe is placed")
        tooth_shares(self.design, self.sample, (x, y))
        return replace(self, probe_at=(x, y))

    def springs(self) -> SpringStack:
        """The stack of sample and sensor as two parallel springs, one to the teeth and one to the ring.

        The scene's sensor model gives the total stiffness and the teeth's share of the force; the column model gives
        the sample's part of the compression. On the rigid support the sample is in the ring's branch, because no film
        lies below either of them.
        """
        if self.on_support:
            pad = self.sample
            compliance = 0.0 if pad is None else pad.thickness / (pad.modulus * pad.area)
            whole = compliance + 1 / SUPPORT_STIFFNESS
            return SpringStack(0.0, 1 / whole, object_share=compliance / whole)
        if self.tooth is not None:
            return SpringStack(PIN_STIFFNESS, 0.0, object_share=1.0)
        if self.response is None or self.sample is None:
            return SpringStack(0.0, 0.0, 0.0)
        ring = self.design.ring
        hardness = self.sample.modulus * ring.height / (ring.material.modulus * self.sample.thickness)
        ratio, stiffness = self.response.force_ratio, self.response.stiffness
        return SpringStack(ratio * stiffness, (1 - ratio) * stiffness, object_share=1 / (1 + hardness))

    def part(self, film: Film) -> float:
        """Fraction of the force on all teeth that the teeth of a film take; under a point probe, of the whole force."""
        if self.on_support:
            return 0.0
        if self.tooth is not None:
            return float(self.tooth in film.teeth)
        if self.probe_at is not None and self.sample is not None and film.kind != "total":
            return tooth_shares(self.design, self.sample, self.probe_at)[film.teeth[0]]
        return len(film.teeth) / len(self.design.teeth)


# --- the chain of a scene ------------------------------------------------------------------------------


def chain_of(
    scene: Scene,
    effects: Effects,
    mounted: Mounted,
    signals: StateSpace,
    leakage: float,
    position: float,
    bridge_tau: float,
    weight: float,
) -> MeasuringChain:
    """The chain of a scene with its present settings.

    Args:
        scene: the scene.
        effects: the scene's effects.
        mounted: what lies under the probe.
        signals: the films' voltages before their amplifiers, as `film_signals` returns them.
        leakage: conductance across a film [S].
        position: position of the positioner [m].
        bridge_tau: time constant of the indicator's filter [s].
        weight: dead weight on the load cell [N].
    """
    rig = scene.rig
    armature, limits = Armature(rig.force_constant, rig.coil_resistance, rig.suspension_stiffness), Limits()
    for effect in effects.shaker:
        armature, limits = effect.shaker(armature, limits)
    stack = mounted.springs()
    yielding = effects.stack.stack(stack) if effects.stack else stack.elastic()
    plays = effects.plays.plays() if effects.plays else Plays(ring=False, radii=(), weights=())
    films, amplifier = scene.design.films, effects.amplifier
    amplifiers, offsets = [gain(np.eye(1)) for _ in films], np.zeros(len(films))
    if amplifier is not None:
        amplifiers = [amplifier.system(film, scene.design, leakage) for film in films]
        offsets = np.array([amplifier.offset(film, scene.design, leakage) for film in films])
    return MeasuringChain(
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
    design: Design,
    effects: Effects,
    mounted: Mounted,
    streams: Mapping[str, Stream],
    set_at_ns: int,
    mounted_at_ns: int,
    ambient: float,
) -> StateSpace:
    """The system that turns forces into the films' voltages before their amplifiers.

    Its four inputs are the force on the teeth, on the ring and on the play operators [N], and the constant 1; its
    outputs, one for each film, are voltages [V].

    Args:
        design: the sensor design, which lists the films.
        effects: the scene's effects.
        mounted: what lies under the probe.
        streams: a random stream for each effect on the films, by the effect's name.
        set_at_ns: clock time at which the drive was last set [ns].
        mounted_at_ns: clock time at which what lies under the probe was last changed [ns].
        ambient: warming of the surroundings since the bench was opened [K].
    """
    shares = np.zeros((len(design.films), 4))
    for number, film in enumerate(design.films):
        part = mounted.part(film)
        played = part if effects.plays is not None and film.kind == effects.plays.path else 0.0
        both = film.kind == "total" or mounted.probe_at is not None
        shares[number] = (part, part if both else 0.0, played, 0.0)
    matrix = np.diag([film.sensitivity for film in design.films])
    for effect in effects.films:
        drawn_at_ns = mounted_at_ns if effect.by_mounting else set_at_ns
        matrix = effect.matrix(design, streams[effect.name], drawn_at_ns) @ matrix
    signals = gain(matrix @ shares)
    for source in effects.source:
        signals = signals.plus(source.source(design, ambient))
    return signals


def response_of(
    scene: Scene, effects: Effects, sample: Sample, streams: Mapping[str, Stream], mounted_at_ns: int
) -> Response:
    """Response of the sensor to a sample: by the scene's model, and changed by effects.

    Args:
        scene: the scene.
        effects: the scene's effects.
        sample: the sample.
        streams: a random stream for each effect that changes the share of the teeth, by the effect's name.
        mounted_at_ns: clock time at which the sample is mounted [ns].

    Raises RangeError: the model does not answer for it, or by effects the teeth take more than the force.
    """
    response = scene.answer(sample)
    changes = [effect.ln_change(sample, streams[effect.name], mounted_at_ns) for effect in effects.share]
    ratio = response.force_ratio * math.exp(math.fsum(changes))
    if changes and not ratio < 1:
        names = ", ".join(effect.name for effect in effects.share)
        raise RangeError(
            f"sample {sample.name!r} has a force ratio of {ratio:.3g} by {names}, which is not below 1: the teeth "
            f"cannot take more than the whole force; give these effects smaller parameters"
        )
    return replace(response, force_ratio=ratio, force_rigid=ratio * response.force_total)
