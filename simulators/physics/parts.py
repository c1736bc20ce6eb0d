"""Parts of the chain, as set by the effects: shaker, stack, play operators; and the limits that are met."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.simulators.linear.lti import StateSpace, gain


@dataclass(frozen=True)
class Touch:
    """The limits of the chain that are reached: -1 the lower one, 0 none, 1 the upper one.

    `contact` tells whether probe and sample touch over the tooth and over the ring. `drag` tells of each play operator:
    -1 dragged down, 0 at rest, 1 dragged up.
    """

    contact: tuple[bool, bool] = (True, True)
    rail: int = 0
    current: int = 0
    stop: int = 0
    drag: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of drive and armature; None: there is none.

    Attributes:
        rail: greatest voltage of the amplifier [V].
        current: greatest current in the coil [A].
        stop: greatest displacement of the armature [m].
    """

    rail: float | None = None
    current: float | None = None
    stop: float | None = None
    stop_stiffness: float = 1e6


@dataclass(frozen=True, eq=False)
class Armature:
    """The shaker: force constant [N/A], resistance [ohm], suspension [N/m]; with inertia where `mass` is given.

    inductance [H], mass [kg], damping [N s/m].
    """

    force_constant: float
    resistance: float
    suspension: float
    inductance: float = 0.0
    mass: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True, eq=False)
class SpringStack:
    """Sample and sensor as springs: the tooth's branch is the object alone, the ring's is object and ring in series.

    tooth, ring: stiffness of the branches [N/m], each summed over the teeth. object_share: the part of the ring
    branch's compliance that is the object's.
    """

    tooth: float
    ring: float
    object_share: float

    def elastic(self) -> StateSpace:
        """System from the compressions over tooth and ring [m] to the forces on them [N]."""
        return gain(np.diag([self.tooth, self.ring]))


@dataclass(frozen=True, eq=False)
class Plays:
    """Play operators z on a force x: z stays until x is farther than a radius away, and then is dragged.

    Attributes:
        ring: whether x is the force on tooth and ring, not on the tooth alone.
        radii: radii [N].
        weights: weights of h = sum of weights times z.

    """

    ring: bool
    radii: tuple[float, ...]
    weights: tuple[float, ...]
