"""The parts of the chain as the effects leave them: shaker, stack, play operators; and which limits are met."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.simulators.linear.lti import StateSpace, gain


@dataclass(frozen=True)
class Touch:
    """Which of the chain's limits are met: -1 below, 0 not, 1 above.

    contact: of probe and sample, over the tooth and over the ring.
    drag: of each play operator: -1 dragged down, 0 at rest, 1 dragged up.
    """

    contact: tuple[bool, bool] = (True, True)
    rail: int = 0
    current: int = 0
    stop: int = 0
    drag: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Limits:
    """Where the drive and the armature end; None: nowhere.

    rail: of the amplifier [V]. current: in the coil [A]. stop: displacement of the armature [m].
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
class Stack:
    """Sample and sensor as springs: the tooth's branch is the object alone, the ring's is object and ring in series.

    tooth, ring: stiffness of the branches [N/m], each summed over the teeth. object_share: the part of the ring
    branch's compliance that is the object's.
    """

    tooth: float
    ring: float
    object_share: float

    def elastic(self) -> StateSpace:
        """From the compressions over tooth and ring [m] to the forces on them [N]."""
        return gain(np.diag([self.tooth, self.ring]))


@dataclass(frozen=True, eq=False)
class Plays:
    """Play operators z on a force x: z stays where it is until x is further than a radius away, and is dragged then.

    ring: whether x holds the ring's force beside the tooth's. radii [N]. weights: h = sum of weights times z.
    """

    ring: bool
    radii: tuple[float, ...]
    weights: tuple[float, ...]
